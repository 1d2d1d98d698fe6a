"""Logs that cannot be read: name -> (bytes, the message behind "launchid: PATH: "); logs of absurd values, which are.

The latter, and the last rows of the former, were found by mutation (`mutated.py`).
"""

import gzip
import math
import zipfile
from io import BytesIO

HEAD = b"t,theta,beta\n"
ROWS = b"".join(b"%.2f,%.3f,%.3f\n" % (k / 100, math.sin(k / 9), math.cos(k / 5)) for k in range(200))
GOOD = HEAD + ROWS
MARKED = GOOD.replace(b"\n1.00,", b"\n@,", 1)   # line 102 begins with what takes the place of @


def at_line_102(cell: bytes) -> bytes:
    return MARKED.replace(b"@", cell)


def cell(text: bytes) -> bytes:
    """A log whose theta in line 3 is this."""
    return HEAD + b"0,1,2\n0.01," + text + b",2\n" + b"0.02,1,2\n"


def no_number(shown: str, line: int = 3, column: str = "theta") -> str:
    return f"line {line}, column {column}: {shown} is no number; expected one such as -0.0123, or an empty cell"


NEAR = " is near it: rename it, or name it in a map (--map)"


def header(found: str) -> str:
    return f"line 1: column '{found}; expected a header with t, theta, beta"


def zipped() -> bytes:
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("log.csv", GOOD)
    return file.getvalue()


CSV = "; expected a UTF-8 CSV file"
TEXT = GOOD.decode()
NO_ROW = "no usable row; expected rows with finite t, theta, beta"
NO_STEP = "column t: no two increasing time stamps, so there is no sample period"
NO_QUOTE = "a quote is opened and not closed; expected a closing quote, or none"
CUT = "; the file ends there: cut short, or still being written"

MALFORMED: dict[str, tuple[bytes, str]] = {
    # ---- what is no CSV text
    "empty": (b"", "empty file; expected a header with t, theta, beta"),
    "a byte order mark alone": (b"\xef\xbb\xbf", "empty file; expected a header with t, theta, beta"),
    "blank lines alone": (b"\n\r\n\n", "empty file; expected a header with t, theta, beta"),
    "UTF-16 with a mark": (TEXT.encode("utf-16"), "this is UTF-16 text; save it as UTF-8" + CSV),
    "Latin-1": (cell(b"1\xb0"), "line 3: the byte 0xb0 is not UTF-8" + CSV),
    "NUL throughout": (bytes(300), "line 1: a NUL character, as UTF-16 and binary files have" + CSV),
    "NUL in a cell": (cell(b"1\x00"), no_number(r"'1\x00'")),
    "NUL at the end, of a file that was not closed": (
        GOOD + bytes(512), "line 202: NUL characters; expected a sample (a file that was not closed may end so)"),
    "gzip": (gzip.compress(GOOD, mtime=0), "this is a gzip archive; unpack it first" + CSV),
    "zip": (zipped(), "this is a zip archive, as a spreadsheet is; unpack it, or save the sheet as CSV" + CSV),
    "JSON": (b'{"t": [0, 1], "theta": [0, 1]}\n', header("""t' is missing (found '{"t": [0,1],"theta": [0,1]}')""")),
    # ---- the header
    "header only": (HEAD, NO_ROW),
    "a comment first": (b"# a log\n" + GOOD, header("t' is missing (found '# a log')")),
    "no header": (ROWS, header("t' is missing (found '0.00,0.000,1.000')")),
    "semicolons": (GOOD.replace(b",", b";"),
                   "line 1: semicolons where commas should be (found 't;theta;beta'); a map (--map) reads them; "
                   "expected a header with t, theta, beta"),
    "tabs": (GOOD.replace(b",", b"\t"),
             "line 1: tabs where commas should be (found 't\\ttheta\\tbeta'); a map (--map) reads them; "
                                        "expected a header with t, theta, beta"),
    "no t": (b"theta,beta\n0,1\n",
             header("t' is missing (found 'theta,beta'); a map (--map) can give a period in its place")),
    "units in the header": (b"t [s],theta [rad],beta [rad]\n0,1,2\n",
                            header("t' is missing (found 't [s],theta [rad],beta [rad]'); 't [s]'" + NEAR)),
    "letters of another script": ("t,thet\u0430,beta\n0,1,2\n".encode(),
                                  header(r"theta' is missing (found 't,thet\u0430,beta'); 'thet\u0430'" + NEAR)),
    "a column twice": (b"t,theta,beta,theta\n0,1,2,3\n", "line 1: column 'theta' stands 2 times; expected once"),
    "gamma and alpha": (b"t,theta,beta,gamma,alpha\n0,1,2,3,4\n",
                        "line 1: columns gamma and alpha; expected one of them, the other follows from theta"),
    "an open quote in the header": (b't,"theta,beta\n0,1,2\n', "line 1: " + NO_QUOTE),
    # ---- rows
    "too few cells": (HEAD + b"0,1,2\n1,2\n2,1,2\n", "line 3: 2 cells, expected 3 as in the header"),
    "too many cells": (HEAD + b"0,1,2,3\n1,2,3\n", "line 2: 4 cells, expected 3 as in the header"),
    "cut short within a row": (GOOD[:-9], "line 201: 2 cells, expected 3 as in the header" + CUT),
    "cut short within a row's first number": (GOOD + b"2.", "line 202: 1 cell, expected 3 as in the header" + CUT),
    "cut short within a number's exponent": (HEAD + b"0,1,2\n0.01,1,2e-", no_number("'2e-'", 3, "beta")),
    "cut short within a quote": (GOOD + b'2.00,1,"2', "line 202: " + NO_QUOTE),
    "the same after blank lines": (HEAD + b"\n\r\n0,1,2\n\n\n1,2\n\n2,1,2\n",
                                   "line 7: 2 cells, expected 3 as in the header"),
    "decimal commas": (HEAD + b"0,0,1,5,0,2\n", "line 2: 6 cells, expected 3 as in the header; "
                                                "the numbers seem to have decimal commas: expected points"),
    "an open quote in line 102": (at_line_102(b'"1.00'), "line 102: " + NO_QUOTE),
    "an open quote in a long log": (HEAD + b'0,1,2\n0.01,"1,2\n' + ROWS * 50, "line 3: " + NO_QUOTE),
    "text behind a quote": (HEAD + b'0,"1"2,2\n', "line 2: text behind a closing quote; expected ',' there"),
    "a header again in the middle": (at_line_102(b"t,theta,beta\n1.00"),
                                     "line 102: the header stands here again; expected one log in a file"),
    "a row of units": (HEAD + b"s,rad,rad\n" + ROWS, no_number("'s'", 2, "t")),
    "a huge cell": (cell(b"1" * 200_000), "line 3: a cell of more than 131072 characters; expected a number"),
    "a line of two million characters": (cell(b"1," * 1_000_000),
                                         "line 3: more than 1048576 characters; expected one sample a line"),
    # ---- cells
    "a word": (cell(b"high"), no_number("'high'")),
    "an optional column": (b"t,theta,beta,theta_dot\n0,1,2,fast\n", no_number("'fast'", 2, "theta_dot")),
    "digits of another script": (cell("\u0661".encode()), no_number(r"'\u0661'")),
    "NA": (cell(b"NA"), no_number("'NA'")),
    "an error of a spreadsheet": (cell(b"#DIV/0!"), no_number("'#DIV/0!'")),
    "thousands with a comma": (cell(b'"1,000.5"'), no_number("'1,000.5'")),
    "an exponent without digits": (cell(b"1e"), no_number("'1e'")),
    "a date": (HEAD + b"2020-01-01T00:00:00,1,2\n", no_number("'2020-01-01T00:00:00'", 2, "t")),
    "a terminal's escape": (cell(b"\x1b[31m1"), no_number(r"'\x1b[31m1'")),
    "a line feed in quotes": (cell(b'"1\n2"'), no_number(r"'1\n2'")),
    "a long cell": (cell(b"x" * 5000), no_number("'" + "x" * 40 + "...'")),
    # ---- rows that are all right, and no log
    "all rows nan": (HEAD + b"nan,NaN,-nan\n" * 5, NO_ROW),
    "no row with all three": (HEAD + b"0,nan,1\n0.1,1,nan\nnan,1,1\n", NO_ROW),
    "one row": (HEAD + b"0,1,2\n", NO_STEP),
    "a clock that stands still": (HEAD + b"1,1,2\n" * 50, NO_STEP),
    "a clock that runs backwards": (HEAD + b"3,1,2\n2,1,2\n1,1,2\n", "column t: t runs backward: sort the rows by t"),
    "a clock in microseconds": (
        HEAD + b"".join(b"%d,%.3f,%.3f\n" % (20_000 * k, math.sin(k / 9), math.cos(k / 5)) for k in range(100)),
        "column t: sample_period=20000.0: expected a number from 1e-06 to 10000; the log's step of 2e+04 looks like "
        "microseconds: divide t by 1e+06"),
    "a clock that hardly moves": (
        HEAD + b"".join(b"%de-308,%.3f,%.3f\n" % (k, math.sin(k / 9), math.cos(k / 5)) for k in range(99)) + b"1,1,2\n",
        "column t: its median step is 1e-308 s; expected at least 1e-06 s"),
}


def flown(column: str, value: str) -> bytes:
    """A second of motion without noise in which one cell of a column is this."""
    lines = ["t,theta,theta_dot,theta_ddot,beta"]
    for k in range(100):
        t = k / 100
        row = {"t": t, "theta": math.sin(7 * t), "theta_dot": 7 * math.cos(7 * t), "theta_ddot": -49 * math.sin(7 * t),
               "beta": 0.3 * math.sin(40 * t)}
        cells = {name: repr(x) for name, x in row.items()} | ({column: value} if k == 50 else {})
        lines.append(",".join(cells.values()))
    return "\n".join(lines).encode()


ABSURD = {  # what overflowed: the fit of what was held out, the look for ideal sensors, the stamps' gaps
    f"{column} of {value}": flown(column, value) for column in ("t", "theta", "theta_dot", "theta_ddot", "beta")
    for value in ("1e155", "-1e308", "5e-324", "1e400", "1e16")}

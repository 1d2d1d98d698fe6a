"""Good logs, damaged by a seeded generator: bytes, cells, rows, columns and whole files."""

import math
from collections.abc import Callable
from random import Random

ROWS, PERIOD = 48, 0.02   # a second of flight: short, for there are many


def _flight(columns: str, end: str = "\n", quote: str = "") -> bytes:
    names = columns.split(",")
    lines = [columns]
    for k in range(ROWS):
        t = k * PERIOD
        row = {"t": t, "theta": 0.05 * math.sin(7 * t), "theta_dot": 0.35 * math.cos(7 * t),
               "theta_ddot": -2.45 * math.sin(7 * t), "beta": 0.3 * math.sin(7 * t) + 0.01 * math.sin(40 * t),
               "beta_cmd": 0.3 * math.sin(7 * t + 0.1), "theta_ref": 0.0, "alpha": 0.04 * math.sin(7 * t)}
        cells = [f"{row.get(name, k):.6g}" if name != "theta_dot" or k % 9 else "" for name in names]
        lines.append(",".join(quote + cell + quote for cell in cells))
    return (end.join(lines) + end).encode()


GOOD = (_flight("t,theta,beta"), _flight("t,theta_ref,beta_cmd,beta,theta,theta_dot"),
        _flight("t,theta,theta_dot,theta_ddot,beta", "\r\n"), _flight("note,beta,theta,t,alpha", quote='"'),
        _flight("t,theta,theta_dot,beta,beta_cmd,theta_ref"))
CELLS = ("", "nan", "-nan", "inf", "-inf", "0", "-0", "1e308", "-1e308", "1e-308", "5e-324", "1e400", "1e16", "-1e9",
         "99999", "1e155", "2147483648", "9007199254740993", "1_0", "0x1", "1,5", '"', '""', '"1"', "'", "\0",
         "\x1a", "\ufeff", "\u0661", "NaN", "true", " ", "\t", "1e", ".", "-", "1e99999", "#", "=1+1", "1.6e9", "1e-20",
         "theta", "\x85", "\u2028", "\r")
Change = Callable[[Random, bytes], bytes]


def _bytes(r: Random, data: bytes) -> bytes:
    made = bytearray(data)
    for _ in range(r.choice((1, 1, 3, 30))):
        made[r.randrange(len(made))] = r.choice((r.randrange(256), ord(r.choice('",\n\r;.-e0 '))))
    return bytes(made)


def _cut(r: Random, data: bytes) -> bytes:
    return data[:r.randrange(len(data))]


def _without(r: Random, data: bytes) -> bytes:
    a = r.randrange(len(data))
    return data[:a] + data[a + r.choice((1, 2, 10, 300)):]


def _again(r: Random, data: bytes) -> bytes:
    a, b = r.randrange(len(data)), r.randrange(len(data))
    return data[:a] + data[min(a, b):max(a, b)] + data[a:]


def _inserted(r: Random, data: bytes) -> bytes:
    a = r.randrange(len(data))
    return data[:a] + r.choice(CELLS).encode() + data[a:]


def _cells(r: Random, data: bytes) -> bytes:
    """The rows with some cells, or a column from some row on, or a whole row, changed."""
    table = [line.split(b",") for line in data.split(b"\n")]
    word = r.choice(CELLS).encode()
    first = r.randrange(len(table))
    column = r.randrange(len(table[0]))
    for row in table[first:first + r.choice((1, 1, 5, ROWS))]:
        if column < len(row):
            row[column] = word if r.random() < 0.8 else r.choice(CELLS).encode()
    return b"\n".join(b",".join(row) for row in table)


def _scaled(r: Random, data: bytes) -> bytes:
    """A column in another unit, of another sign, shifted, or still."""
    table = [line.split(b",") for line in data.split(b"\n")]
    column, factor, shift = r.randrange(len(table[0])), r.choice((1e-300, 1e-3, 0, -1, 57.3, 1e3, 1e6, 1e150, 1e300)), \
        r.choice((0.0, 0.0, 1.0, 1e9, -1e3, 1e300))
    for row in table[1:]:
        if column < len(row):
            try:
                row[column] = repr(float(row[column]) * factor + shift).encode()
            except ValueError:
                continue
    return b"\n".join(b",".join(row) for row in table)


def _rows(r: Random, data: bytes) -> bytes:
    """Rows in another order, doubled, or left out."""
    head, *rows = data.split(b"\n")
    how = r.randrange(4)
    if how == 0:
        r.shuffle(rows)
    elif how == 1:
        a = r.randrange(len(rows) or 1)  # a mutation before may have left the head alone
        rows = rows[a:] + rows[:a]
    elif how == 2:
        rows = [row for row in rows if r.random() < r.choice((0.1, 0.9))]
    else:
        rows = [row for row in rows for _ in range(r.choice((1, 1, 1, 2)))]
    return b"\n".join([head, *rows])


def _spliced(r: Random, data: bytes) -> bytes:
    other = r.choice(GOOD)
    return data[:r.randrange(len(data))] + other[r.randrange(len(other)):]


def _encoded(r: Random, data: bytes) -> bytes:
    try:
        return data.decode().encode(r.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "utf-7")))
    except UnicodeDecodeError:
        return data[::-1]


CHANGES: tuple[Change, ...] = (_bytes, _cut, _without, _again, _inserted, _cells, _cells, _cells, _scaled, _scaled,
                               _rows, _spliced, _encoded)


def mutated(seed: int) -> bytes:
    """The damaged log of a seed: one to three changes of a good one."""
    r = Random(seed)
    data = r.choice(GOOD)
    for _ in range(r.choice((1, 1, 2, 3))):
        data = r.choice(CHANGES)(r, data) or b"\n"
    return data

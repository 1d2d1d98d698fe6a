"""Logs that cannot be read: exit status 3 and exactly one line that says where and what was expected; and logs whose
layout is odd, which are read.

100,000 mutated logs: `-m campaign`; 500 of them by default.
"""

import contextlib
import json
import math
import os
import socket
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest
from every import every
from malformed_logs import ABSURD, CUT, GOOD, HEAD, MALFORMED
from mutated import mutated

from launchid.log.log import measured_logs, read_log
from launchid.log.stamps import usable_rows
from launchid.log.table import ROWS_A_BLOCK
from launchid.main import main
from sim.errors import InputError


@every("case", MALFORMED)
def test_what_cannot_be_read_is_this_line_and_status_3(tmp_path, capsys, case):
    data, message = MALFORMED[case]
    log = tmp_path / "log.csv"
    log.write_bytes(data)
    assert main(["identify", str(log), "--json", str(tmp_path / "x.json")]) == 3
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"launchid: {log}: {message}\n")
    assert list(tmp_path.iterdir()) == [log]


# ---- what is no file


def refused(capsys: pytest.CaptureFixture, log: object, message: str) -> None:
    assert main(["identify", str(log)]) == 3
    assert capsys.readouterr() == ("", f"launchid: {log}: {message}\n")


NO_LOG = "; expected a CSV log with the columns t, theta, beta, or one of " + ", ".join(measured_logs())


def test_what_is_no_file_is_this_line_and_status_3(tmp_path, capsys):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    (tmp_path / "file").write_bytes(GOOD)
    refused(capsys, tmp_path / ("x" * 300), "cannot be read (File name too long)")
    for name in ("none.csv", "link", "circle", "file/log.csv", "a\0b"):
        shown = str(tmp_path / name).replace("\0", "\\x00")
        assert main(["identify", str(tmp_path / name)]) == 3
        err = capsys.readouterr().err
    assert err == f"launchid: {shown}: no such file{NO_LOG}\n" or (   # a file beside it has a name like it
        err.startswith(f"launchid: {shown}: no such file; did you mean ") and len(err.splitlines()) == 1)
    refused(capsys, tmp_path, "neither a file nor a pipe" + NO_LOG)
    with socket.socket(socket.AF_UNIX) as heard:
        heard.bind(str(tmp_path / "s"))
        refused(capsys, tmp_path / "s", "neither a file nor a pipe" + NO_LOG)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may read anything")
def test_a_file_that_may_not_be_read_is_this_line(tmp_path, capsys):
    log = tmp_path / "log.csv"
    log.write_bytes(GOOD)
    log.chmod(0)
    refused(capsys, log, "cannot be read (Permission denied)")


@pytest.mark.skipif(os.name != "posix", reason="POSIX pipes")
@pytest.mark.parametrize("case", ["gzip", "cut short within a row"])
def test_a_pipe_says_what_a_file_says(tmp_path, capsys, case):
    data, message = MALFORMED[case]
    os.mkfifo(tmp_path / "pipe")
    thread = threading.Thread(target=feed, args=(tmp_path / "pipe", data), daemon=True)
    thread.start()
    refused(capsys, tmp_path / "pipe", message)
    thread.join(10)


def feed(pipe: Path, data: bytes) -> None:
    with contextlib.suppress(BrokenPipeError):  # its reader has left
        pipe.write_bytes(data)


@pytest.mark.skipif(os.name != "posix", reason="POSIX pipes")
def test_a_pipe_without_an_end_of_line_is_left_in_time(tmp_path, capsys):
    """A device that gives zeros for ever is such a pipe."""
    os.mkfifo(tmp_path / "pipe")

    def pour() -> None:
        with contextlib.suppress(BrokenPipeError), (tmp_path / "pipe").open("wb") as file:
            while True:
                file.write(b"1" * 65536)

    thread = threading.Thread(target=pour, daemon=True)
    thread.start()
    refused(capsys, tmp_path / "pipe", "line 1: more than 1048576 characters; expected one sample a line")
    thread.join(10)
    assert not thread.is_alive()


def test_a_log_that_grows_while_it_is_read_is_its_rows_so_far_or_this_line(tmp_path):
    """The log is written in pieces that end anywhere, as a file's buffer is flushed."""
    log = tmp_path / "log.csv"
    whole = HEAD + b"".join(b"%d.5,0.25,-0.125\n" % k for k in range(8_000))
    log.write_bytes(whole[:8_000])
    stop = threading.Event()

    def grow() -> None:
        with log.open("ab", buffering=0) as file:
            for at in range(8_000, len(whole), 997):
                file.write(whole[at:at + 997])
                if stop.wait(0.0005):
                    file.write(whole[at + 997:])
                    return

    thread = threading.Thread(target=grow, daemon=True)
    thread.start()
    seen = set()
    for _ in range(10):
        try:
            found = read_log(log)
            assert np.all(np.diff(found.t[:-1]) == 1.0) and np.all(found.theta == 0.25)  # the last may be cut
            seen.add("read")
        except InputError as error:
            assert CUT in str(error) or "is no number" in str(error), error
            seen.add("refused")
    stop.set()
    thread.join(10)
    assert len(read_log(log).t) == 8_000 and seen


@every("words", [["diagnose", "LOG", "constant"], ["uncertainty", "LOG", "constant"],
                 ["identify", "LOG", "--nominal", "constant"], ["nominal", "LOG", "--out", "OUT"]])
def test_a_clock_that_is_none_is_refused_by_every_command(tmp_path, capsys, words):
    """Rows in a second have no number there."""
    log = tmp_path / "log.csv"
    data, message = MALFORMED["a clock that hardly moves"]
    log.write_bytes(data)
    places = {"LOG": str(log), "OUT": str(tmp_path / "new.toml")}
    assert main([places.get(word, word) for word in words]) == 3
    assert capsys.readouterr() == ("", f"launchid: {log}: {message}\n")


# ---- odd layouts that are read


PLAIN = {"t": [0.0, 0.01, 0.02], "theta": [1.0, 2.0, -3.5], "beta": [0.5, 0.25, 0.125]}
READ: dict[str, bytes] = {
    "plain": b"t,theta,beta\n0,1,0.5\n0.01,2,0.25\n0.02,-3.5,0.125\n",
    "line ends of three systems": b"t,theta,beta\r\n0,1,0.5\r0.01,2,0.25\n0.02,-3.5,0.125\r\n",
    "CR alone": b"t,theta,beta\r0,1,0.5\r0.01,2,0.25\r0.02,-3.5,0.125",
    "a mark and blank lines": b"\xef\xbb\xbf\n\nt,theta,beta\n\n0,1,0.5\n\r\n0.01,2,0.25\n0.02,-3.5,0.125\n\n",
    "everything in quotes": b'"t","theta","beta"\n"0","1","0.5"\n"0.01","2","0.25"\n"0.02","-3.5","0.125"\n',
    "trailing commas everywhere": b"t,theta,beta,,\n0,1,0.5,,\n0.01,2,0.25,,\n0.02,-3.5,0.125,,\n",
    "spaces and tabs": b" t ,\ttheta, beta\n 0 , 1 , 0.5 \n0.01,\t2,0.25\n0.02,-3.5, 0.125\n",
    "other ways to write a number": b"t,theta,beta\n+0.,1e0,.5\n1E-2,20e-1,+2.5E-1\n2.e-2,-35e-1,0000.125\n",
    "columns turned round": b"beta,theta,t\n0.5,1,0\n0.25,2,0.01\n0.125,-3.5,0.02\n",
    "a note of three lines": b't,theta,beta,note\n0,1,0.5,"a\nb\nc"\n0.01,2,0.25,\n0.02,-3.5,0.125,"say ""no"""\n',
    "a note in another script": "t,theta,beta,\u03b8\n0,1,0.5,\u00b0\n0.01,2,0.25,\u2603\n0.02,-3.5,0.125,\n".encode()}


@every("layout", READ)
def test_an_odd_layout_is_read(tmp_path, layout):
    (tmp_path / "log.csv").write_bytes(READ[layout])
    log = read_log(tmp_path / "log.csv")
    assert {name: getattr(log, name).tolist() for name in PLAIN} == PLAIN


def test_words_for_what_is_not_measured_and_for_infinity(tmp_path):
    """The words are those that C, Python, MATLAB and numpy print; infinite is data out of range."""
    words = ["", " ", "nan", "NaN", "-nan", "+NAN", "inf", "-Inf", "INFINITY", "1e400", "-1e9999"]
    rows = "".join(f"{k},1,2,{word}\n" for k, word in enumerate(words))
    (tmp_path / "log.csv").write_text("t,theta,beta,theta_dot\n" + rows)
    found = read_log(tmp_path / "log.csv").theta_dot
    assert np.isnan(found[:6]).all()
    assert found[6:].tolist() == [math.inf, -math.inf, math.inf, math.inf, -math.inf]


@pytest.mark.parametrize("at", [0, ROWS_A_BLOCK - 1, ROWS_A_BLOCK, 2 * ROWS_A_BLOCK + 5])
def test_the_line_is_right_in_every_block(tmp_path, at):
    lines = [b"%d,1,2" % k for k in range(2 * ROWS_A_BLOCK + 10)]
    lines[at] = b"%d,x,2" % at
    (tmp_path / "log.csv").write_bytes(HEAD + b"\n".join(lines))
    with pytest.raises(InputError, match=f"line {at + 2}, column theta: 'x' is no number"):
        read_log(tmp_path / "log.csv")


# ---- any damage


@pytest.mark.filterwarnings("error")
@every("case", ABSURD)
def test_one_absurd_value_is_left_out_without_a_warning_of_numpy(tmp_path, capsys, case):
    log = tmp_path / "log.csv"
    log.write_bytes(ABSURD[case])
    assert main(["identify", str(log), "--json", "-", "--window", "0.2"]) == 0
    samples = json.loads(capsys.readouterr().out)["samples"]
    assert samples["accepted"] >= 99 and samples["accepted"] + sum(samples["rejected"].values()) == 100


ASKED = (["--window", "0.2"], ["--window", "0.2"], ["--window", "all"], ["--window", "0.4", "--library", "quadratic"],
         ["--window", "0.2", "--nominal", "constant", "--tracked"], ["--strict", "--window", "0.3"])


def survives(folder: Path, capsys: pytest.CaptureFixture, seed: int) -> None:
    """One run of the command over the damaged log of this seed: status 0, 2 or 3, one line if it is not 0, beside that
    of ignored columns."""
    log = folder / "log.csv"
    log.write_bytes(mutated(seed))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status = main(["identify", str(log), "--json", "-", *ASKED[seed % len(ASKED)]])
    out, err = capsys.readouterr()
    assert status in (0, 2, 3)
    said = [line for line in err.splitlines() if not line.startswith(f"{log}: columns ignored: ")]
    if status:
        assert out == "" and len(said) == 1 and said[0].startswith("launchid: "), err
        assert status == 2 or said[0].startswith(f"launchid: {log}: ")
    else:
        assert json.loads(out)["windows"] is not None
    assert err.replace("\n", "").isprintable()


def is_read_or_refused(folder: Path, seed: int) -> None:
    """The same of the reader alone, which is quick."""
    log = folder / "log.csv"
    log.write_bytes(mutated(seed))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(read_log(log).t) > 0
    except InputError as error:
        assert str(error).startswith(f"{log}: ") and "\n" not in str(error)


def test_damaged_logs_give_an_answer_or_a_line(tmp_path, capsys):
    for seed in range(500):
        is_read_or_refused(tmp_path, seed)
    for seed in range(0, 500, len(ASKED) * 2 - 1):  # every option in turn
        survives(tmp_path, capsys, seed)


def test_stamps_whose_difference_overflows_are_judged_without_a_warning_of_numpy():
    """Seed 35959 of the campaign below: a stamp of 1e308 beside one of -1e308."""
    with np.errstate(all="raise"):
        assert usable_rows(np.array([0.0, -1e308, 1e308, 1.0, 2.0])).tolist() == [True, False, False, True, True]


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(100))
def test_a_hundred_thousand_damaged_logs_give_an_answer_or_a_line(tmp_path, capsys, part):
    for seed in range(1000 * part, 1000 * (part + 1)):
        survives(tmp_path, capsys, seed)

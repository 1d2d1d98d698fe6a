"""Misuse of `import launchid`, one line each: what is no log, no nominal, no path, no number; nothing is computed.

InputError or UsageError, whatever a user hands over; a TypeError out of the depths tells nobody what to do.
"""

import datetime
from pathlib import Path

import numpy as np
import pytest
from every import every
from shortened import short

import launchid
from launchid.cli.main import main

T = np.arange(300) * 0.01
COLUMNS = {"t": T, "theta": 0.01 * np.sin(3.0 * T), "beta": 0.01 * np.cos(5.0 * T)}
NOMINAL = "constant"
DAYS = [datetime.datetime(2026, 1, 1, 0, 0, k) for k in range(3)]
NO_LOG = {
    "a number": (3, "found int"), "nothing": (None, "found NoneType"), "bytes": (b"log.csv", "found bytes"),
    "a list": ([1, 2, 3], "found list"), "an array": (np.zeros((5, 3)), "found ndarray"),
    "a generator": ((x for x in ()), "found generator"), "a class": (Path, "found type"),
    "a module": (launchid, "found module"), "scalars": ({"t": 1.0, "theta": 2.0, "beta": 3.0}, "0 dimensions"),
    "no values": (dict.fromkeys(COLUMNS), "0 dimensions"),
    "dates": ({**COLUMNS, "t": np.datetime64("2026-01-01") + np.arange(300)}, "dates; expected numbers, seconds"),
    "durations": ({**COLUMNS, "t": np.arange(300) * np.timedelta64(10, "ms")}, "dates; expected numbers, seconds"),
    "Python's dates": ({"t": DAYS, "theta": [0, 1, 2], "beta": [0, 1, 2]}, "row 0, column t"),
    "complex numbers": ({**COLUMNS, "beta": 1j * T}, "complex"),
    "an integer beyond a double": ({"t": [0], "theta": [10**400], "beta": [0]}, "row 0, column theta"),
    "a path with NUL": ("a\0b", "NUL"), "a folder": (Path(__file__).parent, "neither a file nor a pipe"),
    "a path of two lines": ("no\nsuch", r"no\nsuch: no such file")}
WRONG = {
    "window": lambda: launchid.identify(COLUMNS, window=[1]),
    "seed": lambda: launchid.identify(COLUMNS, seed="a"),
    "library": lambda: launchid.identify(COLUMNS, library=3),
    "bootstrap": lambda: launchid.diagnose(COLUMNS, NOMINAL, bootstrap=-1),
    "bootstrap of text": lambda: launchid.diagnose(COLUMNS, NOMINAL, bootstrap="many"),
    "noise": lambda: launchid.diagnose(COLUMNS, NOMINAL, noise="loud"),
    "logs": lambda: launchid.fit_lft(3, NOMINAL), "one log for logs": lambda: launchid.fit_lft(COLUMNS, NOMINAL),
    "one path for logs": lambda: launchid.fit_lft("log.csv", NOMINAL),
    "share": lambda: launchid.fit_lft([COLUMNS], NOMINAL, share="most"),
    "half a seed": lambda: launchid.simulate(NOMINAL, seed=1.5),
    "period": lambda: launchid.simulate(NOMINAL, period="fast"),
    "effects": lambda: launchid.simulate(NOMINAL, effects=3),
    "an effect": lambda: launchid.simulate(NOMINAL, effects=[3]),
    "effects by name": lambda: launchid.simulate(NOMINAL, effects={"gyro_bias": {"rate": 0.01}}),
    "accuracy": lambda: launchid.plan(NOMINAL, accuracy="high", window=5),
    "plan's window": lambda: launchid.plan(NOMINAL, accuracy=0.01, window=None),
    "a word that export_c has not": lambda: launchid.export_c(NOMINAL, colour="red"),
    "flights": lambda: launchid.campaign(NOMINAL, out="never", flights=2.5),
    "workers": lambda: launchid.campaign(NOMINAL, out="never", flights=2, workers="all"),
    "requirement": lambda: launchid.campaign(NOMINAL, out="never", flights=2, requirement=3),
    "merge": lambda: launchid.campaign(NOMINAL, out="never", merge=3),
    "out": lambda: launchid.campaign(NOMINAL, out=3, flights=2),
    "map": lambda: launchid.read_log("log.csv", map=3), "a map of columns": lambda: launchid.read_log(COLUMNS, map="m")}


def one_line(error: Exception) -> bool:
    return len(str(error).splitlines()) == 1


@every("kind", NO_LOG)
def test_what_is_no_log_is_one_line(kind):
    source, mention = NO_LOG[kind]
    with pytest.raises((launchid.InputError, launchid.UsageError)) as caught:
        launchid.read_log(source)
    assert mention in str(caught.value) and one_line(caught.value)


@pytest.mark.parametrize("source", [3, None, {}, b"constant", "a\0b", launchid.read_log(COLUMNS)], ids=str)
def test_what_is_no_nominal_is_one_line(source):
    with pytest.raises((launchid.InputError, launchid.UsageError), match=r"nominal|NUL") as caught:
        launchid.load_nominal(source)
    assert one_line(caught.value)


@every("what", WRONG)
def test_a_wrong_parameter_is_one_line(what):
    with pytest.raises(launchid.UsageError) as caught:
        WRONG[what]()
    assert one_line(caught.value)


@pytest.mark.parametrize(("path", "mention"), [
    (3, "found int"), (b"x.csv", "found bytes"), (None, "found NoneType"), (["x.csv"], "found list"),
    ("a\0b", "NUL"), (Path(__file__).parent, "it is a folder"), ("none/x.csv", "no such folder")], ids=str)
def test_what_is_no_path_of_an_output_is_one_line(path, mention):
    with pytest.raises((launchid.InputError, launchid.UsageError), match=mention) as caught:
        launchid.read_log(COLUMNS)
        launchid.simulate(short(0.1)).write(path)
    assert one_line(caught.value)


@pytest.mark.parametrize("words", [
    "diagnose LOG constant --report PLACE", "export-c constant --out PLACE", "reproduce --out PLACE",
    "campaign constant --flights 2 --out PLACE", "diagnose LOG constant --report PLACE/below"])
def test_a_folder_that_cannot_be_one_is_refused_before_anything_is_computed(tmp_path, capsys, monkeypatch, words):
    """`diagnose` said so after its minutes."""
    (tmp_path / "log.csv").write_text("t,theta,beta\n0,0,0\n0.01,0.1,0.1\n0.02,0.1,0.1\n")
    (tmp_path / "place").write_text("a file")
    monkeypatch.setattr("launchid.diagnosis.verdict.diagnose", pytest.fail)
    given = words.replace("LOG", str(tmp_path / "log.csv")).replace("PLACE", str(tmp_path / "place"))
    assert main(given.split()) == 3
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1 and "cannot be made a folder" in said.err
    assert (tmp_path / "place").read_text() == "a file"


def test_a_frame_that_holds_no_data_yet_is_to_be_collected():
    polars = pytest.importorskip("polars")
    with pytest.raises(launchid.InputError, match=r"\.collect\(\)"):
        launchid.read_log(polars.DataFrame(COLUMNS).lazy())

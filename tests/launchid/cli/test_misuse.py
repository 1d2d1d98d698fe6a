"""Misuse of `import launchid` gets one line that names the remedy, as InputError or UsageError; nothing is computed.

A TypeError out of the depths tells nobody what to do.
"""

import datetime
import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from every import every
from shortened import short

import launchid
from launchid.convert.mapping import load_map
from launchid.main import main
from launchid.monte_carlo.requirement.grammar import requirement
from sim.effects.catalogue import from_text
from sim.nominal import built_in

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


SEMICOLONS, OTHER_NAMES, REVERSED, WRITTEN = "semicolons.csv", "names.csv", "reversed.csv", "own.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a user's files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / SEMICOLONS).write_text("t;theta;beta\n0;0;0\n")
    (tmp_path / OTHER_NAMES).write_text("t,pitch,nozzle\n0,0,0\n")
    (tmp_path / REVERSED).write_text("t,theta,beta\n3,0.1,0.2\n2,0.1,0.1\n1,0,0\n")
    (tmp_path / WRITTEN).write_text(built_in("constant").read_text())
    return tmp_path


@pytest.mark.parametrize(("words", "status", "remedy"), [
    ("identfy x.csv", 2, "did you mean identify?"),
    ("identify x.csv --windw 5", 2, "did you mean --window?"),
    ("identify x.csv --formulation intgral", 2, "did you mean integral?"),
    ("diagnose vega_like flight.csv", 3, "the log comes first"),
    (f"diagnose {WRITTEN} flight.csv", 3, "the log comes first"),
    (f"diagnose {REVERSED} {REVERSED}", 2, "expected diagnose LOG"),
    ("simulate vega --out x.csv", 3, "did you mean vega_like?"),
    ("identify dfki_pendulum_dircl", 3, "did you mean dfki_pendulum_dircol?"),
    ("simulate constant --out x.csv --effect control_los:fraction=0.1", 2, "did you mean control_loss?"),
    (f"identify {SEMICOLONS}", 3, "--map"),
    (f"identify {OTHER_NAMES}", 3, "'pitch' may be it: name it in a map (--map)"),
    (f"identify {REVERSED}", 3, "sort the rows by t"),
    ("identify dfki_pendulum_dircol --tracked", 2, "--tracked needs --nominal"),
    ("identify dfki_pendulum_dircol pendulum_linear --nominal constant", 2, "expected one nominal"),
    ("watch flight.csv", 2, "expected watch LOG NOMINAL.toml"),
    ("simulate constant --out x.csv --effect gyro_bias:rate=1e308", 2, "expected a number")])
def test_a_mistake_gets_one_line_with_its_remedy(folder, capsys, words, status, remedy):
    assert main(words.split()) == status
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and remedy in said[0]


def test_a_misspelt_key_of_a_nominal_is_named(folder, capsys):
    (folder / WRITTEN).write_text((folder / WRITTEN).read_text().replace("command_noise_std", "comand_noise_std"))
    assert main(["simulate", WRITTEN, "--out", "x.csv"]) == 3
    assert "did you mean command_noise_std?" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX pipes")
def test_a_pipe_as_a_profile_is_refused_and_does_not_hang(folder, capsys):
    os.mkfifo(folder / "profile.csv")
    lines = (folder / WRITTEN).read_text().replace("a6 = 2.0", 'profile = "profile.csv"', 1).replace("k1 = -7.0", "", 1)
    (folder / WRITTEN).write_text(lines)
    assert main(["simulate", WRITTEN, "--out", "x.csv"]) == 3
    assert "no regular file" in capsys.readouterr().err


def test_a_controller_that_turns_the_vehicle_away_is_warned_of(folder):
    (folder / WRITTEN).write_text((folder / WRITTEN).read_text().replace("k1 = -7.0", "k1 = 7.0", 1))
    with pytest.warns(launchid.DataWarning, match="k1 and kp have the same sign"):
        launchid.load_nominal(WRITTEN)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("constant", "vega_like", "greensite_cr826", "pendulum_linear", "balancing_robot"):
            launchid.load_nominal(name)


def test_percent_and_long_units_are_understood(folder):
    asked = requirement("lost<5%@90%")
    assert (asked.probability, asked.confidence) == (0.05, 0.9)
    assert from_text("control_loss:fraction=30%,time=40") == from_text("control_loss:fraction=0.3,time=40")
    text = '[time]\nname = "x.t"\n[columns.theta]\nfrom = "x.a"\nunit = "{}"\n[columns.beta]\nfrom = "x.b"\n'
    maps = []  # of one path: equal but for the unit's name
    for unit in ("deg", "degrees", "degree"):
        (folder / "map.toml").write_text(text.format(unit))
        maps.append(load_map(folder / "map.toml"))
    assert maps[0] == maps[1] == maps[2]

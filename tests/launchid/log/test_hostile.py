"""The front door as a hostile user finds it: what was seen once, and has no test elsewhere."""

import dataclasses
import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import launchid
from launchid.cli.main import main
from launchid.diagnosis.data.used import MOST
from launchid.log.log import write_columns
from sim.nominal import Nominal, load_nominal, write_nominal


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    status = main([str(word) for word in words])
    return status, *capsys.readouterr()


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    """The constant nominal, of 20 s."""
    found = load_nominal("constant")
    assert found.simulation is not None
    return dataclasses.replace(found, simulation=dataclasses.replace(found.simulation, duration=20.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, nominal) -> Path:
    """A flight in degrees, as an engineer's logger may write it, and its nominal."""
    path = tmp_path_factory.mktemp("hostile")
    write_nominal(nominal, path / "n.toml")
    columns = launchid.simulate(nominal, seed=3).log.measured()
    write_columns(path / "degrees.csv", {name: x if name == "t" else np.degrees(x) for name, x in columns.items()})
    return path


# ---- what is not what it seems


@pytest.mark.parametrize("words", ["identify LOG --nominal N --window 5", "identify LOG --window 5",
                                   "uncertainty LOG N --window 5"])
def test_degrees_are_warned_of_and_refused_with_strict(folder, capsys, words):
    """Degrees of every column cannot be seen without a nominal: then only the nominal could tell."""
    given = words.replace("LOG", str(folder / "degrees.csv")).replace(" N", f" {folder / 'n.toml'}").split()
    status, out, err = run(capsys, *given)
    assert status == 0 and out
    if "N" in words:
        assert "degrees" in err and len(err.splitlines()) == 1
        status, out, err = run(capsys, *given, "--strict")
        assert (status, out) == (3, "") and "degrees" in err and len(err.splitlines()) == 1


def test_fit_lft_refuses_degrees(folder, capsys):
    """The command wrote a range of 9.5."""
    status, out, err = run(capsys, "fit-lft", folder / "degrees.csv", folder / "n.toml", "--out", folder / "new.toml")
    assert (status, out) == (3, "") and "degrees" in err and len(err.splitlines()) == 1
    assert not (folder / "new.toml").exists()


# ---- a log of the simulator itself, and one of a million rows


@pytest.mark.campaign
def test_the_truth_is_recognised_and_nothing_is_explained_by_it(nominal):
    """The nominal's own noise-free flight was EXPLAINED by a size of 1 +- 1.9e-07, its `ideal` suite UNEXPLAINED."""
    quiet = dataclasses.replace(nominal, sensors=dataclasses.replace(
        nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0))
    log = launchid.simulate(quiet, seed=3).log.measured()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        own, other = launchid.diagnose(log, quiet), launchid.diagnose(log, nominal)
    assert own.verdict == "consistent", own.summary()
    assert other.report["causes"] == [] and other.extension is None, other.summary()
    with pytest.warns(launchid.DataWarning, match="ideal suite"):
        launchid.diagnose(launchid.simulate(nominal, seed=3, suite="ideal").log.measured(), nominal)


@pytest.mark.campaign
def test_a_million_rows_are_diagnosed_and_it_is_said_which(nominal):
    """A log of that size had no answer, and no warning."""
    assert nominal.simulation is not None
    period, once = 0.001, 1_000_000
    long = dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=once * period))
    log = launchid.simulate(long, seed=3, period=period).log
    assert len(log.t) == once
    made = launchid.diagnose(log, long)
    used = made.diagnosis.used
    assert used is not None and used.rows <= MOST
    assert math.isclose(used.end - used.begin, used.rows * used.every * period, rel_tol=0.01)
    assert f"  {used.words}" in made.summary().splitlines()
    assert made.verdict == "consistent", made.summary()

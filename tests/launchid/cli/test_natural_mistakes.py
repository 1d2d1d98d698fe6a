"""Mistakes that a user makes on the first day get one line that names the remedy."""

import os
import warnings

import pytest

import launchid
from launchid.cli.main import main
from launchid.convert.mapping import load_map
from launchid.monte_carlo.requirement.grammar import requirement
from sim.effects.catalogue import from_text
from sim.errors import did_you_mean
from sim.nominal import built_in

SEMICOLONS, OTHER_NAMES, REVERSED, NOMINAL = "semicolons.csv", "names.csv", "reversed.csv", "own.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a user's files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / SEMICOLONS).write_text("t;theta;beta\n0;0;0\n")
    (tmp_path / OTHER_NAMES).write_text("t,pitch,nozzle\n0,0,0\n")
    (tmp_path / REVERSED).write_text("t,theta,beta\n3,0.1,0.2\n2,0.1,0.1\n1,0,0\n")
    (tmp_path / NOMINAL).write_text(built_in("constant").read_text())
    return tmp_path


@pytest.mark.parametrize(("words", "status", "remedy"), [
    ("identfy x.csv", 2, "did you mean identify?"),
    ("identify x.csv --windw 5", 2, "did you mean --window?"),
    ("identify x.csv --formulation intgral", 2, "did you mean integral?"),
    ("diagnose vega_like flight.csv", 3, "the log comes first"),
    (f"diagnose {NOMINAL} flight.csv", 3, "the log comes first"),
    (f"diagnose {REVERSED} {REVERSED}", 3, "comes before the nominal"),
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
    (folder / NOMINAL).write_text((folder / NOMINAL).read_text().replace("command_noise_std", "comand_noise_std"))
    assert main(["simulate", NOMINAL, "--out", "x.csv"]) == 3
    assert "did you mean command_noise_std?" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="POSIX pipes")
def test_a_pipe_as_a_profile_is_refused_and_does_not_hang(folder, capsys):
    os.mkfifo(folder / "profile.csv")
    lines = (folder / NOMINAL).read_text().replace("a6 = 2.0", 'profile = "profile.csv"', 1).replace("k1 = -7.0", "", 1)
    (folder / NOMINAL).write_text(lines)
    assert main(["simulate", NOMINAL, "--out", "x.csv"]) == 3
    assert "no regular file" in capsys.readouterr().err


def test_a_controller_that_turns_the_vehicle_away_is_warned_of(folder):
    (folder / NOMINAL).write_text((folder / NOMINAL).read_text().replace("k1 = -7.0", "k1 = 7.0", 1))
    with pytest.warns(launchid.DataWarning, match="k1 and kp have the same sign"):
        launchid.load_nominal(NOMINAL)
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


@pytest.mark.parametrize(("word", "words", "hint"), [
    ("identfy", ["identify", "margins"], "did you mean identify?"), ("vega", ["vega_like"], "did you mean vega_like?"),
    ("zzz", ["identify"], ""), ("", ["identify"], "")])
def test_the_nearest_word_is_asked_for_and_a_far_one_is_not(word, words, hint):
    assert did_you_mean(word, words) == hint

"""`import launchid`: the commands' answers, from paths, frames and arrays, as results to look at."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.formatting import with_std
from launchid.log.log import read_log, write_columns
from launchid.main import main
from sim.effects import effect
from sim.nominal import write_nominal

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A nominal of 20 s, and its log."""
    path = tmp_path_factory.mktemp("front")
    write_nominal(short(20.0), path / "n.toml")
    launchid.simulate(path / "n.toml", seed=3).write(path / "log.csv")
    return path


def said(capsys, *words: object) -> str:
    capsys.readouterr()
    assert main([str(word) for word in words]) == 0
    return capsys.readouterr().out


# ---- the same as the commands


def test_identify_is_the_command(folder, capsys):
    log, nominal = folder / "log.csv", folder / "n.toml"
    words = ["identify", log, "--nominal", nominal, "--window", "5", "--tracked"]
    made = launchid.identify(str(log), nominal, window=5, tracked=True)
    assert made.to_json() + "\n" == said(capsys, *words, "--json", "-")
    assert made.summary() + "\n" == said(capsys, *words)
    assert json.loads(made.to_json()) == made.report
    plain = launchid.identify(log, library="theta,beta,sin(theta)", solver="ssr", compression=2, seed=4, window="all")
    assert plain.to_json() + "\n" == said(capsys, "identify", log, "--library", "theta,beta,sin(theta)", "--solver",
                                          "ssr", "--compression", "2", "--seed", "4", "--window", "all", "--json", "-")


def test_uncertainty_is_the_command(folder, capsys):
    log, nominal = folder / "log.csv", folder / "n.toml"
    made = launchid.uncertainty(log, nominal, window=4)
    assert made.to_json() + "\n" == said(capsys, "uncertainty", log, nominal, "--window", "4", "--json", "-")
    assert made.summary() + "\n" == said(capsys, "uncertainty", log, nominal, "--window", "4")


def test_diagnose_is_the_command(folder, tmp_path, capsys):
    columns = read_log(folder / "log.csv").measured()
    columns["beta"] = -columns["beta"]
    write_columns(tmp_path / "log.csv", columns)
    made = launchid.diagnose(tmp_path / "log.csv", folder / "n.toml")
    assert made.verdict == "bad-data" and made.extension is None
    assert made.to_json() + "\n" == said(capsys, "diagnose", tmp_path / "log.csv", folder / "n.toml", "--json", "-")
    assert made.summary() + "\n" == said(capsys, "diagnose", tmp_path / "log.csv", folder / "n.toml")
    made.write_report(tmp_path / "report")
    assert json.loads((tmp_path / "report" / "verdict.json").read_text()) == made.report
    assert made.columns()["cause"] == [] and "<table>" in made._repr_html_()


def test_simulate_plan_and_fit_lft_write_the_command_s_bytes(folder, tmp_path, capsys):
    nominal = folder / "n.toml"
    effect = "steady_wind:angle=0.02"
    flown = launchid.simulate(nominal, seed=5, period=0.02, effects=[effect])
    planned = launchid.plan(nominal, accuracy=0.02, window=5)
    fitted = launchid.fit_lft([folder / "log.csv"], nominal, share=0.9)
    commands = {
        "log.csv": (flown, ["simulate", nominal, "--seed", "5", "--period", "0.02", "--effect", effect]),
        "plan.toml": (planned, ["plan", nominal, "--accuracy", "0.02", "--window", "5"]),
        "range.toml": (fitted, ["fit-lft", folder / "log.csv", nominal, "--share", "0.9"])}
    for name, (made, words) in commands.items():
        ours, theirs = tmp_path / f"ours.{name}", tmp_path / f"theirs.{name}"
        made.write(ours)
        printed = said(capsys, *words, "--out", theirs)
        assert printed in ("", made.summary(str(theirs)) + "\n")
        assert ours.read_bytes() == theirs.read_bytes()


# ---- what may stand for a log


def test_a_log_is_the_same_however_it_comes(folder):
    identified = launchid.identify(folder / "log.csv", window=10)
    log = identified.log
    for source in (log.measured(), {name: x.tolist() for name, x in log.measured().items()}, log,
                   launchid.simulate(folder / "n.toml", seed=3), identified):
        other = launchid.read_log(source)
        assert all(np.array_equal(x, getattr(other, name)) for name, x in log.measured().items())
    other = launchid.identify(log.measured(), window=10).report
    assert {**other, "next": None} == {**identified.report, "next": None}   # which names the log


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_data_frame_of_any_library_is_a_log(folder, library):
    frames = pytest.importorskip(library)
    log = read_log(folder / "log.csv")
    columns = log.measured()
    made = launchid.read_log(frames.DataFrame({name: columns[name] for name in reversed(columns)}
                                              | {"note": ["x"] * len(columns["t"])}))
    assert made.ignored == ("note",) and set(made.columns) == set(log.columns)
    assert all(np.array_equal(getattr(made, name), getattr(log, name), equal_nan=True) for name in log.columns)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_missing_cells_of_a_frame_are_not_measured(library):
    frames = pytest.importorskip(library)
    rate = [0.1, None, 0.3]
    options = {"dtype": "Float64"} if library == "pandas" else {}
    column = frames.Series("theta_dot", rate) if library == "polars" else frames.Series(rate, **options)
    log = launchid.read_log(frames.DataFrame({"t": [0, 1, 2], "theta": [0, 1, 2], "beta": [0, 1, 2],
                                              "theta_dot": column}))
    assert np.array_equal(log.theta_dot, [0.1, math.nan, 0.3], equal_nan=True)
    assert log.t.dtype == np.float64


@pytest.mark.parametrize(("columns", "mention"), [
    ({"t": [0, 1], "theta": [0, 1]}, "'beta' is missing"), ({}, "'t' is missing"),
    ({"t": [0, 1], "theta": [0, 1], "beta": [0]}, "unequal length"),
    ({"t": [0, 1], "theta": [0, "high"], "beta": [0, 1]}, "row 1, column theta: 'high' is no number"),
    ({"t": [0, 1], "theta": [[0, 1], [1, 2]], "beta": [0, 1]}, "column theta: 2 dimensions"),
    ({"t": [], "theta": [], "beta": []}, "no usable row"),
    ({"t": [0], "theta": [math.nan], "beta": [0]}, "no usable row"),
    ({"t": [0, 1], "theta": [0, 1], "beta": [0, 1], "gamma": [0, 1], "alpha": [0, 1]}, "gamma and alpha")])
def test_columns_that_are_no_log_are_one_line(columns, mention):
    with pytest.raises(launchid.InputError, match=mention) as caught:
        launchid.read_log(columns)
    assert len(str(caught.value).splitlines()) == 1


# ---- parameters


@pytest.mark.parametrize("effects", [
    "gyro_bias:rate=0.01", effect("gyro_bias", rate=0.01), {"name": "gyro_bias", "rate": 0.01},
    [{"name": "gyro_bias", "rate": 0.01}], (effect("gyro_bias", rate=0.01),)])
def test_an_effect_is_a_text_a_dict_or_an_effect(folder, effects):
    plain, biased = (launchid.simulate(folder / "n.toml", seed=1, period=0.1, effects=each).log.theta_dot
                     for each in ((), effects))
    assert np.allclose(biased - plain, 0.01, atol=1e-6)


# ---- the package


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="minutes without compiled kernels")
def test_the_example_of_the_page_runs(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("pandas")
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    example = page.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "python.md", "exec"), {})
    assert "sudden change of k1 at 60." in capsys.readouterr().out and (tmp_path / "v.png").is_file()


# ---- numbers


@pytest.mark.parametrize(("value", "std", "shown"), [
    (4.5253, 1.6, "4.5 +- 1.6"), (-7.0123456, 0.01549, "-7.012 +- 0.015"), (0.0, 0.0996, "0.00 +- 0.10"),
    (12345.6, 234.5, "12350 +- 230"), (2.0, 0.0, "2"), (2.0, None, "2"), (None, 1.0, "-"), (math.nan, 1.0, "-"),
    (1.5, math.nan, "1.5"), (1.0, 9.96, "1 +- 10"), (2.0, 1.9e-7, "2.00000000 +- 0.00000019"),
    (2.0, 1e-15, "2 +- 1.0e-15"), (-0.001, 1.0, "-0.0 +- 1.0")])
def test_a_value_is_shown_to_two_digits_of_its_standard_deviation(value, std, shown):
    assert with_std(value, std) == shown

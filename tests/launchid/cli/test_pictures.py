"""Pictures: residuals and their numbers, curves that a page draws again, `launchid show`, `compare` as a command."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.commands.identify import Identification
from launchid.commands.identify import identify as identified
from launchid.identification import residuals as rs
from launchid.log.check import ideal_note
from launchid.log.log import Log, flown_log, read_log, write_columns, write_flight
from launchid.main import main
from sim.errors import InputError
from sim.flight import fly_whole

pytest.importorskip("matplotlib", reason="matplotlib is not installed: no figures")

from matplotlib.figure import Figure

from launchid.report.curves import figure_json
from launchid.report.drawing import band, envelope, mark_refused
from launchid.report.inline import FOLDER, MARKS, inlined


def a_log(seconds: float = 60.0) -> Log:
    t = np.arange(0.0, seconds, 0.01)
    none = np.full(len(t), np.nan)
    return Log("log.csv", ("t", "theta", "beta"), (), t, np.sin(t), none, np.cos(t), none, none, none)


def labels(axis) -> set[str]:
    legend = axis.get_legend()
    return set() if legend is None else {text.get_text() for text in legend.get_texts()}


# ---- residuals


@pytest.fixture(scope="module")
def identification() -> Identification:
    nominal = short(40.0)
    return identified(flown_log(fly_whole(nominal, 3)), nominal, window=5.0)


def test_the_residual_of_a_right_model_is_white_and_it_predicts(identification):
    found = rs.residuals(identification.log, identification.estimates, identification.nominal)
    white = found.correlation
    assert white is not None and np.mean(np.abs(white.values) > white.band) <= 0.1
    own, before = found.predicted[-1].fits
    assert found.predicted[-1].horizon == 1.0 and own > 80.0 and before > 50.0


def test_the_residual_of_a_wrong_model_is_not_white_and_predicts_worse(identification):
    wrong = [replace(each, xi=each.xi * np.where(np.array(each.terms) == "beta", 0.5, 1.0)[:, None])
             for each in identification.estimates]
    right, found = (rs.residuals(identification.log, estimates, identification.nominal)
                    for estimates in (identification.estimates, wrong))
    assert found.correlation is not None
    assert np.mean(np.abs(found.correlation.values) > found.correlation.band) > 0.3
    assert found.predicted[-1].fits[0] < right.predicted[-1].fits[0] - 30.0


def test_predictions_are_the_equations_solution():
    """theta_ddot = -4 theta from rest: a cosine."""
    t = np.arange(0.0, 10.0, 0.01)
    log = replace(a_log(10.0), theta=np.cos(2.0 * t), theta_dot=-2.0 * np.sin(2.0 * t), beta=np.zeros(len(t)))
    made = identified(log, window=2.5, library="theta,beta")
    exact = [replace(each, valid=True, xi=np.array([[0.0, -4.0, 0.0], [0.0, 0.0, 0.0]]), terms=("theta", "beta"),
                     support=np.array([[False, True, False], [False, False, False]])) for each in made.estimates]
    found = rs.residuals(log, exact)
    assert np.max(np.abs(found.residual)) < 1e-3
    for each in found.predicted:
        assert np.max(np.abs(each.within - np.cos(2.0 * each.t))) < 1e-3 and each.fits[0] > 99.0
        assert each.ceiling > 99.0  # of no noise


def test_the_command_draws_them_and_refuses_in_one_line(identification, tmp_path, capsys):
    write_flight(tmp_path / "v.csv", fly_whole(short(6.0), 3))
    words = ["identify", str(tmp_path / "v.csv"), "--nominal", "constant", "--window", "2", "--resid"]
    assert not main([*words, str(tmp_path / "r.png")])
    assert (tmp_path / "r.png").read_bytes()[:4] == b"\x89PNG"
    figure = identification.residuals()
    assert "autocorrelation" in figure.axes[1].get_title(loc="left")
    assert any("own window: fit" in text for text in labels(figure.axes[-1]))
    assert any("sensor noise alone: fit" in text for text in labels(figure.axes[-1]))
    assert "of sensor noise alone" in figure.axes[0].get_title(loc="left")
    blind = replace(identification.log, theta_dot=np.full(len(identification.log.t), np.nan))
    assert rs.residuals(blind, identification.estimates).predicted   # of the attitude's slope
    with pytest.raises(InputError, match="theta and beta over more"):
        rs.residuals(replace(blind, theta=blind.theta_dot), identification.estimates)
    with pytest.raises(InputError, match="no window has a fit"):
        rs.residuals(identification.log, [])


# ---- what a log and a sample look like


def test_the_ideal_suite_is_recognised_and_a_real_sensor_is_not(tmp_path):
    nominal = short(10.0, "vega_like")
    write_flight(tmp_path / "i.csv", fly_whole(nominal, 1, "ideal"))
    log = read_log(tmp_path / "i.csv")
    said, = ideal_note(log)
    assert "ideal suite" in said and "\n" not in said
    assert any("ideal suite" in line for line in launchid.identify(log).warnings)
    noise = np.random.default_rng(1).normal(0.0, 1e-6, len(log.t))
    assert ideal_note(replace(log, theta_dot=log.theta_dot + noise)) == ()
    assert ideal_note(flown_log(fly_whole(nominal, 1))) == ()


def curves(rows: int = 1, columns: int = 1):
    figure = Figure(figsize=(9.0, 2.0 * rows))
    return figure, figure.subplots(rows, columns, sharex=True, squeeze=False)


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
def test_every_number_of_a_curve_is_there(origin):
    """Times are there to a microsecond, also of stamps since 1970, and values to five digits; an unknown one is a
    gap."""
    figure, axes = curves(2)
    t, x = origin + 0.01 * np.arange(500), np.random.default_rng(1).normal(size=500)
    x[17] = np.nan
    axes[0, 0].plot(t, x, label="x")
    axes[1, 0].plot(t, 2.0 * x, "o", label="y")
    found = figure_json(figure)
    first, second = (panel["series"][0] for panel in found["panels"])
    assert np.allclose(found["arrays"][first["x"]], t, rtol=0.0, atol=1e-2 if origin else 1e-9)
    drawn = np.array(found["arrays"][first["y"]], dtype=float)
    assert np.array_equal(np.isnan(drawn), np.isnan(x)) and np.allclose(drawn, x, rtol=1e-4, equal_nan=True)
    assert first["x"] == second["x"] and len(found["arrays"]) == 3, "an abscissa is there once"
    assert (first["width"] > 0, first["size"], second["width"], second["size"] > 0) == (True, 0, 0, True)
    assert {panel["group"] for panel in found["panels"]} == {0}, "one abscissa, one zoom"


def test_a_filled_band_is_there_and_what_is_not_told_apart_is_left_to_the_picture():
    figure, axes = curves()
    t, low = np.arange(5.0), np.array([0.0, 1.0, np.nan, 3.0, 4.0])
    band(axes[0, 0], t, low, low + 2.0, "#336699", "range")
    found = figure_json(figure)
    (told,), numbers = found["panels"][0]["bands"], found["arrays"]
    assert [numbers[told[name]] for name in ("x", "low", "high")] == [
        [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, None, 3.0, 4.0], [2.0, 3.0, None, 5.0, 6.0]]
    assert (told["label"], told["color"]) == ("range", "#336699")
    axes[0, 0].scatter(t, t)
    assert figure_json(figure) is None


@pytest.mark.parametrize(("n", "groups"), [(1000, 10), (1003, 10), (3, 10), (1, 10)])
def test_an_envelope_holds_every_value_and_reaches_its_extremes(n, groups):
    x = np.random.default_rng(2).normal(size=n)
    t, low, high = envelope(np.arange(float(n)), x, groups)
    assert len(t) <= groups + 1 and (low <= high).all() and (low.min(), high.max()) == (x.min(), x.max())
    assert (np.diff(t) > 0.0).all() and t[0] >= 0.0 and t[-1] <= n - 1.0


@pytest.mark.parametrize("limit", [0.0, 0.6, 5.0, 9.4])
def test_the_reason_of_a_refused_window_stands_clear_of_limits_and_curves(limit):
    _, axes = curves()
    axis = axes[0, 0]
    axis.plot([0.0, 10.0], [limit, 9.0])
    axis.axhline(limit)
    axis.set_ylim(0.0, 10.0)
    mark_refused(axis, [{"t_start": 4.0, "t_end": 6.0, "valid": False, "status": "CHANGE"}])
    height = 10.0 * axis.texts[0].get_position()[1]
    assert abs(height - limit) > 0.5 and abs(height - (limit + 0.5 * (9.0 - limit))) > 0.5


def test_a_page_holds_the_library_its_licence_and_nothing_from_elsewhere():
    page = inlined("<style>/* charts.css */</style><script>/* charts.js */</script><p>/* charts.js */</p>")
    for names in MARKS.values():
        for name in names:
            assert (FOLDER / name).read_text(encoding="utf-8") in page
    assert "MIT License" in page and "Copyright (c) 2022 Leon Sorokin" in page
    assert page.endswith("<p>/* charts.js */</p>"), "what a user wrote stands for itself"
    assert page.count("</script") == page.count("</style") == 1, "nothing in them ends them early"
    assert set(re.findall(r"https?://[^\s\"')]+", page)) == {"https://github.com/leeoniya/uPlot"}, "who made it"
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(|@import|url\(|WebSocket", page)


T = 0.01 * np.arange(2000)


def columns(scale: float = 1.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    theta = 0.1 * scale * np.sin(T)
    return {"t": T, "theta": theta + 1e-4 * rng.standard_normal(len(T)),
            "theta_dot": 0.1 * scale * np.cos(T) + 1e-4 * rng.standard_normal(len(T)),
            "beta": 0.02 * scale * np.sin(T + 1.0) + 1e-4 * rng.standard_normal(len(T))}


@pytest.mark.parametrize(("name", "start"), [("look.png", b"\x89PNG"), ("look.svg", b"<?xml"),
                                             ("look.html", b"<!DOCTYPE")])
def test_pictures_and_a_page(name, start, tmp_path, capsys):
    write_columns(tmp_path / "a.csv", columns())
    write_columns(tmp_path / "b.csv", columns(2.0))
    out = tmp_path / name
    assert main(["show", str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(start)
    said = capsys.readouterr().out
    assert said.count("2000 rows") == 2 and said.endswith("drawn\n")
    if name.endswith("html"):
        page = out.read_text(encoding="utf-8")
        chart = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
        assert [panel["series"][0]["label"] for panel in chart["panels"]] == ["a"] * 3
        assert "The data check finds nothing" in page


def test_a_suffix_that_is_no_picture_and_a_log_that_is_not_there(tmp_path):
    write_columns(tmp_path / "a.csv", columns())
    assert main(["show", str(tmp_path / "a.csv"), "--out", str(tmp_path / "look.txt")]) == 2
    assert main(["show", str(tmp_path / "none.csv")]) == 3


# ---- compare, as a command


def test_compare_prints_its_json_alone(tmp_path, capsys):
    assert main(["simulate", "constant", "--out", str(tmp_path / "a.csv"), "--seed", "3"]) == 0
    capsys.readouterr()
    assert main(["compare", str(tmp_path / "a.csv"), "constant", "--flights", "4", "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["nominals"][0]["nominal"] == "constant"
    assert said["nominals"][0]["channels"]["theta"]["percentile"]["peak"] in (0.0, 0.25, 0.5, 0.75, 1.0)
    assert main(["compare", str(tmp_path / "a.csv"), "constant", "--flights", "-1"]) == 2
    assert main(["compare", str(tmp_path / "a.csv"), "no_such_nominal"]) == 3

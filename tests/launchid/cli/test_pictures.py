"""The pictures: what sets their scale, what is marked at the edge, what stands beside them; the residuals' numbers.

Curves on a page: what of a figure is drawn again by the browser, and that a page holds all it needs.

`launchid show`: logs drawn over each other, with what the data check finds; and `compare` as a command.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.cli.main import main
from launchid.commands.identify import Identification
from launchid.commands.identify import identify as identified
from launchid.figures.logs import logs_figure, looked_at
from launchid.log.check import ideal_note
from launchid.log.log import Log, flown_log, log_of, read_log, write_columns, write_flight
from launchid.results import residuals as rs
from sim.errors import InputError
from sim.flight import fly_whole

pytest.importorskip("matplotlib", reason="matplotlib is not installed: no figures")

from matplotlib.figure import Figure

from launchid.charts import FOLDER, MARKS, inlined
from launchid.charts.figure import figure_json
from launchid.results import figures

WINDOWS = 12


def window(k: int, a6: float, a6_std: float, **other) -> dict:
    """A window of the identify JSON."""
    given = {"t_start": 5.0 * k, "t_end": 5.0 * k + 5.0, "valid": True, "status": "OK", "a6": a6, "a6_std": a6_std,
             "k1": -7.0, "k1_std": 0.1, "a6_bound": 0.8 * a6_std, "k1_bound": 0.08, "terms": {}, "wind": None,
             "wind_std": None}
    return given | other


def a_log(seconds: float = 60.0) -> Log:
    t = np.arange(0.0, seconds, 0.01)
    none = np.full(len(t), np.nan)
    return Log("log.csv", ("t", "theta", "beta"), (), t, np.sin(t), none, np.cos(t), none, none, none)


def drawn(windows: list[dict], nominal=None, **report):
    figure = figures.identify_figure(a_log(), {"windows": windows, **report}, nominal)
    figure.canvas.draw()
    return figure


def labels(axis) -> set[str]:
    legend = axis.get_legend()
    return set() if legend is None else {text.get_text() for text in legend.get_texts()}


# ---- identify


def test_a_change_is_a_line_with_its_numbers_and_breaks_the_tracked_line():
    tracked = [{"valid": True, "a6": 2.0, "a6_std": 0.01, "k1": k1, "k1_std": 0.01, "wind": None, "wind_std": None}
               for k1 in [-8.0] * 6 + [-5.7] * 6]
    change = {"t": 30.0, "t_std": 0.015, "parameter": "k1", "before": -8.0, "after": -5.7, "size": 2.3,
              "size_std": 0.07}
    windows = [window(k, 2.0, 0.1, tracked=each) for k, each in enumerate(tracked)]
    figure = drawn(windows, changes=[change])
    assert any(text.startswith("sudden change at 30.000 +- 0.015 s, size 2.300 +- 0.070")
               for text in labels(figure.axes[1]))
    assert not any("sudden" in text for text in labels(figure.axes[0]))
    line, = (line for line in figure.axes[1].lines if len(line.get_xdata()) == WINDOWS + 1)
    assert np.isnan(line.get_ydata()[6]) and np.isfinite(np.delete(line.get_ydata(), 6)).all()


def test_refused_windows_say_why_and_a_bound_is_drawn_where_there_is_one():
    nothing = {"valid": False, "a6": None, "a6_std": None, "k1": None, "k1_std": None, "a6_bound": None,
               "k1_bound": None}
    axis = drawn([window(0, 2.0, 0.1), window(1, 0.0, 0.0, status="SEPARATION") | nothing]).axes[0]
    assert "SEPARATION" in [text.get_text() for text in axis.texts]
    assert {"refused, with the reason", "Cramer-Rao bound of it, 95 %"} <= labels(axis)
    figure = drawn([window(0, 0.0, 0.0, status="MODEL") | nothing], why="no window of this log is valid: X")
    assert "no window of this log is valid: X" in figure.axes[-1].get_xlabel()
    assert not any("95 %" in text for text in labels(figure.axes[0]))


# ---- uncertainty, and the paper's figures


@pytest.mark.parametrize(("library", "panels"), [
    ("beta,theta_dot", ["k1", "theta", "beta"]), ("theta", ["a6", "theta", "beta"]), ("theta_dot", ["theta", "beta"])])
def test_a_parameter_whose_term_the_library_lacks_has_no_panel(library, panels):
    made = identified(replace(a_log(), theta_dot=np.cos(a_log().t)), window=5.0, library=library)
    assert [axis.get_ylabel().split(" ")[0] for axis in made._figure().axes] == panels


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


@pytest.mark.parametrize("draw", [
    lambda axis: axis.bar([1.0], [2.0]), lambda axis: axis.errorbar([1.0], [2.0], [0.1]),
    lambda axis: axis.imshow(np.eye(3)), lambda axis: axis.fill_between([0.0, 1.0], 0.0, 1.0)])
def test_what_is_no_curve_stays_a_picture(draw):
    figure, ((axis,),) = curves()
    draw(axis)
    assert figure_json(figure) is None
    assert figure_json(Figure()) is None


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


def crosses(axis) -> list[np.ndarray]:
    return [line.get_xdata() for line in axis.lines if line.get_marker() == "x"]


def test_each_log_has_a_line_in_each_panel_and_its_name_once():
    logs = [log_of(columns(k), f"{name}.csv") for k, name in ((1.0, "one"), (2.0, "two"))]
    figure = logs_figure([looked_at(log) for log in logs])
    assert [axis.get_ylabel() for axis in figure.axes] == ["theta [rad]", "beta [rad]", "theta_dot [rad/s]"]
    for axis in figure.axes:
        assert [text.get_text() for text in axis.get_legend().get_texts()] == ["one", "two"]
        assert len({(line.get_color(), line.get_linestyle()) for line in axis.lines}) == 2
        assert not crosses(axis)


def test_a_column_in_another_unit_is_grey_and_named():
    given = columns()
    degrees = looked_at(log_of(given | {"theta_dot": np.degrees(given["theta_dot"])}))
    assert [fault.kind for fault in degrees.faults] == ["unit"]
    titles = {axis.get_ylabel(): axis.get_title(loc="right") for axis in logs_figure([degrees]).axes}
    assert titles == {"theta [rad]": "", "beta [rad]": "", "theta_dot [rad/s]": "hatched: unit?"}


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

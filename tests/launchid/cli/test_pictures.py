"""The pictures: what sets their scale, what is marked at the edge, what stands beside them; the residuals' numbers."""

from dataclasses import replace

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.cli.main import main
from launchid.commands.identify import Identification
from launchid.commands.identify import identify as identified
from launchid.log.check import ideal_note
from launchid.log.log import Log, flown_log, read_log, write_flight
from launchid.results import residuals as rs
from sim.errors import InputError
from sim.flight import fly_whole

pytest.importorskip("matplotlib", reason="matplotlib is not installed: no figures")

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

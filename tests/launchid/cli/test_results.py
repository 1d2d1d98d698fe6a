"""Every result of `import launchid`: summary, plot, frame and a notebook's page, one test a result; what was identified
as python-control's systems.
"""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.log.log import flown_log
from sim.flight import fly_whole
from sim.nominal import load_nominal, write_nominal
from sim.result import NOTEBOOK_ROWS

pytest.importorskip("matplotlib", reason="matplotlib is not installed: no figures")
pandas = pytest.importorskip("pandas", reason="pandas is not installed: no frames")

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A nominal of 12 s, and its log."""
    path = tmp_path_factory.mktemp("results")
    write_nominal(short(12.0), path / "n.toml")
    launchid.simulate(path / "n.toml", seed=3).write(path / "log.csv")
    return path


def reversed_log(folder: Path) -> dict[str, Any]:
    """A log whose nozzle has the other sign: the data check says it, no search is made."""
    columns = launchid.read_log(folder / "log.csv").measured()
    return columns | {"beta": -columns["beta"]}


RESULTS: dict[str, tuple[Callable[[Path], Any], str]] = {  # how it is made, a word of its first line
    "identify": (lambda f: launchid.identify(f / "log.csv", f / "n.toml", window=3, tracked=True), "window 3 s"),
    "uncertainty": (lambda f: launchid.uncertainty(f / "log.csv", f / "n.toml", window=3), "delta of a"),
    "margins": (lambda f: launchid.margins(f / "log.csv", f / "n.toml", window=4), "margins"),
    "compare": (lambda f: launchid.compare(f / "log.csv", f / "n.toml", flights=4), "measured beside n"),
    "diagnose": (lambda f: launchid.diagnose(reversed_log(f), f / "n.toml"), "BAD DATA"),
    "fit_lft": (lambda f: launchid.fit_lft([f / "log.csv"], f / "n.toml"), "range"),
    "simulate": (lambda f: launchid.simulate(f / "n.toml", seed=1), "1200 rows"),
    "plan": (lambda f: launchid.plan(f / "n.toml", accuracy=0.02, window=3), "bound"),
    "export_c": (lambda f: launchid.export_c(f / "n.toml", window=2, formulation="integral"), "launchid.c"),
    "campaign": (lambda f: launchid.campaign(f / "n.toml", out=f / "campaign", flights=2, workers=1), "2"),
    "load_nominal": (lambda f: launchid.load_nominal(f / "n.toml"), "constant: a6 2, k1 -7 1/s^2"),
    "read_log": (lambda f: launchid.read_log(f / "log.csv"), "1200 rows over 11.99 s, 0.01 s apart")}


@functools.cache
def made(name: str, folder: Path) -> Any:
    return RESULTS[name][0](folder)


def test_every_function_is_in_the_list():
    functions = {name for name in launchid.__all__ if callable(getattr(launchid, name))
                 and not isinstance(getattr(launchid, name), type) and name.islower()} - {"onboard_model"}
    assert functions == set(RESULTS)


@pytest.mark.parametrize("name", RESULTS)
def test_its_summary_is_text_and_its_first_line_says_what_it_is(folder, name):
    first = made(name, folder).summary().splitlines()[0]
    assert RESULTS[name][1] in first


@pytest.mark.parametrize("name", RESULTS)
def test_its_frame_has_a_row_for_each_of_its_parts(folder, name):
    frame = made(name, folder).to_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame.columns) >= 2 and (len(frame) > 0) == (name != "diagnose"), "no cause is named of bad data"


TEXTS = {"status", "a6_band", "k1_band"}


@pytest.mark.parametrize("found", [launchid.identify, launchid.uncertainty])
def test_a_frame_without_a_valid_window_has_numbers_that_are_nan(folder, found):
    """A log that stands still: nothing is known of it, and its columns are still those of numbers."""
    still = {"t": 0.01 * np.arange(600), "theta": np.zeros(600), "beta": np.zeros(600)}
    made = found(still, folder / "n.toml", window=2)
    frame = made.to_frame()
    assert len(frame) == 3 and not frame["valid"].any()
    assert {name for name, kind in frame.dtypes.items() if not pandas.api.types.is_numeric_dtype(kind)} <= TEXTS
    assert all(frame[name].isna().all() for name in frame.columns if name.startswith(("a6_d", "k1_s", "wind")))


@pytest.mark.parametrize("name", RESULTS)
def test_it_is_drawn_into_a_file_and_on_a_page(folder, tmp_path, name):
    figure = made(name, folder).plot(tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(PNG)
    assert figure.axes and all(axis.get_ylabel() or axis.get_xlabel() or axis.get_title() for axis in figure.axes)
    if name == "read_log":  # a page is drawn as a file is, and a suffix refused, whatever the result
        assert figure._repr_png_().startswith(PNG)
        with pytest.raises(launchid.UsageError, match="png"):
            made(name, folder).plot(tmp_path / "x.txt")


@pytest.mark.parametrize("name", RESULTS)
def test_a_notebook_shows_its_first_line_and_a_short_table(folder, name):
    result = made(name, folder)
    page = result._repr_html_()
    assert page.startswith("<p><b>") and "<table>" in page and "<script" not in page
    assert page.count("<tr>") == min(len(result.to_frame()), NOTEBOOK_ROWS) + 1


# ---- a log and a nominal


pytest.importorskip("control")


@pytest.fixture(scope="module")
def found():
    return launchid.identify(flown_log(fly_whole(load_nominal("constant"), 1)), window=5.0, formulation="integral")


def test_the_systems_are_the_windows(found):
    window = [e for e in found.estimates if e.valid][-1]
    plant = found.to_control()
    assert plant.t == 0.5 * (window.t_start + window.t_end)
    assert np.sort(plant.state_space.poles().real) == pytest.approx([-window.a6**0.5, window.a6**0.5])
    omega = np.array([0.5, 3.0, 10.0])
    expected = window.k1 / (-omega**2 - window.a6)
    assert plant.transfer_function(1j * omega) == pytest.approx(expected)
    assert plant.state_space(1j * omega)[0, 0] == pytest.approx(expected)
    assert plant.state_space.input_labels == ["beta"] and plant.state_space.output_labels == ["theta", "theta_dot"]


def test_its_covariance_is_the_estimates(found):
    window = next(e for e in found.estimates if e.valid)
    plant = found.to_control(window.t_start)
    assert np.sqrt(np.diag(plant.covariance)) == pytest.approx([window.a6_std, window.k1_std])
    assert plant.covariance[0, 1] == pytest.approx(window.a6_k1_corr * window.a6_std * window.k1_std)


def test_a_time_without_a_valid_window_is_refused(found):
    with pytest.raises(launchid.InputError, match="no window is valid at 1000 s"):
        found.to_control(1000.0)


def test_terms_of_no_linear_plant_are_refused():
    flight = flown_log(fly_whole(load_nominal("constant"), 1))
    found = launchid.identify(flight, window=20.0, formulation="integral", library="sin(theta),beta")
    with pytest.raises(launchid.UsageError, match="sin"):
        found.to_control()

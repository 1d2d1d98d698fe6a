"""How far a run is, on a terminal and in a file; and the pages of `identify` and `margins`."""

import io
import json

import pytest
from shortened import short
from test_diagnosis_report import Page

import launchid
from launchid import progress
from launchid.cli import terminal
from launchid.main import main
from sim.flight import fly_whole
from sim.nominal import load_nominal


class Stream(io.StringIO):
    """A stderr that may be a terminal."""

    def __init__(self, is_terminal: bool) -> None:
        super().__init__()
        self.is_terminal = is_terminal

    def isatty(self) -> bool:
        return self.is_terminal


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets."""
    now = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(terminal.Progress, "LINE", 10.0)  # s; other tests have none
    return now


def run_of(clock, monkeypatch, is_terminal: bool, seconds: int, is_quiet: bool = False) -> str:
    """What is written of a run in which a unit of work takes a second."""
    stream = Stream(is_terminal)
    monkeypatch.setattr(terminal.sys, "stderr", stream)
    with terminal.progress_shown(is_quiet):
        for _ in progress.each(range(seconds), "windows"):
            clock[0] += 1.0
    return stream.getvalue()


def test_a_file_gets_a_line_every_ten_seconds_with_how_far_it_is(clock, monkeypatch):
    assert run_of(clock, monkeypatch, False, 35).splitlines() == [
        "launchid: windows: 10 of 35", "launchid: windows: 20 of 35", "launchid: windows: 30 of 35"]


def test_a_terminal_shows_one_line_that_is_taken_off_at_the_end(clock, monkeypatch):
    shown = run_of(clock, monkeypatch, True, 4)
    assert "\n" not in shown and shown.endswith("\r\x1b[K")
    assert "[##########..........] windows: 2 of 4, 2 s left" in shown


def test_quiet_says_nothing(clock, monkeypatch):
    for is_terminal in (False, True):
        assert run_of(clock, monkeypatch, is_terminal, 35, is_quiet=True) == ""


# ---- pages


def words_of(path) -> str:
    """The words of a page, whose tags must be balanced and which loads nothing."""
    page = Page(path.read_text(encoding="utf-8"))
    assert page.open == page.faults == [] and all(link.startswith(("data:", "#")) for link in page.links)
    return page.words


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "flight.csv"
    launchid.simulate(short(15.0), seed=4).write(path)
    return path


@pytest.mark.parametrize(("command", "pictures"), [
    ("identify", {"identify.png", "residuals.png", "log.png"}), ("margins", {"margins.png"})])
def test_a_report_is_one_page_with_the_answer_and_its_figures(log, tmp_path, capsys, command, pictures):
    pytest.importorskip("matplotlib")
    folder = tmp_path / "report"
    assert main([command, str(log), "constant", "--window", "5", "--tracked", "--report", str(folder),
                 "--json", str(tmp_path / "answer.json"), "--quiet"]) == 0
    assert {path.name for path in folder.iterdir()} == {"report.html", f"{command}.json"} | pictures
    said = json.loads((folder / f"{command}.json").read_text())
    assert said == json.loads((tmp_path / "answer.json").read_text())
    words = words_of(folder / "report.html")
    for window in said["windows"]:
        assert f"{window['t_start']:g} .. {window['t_end']:g}" in words
    assert capsys.readouterr().err == ""


def test_a_report_of_a_log_without_a_window_says_why(tmp_path):
    flight = fly_whole(load_nominal("constant"), seed=1)
    short = {name: getattr(flight, name)[:120] for name in ("t", "theta", "theta_dot", "beta", "beta_cmd")}
    launchid.identify(short, "constant", window=5.0).write_report(tmp_path / "report")
    words = words_of(tmp_path / "report" / "report.html")
    assert "0 of 0 windows are valid" in words and "expected a longer log" in words

"""The report: whole, self-contained, the same bytes twice, readable by a browser; every verdict has one."""

import base64
import json
import os
import shutil
import signal
import subprocess
import time
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.commands.diagnose import Diagnosed
from launchid.diagnosis.answer import extension
from launchid.diagnosis.answer import report as json_of
from launchid.diagnosis.named import Result
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import OPTIONAL, REQUIRED, Log
from launchid.report.diagnosis_page import write_report
from launchid.report.inline import FOLDER
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import load_nominal

DURATION = 20.0        # s
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "headless_shell")
PATIENCE = 30.0        # s for a browser to load a page
LOADED = "the page is loaded"
VOID = {"meta", "link", "img", "br", "hr"}
EXPECTED = {
    "consistent": {"misfit.png", "innovations.png"},
    "explained": {"misfit.png", "innovations.png", "worth.png", "comparison.png", "responses.png"},
    "unexplained": {"misfit.png", "innovations.png", "worth.png"},
    "bad-data": {"faults.png"}}
REMAINING = "a disturbance of unknown shape at the plant explains 19 nats more"


def measured(effects=(), in_degrees=False, name="<flight & test>.csv"):
    """A short flight as a log; in_degrees: its theta_dot."""
    nominal = short(DURATION)
    flight = fly_whole(nominal, 1, effects=effects)
    columns = ("t", "theta", "theta_dot", "beta", "beta_cmd", "theta_ref")
    arrays = {column: getattr(flight, column).copy() for column in columns}
    if in_degrees:
        arrays["theta_dot"] = np.degrees(arrays["theta_dot"])
    return Log(name, columns, (), theta_ddot=np.full(len(flight.t), np.nan), **arrays), nominal


@pytest.fixture(scope="module")
def explained() -> Diagnosed:
    """A loss of control that is named."""
    return launchid.diagnose(*measured([effect("control_loss", fraction=0.4, time=10.0)]))


@pytest.fixture(scope="module")
def diagnoses(explained) -> dict[str, Result]:
    """One of each verdict; dominant and unexplained are the explained one, said so."""
    one = explained.diagnosis
    found = {each.verdict: each for each in (one, diagnose(*measured()), diagnose(*measured(in_degrees=True)))}
    found["dominant"] = replace(one, verdict="dominant", remaining=(REMAINING,), share=0.2, remaining_where="plant")
    found["unexplained"] = replace(one, verdict="unexplained", named=(), nearest=one.named, doubts=(REMAINING,))
    return found


@pytest.fixture(scope="module")
def folders(explained, diagnoses, tmp_path_factory) -> dict[str, Path]:
    """The reports, written; the explained one as a user writes it, with the log beside nominal and extension."""
    top = tmp_path_factory.mktemp("reports")
    found = {verdict: top / verdict / "new" for verdict in EXPECTED}
    explained.write_report(found["explained"])
    for verdict in EXPECTED.keys() - {"explained"}:
        write_report(diagnoses[verdict], json_of(diagnoses[verdict]), str(found[verdict]))
    return found


class Page(HTMLParser):
    """Open and closed tags, what it links to, its images and its words."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.faults: list[str] = []
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.tags: set[str] = set()
        self.words = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.tags.add(tag)
        self.links += [given[key] for key in ("src", "href") if key in given]
        self.ids |= {given["id"]} if "id" in given else set()
        if tag == "img" and not given.get("alt"):
            self.faults.append("an image without words")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}>")

    def handle_data(self, data):
        self.words += data


def read(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.mark.parametrize("verdict", EXPECTED)
def test_a_report_is_one_balanced_page_that_needs_nothing_else(folders, verdict):
    page = read(folders[verdict])
    assert page.faults == [] and page.open == []
    assert not page.tags & {"iframe", "object", "embed"}
    inside = [link for link in page.links if link.startswith("#")]
    assert {link[1:] for link in inside} <= page.ids
    assert all(link.startswith("data:") or link == "extension.toml" for link in page.links if link not in inside)
    html = (folders[verdict] / "report.html").read_text(encoding="utf-8")
    for name in ("uPlot.iife.min.js", "uPlot.min.css"):   # whose comments and namespaces hold addresses
        html = html.replace((FOLDER / name).read_text(encoding="utf-8"), "")
    assert "http:" not in html and "https:" not in html and "url(" not in html and "@import" not in html


@pytest.mark.parametrize("verdict", EXPECTED)
def test_every_figure_is_a_png_in_the_folder_and_in_the_page(folders, verdict):
    image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed: no figures")
    written = {path.name for path in folders[verdict].glob("*.png")}
    assert written == EXPECTED[verdict]
    files = {(folders[verdict] / name).read_bytes() for name in written}
    head = "data:image/png;base64,"
    embedded = [base64.b64decode(link[len(head):], validate=True) for link in read(folders[verdict]).links
                if link.startswith(head)]
    assert set(embedded) == files and len(embedded) == len(files)
    for name in written:
        pixels = image.imread(folders[verdict] / name)
        assert min(pixels.shape[:2]) > 80 and float(np.std(pixels[..., :3])) > 0.01, f"{name} is empty"


def test_the_first_screen_says_verdict_cause_size_and_doubt(folders, diagnoses, tmp_path):
    pages = {verdict: read(folder) for verdict, folder in folders.items()}
    write_report(diagnoses["dominant"], json_of(diagnoses["dominant"]), tmp_path / "dominant")
    pages["dominant"] = read(tmp_path / "dominant")
    words = {verdict: " ".join(page.words.split()) for verdict, page in pages.items()}
    assert all("<flight & test>.csv" in said for said in words.values())
    assert "EXPLAINED (plant): control_loss" in words["explained"] and "fraction 0." in words["explained"]
    assert "Measured beside simulated" in words["explained"] and "extension" in words["explained"]
    assert "UNEXPLAINED" in words["unexplained"] and REMAINING in words["unexplained"]
    assert "20 % remain" in words["dominant"] and REMAINING in words["dominant"]
    assert "CONSISTENT" in words["consistent"] and "would have shown" in words["consistent"]
    fault, = diagnoses["bad-data"].reading.data.faults
    assert "BAD DATA" in words["bad-data"] and fault.message in words["bad-data"]


def test_a_log_too_short_for_a_model_has_a_report(tmp_path):
    log, nominal = measured()
    few = replace(log, **{name: getattr(log, name)[:30] for name in (*REQUIRED, *OPTIONAL)})
    made = diagnose(few, nominal)
    write_report(made, json_of(made), str(tmp_path))
    assert made.verdict == "unexplained" and read(tmp_path).faults == []


@pytest.mark.parametrize("verdict", EXPECTED)
def test_the_json_is_the_commands_and_nothing_half_written_is_left(folders, diagnoses, verdict):
    written = json.loads((folders[verdict] / "verdict.json").read_text())
    known = json.loads(json.dumps(json_of(diagnoses[verdict])))
    assert {name: written[name] for name in known} == known and written.keys() - known <= {"headline", "next"}
    assert [path.name for path in folders[verdict].iterdir() if path.name.startswith(".")] == []
    assert (folders[verdict] / "extension.toml").exists() == (verdict == "explained")


def test_the_extension_reads_back(folders, diagnoses):
    made = diagnoses["explained"]
    read_back = load_nominal(folders["explained"] / "extension.toml")
    assert [of.name for of in read_back.effects] == ["control_loss"]
    assert read_back.effects == extension(made).effects and read_back.controller == made.nominal.controller


def test_the_same_diagnosis_gives_the_same_bytes(folders, diagnoses, tmp_path):
    write_report(diagnoses["unexplained"], json_of(diagnoses["unexplained"]), str(tmp_path))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == sorted(path.name for path in folders["unexplained"].iterdir())
    for name in names:
        assert (tmp_path / name).read_bytes() == (folders["unexplained"] / name).read_bytes(), name


def test_what_an_earlier_report_left_is_removed(diagnoses, tmp_path):
    for name in ("extension.toml", "worth.png"):
        (tmp_path / name).write_text("old")
    (tmp_path / "mine.txt").write_text("not of a report")
    write_report(diagnoses["bad-data"], json_of(diagnoses["bad-data"]), str(tmp_path))
    left = {path.name for path in tmp_path.iterdir()}
    assert left - {"faults.png"} == {"mine.txt", "report.html", "verdict.json"}


def test_a_log_without_nozzle_command_and_reference_has_a_report(tmp_path):
    """The log has theta alone beside beta: no closed loop, no controller check, no actuator."""
    log, nominal = measured()
    none = np.full(len(log.t), np.nan)
    made = diagnose(replace(log, beta_cmd=none, theta_ref=none, theta_dot=none), nominal)
    write_report(made, json_of(made), str(tmp_path))
    page = read(tmp_path)
    assert page.faults == [] and "Not checked" in page.words


# ---- in a browser


def browser() -> str:
    for name in BROWSERS:
        found = shutil.which(name)
        if found:
            return found
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        pytest.skip(f"no browser to look with: none of {', '.join(BROWSERS)} in PATH and no playwright")
    with sync_playwright() as player:
        path = player.chromium.executable_path
    if not Path(path).exists():
        pytest.skip("playwright is here, but its Chromium is not installed")
    return path


def console(page: Path, profile: Path) -> list[str]:
    """The lines of the browser's console while it loads a page, up to a last line of the page's own."""
    command = [browser(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
               f"--user-data-dir={profile}", "--enable-logging=stderr", "--virtual-time-budget=3000", "--dump-dom",
               page.as_uri()]
    said = profile.with_suffix(".log")
    with said.open("wb") as out:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=out, start_new_session=True)
    try:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and LOADED.encode() not in said.read_bytes():
            time.sleep(0.1)
    finally:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()
    return [line for line in said.read_text(errors="replace").splitlines() if "CONSOLE" in line]


def with_last_line(page: Path, to: Path) -> Path:
    """The page and a script at its end that tells the console when all images have been decoded."""
    last = ("<script>window.addEventListener('load', () => {"
            "for (const i of document.images) if (!i.naturalWidth) console.error('broken image ' + i.alt);"
            f"console.log('{LOADED}')}})</script></body>")
    to.write_text(page.read_text(encoding="utf-8").replace("</body>", last), encoding="utf-8")
    return to


@pytest.mark.parametrize("verdict", ["explained", *(pytest.param(verdict, marks=pytest.mark.campaign)
                                                   for verdict in ("unexplained", "bad-data"))])
def test_chromium_shows_it_without_a_console_error(folders, tmp_path, verdict):
    said = console(with_last_line(folders[verdict] / "report.html", tmp_path / "page.html"), tmp_path / "profile")
    assert len(said) == 1 and LOADED in said[0], said

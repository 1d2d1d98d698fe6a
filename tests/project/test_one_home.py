"""Each concept has one home: the name that is defined there, and what marks a second one elsewhere.

`python tests/project/test_one_home.py` prints the homes with file and line.
"""

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
ABOVE = sorted([*(ROOT / "sim").rglob("*.py"), *(ROOT / "launchid").rglob("*.py")])


class Home(NamedTuple):
    """A concept: file and name where it is defined, a pattern of its second homes, and files that may hold that."""

    concept: str
    file: str
    name: str
    pattern: str = ""
    others: tuple[str, ...] = ()


HOMES = (
    Home("a value with its standard deviation in words", "launchid/formatting.py", "with_std",
         r":\.\d[fge]\} \+- \{"),
    Home("a number for JSON", "launchid/formatting.py", "json_number", r"float\(\w+\) if .*isfinite\(\w+\) else None"),
    Home("a result's JSON as text", "launchid/report/answer.py", "json_text", r"json\.dumps\([^\n]*indent=",
         ("launchid/monte_carlo/requirement/folder.py",)),   # a campaign's definition, which is read again
    Home("what a command returns", "launchid/report/answer.py", "Answer"),
    Home("a page", "launchid/report/page.py", "page", r"<section|<figure"),
    Home("a report's folder", "launchid/report/folder.py", "write_report", r"REPORT_FILE = "),
    Home("a figure as curves that zoom", "launchid/report/curves.py", "figure_json", r"get_subplotspec"),
    Home("a figure as a file", "sim/canvas.py", "save", r"savefig\(|print_figure\("),
    Home("headline and next command", "launchid/report/headline.py", "closing"),
    Home("95 % in figures", "launchid/report/drawing.py", "INTERVAL"),
    Home("units of a log's columns", "launchid/log/table.py", "UNITS", r"\"theta_dot\": \"rad/s\"",
         ("launchid/c_export/kit.py", "launchid/first_nominal/write.py")),   # of the port's sample; of all numbers
    Home("tail and quantiles of chi square", "launchid/chi_square.py", "quantile", r"lgamma\(|Hilferty|9\.0 \* free"),
    Home("segments of averaged spectra", "launchid/spectra.py", "segments"),
    Home("lines over what was not measured", "launchid/series.py", "filled",
         r"np\.interp\(\w[^,\n]*, \w+\[(known|good|there|np\.isfinite)"),
    Home("white noise by differences", "launchid/series.py", "white_variance",
         r"np\.diff\(\w+(\[\w+\])?, (n=)?3\b|/ 20\.0\b|0\.6745|1\.4826",
         ("launchid/bound/step.py",)),   # h^5 / 20 of an integrated noise
    Home("input of another time (placebo)", "launchid/placebo.py", "is_placebo", r"np\.roll\("),
    Home("forward and backward selection", "launchid/selection.py", "step_by_step"),
    Home("sums in one order on every machine", "launchid/sums.py", "least_squares", r"np\.linalg\.qr\("),
    Home("the data check", "launchid/log/check.py", "checked"),
    Home("a log on a grid", "launchid/log/record.py", "Record"),
    Home("the likelihood of vehicle, servo, air and sensors", "launchid/likelihood/likelihood.py", "run"),
    Home("the tests that refuse a window", "launchid/judge/table.py", "TESTS"),
    Home("from a log to judged windows", "launchid/identification/log.py", "identified_log"),
    Home("a nominal's controller replayed", "launchid/controller/replay.py", "run_controller"),
    Home("the regression in modes", "launchid/weakform/modes.py", "term_modes"),
    Home("the estimator's model from a nominal", "sim/onboard.py", "onboard_model"),
    Home("a6 and k1 of a flight", "sim/plant.py", "parameters"),
    Home("a servo's step without input", "sim/vehicle/actuator.py", "free_servo"),
    Home("a gust of one minus cosine", "sim/effects/environment.py", "gust_angle", r"1\.0 - (np|math)\.cos\("),
    Home("a cause, with its equation", "sim/effects/table.py", "Cause"),
    Home("the decorators of compiled code", "sim/kernels.py", "kernel", r"numba\.njit|from numba"),
)


def line_of(home: Home) -> int | None:
    """The line in which the concept is defined, at the top level of its file; None if it is not."""
    for node in ast.parse((ROOT / home.file).read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else ()
        names = [target.id for target in targets if isinstance(target, ast.Name)]
        if home.name in (*names, getattr(node, "name", "")):
            return node.lineno
    return None


@pytest.mark.parametrize("home", HOMES, ids=lambda home: home.concept)
def test_a_concept_has_one_home(home):
    assert line_of(home) is not None
    second = [f"{path.relative_to(ROOT)}:{k}" for path in ABOVE if home.pattern
              and str(path.relative_to(ROOT)) not in (home.file, *home.others)
              for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
              if re.search(home.pattern, line)]
    assert second == []


if __name__ == "__main__":
    for each in HOMES:
        print(f"{each.concept}: {each.file}:{line_of(each)} ({each.name})")

"""Write the report of identify: a table of windows, lines for the user, and figures."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.errors import InputError

from ..formatting import with_std
from .folder import Picture, paragraphs, write_report
from .headline import closing
from .page import table, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..commands.identify import Identification

COEFFICIENTS = ("a6", "k1")
IDENTIFY_WORDS = (
    ("window", "an interval of the flight that is estimated from its own samples only"),
    ("tracked", "the estimate from all samples so far, at the window's end"),
    ("+-", "one standard deviation; figures show 95 % intervals, 1.96 of them to each side"),
    ("OK", "the window's numbers may be used; every other status says why they may not, and is hatched in the figure"),
    ("whiteness", "the probability that residuals as correlated as these come from white noise: below 0.001 the model "
                  "lacks something"),
    ("predicts", "the share of the variance of left-out rows that the model explains"))


def _number(x: float | None) -> str:
    return "-" if x is None or not np.isfinite(x) else f"{x:.3g}"


def identify_report(found: "Identification", folder: str | Path) -> None:
    """Write report.html, identify.json and the figures of an identification into a folder."""
    windows = found.report["windows"]
    is_tracked = any("tracked" in window for window in windows)
    head = ["window [s]", "status", *(f"{name} [1/s^2]" for name in COEFFICIENTS),
            *(f"{name} tracked [1/s^2]" for name in COEFFICIENTS if is_tracked), "terms", "predicts", "whiteness"]
    rows = [[f"{window['t_start']:g} .. {window['t_end']:g}", text(window["status"]), *_coefficients(window),
             *(_coefficients(window.get("tracked", {})) if is_tracked else ()), text(", ".join(window["terms"])),
             *(_number(window["fit"][name]) for name in ("r2_held_out", "whiteness"))] for window in windows]
    valid, last = sum(window["valid"] for window in windows), closing(found.report)
    lines = [line for line in found.summary().splitlines()[1:] if not line[:1].isspace() and line not in last]
    first = f"<p>{valid} of {len(windows)} windows are valid.</p>" \
        + paragraphs([*last[1:], *lines, *found.warnings]) + table(head, rows, [False] * len(rows))
    pictures = {
        "identify.png": Picture("Estimates over the flight",
            "Dots: windows, with 95 % intervals; line and band: tracked; dashed: the nominal. Hatched: windows "
            "that may not be used.", found._figure),
        "residuals.png": Picture("What the windows leave",
            "Above: residuals over time, and their correlation, which is inside the band where they are white. Below: "
            "predictions from the windows' numbers, beside the log.", lambda: _residuals(found)),
        "log.png": Picture("The log", "The columns as they were read.", lambda: _columns(found))}
    nominal = "the log alone" if found.nominal is None else f"nominal {found.nominal.name}"
    write_report(folder, found.report["headline"], f"launchid identify: a6 and k1 of {Path(found.log.path).name}, "
                 f"{found.config.formulation}, windows of {found.config.window:g} s, {nominal}", first,
                 [("Figures", [pictures])], ("identify.json", found.to_json()), glossary=IDENTIFY_WORDS)


def _coefficients(window: dict[str, Any]) -> list[str]:
    return [text(with_std(window.get(name), window.get(f"{name}_std"))) for name in COEFFICIENTS]


def _residuals(found: "Identification") -> "Figure | None":
    try:
        return found.residuals()
    except InputError:  # no window has any
        return None


def _columns(found: "Identification") -> "Figure":
    from .log_figures import logs_figure, looked_at
    return logs_figure([looked_at(found.log)])

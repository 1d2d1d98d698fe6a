"""Write the reports of `identify` and `margins`: a table of windows, lines for the user, and figures."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.errors import InputError
from sim.sections import Required

from ..formatting import with_std
from ..robustness.flight_margins import MARGIN_NAMES, closing_lines, gain_lines, heads, margin_words
from .folder import Picture, paragraphs, write_report
from .headline import closing
from .page import table, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..commands.identify import Identification
    from ..commands.margins import FlightMargins

COEFFICIENTS = ("a6", "k1")
IDENTIFY_WORDS = (
    ("window", "an interval of the flight that is estimated from its own samples only"),
    ("tracked", "the estimate from all samples so far, at the window's end"),
    ("+-", "one standard deviation; figures show 95 % intervals, 1.96 of them to each side"),
    ("OK", "the window's numbers may be used; every other status says why they may not, and is hatched in the figure"),
    ("whiteness", "the probability that residuals as correlated as these come from white noise: below 0.001 the model "
                  "lacks something"),
    ("predicts", "the share of the variance of left-out rows that the model explains"))
MARGIN_WORDS = (
    ("gain, low", "how far the loop's gain may fall before the vehicle is unstable (aerodynamic margin)"),
    ("gain, high", "how far the loop's gain may rise before the vehicle is unstable"),
    ("phase", "the smallest phase margin of all crossovers"),
    ("delay", "the delay that the loop still bears"),
    ("modulus margin", "the least distance |1 + L| from the critical point; its inverse Ms is the largest sensitivity"),
    ("disk margin", "2 min |1 + L|/|1 - L|: gain and phase may move at once, by any factor of that disk"),
    ("P(stable)", "the probability that the loop as identified is stable"),
    ("interval", "95 %, from the covariance of a6, k1 and the servo's numbers"))


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
    first = f"<p><b>{text(found.report['headline'])}</b></p><p>{valid} of {len(windows)} windows are valid.</p>" \
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
    write_report(folder, f"a6 and k1 of {Path(found.log.path).name}", f"launchid identify: {found.config.formulation}, "
                 f"windows of {found.config.window:g} s, {nominal}", first, [("Figures", [pictures])],
                 ("identify.json", found.to_json()), glossary=IDENTIFY_WORDS)


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


def margins_report(found: "FlightMargins", folder: str | Path) -> None:
    """Write report.html, margins.json and the figure of a flight's margins into a folder."""
    said = found.report
    rows, chosen = [], []
    for window in said["windows"]:
        for of, one in (("window", window), *((("tracked", window["tracked"]),) if "tracked" in window else ())):
            stable = one["stable"]["probability"]
            rows.append([f"{window['t_start']:g} .. {window['t_end']:g}", of, text(one["status"]),
                         *(text(margin_words(one[name], name)) for name in MARGIN_NAMES),
                         "-" if stable is None else f"{stable:.4f}"])
            chosen.append(any(each["t_start"] == window["t_start"] and each["estimate"] == of
                              for each in said["below"] + said["may_be_below"]))
    lines = [*closing_lines(said), *gain_lines(said), *(said[key] for key in ("why", "next") if key in said),
             *said["findings"], *(f"assumed: {each}" for each in said["assumed"]), *found.warnings]
    required = Required() if found.nominal is None else found.nominal.margins
    whose = "the log alone" if found.nominal is None else f"nominal {found.nominal.name}"
    first = "".join(f"<p>{text(line)}</p>" for line in lines) + paragraphs(
        [f"Required: {required.words}; bold: below it, or perhaps."])
    first += table(["window [s]", "of", "status",
                    *heads(), "P(stable)"],
                   rows, chosen)
    pictures = {"margins.png": Picture("Margins over the flight, and the last loop",
        "Left: margins with 95 % intervals, and what is required. Right: the last window that has margins, as Nichols "
        "chart and Bode plot, beside the nominal's loop and those of its declared ranges.", found._figure)}
    write_report(folder, f"Stability margins of {Path(found.log.path).name}",
                 f"launchid margins: windows of {found.config.window:g} s, {whose}", first,
                 [("Figures", [pictures])], ("margins.json", found.to_json()), glossary=MARGIN_WORDS)

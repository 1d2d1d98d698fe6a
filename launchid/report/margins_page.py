"""Write the report of margins: a table of windows, lines for the user, and the figure."""

from pathlib import Path
from typing import TYPE_CHECKING

from sim.sections import Required

from ..robustness.flight_margins import MARGIN_NAMES, closing_lines, crossing_lines, gain_lines, heads, margin_words
from .folder import Picture, paragraphs, write_report
from .page import table, text

if TYPE_CHECKING:
    from ..commands.margins import FlightMargins

MARGIN_WORDS = (
    ("gain, low", "how far the loop's gain may fall before the vehicle is unstable (aerodynamic margin)"),
    ("gain, high", "how far the loop's gain may rise before the vehicle is unstable"),
    ("phase", "the smallest phase margin of all crossovers"),
    ("delay", "the delay that the loop still bears"),
    ("modulus margin", "the least distance |1 + L| from the critical point; its inverse Ms is the largest sensitivity"),
    ("disk margin", "2 min |1 + L|/|1 - L|: gain and phase may move at once, by any factor of that disk"),
    ("P(stable)", "the probability that the loop as identified is stable"),
    ("interval", "95 %, from the covariance of a6, k1 and the servo's numbers"))


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
    lines = [*crossing_lines(said), *closing_lines(said), *gain_lines(said),
             f"Next: {said['next']}",
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
    write_report(folder, said["headline"], f"launchid margins: the loop of {Path(found.log.path).name}, "
                 f"windows of {found.config.window:g} s, {whose}", first,
                 [("Figures", [pictures])], ("margins.json", found.to_json()), glossary=MARGIN_WORDS)

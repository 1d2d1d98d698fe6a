"""Write the report of a comparison: one page that needs no network, the comparison as JSON, the figures."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING

from ..comparison.flown import FLOWN_CHANNELS
from ..comparison.frequency_response import BIASED
from ..comparison.prediction import HORIZONS
from ..log.table import UNITS
from .folder import Picture, write_report
from .page import table, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .comparison import Comparison

CAPTIONS = {  # file: heading, and how to read it
    "comparison.png": ("Measured and simulated",
        "Wide grey: measured. Each nominal has its colour and dash, named with its fit and Theil's "
        "coefficient (TIC). Left: the nominal flies the log's reference with its own controller, without noise. Right: "
        "what the prediction 1 s ahead leaves, from the state as the nominal's filter knows it, on the logged "
        "commands."),
    "dispersions.png": ("The flight in the nominal's dispersions",
        "Band: from 5 to 95 % of the dispersed flights; dashed: their median; line: measured. A flight of the "
        "nominal is outside in 10 % of the time."),
    "responses.png": ("Frequency responses",
        "Dots: measured, where the coherence is high enough; dotted: 95 % interval; wide grey, where there is an "
        "instrument: measured without it. Each nominal has its colour and dash. Of a vehicle that changes the "
        "nominal's response is the mean over the flight that the estimate is of.")}
GLOSSARY = (
    ("fit", "100 % less the RMS error over the RMS of the measured values about their mean: 100 % is exact, 0 no "
            "better than the mean"),
    ("TIC", "Theil's inequality coefficient: RMS error over the sum of the two RMS values: 0 is exact, 1 no relation. "
            "Its shares: of the means (bias), of the spreads (variance), and the rest (covariance), which no shift or "
            "scale takes away"),
    ("noise allows", "the fit of a nominal without a fault: what its declared noise leaves of the prediction"),
    ("coherence", "the share of the output that is linear in the input (with an instrument: in the instrument, and of "
                  "the input likewise; the smaller one)"),
    ("instrument", "what moves the loop and is moved by nothing in it: the test input, else the reference. Without one "
                   f"the estimate is of the input itself: {BIASED}"))


def pictures_of(made: "Comparison") -> dict[str, Picture]:
    """Return file name -> picture (heading, caption, drawing function) of the comparison's figures."""
    def draw(name: str) -> "Figure | None":
        from .comparison_figures import COMPARISON_FIGURES
        return COMPARISON_FIGURES[name](made)

    return {name: Picture(*words, functools.partial(draw, name)) for name, words in CAPTIONS.items()}


def write_comparison(made: "Comparison", folder: str | Path) -> None:
    """Write report.html, compare.json and the figures into a folder, which is made if there is none."""
    names = ", ".join(each.label for each in made.nominals)
    write_report(folder, made.report["headline"], f"launchid compare: {Path(made.log.path).name} beside {names}",
                 f"<p>Next: {text(made.report['next'])}</p>" + summary_table(made),
                 [("Figures", [pictures_of(made)])], ("compare.json", made.to_json()),
                 glossary=GLOSSARY)


def summary_table(made: "Comparison") -> str:
    """Return the report's first screen as HTML: a row for each channel and nominal with fits, Theil's coefficients and
    place among dispersed flights, then lines on the responses."""
    rows = []
    for name in FLOWN_CHANNELS:
        for said in made.report["nominals"]:
            if name not in said["channels"]:
                continue
            found = said["channels"][name]
            cells = [_cell(found["ahead"].get(f"{h:g}")) for h in HORIZONS] + [_cell(found["flown"])]
            last = found["ahead"].get(f"{HORIZONS[-1]:g}")
            noise = "-" if last is None or last["noise_fit"] is None else f"{last['noise_fit']:.1f} %"
            place = found["percentile"]
            rows.append((f"{name} [{UNITS[name]}]", text(said["nominal"]), *cells[:3], noise, cells[3], *(
                ("-", "-") if place is None or place["share_outside_90"] is None else
                (f"{100.0 * place['share_outside_90']:.0f} %", f"{100.0 * place['peak']:.0f} %"))))
    lines = "".join(f"<p class=\"note\">{text(line)}</p>" for line in (*made.response_lines(), *made.warnings))
    return table(("channel", "nominal", *(f"{h:g} s ahead: fit, TIC" for h in HORIZONS),
                  f"noise allows at {HORIZONS[-1]:g} s", "flown: fit, TIC", "time outside 5..95 %",
                  "flights with a lower peak"), rows) + lines


def _cell(found: dict[str, float | None] | None) -> str:
    if found is None or found["rms"] is None:
        return "-"
    fit = "-" if found["fit"] is None else f"{found['fit']:.1f} %"
    return fit if found["tic"] is None else f"{fit}, {found['tic']:.3f}"

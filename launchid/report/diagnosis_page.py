"""Write the report of a diagnosis: an HTML page that needs no network, JSON, the extended nominal, the figures."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.nominal import rewrite_nominal

from ..diagnosis.answer import extension, headline, sizes, would_decide
from ..diagnosis.named import Result
from .answer import json_text
from .comparison import Comparison
from .comparison_page import CAPTIONS, summary_table
from .comparison_page import pictures_of as comparison_pictures
from .folder import Picture
from .folder import write_report as folder_report
from .headline import shown_path
from .page import list_of, table, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"consistent": "#1b5e20", "explained": "#12355b", "dominant": "#3b3170", "unexplained": "#8a4b00",
           "bad-data": "#7f1d1d"}
EXTENSION = ("extension.toml", "extension.vehicle.csv", "extension.uncertainty.csv")
PICTURES = {
    "faults.png": ("The log as it is", "Marked: where the data check found fault."),
    "misfit.png": ("Measured against predicted",
                   "Each prediction runs free from the state as known at its start, under numbers that its block was "
                   "not used for. Grey: measured; dashed: as simulated; solid: with the causes."),
    "innovations.png": ("Prediction errors along the log",
                        "Measured less predicted one row ahead, by a filter that corrects itself at each row. Bands: "
                        "from the lowest to the highest of neighbouring rows. Dotted: 3 standard deviations, which "
                        "0.3 % leave if the model is right."),
    "worth.png": ("What each cause is worth",
                  "What it saves on blocks left out when it comes last, in nats: 3 nats are odds of 20 to 1.")}


def write_report(result: Result, answer: dict[str, Any], folder: str | Path, beside: Comparison | None = None) -> None:
    """Write report.html, verdict.json, extension.toml (if the model was extended) and the figures into a folder.

    `beside`: the log compared with the nominal and its extension; None: they cannot be compared.  Files of an earlier
    report that this one lacks are removed.  InputError in one line if it cannot be written.
    """
    said = (*result.doubts, *result.remaining, *result.notes)
    measured, simulated = Path(result.reading.log.path).name, result.nominal.name
    again = f"launchid diagnose {result.reading.log.path} {shown_path(result.nominal.path or simulated)} --report DIR" \
        + result.reading.raw.options
    folder_report(
        folder, headline(result), f"launchid diagnose: measured {measured} against the simulation of {simulated}",
        _first(result, answer), (
            ("Causes", [_causes(result)]), ("Held-out gain", [_gain(answer["gain"])]),
            ("Figures", [pictures_of(result)]),
            ("Measured beside simulated", [] if beside is None else [
                summary_table(beside), comparison_pictures(beside)]),
            ("Against the model", [list_of([text(each) for each in said])] if said else []),
            ("What could have been seen", [table(("cause", "size that this log would have shown"), [
                (text(name), f"{each['parameter']} {each['size']:.3g} {text(each['unit'])}")
                for name, each in answer["limits"].items() if each["size"] is not None])]),
            ("Noise", [table(("noise of", "measured over declared"), [
                (text(name), f"{level['factor']:.3g}" + (" (differs)" if level["significant"] else ""))
                for name, level in answer["noise"].items()])]),
            ("Data check", [_data(result)]), ("Controller check", [_controller(result)]),
            ("To reproduce", [f"<pre>{text(again)}</pre>"])),
        ("verdict.json", json_text(answer)), colour=COLOURS[result.verdict],
        stale=(*EXTENSION, *PICTURES, *CAPTIONS))
    extended = extension(result)
    if extended is not None:
        rewrite_nominal(extended, Path(folder) / "extension.toml")


def pictures_of(result: Result) -> dict[str, Picture]:
    """Return file name -> picture of the figures that this diagnosis may have."""
    def draw(name: str) -> "Figure | None":
        from .diagnosis_figures import REPORT_FIGURES
        return REPORT_FIGURES[name](result)

    names = ("faults.png",) if result.model is None else tuple(PICTURES)
    return {name: Picture(*PICTURES[name], functools.partial(draw, name)) for name in names}


def _first(result: Result, answer: dict[str, Any]) -> str:
    """Return the verdict in plain words, as HTML."""
    said = [f"<p>{text(answer['headline'])}</p>"] if "headline" in answer else []
    if result.named:
        said.append(list_of([f"{text(each.cause)}: {text(sizes(each))}" for each in result.named]))
    if extension(result) is not None:
        said.append('<p>The nominal with what was found: <a href="extension.toml">extension.toml</a>.</p>')
    if "next" in answer:
        said.append(f"<p>Next: {text(answer['next'])}</p>")
    return '<div class="plain">' + "".join(said) + "</div>"


def _causes(result: Result) -> str:
    rows = [(text(each.cause), text(each.where), text(sizes(each)), f"{each.nats:.0f}", f"{100 * each.share:.0f} %",
             text(", ".join(each.alike)), text(" or ".join(would_decide(each))))
            for each in (*result.named, *result.nearest)]
    return table(("in the model" if result.named else "nearest, not the cause", "where",
                  "size +- one standard deviation", "nats", "of the removable error", "cannot be told from",
                  "would decide"), rows)


def _gain(gain: dict[str, Any] | None) -> str:
    if gain is None:
        return ""
    channels = list(dict.fromkeys(name for row in gain["horizons"].values() for name in row))
    rows = [(name, *(f"{row[name]['before']:.3g} &rarr; {row[name]['after']:.3g}" if name in row else ""
                     for row in gain["horizons"].values())) for name in channels]
    return ('<p class="note">Prediction error over the change of the channel on blocks left out, nominal &rarr; with '
            "what was fitted.</p>" + table(("channel", *(f"over {h} s" for h in gain["horizons"])), rows))


def _data(result: Result) -> str:
    data = result.reading.data
    rows = [(text(each.kind), text(each.channel or "rows"), f"{each.t_start:.6g}", f"{each.t_end:.6g}",
             str(each.rows), text(each.message)) for each in data.faults]
    return f"<p>{int(data.usable.sum())} of {len(result.reading.log.t)} rows have usable time stamps.</p>" + (
        table(("fault", "in", "from [s]", "to [s]", "rows", "what"), rows) or "<p>No fault found.</p>")


def _controller(result: Result) -> str:
    found = result.reading.controller
    if found is None:
        return "<p>Not checked: that needs beta_cmd and theta_ref in the log and a [controller] in the nominal.</p>"
    if found.kind == "none":
        return f"<p>The logged command is the nominal controller's ({found.before:.2g} rad rms apart).</p>"
    return f"<p>The logged command is not the nominal controller's: {text(found.words)}.</p>"

"""Figures of a comparison: the measured in wide grey, each nominal in a colour and a dash that print apart."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import NOMINAL_COLOUR, TRACKED_BAND

from ..comparison.flown import FLOWN_CHANNELS
from ..comparison.frequency_response import COHERENT, DECIBEL, Response, decibels_and_degrees
from ..comparison.prediction import HORIZONS
from ..log.table import UNITS
from .drawing import INTERVAL, band

if TYPE_CHECKING:
    from .comparison import Comparison

MEASURED_LINE: dict[str, Any] = {"color": "0.72", "linewidth": 2.6, "linestyle": "-"}
NOMINAL_STYLES: tuple[dict[str, Any], ...] = (  # from light to dark in grey
    {"color": "#c2570c", "linewidth": 1.1, "linestyle": "--"}, {"color": "#12355b", "linewidth": 1.1, "linestyle": "-"},
    {"color": "#2f8f6b", "linewidth": 1.1, "linestyle": "-."}, {"color": "#000000", "linewidth": 1.2, "linestyle": ":"})
CHANNEL_WORDS = {"theta": "attitude theta", "theta_dot": "rate theta_dot", "beta": "nozzle beta",
                 "beta_cmd": "command beta_cmd"}
FONT_SIZE = 8    # points, of ticks and labels
LONGEST_HORIZON = HORIZONS[-1]
LEAST_SPAN = (6.0, 20.0)   # dB, deg: an axis shows at least a quarter of it beside what is measured
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)   # Hz


def style(k: int) -> dict[str, Any]:
    """Return matplotlib's keywords for lines of the k-th nominal; the first is on top, its dashes show those below."""
    return {**NOMINAL_STYLES[k % len(NOMINAL_STYLES)], "zorder": 10 - k}


def comparison_figure(made: "Comparison") -> Figure:
    """Draw each channel: left measured, and flown by each nominal; right measured less predicted, 1 s ahead."""
    names = [name for name in FLOWN_CHANNELS if np.isfinite(getattr(made.log, name)).any()]
    figure = Figure(figsize=(13.0, 1.0 + 2.0 * len(names)), layout="constrained")
    figure.suptitle(f"{Path(made.log.path).name}: measured beside {', '.join(each.label for each in made.nominals)}",
                    fontsize=11)
    axes = figure.subplots(len(names), 2, sharex=True, squeeze=False)
    is_flown = any(each.flown is not None for each in made.nominals)
    axes[0, 0].set_title("flown from the reference" if is_flown else "measured (no nominal can fly this log)",
                         fontsize=9, loc="left", pad=26)
    axes[0, 1].set_title(f"predicted {LONGEST_HORIZON:g} s ahead", fontsize=9, loc="left", pad=26)
    for (left, right), name in zip(axes, names, strict=True):
        left.plot(made.log.t, getattr(made.log, name), label="measured", **MEASURED_LINE)
        for k, (each, said) in enumerate(zip(made.nominals, made.report["nominals"], strict=True)):
            found = said["channels"][name]
            if each.flown is not None:
                left.plot(made.log.t, each.flown[name], label=f"{each.label}: {_words(found['flown'])}", **style(k))
            ahead = each.predictions.get(name, {}).get(LONGEST_HORIZON)
            if ahead is not None:
                right.plot(ahead.t, ahead.measured - ahead.predicted,
                           label=f"{each.label}: {_words(found['ahead'][f'{LONGEST_HORIZON:g}'])}", **style(k))
        if not right.lines:
            right.text(0.5, 0.5, "not predicted: the command is what predictions are given", ha="center", va="center",
                       fontsize=FONT_SIZE, transform=right.transAxes)
        left.set_ylabel(f"{CHANNEL_WORDS[name]}\n[{UNITS[name]}]", fontsize=FONT_SIZE)
        right.set_ylabel(f"{name}, measured\nless predicted [{UNITS[name]}]", fontsize=FONT_SIZE)
    for axis in axes[-1]:
        axis.set_xlabel("t [s]", fontsize=FONT_SIZE)
    return _finished(figure)


def dispersion_figure(made: "Comparison") -> Figure | None:
    """Draw the log in the band of each nominal's dispersed flights; None if no nominal flew."""
    flew = [(each.label, each.dispersed) for each in made.nominals if each.dispersed is not None]
    if not flew:
        return None
    names = [name for name in FLOWN_CHANNELS if any(name in of.places for _, of in flew)]
    figure = Figure(figsize=(6.5 * max(1.4, len(flew)), 1.2 + 2.0 * len(names)), layout="constrained")
    figure.suptitle(f"{Path(made.log.path).name} among dispersed flights of "
                    f"{', '.join(label for label, _ in flew)}", fontsize=11)
    axes = figure.subplots(len(names), len(flew), sharex=True, sharey="row", squeeze=False)
    for column, (label, of) in zip(axes.T, flew, strict=True):
        for axis, name in zip(column, names, strict=True):
            place = of.places[name]
            band(axis, place.t, place.low, place.high, TRACKED_BAND, "5 to 95 % of the flights")
            axis.plot(place.t, place.measured, color="0.2", linewidth=0.8, label="measured")
            axis.plot(place.t, place.middle, color=NOMINAL_COLOUR, linewidth=1.1, linestyle="--", label="their median")
            axis.set_title(f"{label}: outside in {100.0 * place.outside:.0f} % of the time; peak above that of "
                           f"{100.0 * place.peak:.0f} % of the flights", fontsize=FONT_SIZE, loc="left")
            axis.set_ylabel(f"{CHANNEL_WORDS[name]}\n[{UNITS[name]}]", fontsize=FONT_SIZE)
        column[-1].set_xlabel("t [s]", fontsize=FONT_SIZE)
    return _finished(figure, one_legend=True)


def response_figure(made: "Comparison") -> Figure | None:
    """Draw gain, phase and coherence of each pair of input and output, where the coherence is high enough: measured
    (once, with the first nominal's instrument) and of each nominal; None if there is no response."""
    shown: dict[tuple[str, str], list[Response]] = {}
    for each in made.nominals[0].responses:
        shown.setdefault((each.source, each.to), []).append(each)
    if not shown:
        return None
    figure = Figure(figsize=(6.5 * max(1.4, len(shown)), 8.8), layout="constrained")
    figure.suptitle(f"{Path(made.log.path).name}: frequency responses", fontsize=11)
    axes = figure.subplots(3, len(shown), sharex="col", squeeze=False)
    for column, (pair, measured) in zip(axes.T, shown.items(), strict=True):
        best = measured[0]
        column[0].set_title(f"{pair[0]} to {pair[1]}" + (f"; instrument {best.instrument}" if best.instrument else ""),
                            fontsize=9, loc="left")
        for each in measured:
            _measured_response(column, each, is_best=each is best)
        lines = [one for beside in made.nominals for one in beside.responses
                 if (one.source, one.to, one.instrument) == (*pair, best.instrument)]
        for k, (beside, one) in enumerate(zip(made.nominals, lines, strict=False)):
            for axis, x in zip(column, decibels_and_degrees(one)[2:], strict=False):
                axis.plot(one.frequency, x, label=beside.label, **style(k))
        _response_axes(column, measured)
    return _finished(figure, one_legend=True)


def _measured_response(column: Any, of: Response, is_best: bool) -> None:
    """Draw one measured response: the best with its interval as dots, the other as a wide line."""
    usable = of.coherence >= COHERENT
    form = {"color": "0.0", "marker": "o", "markersize": 3, "linestyle": "None"} if is_best else \
        {**MEASURED_LINE, "marker": ".", "markersize": 3}  # a frequency that stands alone is seen, too
    words = "measured" if is_best else "measured, of the input itself (biased in closed loop)"
    for axis, value, half in zip(column, decibels_and_degrees(of)[:2], (DECIBEL * of.std, np.degrees(of.std)),
                                 strict=False):
        axis.plot(of.frequency, np.where(usable, value, np.nan), label=words, zorder=12 if is_best else 1, **form)
        for sign in (-1.0, 1.0) if is_best else ():
            axis.plot(of.frequency, np.where(usable, value + sign * INTERVAL * half, np.nan), color="0.0",
                      linewidth=0.9, linestyle=":", label="95 % interval" if sign > 0.0 else "_")
    line = {"color": "0.0", "linewidth": 0.9} if is_best else {**MEASURED_LINE, "linewidth": 1.6}
    column[2].plot(of.frequency, of.coherence, zorder=12 if is_best else 1, **line)


def _response_axes(column: Any, measured: list[Response]) -> None:
    """Set scales that hold what is measured, and mark the coherence above which it is drawn."""
    gain, phase, coherence = column
    usable = [each.coherence >= COHERENT for each in measured]
    reach = np.concatenate([each.frequency[kept] for each, kept in zip(measured, usable, strict=True)])
    low, high = (reach.min(), reach.max()) if len(reach) else (measured[0].frequency[0], measured[0].frequency[-1])
    for axis, k in ((gain, 0), (phase, 1)):
        values = np.concatenate([decibels_and_degrees(each)[k][kept]
                                 for each, kept in zip(measured, usable, strict=True)])
        if len(values):
            margin = 0.12 * max(LEAST_SPAN[k], float(np.ptp(values)))
            axis.set_ylim(values.min() - margin, values.max() + margin)
    for axis, label in zip(column, ("gain [dB]", "phase [deg]", "coherence [-]"), strict=True):
        axis.set_ylabel(label, fontsize=FONT_SIZE)
        axis.set_xscale("log")
        axis.set_xlim(0.9 * low, 1.1 * high)
    coherence.axhline(COHERENT, color="0.35", linewidth=0.9, linestyle="--")
    coherence.set_title(f"measured gain and phase are drawn where the coherence is above {COHERENT:g}",
                        fontsize=FONT_SIZE,
                        loc="left")
    coherence.set_ylim(0.0, 1.03)
    ticks = [x for x in TICKS if 0.9 * low <= x <= 1.1 * high]
    coherence.set_xticks(ticks, [f"{x:g}" for x in ticks], minor=False)
    coherence.set_xticks([], minor=True)
    coherence.set_xlabel("frequency [Hz]", fontsize=FONT_SIZE)


def _words(found: dict[str, Any]) -> str:
    """Return the fit and Theil's coefficient of a line, for its legend."""
    if found["rms"] is None:
        return "no value"
    fit = "" if found["fit"] is None else f"fit {found['fit']:.1f} %, "
    return f"{fit}TIC {found['tic']:.3f}" if found["tic"] is not None else fit.rstrip(", ")


def _finished(figure: Figure, one_legend: bool = False) -> Figure:
    """Return the figure after adding grids, small ticks, and legends above: one of the first panel, or one each."""
    for axis in figure.axes:
        axis.grid(True, color="0.88", linewidth=0.6)
        axis.tick_params(labelsize=FONT_SIZE)
        if axis.get_legend_handles_labels()[1] and not one_legend:
            axis.legend(fontsize=7, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 0.99), frameon=False)
    if one_legend:
        figure.legend(*figure.axes[0].get_legend_handles_labels(), fontsize=FONT_SIZE, ncol=6, loc="outside lower left",
                      frameon=False)
    return figure


COMPARISON_FIGURES: dict[str, "Callable[[Comparison], Figure | None]"] = {
    "comparison.png": comparison_figure, "dispersions.png": dispersion_figure, "responses.png": response_figure}

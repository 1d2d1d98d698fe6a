"""The comparison, drawn: what was measured in wide grey, each nominal in a colour and a dash that print apart."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .flown import CHANNELS
from .frequency_response import COHERENT
from .prediction import HORIZONS
from .result import INTERVAL, UNITS, Comparison, decibels_and_degrees

MEASURED: dict[str, Any] = {"color": "0.72", "linewidth": 2.6, "linestyle": "-"}
STYLES: tuple[dict[str, Any], ...] = (   # from light to dark in grey
    {"color": "#c2570c", "linewidth": 1.1, "linestyle": "--"}, {"color": "#12355b", "linewidth": 1.1, "linestyle": "-"},
    {"color": "#2f8f6b", "linewidth": 1.1, "linestyle": "-."}, {"color": "#000000", "linewidth": 1.2, "linestyle": ":"})
WORDS = {"theta": "attitude theta", "theta_dot": "rate theta_dot", "beta": "nozzle beta", "beta_cmd": "command beta_cmd"}
SMALL = 8        # points, of ticks and labels
FAR = HORIZONS[-1]
GAINS = 60.0     # dB that a gain's axis spans at most


def style(k: int) -> dict[str, Any]:
    """Return the style of the k-th nominal."""
    return STYLES[k % len(STYLES)]


def comparison_figure(made: Comparison) -> Figure:
    """Draw each channel: left as flown from the reference, right what the prediction 1 s ahead leaves."""
    names = [name for name in CHANNELS if np.isfinite(getattr(made.log, name)).any()]
    figure = Figure(figsize=(13.0, 1.0 + 2.0 * len(names)), layout="constrained")
    figure.suptitle(f"{Path(made.log.path).name}: measured beside {', '.join(each.label for each in made.nominals)}",
                    fontsize=11)
    axes = figure.subplots(len(names), 2, sharex=True, squeeze=False)
    is_flown = any(each.flown is not None for each in made.nominals)
    axes[0, 0].set_title("flown from the reference" if is_flown else "measured (no nominal can fly this log)",
                         fontsize=9, loc="left", pad=26)
    axes[0, 1].set_title(f"measured less predicted, {FAR:g} s ahead", fontsize=9, loc="left", pad=26)
    for (left, right), name in zip(axes, names, strict=True):
        left.plot(made.log.t, getattr(made.log, name), label="measured", **MEASURED)
        for k, (each, said) in enumerate(zip(made.nominals, made.report["nominals"], strict=True)):
            found = said["channels"][name]
            if each.flown is not None:
                left.plot(made.log.t, each.flown[name], label=f"{each.label}: {_words(found['flown'])}", **style(k))
            ahead = each.predictions.get(name, {}).get(FAR)
            if ahead is not None:
                right.plot(ahead.t, ahead.measured - ahead.predicted,
                           label=f"{each.label}: {_words(found['ahead'][f'{FAR:g}'])}", **style(k))
        if not right.lines:
            right.text(0.5, 0.5, "not predicted: the command is what predictions are given", ha="center", va="center",
                       fontsize=SMALL, transform=right.transAxes)
        left.set_ylabel(f"{WORDS[name]}\n[{UNITS[name]}]", fontsize=SMALL)
        right.set_ylabel(f"[{UNITS[name]}]", fontsize=SMALL)
    for axis in axes[-1]:
        axis.set_xlabel("t [s]", fontsize=SMALL)
    return _finished(figure)


def dispersion_figure(made: Comparison) -> Figure | None:
    """Draw the log in the band of each nominal's dispersed flights; None where none flew."""
    flew = [each for each in made.nominals if each.dispersed is not None]
    if not flew:
        return None
    names = [name for name in CHANNELS if any(each.dispersed and name in each.dispersed.places for each in flew)]
    figure = Figure(figsize=(6.5 * max(2, len(flew)), 1.0 + 2.0 * len(names)), layout="constrained")
    figure.suptitle(f"{Path(made.log.path).name} in the nominal's own dispersed flights", fontsize=11)
    axes = figure.subplots(len(names), len(flew), sharex=True, sharey="row", squeeze=False)
    for column, each in zip(axes.T, flew, strict=True):
        assert each.dispersed is not None
        column[0].set_title(each.label, fontsize=9, loc="left", pad=26)
        for axis, name in zip(column, names, strict=True):
            place = each.dispersed.places[name]
            axis.plot(place.t, place.measured, label=f"measured: {100.0 * place.outside:.0f} % of the time outside, peak "
                      f"above that of {100.0 * place.peak:.0f} % of the flights", **MEASURED)
            axis.plot(place.t, place.low, color="0.0", linewidth=0.9, linestyle="--", label="5 and 95 % of the flights")
            axis.plot(place.t, place.high, color="0.0", linewidth=0.9, linestyle="--")
            axis.plot(place.t, place.middle, color="0.0", linewidth=0.9, linestyle=":", label="median")
            axis.set_ylabel(f"{WORDS[name]}\n[{UNITS[name]}]", fontsize=SMALL)
        column[-1].set_xlabel("t [s]", fontsize=SMALL)
    return _finished(figure)


def response_figure(made: Comparison) -> Figure | None:
    """Draw gain, phase and coherence of each pair, as measured for the first nominal and of each nominal; None without
    any.  With an instrument it is that estimate, else that of the input itself."""
    first = made.nominals[0].responses
    if not first:
        return None
    pairs = list({(each.source, each.to): each for each in reversed(first)}.values())[::-1]
    figure = Figure(figsize=(6.5 * max(2, len(pairs)), 8.4), layout="constrained")
    figure.suptitle(f"{Path(made.log.path).name}: frequency responses, measured and of the nominal", fontsize=11)
    axes = figure.subplots(3, len(pairs), sharex="col", squeeze=False)
    for (gain, phase, coherence), shown in zip(axes.T, pairs, strict=True):
        usable = shown.coherence >= COHERENT
        decibels, degrees, *_ = decibels_and_degrees(shown)
        way = f"instrument {shown.instrument}" if shown.instrument else "of the input itself: biased in closed loop"
        gain.set_title(f"{shown.source} to {shown.to}, {way}", fontsize=9, loc="left", pad=26)
        for axis, value, half in ((gain, decibels, 20.0 / np.log(10.0) * shown.std),
                                  (phase, degrees, np.degrees(shown.std))):
            low, high = (np.where(usable, value + sign * INTERVAL * half, np.nan) for sign in (-1.0, 1.0))
            axis.plot(shown.frequency, np.where(usable, value, np.nan), marker="o", markersize=3,
                      label="measured", **MEASURED)
            axis.plot(shown.frequency, low, color="0.35", linewidth=0.8, linestyle=":", label="95 % interval")
            axis.plot(shown.frequency, high, color="0.35", linewidth=0.8, linestyle=":")
            for k, each in enumerate(made.nominals):
                same = next((one for one in each.responses if (one.source, one.to, one.instrument)
                             == (shown.source, shown.to, shown.instrument)), None)
                if same is not None and np.isfinite(same.nominal).any():
                    _, _, believed, turned = decibels_and_degrees(same)
                    axis.plot(same.frequency, believed if axis is gain else turned, label=each.label, **style(k))
            _scaled(axis, value[usable])
        coherence.plot(shown.frequency, shown.coherence, color="0.0", linewidth=0.9)
        coherence.axhline(COHERENT, color="0.35", linewidth=0.9, linestyle="--")
        coherence.annotate(f"{COHERENT:g}: below it nothing is drawn above", (shown.frequency[0], COHERENT),
                           xytext=(4, -10), textcoords="offset points", fontsize=7,
                           bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8})
        coherence.set_ylim(0.0, 1.03)
        for axis, label in ((gain, "gain [dB]"), (phase, "phase [deg]"), (coherence, "coherence [-]")):
            axis.set_ylabel(label, fontsize=SMALL)
            axis.set_xscale("log")
        ticks = [x for x in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if shown.frequency[0] <= x <= shown.frequency[-1]]
        coherence.set_xticks(ticks, [f"{x:g}" for x in ticks], minor=False)
        coherence.set_xticks([], minor=True)
        coherence.set_xlabel("frequency [Hz]", fontsize=SMALL)
    return _finished(figure)


def _scaled(axis: Any, values: np.ndarray) -> None:
    """An ordinate that holds the values that are drawn as measured, and what is near them of the rest."""
    values = values[np.isfinite(values)]
    if len(values):
        margin = 0.15 * max(6.0, float(np.ptp(values)))
        axis.set_ylim(max(values.min(), values.max() - 6.0 * GAINS) - margin, values.max() + margin)


def _words(found: dict[str, Any]) -> str:
    """The fit and the coefficient of a line, for its legend."""
    if found["rms"] is None:
        return "no value"
    fit = "" if found["fit"] is None else f"fit {found['fit']:.1f} %, "
    return f"{fit}TIC {found['tic']:.3f}" if found["tic"] is not None else fit.rstrip(", ")


def _finished(figure: Figure) -> Figure:
    """The figure with grids, small ticks, and each panel's legend above it."""
    for axis in figure.axes:
        axis.grid(True, color="0.88", linewidth=0.6)
        axis.tick_params(labelsize=SMALL)
        if axis.get_legend_handles_labels()[1]:
            axis.legend(fontsize=7, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 0.99), frameon=False)
    return figure


DRAWN: dict[str, Callable[[Comparison], Figure | None]] = {
    "comparison.png": comparison_figure, "dispersions.png": dispersion_figure, "responses.png": response_figure}

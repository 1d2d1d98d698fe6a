"""Draw a diagnosis: measured and predicted motion, prediction errors, the worth of each cause."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import panels

from ..diagnosis.gain import CHANNELS, GAIN_HORIZON, SPACING, Fitted, predictions
from ..diagnosis.named import Result
from ..likelihood.estimate import refreshed
from ..log.table import UNITS
from .drawing import band, envelope
from .log_figures import logs_figure, looked_at

ENVELOPE_COLOURS = ("#f0bd98", "#5f7ea6")  # nominal, with the causes: in grey, too, the second is darker
GROUPS = 450           # neighbours of an envelope: some two pixels each
INNOVATION_BAND = 3.0  # standard deviations of an innovation: 99.7 % stay within
LOG_LINE = {"color": "0.72", "linewidth": 2.6}
BEFORE_LINE = {"color": "#c2570c", "linewidth": 1.0, "linestyle": "--"}
AFTER = {"color": "#12355b", "linewidth": 1.0}


def shown(result: Result) -> list[tuple[str, dict, Fitted]]:
    """Return (label, line style, fitted model) of the nominal, and of it with its causes if any are named."""
    both = [("nominal", BEFORE_LINE, result.fitted[0])]
    return [*both, ("with the causes", AFTER, result.fitted[1])] if result.named else both


def misfit(result: Result) -> Figure | None:
    """Return a figure of measured and predicted change of attitude (or rate) ahead; None without held-out gain."""
    m, gain = result.model, result.gain
    if m is None or gain is None:
        return None
    channel = 0 if m.log.has["theta"] else 1
    row = m.log.period
    span = max(1, round(min(gain.longest, GAIN_HORIZON) / row))
    starts = np.arange(max(10, m.log.n // 200), m.log.n - 1 - span, max(1, round(SPACING / row)))
    if len(starts) < 2:
        return None
    change = m.log.z[starts + span, channel] - m.log.z[starts, channel]
    t = m.log.t[starts + span] + m.log.track.record.shift
    figure, (above, below) = panels(2, f"measured against predicted, {span * row:.2g} s ahead, blocks left out")
    above.plot(t, change, label="measured", **LOG_LINE)
    for label, style, fit in shown(result):
        error = predictions(*fit, starts, np.array([span]))[:, 0, channel]
        above.plot(t, change - error, label=f"predicted, {label}", **style)
        seen = error[np.isfinite(error)]
        rms = float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")
        below.plot(t, error, label=f"{label}: {rms:.2g} {UNITS[CHANNELS[channel]]} rms", **style)
    above.set_ylabel(f"change of {CHANNELS[channel]} [{UNITS[CHANNELS[channel]]}]")
    below.set_ylabel(f"measured less predicted\n[{UNITS[CHANNELS[channel]]}]")
    below.set_xlabel("t [s]")
    for axis in (above, below):
        axis.legend(fontsize=8, ncol=3)
        for each in result.named:
            if "time" in each.parameters:
                axis.axvline(each.values["time"] + m.log.track.record.shift, color="0", linestyle="-.", linewidth=0.9)
    return figure


def innovations(result: Result) -> Figure | None:
    """Return a figure of each channel's innovations and 3 sigma, nominal and with causes; None without a model."""
    m = result.model
    if m is None:
        return None
    channels = [ch for ch, name in enumerate(CHANNELS) if m.log.has[name]]
    figure, axes = panels(len(channels), "prediction errors one row ahead; dotted: 3 standard deviations")
    t = m.log.t[:-1] + m.log.track.record.shift
    for colour, (label, _, fit) in zip(ENVELOPE_COLOURS, shown(result), strict=False):
        made = refreshed(*fit).run
        for axis, ch in zip(axes, channels, strict=True):
            inside = np.isfinite(made.S[:, ch])
            outside = float(np.mean(np.abs(made.E[inside, ch]) > INNOVATION_BAND * np.sqrt(made.S[inside, ch])))
            if inside.any():
                band(axis, *envelope(t[inside], made.E[inside, ch], GROUPS), colour,
                     f"{label}: {100 * outside:.1f} % outside")
            for sign in (-1.0, 1.0):
                axis.plot(t[inside], sign * INNOVATION_BAND * np.sqrt(made.S[inside, ch]), color="0", linewidth=0.8,
                          linestyle=":", label="3 standard deviations" if sign > 0.0 and label == "nominal" else "_")
            top = 1.2 * float(np.quantile(np.abs(made.E[inside, ch]), 0.999))
            if top > 0.0 and label == "nominal":
                axis.set_ylim(-top, top)
            axis.set_ylabel(f"{CHANNELS[ch]} [{UNITS[CHANNELS[ch]]}]")
            axis.legend(fontsize=8, ncol=3)
    axes[-1].set_xlabel("t [s]")
    return figure


def worth(result: Result) -> Figure | None:
    """Return a figure of the nats that each cause kept saves on blocks left out, or by which a stranger's log is
    likelier with it; None if none was kept."""
    el, m = result.elimination, result.model
    if el is None or m is None or not el.kept:
        return None
    figure = Figure(figsize=(9, 1.2 + 0.4 * len(el.kept)), layout="constrained")
    axis = figure.subplots()
    names = [each.group.kind for each in el.kept]
    axis.barh(range(len(names)), [0.5 * each.gain for each in el.kept], xerr=[0.5 * each.error for each in el.kept],
              color="#12355b", height=0.6)
    axis.set_yticks(range(len(names)), names)
    how = "saved on blocks left out" if m.log.is_flown else "likelier with it, over blocks"
    axis.set_xlabel(f"{how} [nats], with one standard error")
    axis.grid(True, axis="x", color="0.85", linewidth=0.6)
    return figure


REPORT_FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "faults.png": lambda result: logs_figure([looked_at(result.reading.raw)]) if result.reading.is_bad else None,
    "misfit.png": misfit, "innovations.png": innovations, "worth.png": worth}

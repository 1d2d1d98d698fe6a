"""The figures of a diagnosis: axes with units, measured and believed drawn, readable in grey.

Before and after are judged alike: the nominal is run with the filter, and with the a6 and k1 within their tolerance,
of the extended model, so that levels fitted large to swallow a misfit do not hide it.  Times are the log's clock.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from sim.canvas import save
from sim.effects import Effect
from sim.errors import InputError
from sim.flight import Flight

from ..data.record import BETA, CHANNELS, THETA, Record
from ..data.world import CALM
from ..judge.closed_loop import as_flown, flown_along
from ..judge.constancy import CONSTANCY_LIMIT
from ..judge.diagnosis import Diagnosis
from ..judge.user_gain import INTERVAL
from ..model.nuisance import Problem
from ..search.fit import Fit
from ..search.profile import as_simulated
from ..search.proposal import acceleration
from ..search.selection import needed
from .answer import NEARLY_ALIKE
from .canvas import AFTER, BEFORE, EXTENDED, MEASURED, PATCH, SYMBOLS, UNITS, axes_of, legend_above, mark_times
from .misfit import misfit
from .whiteness import chance_level, correlations, spectrum, strongest
from .words import predicts_better

__all__ = ["DRAWN", "save"]

BAND = 3.0             # standard deviations of an innovation: 99.7 % stay within
SHOWN = 0.999          # of the innovations fit on their axes; the rest is cut, so that one spike does not flatten them
SMOOTHING = 0.3        # s, of the reconstructed disturbance
PARTITIONS = 20        # of the scatter's running median
RANKED = 12            # hypotheses shown per step


@dataclass(frozen=True, eq=False)
class Judged:
    """A model along the log: innovations e (n, 3) and whitened ones, 0 where not measured."""

    label: str
    e: np.ndarray
    white: np.ndarray


def judged(made: Diagnosis) -> list[Judged]:
    """The nominal, and the model with its causes where it has any."""
    assert made.selection is not None
    fit = made.selection.model.fit
    if not fit.causes or not predicts_better(made):
        fit = made.selection.nominal.fit
        return [Judged("nominal", fit.innovations, fit.whitened)]
    white, e, _, _ = Problem(fit.record, fit.filter).white(replace(fit.point, effects=()))
    return [Judged("before: nominal", e, white),
            Judged(f"after: {EXTENDED[made.verdict]}", fit.innovations, fit.whitened)]


# ---- the closed loop


def _flown(record: Record, effects: Sequence[Effect]) -> Flight | None:
    """The flight without noise: what the simulation means, not one draw of it; None where the nominal cannot fly."""
    flown = as_flown(record)
    if flown is None or flown.actuator is None or flown.simulation is None:
        return None
    quiet = replace(flown, sensors=replace(flown.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0),
                    actuator=replace(flown.actuator, command_noise_std=0.0),
                    simulation=replace(flown.simulation, acceleration_noise_std=0.0))
    try:
        return flown_along(record, quiet, 0, effects)
    except InputError:
        return None


def closed_loop(made: Diagnosis) -> Figure | None:
    """Measured against simulated in closed loop; None where the nominal cannot fly this log."""
    assert made.record is not None and made.selection is not None
    record = made.record
    effects = made.selection.model.fit.point.effects if made.extension is None else \
        made.extension.effects[len(made.nominal.effects):]
    flights = [("nominal", BEFORE, _flown(record, ()))]
    if effects and predicts_better(made):
        flights.append((EXTENDED[made.verdict], AFTER, _flown(record, effects)))
    if flights[0][2] is None:
        return None
    figure, axes = axes_of(3, 1, (9.4, 6.4), sharex=True)
    for axis, column, name in ((axes[0, 0], THETA, "theta"), (axes[1, 0], BETA, "beta")):
        if np.isfinite(record.z[:, column]).any():
            axis.plot(record.t, record.z[:, column], label="measured", **MEASURED)
        axis.set_ylabel(f"{SYMBOLS[name]}\n[{UNITS[name]}]", fontsize=9)
    for label, style, flight in flights:
        if flight is None:
            continue
        n = min(len(flight.t), record.rows)
        lost = " (vehicle lost)" if flight.lost else ""
        axes[0, 0].plot(record.t[:n], flight.theta[:n], label=f"simulated, {label}{lost}", **style)
        axes[1, 0].plot(record.t[:n], flight.beta[:n], **style)
        rest = record.z[:n, THETA] - flight.theta[:n]
        axes[2, 0].plot(record.t[:n], rest, label=f"{label}: {math.sqrt(np.nanmean(rest**2)):.2g} rad rms", **style)
    axes[2, 0].set_ylabel("measured less\nsimulated theta [rad]", fontsize=9)
    axes[2, 0].set_xlabel("t [s]")
    for axis in axes[:, 0]:
        if axis is not axes[1, 0]:
            axis.legend(fontsize=8, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 0.99), frameon=False)
        mark_times(axis, made, named=axis is axes[0, 0])
    return figure


# ---- innovations


def innovation_bands(made: Diagnosis) -> Figure:
    """Innovations of each channel over time with their bands, before and after."""
    record, models = made.record, judged(made)
    assert record is not None and made.selection is not None
    band = BAND * np.sqrt(np.sum(made.selection.model.fit.filter.low**2, axis=2))
    channels = [CHANNELS.index(name) for name in record.channels]
    figure, axes = axes_of(len(channels), len(models), (9.4, 1.0 + 1.6 * len(channels)), sharex=True, sharey="row")
    t = record.t + record.shift
    for row, k in enumerate(channels):
        seen = np.concatenate([np.abs(m.e[np.isfinite(m.e[:, k]), k]) for m in models])
        top = max(float(np.quantile(seen, SHOWN)), float(np.median(band[:, k]))) * 1.15
        for column, model in enumerate(models):
            axis = axes[row, column]
            axis.plot(t, model.e[:, k], color=(AFTER if model is models[-1] else BEFORE)["color"], linewidth=0.5)
            for sign in (-1.0, 1.0):
                axis.plot(t, sign * band[:, k], color="0.0", linewidth=1.0, linestyle=":")
            inside = np.isfinite(model.e[:, k])
            outside = float(np.mean(np.abs(model.e[inside, k]) > band[inside, k]))
            axis.set_title(f"{model.label}: {100 * outside:.1f} % outside", fontsize=8, loc="left")
            axis.set_ylim(-top, top)
            mark_times(axis, made, named=row == 0)
        axes[row, 0].set_ylabel(f"{CHANNELS[k]}\n[{UNITS[CHANNELS[k]]}]", fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("t [s]")
    return figure


def whiteness(made: Diagnosis) -> Figure:
    """Auto- and cross-correlations of the whitened innovations at positive lags."""
    assert made.record is not None
    models = judged(made)
    found = [correlations(model.white) for model in models]
    size = math.isqrt(len(found[0]))
    figure, axes = axes_of(size, size, (9.4, 1.0 + 1.75 * size), sharex=True, sharey=True)
    lags = (1 + np.arange(len(found[0][0].values))) * made.record.period
    for k, axis in enumerate(axes.flat):
        band = found[-1][k].band
        axis.axhspan(-band, band, color="0.9")
        for of, model in zip(found, models, strict=True):
            last = model is models[-1]
            axis.plot(lags, of[k].values, "o-" if last else "^--", color=(AFTER if last else BEFORE)["color"],
                      markersize=2.8 if last else 3.2, markerfacecolor=None if last else "white", linewidth=0.8,
                      label=model.label)
        pair = dict.fromkeys((found[0][k].channel, found[0][k].with_channel))
        axis.set_title(" after ".join(pair), fontsize=8, loc="left")
        axis.axhline(0.0, color="0.5", linewidth=0.6)
    for k in range(size):
        axes[-1, k].set_xlabel("lag [s]")
        axes[k, 0].set_ylabel("correlation [-]", fontsize=8)
    legend_above(figure, axes[0, 0])
    return figure


# ---- spectra


def spectra(made: Diagnosis) -> Figure:
    """Spectra of the whitened innovations, before and after, strongest lines named."""
    assert made.record is not None
    record, models = made.record, judged(made)
    channels = [CHANNELS.index(name) for name in record.channels]
    figure, axes = axes_of(len(channels), 1, (9.4, 1.0 + 1.9 * len(channels)), sharex=True)
    for row, k in enumerate(channels):
        axis = axes[row, 0]
        for model in models:
            frequency, density, freedom = spectrum(model.white[:, k], record.period)
            axis.loglog(frequency, density, label=model.label, **(AFTER if model is models[-1] else BEFORE))
        level = chance_level(len(frequency), freedom)
        axis.axhline(level, color="0.0", linestyle=":", linewidth=1.0, label="99 % of white noise stays below")
        axis.axhline(1.0, color="0.5", linewidth=0.6)
        first = spectrum(models[0].white[:, k], record.period)[1]
        for hertz, height in strongest(frequency, first, level):
            axis.plot(hertz, height, "v", color="0.0", markersize=4)
            axis.annotate(f"{hertz:.3g} Hz\n({2 * math.pi * hertz:.3g} rad/s)", (hertz, height), xytext=(5, -3),
                          textcoords="offset points", fontsize=7)
        axis.set_ylabel(f"{CHANNELS[k]}\n[1 = white]", fontsize=9)
        axis.margins(y=0.18)
        axis.yaxis.set_minor_formatter(NullFormatter())
    axes[-1, 0].set_xlabel("frequency [Hz]")
    legend_above(figure, axes[0, 0])
    return figure


# ---- hypotheses


def ranking(made: Diagnosis) -> Figure | None:
    """Evidence of the hypotheses, step by step, and what was needed; None if none promised anything."""
    assert made.selection is not None
    steps = [step[:RANKED] for step in made.selection.rankings if step]
    if not steps:
        return None
    heights = [max(len(step), 2) for step in steps]
    figure, axes = axes_of(len(steps), 1, (9.4, 0.7 * len(steps) + 0.27 * sum(heights)), height_ratios=heights)
    for k, (axis, step) in enumerate(zip(axes[:, 0], steps, strict=True)):
        least = needed(made.threshold, k)
        place = -np.arange(len(step))
        values = [each.evidence for each in step]
        bars = axis.barh(place, values, height=0.66, edgecolor="0.2", linewidth=0.6,
                         color=["#12355b" if value >= least and n == 0 else "0.82" for n, value in enumerate(values)])
        axis.bar_label(bars, [str(round(value)) for value in values], padding=3, fontsize=8)
        fixed = [[str(value) for _, value in each.cause.hypothesis.fixed] for each in step]
        axis.set_yticks(place, [" ".join((each.cause.hypothesis.cause, *terms))
                                for each, terms in zip(step, fixed, strict=True)], fontsize=8)
        axis.axvline(least, color="0.0", linestyle="--", linewidth=1.2)
        axis.set_title(f"cause {k + 1}: {least:.0f} nats needed (dashed)", fontsize=9, loc="left")
        low, high = min(0.0, *values), max(least, *values)
        axis.set_xlim(low - (0.08 * (high - low) if low < 0.0 else 0.0), high + 0.1 * (high - low))
        axis.grid(False, axis="y")
    axes[-1, 0].set_xlabel("evidence at that step [nats]")
    return figure


def sizes(made: Diagnosis) -> Figure | None:
    """Size of each cause in each part of the log; None if there is no cause with a size."""
    assert made.record is not None
    named = [cause for cause in (*made.causes, *made.nearest) if cause.constancy is not None]
    if not named:
        return None
    figure, axes = axes_of(len(named), 1, (9.4, 0.8 + 1.9 * len(named)), sharex=True)
    for axis, cause in zip(axes[:, 0], named, strict=True):
        of = cause.constancy
        assert of is not None
        name = next(iter(cause.std))
        ends, size = np.array(of.t) + made.record.shift, np.array(of.size)
        value, half = float(cause.values[name]), INTERVAL * cause.std[name]
        axis.axhspan(value - half, value + half, color="0.88", label="fitted to the whole log, 95 %")
        axis.axhline(value, color="0.4", linestyle="--", linewidth=1.0)
        axis.errorbar(0.5 * (ends[1:] + ends[:-1]), size, INTERVAL * np.array(of.std), 0.5 * np.diff(ends), fmt="o",
                      color=AFTER["color"], markersize=4, linewidth=1.0, capsize=3,
                      label="each part beside the others, 95 %")
        unit = (cause.units.get(name) or "-").replace(" per ", "\nper ")
        axis.set_ylabel(f"{name}\n[{unit}]", fontsize=9 if "\n" not in unit else 7)
        axis.set_title(f"{cause.label}: chi-squared {of.chi_squared:.0f} (limit {CONSTANCY_LIMIT:.0f})", fontsize=9,
                       loc="left")
    axes[0, 0].legend(fontsize=8, ncol=2, loc="lower right", bbox_to_anchor=(1.0, 0.99), frameon=False)
    axes[-1, 0].set_xlabel("t [s]")
    return figure


def isolability(made: Diagnosis) -> Figure | None:
    """A figure of how alike the responses of the causes are in this log: of those that are like another; None if none
    is."""
    if (table := made.isolability) is None:
        return None
    alike = (table.cosine >= NEARLY_ALIKE) & ~np.eye(len(table.names), dtype=bool)
    kept = np.flatnonzero(alike.any(axis=1))
    if len(kept) == 0:
        return None
    n, names, cosine = len(kept), [table.names[k] for k in kept], table.cosine[np.ix_(kept, kept)]
    figure, axes = axes_of(1, 1, (min(9.4, 3.4 + 0.5 * n), min(8.2, 2.2 + 0.42 * n)))
    axis = axes[0, 0]
    axis.grid(False)
    image = axis.imshow(cosine, cmap="Greys", vmin=0.0, vmax=1.0)
    axis.set_xticks(range(n), names, rotation=60, ha="right", fontsize=7.5)
    axis.set_yticks(range(n), names, fontsize=7.5)
    for a, b in np.argwhere(alike[np.ix_(kept, kept)]):
        axis.text(b, a, f"{cosine[a, b]:.2f}", color="white", ha="center", va="center", fontsize=7)
    figure.colorbar(image, ax=axis, shrink=0.8).set_label("|cosine| of the responses [-]: 1 cannot be told apart",
                                                          fontsize=9)
    return figure


# ---- what is not explained, what is not usable


def bare(made: Diagnosis) -> Fit:
    """The nominal alone, without states of the world, which would take in what it lacks."""
    assert made.record is not None
    return as_simulated(replace(made.record, world=CALM)).fit


def reconstructed(of: Fit) -> np.ndarray:
    """Disturbance (n,) [rad/s^2] that a model lacks: the filter's corrections of the rate per second, smoothed."""
    added = acceleration(of)
    rows = max(1, round(SMOOTHING / of.record.period))
    weight = np.convolve(np.ones(len(added)), np.ones(rows), "same")
    return np.asarray(np.convolve(added, np.ones(rows), "same") / weight)


def disturbance(made: Diagnosis) -> Figure | None:
    """The reconstructed disturbance over time and against the states; only for what no cause explains."""
    if made.verdict != "unexplained" or made.record is None or made.selection is None:
        return None
    nominal = bare(made)
    record, d = made.record, reconstructed(nominal)
    figure = plt.figure(figsize=(9.4, 5.6), layout="constrained")
    grid = figure.add_gridspec(2, 3)
    axis = figure.add_subplot(grid[0, :])
    axis.plot(record.t + record.shift, d, **AFTER)
    axis.set_xlabel("t [s]")
    axis.set_ylabel("acceleration that\nlacks [rad/s$^2$]", fontsize=9)
    axes = [axis]
    states = nominal.states
    for k, name in enumerate(CHANNELS):
        axis = figure.add_subplot(grid[1, k], sharey=axes[0])
        axis.plot(states[:, k], d, ".", color="0.65", markersize=1.5)
        order = np.array_split(np.argsort(states[:, k], kind="stable"), PARTITIONS)
        middles = [(np.median(states[part, k]), np.median(d[part])) for part in order if len(part)]
        axis.plot(*np.array(middles).T, "o-", color="0.0", markersize=3.5, linewidth=1.2)
        axis.set_xlabel(f"{SYMBOLS[name]} [{UNITS[name]}]", fontsize=9)
        axis.locator_params(axis="x", nbins=4)
        axes.append(axis)
    axes[1].set_ylabel(axes[0].get_ylabel(), fontsize=9)
    for axis in axes:
        axis.grid(True, color="0.88", linewidth=0.6)
        axis.axhline(0.0, color="0.5", linewidth=0.6)
        axis.tick_params(labelsize=8)
    return figure


def faults(made: Diagnosis) -> Figure | None:
    """The columns as logged, and where the data check found fault; only for a log that is bad."""
    log, fair = made.log, np.isfinite(made.log.t)
    columns = [name for name in (*CHANNELS, "beta_cmd", "theta_ref") if np.isfinite(getattr(log, name)).any()]
    if made.verdict != "bad-data" or not columns or fair.sum() < 2:
        return None
    figure, axes = axes_of(len(columns), 1, (9.4, 0.8 + 1.3 * len(columns)), sharex=True)
    for axis, name in zip(axes[:, 0], columns, strict=True):
        axis.plot(log.t[fair], getattr(log, name)[fair], color="0.25", linewidth=0.8)
        axis.set_ylabel(f"{name}\n[{UNITS.get(name, 'rad')}]", fontsize=9)
        for fault in made.data.faults:
            if fault.channel in (name, None, "t") and math.isfinite(fault.t_start + fault.t_end):
                axis.axvspan(fault.t_start, fault.t_end, facecolor="0.85", edgecolor="0.3", hatch="///", linewidth=0.8)
                axis.annotate(fault.kind, (fault.t_start, 1.0), xycoords=("data", "axes fraction"), xytext=(2, -9),
                              textcoords="offset points", fontsize=7, bbox=PATCH)
    axes[-1, 0].set_xlabel("t [s]")
    return figure


def drawable(made: Diagnosis) -> tuple[str, ...]:
    """The pictures that this diagnosis may have: of the log where it is bad, none where no model was fitted to it."""
    if made.verdict == "bad-data":
        return ("faults.png",)
    return () if made.selection is None else tuple(name for name in DRAWN if name != "faults.png")


DRAWN: dict[str, Callable[[Diagnosis], Figure | None]] = {
    "faults.png": faults, "misfit.png": misfit, "closed_loop.png": closed_loop, "innovations.png": innovation_bands,
    "correlations.png": whiteness, "spectra.png": spectra, "ranking.png": ranking, "sizes.png": sizes,
    "disturbance.png": disturbance, "isolability.png": isolability}

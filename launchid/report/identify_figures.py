"""Figures of the results: axes with units, scaled by the estimates with small intervals, readable in grey."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from launchid_core import EDGES, Estimate, Level
from sim.canvas import NOMINAL_COLOUR, TRACKED, TRACKED_BAND, UNIT, panels
from sim.errors import UsageError
from sim.flight import Flight
from sim.nominal import Nominal

from ..formatting import with_std
from ..identification.residuals import INCREMENT, LAG_OF_WHITENESS, Predicted, Residuals
from ..log.log import Log
from ..test_input import Plan

INTERVAL = 1.96     # standard deviations: 95 %
DETERMINED = 3.0    # times the interval of the best quarter: a wider one does not set the scale, unless
USABLE_SHARE = 0.5  # of the value, within which an interval says something of it
KNOWN_DELTA = 1.0   # of the range: a delta known to less does not set the scale
CHANGE_SIGMAS = 3.0  # standard deviations of its time, after which a change has happened
MISSED = 1.5        # horizons from one prediction to the next, above which some are missing between
MARKED_PREDICTIONS = 40  # predictions that are marked one by one
WORDED = 2          # sudden changes of a parameter, up to which the legend gives their numbers
MOST_DELTA = 2.5    # of the range that the uncertainty level's axis shows: beyond it out is out


def _delta_panel(axis: Any, t: np.ndarray, levels: list[Level], name: str) -> None:
    """Draw delta of one parameter with its 95 % interval, between the edges of the bands."""
    delta, half = np.array([x.delta for x in levels]), INTERVAL * np.array([x.delta_std for x in levels])
    out = np.array([not x.in_range for x in levels], bool)
    axis.fill_between(t, delta - half, delta + half, color="0.8", label="95 % interval")
    for edge, line in zip(EDGES, (":", "--", "-"), strict=True):
        axis.axhline(edge, color="0.4", linestyle=line, linewidth=0.9, label=f"{100 * edge:g} % of sigma")
        axis.axhline(-edge, color="0.4", linestyle=line, linewidth=0.9)
    axis.plot(t, delta, color="0.0", linewidth=1.3, label="delta")
    axis.plot(t[out], delta[out], "x", color="0.0", markersize=4, label="out: another factor at play")
    known = half <= KNOWN_DELTA
    limit = min(max(1.3, 1.15 * float(np.max(np.abs(delta[known]), initial=0.0))), MOST_DELTA)
    axis.set_ylim(-limit, limit)
    _mark_edges(axis, t, delta, np.zeros(len(t)), -limit, limit)
    axis.set_ylabel(f"delta of {name} [-]")


def uncertainty_figure(log: Log, estimates: list[Estimate], nominal: Nominal) -> Figure:
    """Draw delta of a6 and k1 with its bands and 95 % interval, and the tracked a6 and k1 over the nominal's range."""
    figure, axes = panels(4, f"{Path(log.path).name}: uncertainty level", 1.8)
    known = [(e.t_end, e.uncertainty, e.tracked) for e in estimates
             if e.uncertainty is not None and e.uncertainty.valid and e.tracked is not None]
    t = np.array([row[0] for row in known])
    fine = np.linspace(estimates[0].t_start, estimates[-1].t_end, 400) if estimates else np.zeros(1)
    assert nominal.uncertainty is not None
    for k, name in enumerate(("a6", "k1")):
        _delta_panel(axes[k], t, [getattr(u, name) for _, u, _ in known], name)
        value = nominal.vehicle.at(fine)[k]
        spread = np.abs(value) * nominal.uncertainty.at(fine)[k]
        tracked = np.array([getattr(x, name) for *_, x in known])
        half = INTERVAL * np.array([getattr(x, f"{name}_std") for *_, x in known])
        axis = axes[2 + k]
        axis.fill_between(fine, value - spread, value + spread, color="0.88", label="range of the nominal")
        axis.plot(fine, value, "--", color=NOMINAL_COLOUR, linewidth=1.4, label="nominal")
        axis.plot(t, tracked, color=TRACKED, linewidth=1.3, label="tracked")
        axis.plot(t, tracked - half, ":", color=TRACKED, linewidth=0.9, label="its 95 % interval")
        axis.plot(t, tracked + half, ":", color=TRACKED, linewidth=0.9)
        shown = np.concatenate([value - 1.3 * spread, value + 1.3 * spread, tracked])
        margin = 0.08 * float(np.ptp(shown))
        axis.set_ylim(float(np.min(shown)) - margin, float(np.max(shown)) + margin)
        axis.set_ylabel(f"{name} [{UNIT}]")
    for axis, columns in ((axes[0], 4), (axes[1], 4), (axes[2], 4)):
        _legend(axis, columns, axes[:2] if axis is axes[0] else [axis] if axis is axes[2] else [])
    axes[3].set_xlabel("t [s]")
    return figure


# ---- identify


def _numbers(windows: list[dict[str, Any]], name: str) -> np.ndarray:
    return np.array([math.nan if w[name] is None else w[name] for w in windows], dtype=float)


def _determined(value: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the mask of estimates that set the scale: those whose 95 % interval is narrow, or narrow for the value."""
    known = np.isfinite(value) & np.isfinite(half)
    if known.any():
        narrow = DETERMINED * float(np.quantile(half[known], 0.25, method="lower"))
        known &= (half <= narrow) | (half <= USABLE_SHARE * np.abs(value))
    return known


def _scale(value: np.ndarray, half: np.ndarray, beside: list[np.ndarray]) -> tuple[float, float]:
    """Return (low, high) of the ordinate: estimates that set the scale, with intervals, and other drawn values."""
    known = _determined(value, half)
    drawn = np.concatenate([value[known] - half[known], value[known] + half[known], *beside])
    drawn = drawn[np.isfinite(drawn)]
    if len(drawn) == 0:
        return -1.0, 1.0
    low, high = float(np.min(drawn)), float(np.max(drawn))
    margin = 0.08 * (high - low) + 0.02 * max(abs(low), abs(high)) + 1e-6
    return low - margin, high + margin


def _mark_edges(axis: Any, t: np.ndarray, value: np.ndarray, half: np.ndarray, low: float, high: float) -> None:
    """Draw triangles at the edge: filled where a value is beyond it, open where its interval is."""
    for edge, marker, beyond, reaches in ((high, "^", value > high, value + half > high),
                                          (low, "v", value < low, value - half < low)):
        for chosen, face, words in ((beyond, "0.1", "value beyond the edge"),
                                    (reaches & ~beyond & (value > low) & (value < high), "white",
                                     "interval beyond the edge")):
            if chosen.any():
                axis.plot(t[chosen], np.full(chosen.sum(), edge), marker, color="0.1", markerfacecolor=face,
                          markersize=4, clip_on=False, zorder=5, label=words)


def _draw_tracked(axis: Any, windows: list[dict[str, Any]], name: str, breaks: list[float]) -> list[np.ndarray]:
    """Draw the tracked estimate with its 95 % band, broken at `breaks` [s]; return [values], [] if there is none."""
    rows = [(w["t_end"], w["tracked"][name], INTERVAL * w["tracked"][f"{name}_std"])
            for w in windows if w.get("tracked") and w["tracked"]["valid"] and w["tracked"][name] is not None
            and w["tracked"][f"{name}_std"]]
    if not rows:
        return []
    t, value, half = np.array(sorted([*rows, *((at, math.nan, math.nan) for at in breaks)],
                                     key=lambda row: row[0]), dtype=float).T
    axis.fill_between(t, value - half, value + half, color=TRACKED_BAND, label="tracked, 95 % interval")
    axis.plot(t, value, color=TRACKED, linewidth=1.3)
    return [value]


def _draw_changes(axis: Any, changes: list[dict[str, Any]]) -> None:
    """Draw sudden changes as lines with the interval of their time; a few of them with their numbers in the legend."""
    for change in changes:
        half = INTERVAL * change["t_std"]
        label = "sudden change" if len(changes) > WORDED else \
            f"sudden change at {with_std(change['t'], change['t_std'])} s, size " \
            f"{with_std(change['size'], change['size_std'])} (+-: one std)"
        axis.axvspan(change["t"] - half, change["t"] + half, color="0.6", linewidth=0)
        axis.axvline(change["t"], color="0.0", linestyle="-.", linewidth=1.0, label=label)


def _draw_refused(axis: Any, windows: list[dict[str, Any]]) -> None:
    """Hatch windows that are not valid, with their status."""
    for status, group in itertools.groupby(windows, key=lambda w: None if w["valid"] else w["status"]):
        refused = list(group)
        if status is not None:
            axis.axvspan(refused[0]["t_start"], refused[-1]["t_end"], facecolor="0.96", edgecolor="0.8", hatch="//",
                         linewidth=0, zorder=0, label="refused, with the reason")
            axis.text(0.5 * (refused[0]["t_start"] + refused[-1]["t_end"]), 0.05, status, ha="center", fontsize=6,
                      color="0.25", transform=axis.get_xaxis_transform(), clip_on=True)


def _legend(axis: Any, columns: int = 3, axes: list[Any] | None = None) -> None:
    """Draw a legend above the axis, with each label of it (or of `axes`) once."""
    entries = {label: handle for each in ([axis] if axes is None else axes)
               for handle, label in zip(*each.get_legend_handles_labels(), strict=True)}
    if entries:
        axis.legend(entries.values(), entries.keys(), fontsize=7, ncol=columns, loc="lower left",
                    bbox_to_anchor=(0.0, 1.0), frameon=False)


def _parameter_panel(axis: Any, name: str, log: Log, report: dict[str, Any], nominal: Nominal | None) -> None:
    """Draw one parameter: windows, tracked estimate, nominal, Cramer-Rao bound and sudden changes."""
    windows = report["windows"]
    t = np.array([0.5 * (w["t_start"] + w["t_end"]) for w in windows])
    width = np.array([0.5 * (w["t_end"] - w["t_start"]) for w in windows])
    value, half = _numbers(windows, name), INTERVAL * _numbers(windows, f"{name}_std")
    changes = [change for change in report.get("changes", []) if change["parameter"] == name]
    beside = _draw_tracked(axis, windows, name, [change["t"] + CHANGE_SIGMAS * change["t_std"] for change in changes])
    if nominal is not None:
        fine = np.linspace(float(np.nanmin(log.t)), float(np.nanmax(log.t)), 400)
        beside.append(nominal.vehicle.at(fine)[name == "k1"])
        axis.plot(fine, beside[-1], "--", color=NOMINAL_COLOUR, linewidth=1.4, label="nominal")
    seen, bound = np.isfinite(value), INTERVAL * _numbers(windows, f"{name}_bound")
    if seen.any():
        axis.errorbar(t[seen], value[seen], xerr=width[seen], yerr=np.nan_to_num(half[seen]), fmt="o", color="0.1",
                      markersize=3, linewidth=0.8, label="window, 95 % interval")
    bounded = seen & np.isfinite(bound)
    if bounded.any():
        axis.errorbar(t[bounded], value[bounded], yerr=bound[bounded], fmt="none", ecolor="0.45", elinewidth=0,
                      capsize=4, label="Cramer-Rao bound of it, 95 %")
    _draw_changes(axis, changes)
    _draw_refused(axis, windows)
    low, high = _scale(value, half, beside)
    axis.set_ylim(low, high)
    _mark_edges(axis, t, value, half, low, high)
    axis.set_ylabel(f"{name} [{UNIT}]")
    _legend(axis)


def _has_wind(windows: list[dict[str, Any]]) -> bool:
    return any(w["wind_std"] for w in windows)


def _wind_panel(axis: Any, windows: list[dict[str, Any]]) -> None:
    """Draw the wind angle at the windows' ends, and the tracked one."""
    t = np.array([w["t_end"] for w in windows])
    value, half = _numbers(windows, "wind"), INTERVAL * _numbers(windows, "wind_std")
    beside = _draw_tracked(axis, windows, "wind", [])
    seen = np.isfinite(value)
    axis.errorbar(t[seen], value[seen], yerr=np.nan_to_num(half[seen]), fmt="o", color="0.1", markersize=3,
                  linewidth=0.8, label="at the window's end, 95 % interval")
    low, high = _scale(value, half, beside)
    axis.set_ylim(low, high)
    _mark_edges(axis, t, value, half, low, high)
    axis.set_ylabel("wind [rad]")
    _legend(axis)


def identify_figure(log: Log, report: dict[str, Any], nominal: Nominal | None,
                    parameters: Sequence[str] = ("a6", "k1")) -> Figure:
    """Draw estimates of a log with 95 % intervals, the nominal, the wind if there is any, and theta and beta.

    report      the identify JSON; windows that are not valid in it are hatched
    parameters  to draw: those whose terms the library has
    """
    windows = report["windows"]
    windy = int(_has_wind(windows))
    figure, axes = panels(len(parameters) + windy + 2, f"{Path(log.path).name}: identified parameters", 1.7)
    for axis, name in zip(axes, parameters, strict=False):
        _parameter_panel(axis, name, log, report, nominal)
    if windy:
        _wind_panel(axes[len(parameters)], windows)
    for axis, name in zip(axes[-2:], ("theta", "beta"), strict=True):
        axis.plot(log.t, getattr(log, name), color="0.1", linewidth=0.8)
        axis.set_ylabel(f"{name} [rad]")
    axes[-1].set_xlabel("t [s]" + (f"\n{report['why']}" if "why" in report else ""))
    return figure


def residual_figure(log: Log, residuals: Residuals, windows: list[dict[str, Any]]) -> Figure:
    """Draw the residuals of identified windows over time, their whiteness, and predictions over horizons.

    windows  of the identify JSON; those that are not valid are hatched
    """
    count = len(residuals.predicted)
    figure = Figure(figsize=(9, 3.4 + 1.6 * count), layout="constrained")
    air = "\nwind is in no prediction: it is part of what is left" if _has_wind(windows) else ""
    figure.suptitle(f"{Path(log.path).name}: residuals and predictions of the identified windows{air}", fontsize=11)
    grid = figure.add_gridspec(1 + count, 2, width_ratios=[2.0, 1.0])
    over, white = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    ahead = [figure.add_subplot(grid[1 + k, :], sharex=over) for k in range(count)]
    over.plot(residuals.t, residuals.residual, ".", color="0.1", markersize=1.5)
    rms, alone = (float(np.sqrt(np.mean(x**2))) if len(x) else math.nan for x in (residuals.residual, residuals.noise))
    over.set_title(f"mean acceleration left over {INCREMENT:g} s: {rms:.2g} rad/s$^2$ rms, of sensor noise alone "
                   f"{alone:.2g}", fontsize=8, loc="left")
    over.set_ylabel("residual [rad/s$^2$]", fontsize=8)
    _draw_refused(over, windows)
    over.set_xlabel("t [s]", fontsize=8)
    _whiteness_panel(white, residuals)
    for axis, each in zip(ahead, residuals.predicted, strict=True):
        _prediction_panel(axis, each)
    ahead[-1].set_xlabel("t [s]")
    for axis in (over, white, *ahead):
        axis.grid(True, color="0.85", linewidth=0.6)
        axis.tick_params(labelsize=8)
    return figure


def _whiteness_panel(axis: Any, residuals: Residuals) -> None:
    if residuals.correlation is None:
        axis.text(0.5, 0.5, "too few rows for a correlation", ha="center", fontsize=8, transform=axis.transAxes)
        return
    values, band = residuals.correlation.values, residuals.correlation.band
    lags = LAG_OF_WHITENESS * INCREMENT * (1 + np.arange(len(values)))
    axis.axhspan(-band, band, color="0.88")
    axis.vlines(lags, 0.0, values, color="0.1")
    axis.plot(lags, values, "o", color="0.1", markersize=3)
    axis.axhline(0.0, color="0.4", linewidth=0.6)
    out = int(np.count_nonzero(np.abs(values) > band))
    axis.set_title(f"autocorrelation: {out} of {len(values)} beyond 99 % of white", fontsize=8, loc="left")
    axis.set_ylim(-1.0, 1.0)
    axis.set_xlim(0.0, lags[-1] + lags[0])
    axis.set_xlabel("lag [s]", fontsize=8)


def _prediction_panel(axis: Any, predicted: Predicted) -> None:
    """Draw the change of theta over a horizon, measured and predicted (in theta itself errors could not be seen)."""
    base = predicted.measured - predicted.change
    gaps = 1 + np.flatnonzero(np.diff(predicted.t) > MISSED * predicted.horizon)
    t = np.insert(predicted.t, gaps, np.nan)  # which breaks the lines
    few = "o" if len(predicted.t) < MARKED_PREDICTIONS else None
    axis.plot(t, np.insert(predicted.change, gaps, np.nan), color="0.72", linewidth=2.6, marker=few,
              label=f"measured ({len(predicted.t)})" + (f"; sensor noise alone: fit {predicted.ceiling:.0f} %"
                                                        if math.isfinite(predicted.ceiling) else ""))
    words = ("own window", "window before, which has not seen it")
    for value, fit, line, grey, word in zip((predicted.within, predicted.before), predicted.fits, ("-", "--"),
                                            ("0.0", "0.4"), words, strict=True):
        if np.isfinite(value).any():
            said = f"fit {fit:.0f} %" if math.isfinite(fit) else "too few for a fit"
            axis.plot(t, np.insert(value - base, gaps, np.nan), line, color=grey, linewidth=0.9, marker=few,
                      markersize=3, label=f"{word}: {said}")
    seen = np.concatenate([predicted.change, predicted.within - base])
    seen = seen[np.isfinite(seen)]
    if len(seen) and np.ptp(seen) > 0.0:
        axis.set_ylim(np.min(seen) - 0.1 * np.ptp(seen), np.max(seen) + 0.1 * np.ptp(seen))
    axis.set_ylabel(f"theta's change\nin {predicted.horizon:g} s [rad]", fontsize=8)
    _legend(axis)


# ---- flights, inputs, ranges


def flight_figure(flight: Flight, nominal: Nominal) -> Figure:
    """Draw the signals of a flight, and its true a6 and k1 over the nominal's."""
    figure, axes = panels(5, f"{nominal.name}: a flight" + (", LOST at its end" if flight.lost else ""), 1.4)
    axes[2].plot(flight.t, flight.beta_cmd, color="0.7", linewidth=0.6, label="beta_cmd")
    for axis, name, unit in zip(axes, ("theta", "theta_dot", "beta"), ("rad", "rad/s", "rad"), strict=False):
        axis.plot(flight.t, getattr(flight, name), color="0.1", linewidth=0.8, label="measured")
        axis.set_ylabel(f"{name} [{unit}]")
    axes[0].plot(flight.t, flight.theta_ref, "--", color="0.5", linewidth=1.0, label="theta_ref")
    for axis, name in zip(axes[3:], ("a6", "k1"), strict=True):
        axis.plot(flight.t, getattr(flight, name), color="0.1", label="truth")
        axis.plot(flight.t, nominal.vehicle.at(flight.t)[name == "k1"], "--", color=NOMINAL_COLOUR, label="nominal")
        axis.set_ylabel(f"{name} [{UNIT}]")
    for axis in (axes[0], axes[2], axes[3]):
        _legend(axis)
    axes[-1].set_xlabel("t [s]")
    return figure


def plan_figure(plan: Plan) -> Figure:
    """Draw a designed test input over time, and the amplitudes of its sines; UsageError if none is needed."""
    multisine = plan.nominal.test_input
    if multisine is None:
        raise UsageError("plan: no test input is needed, there is nothing to draw")
    figure = Figure(figsize=(9, 4.6))
    figure.suptitle(f"{plan.nominal.name}: test input, {plan.root_mean_square:.2e} rad rms", fontsize=11, y=0.96)
    above, below = figure.subplots(2, 1)
    longest = min(multisine.duration, 2 * 2.0 * math.pi / min(multisine.frequency))
    t = multisine.start + np.linspace(0.0, longest, 2000, endpoint=False)
    above.plot(t, multisine.at(t), color="0.1", linewidth=0.9)
    above.set_xlabel("t [s]")
    above.set_ylabel("angle [rad]")
    below.vlines(multisine.frequency, 0.0, multisine.amplitude, color="0.1")
    below.plot(multisine.frequency, multisine.amplitude, "o", color="0.1", markersize=4)
    below.set_xlabel("frequency [rad/s]")
    below.set_ylabel("amplitude [rad]")
    below.set_ylim(bottom=0.0)
    for axis in (above, below):
        axis.grid(True, color="0.85", linewidth=0.6)
    figure.subplots_adjust(hspace=0.45)
    return figure



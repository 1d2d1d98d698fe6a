"""Figures of the results: axes with units, scaled by the estimates with small intervals, readable in grey."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import NOMINAL_COLOUR, TRACKED, TRACKED_BAND, UNIT, panels
from sim.nominal import Nominal

from ..formatting import with_std
from ..log.log import Log
from .drawing import INTERVAL, has_wind, legend, mark_edges, mark_refused

DETERMINED = 3.0    # times the interval of the best quarter: a wider one does not set the scale, unless
USABLE_SHARE = 0.5  # of the value, within which an interval says something of it
CHANGE_SIGMAS = 3.0  # standard deviations of its time, after which a change has happened
WORDED = 2          # sudden changes of a parameter, up to which the legend gives their numbers


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
    low, high = _scale(value, half, beside)
    axis.set_ylim(low, high)
    mark_refused(axis, windows)
    mark_edges(axis, t, value, half, low, high)
    axis.set_ylabel(f"{name} [{UNIT}]")
    legend(axis)


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
    mark_edges(axis, t, value, half, low, high)
    axis.set_ylabel("wind [rad]")
    legend(axis)


def identify_figure(log: Log, report: dict[str, Any], nominal: Nominal | None,
                    parameters: Sequence[str] = ("a6", "k1")) -> Figure:
    """Draw estimates of a log with 95 % intervals, the nominal, the wind if there is any, and theta and beta.

    report      the identify JSON; windows that are not valid in it are hatched
    parameters  to draw: those whose terms the library has
    """
    windows = report["windows"]
    windy = int(has_wind(windows))
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


# ---- flights, inputs, ranges

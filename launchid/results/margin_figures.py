"""Figure of a flight's margins: over time, and one loop as Nichols chart and Bode plot, with 95 % regions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import NOMINAL_COLOUR, TRACKED, TRACKED_BAND
from sim.nominal import Nominal

from ..log.log import Log
from ..robustness.flight_margins import MARGINS, Judged, WindowMargins, declared_servo, required_of
from ..robustness.loops import Loops, loops, plants_of
from ..robustness.margin_spread import MARGIN_NAMES, ellipsoid

DECADES = (-1.0, 0.02)   # of the frequency axis around the crossover: from, and below half the sampling rate
CURVE_POINTS = 400
RIM = 96                 # loops on the ellipsoid that draw the region
CORNERS = np.array([(a, k) for a in (-1.0, 1.0) for k in (-1.0, 1.0)])
PHASE_AXIS = (-400.0, -80.0)  # deg that the Bode plot shows
MOST_WIDE = 8.0          # times the median interval: a wider one says little, and sets no scale
NICHOLS_RANGE = 40.0     # dB that the Nichols chart shows of either side


def margins_figure(log: Log, nominal: Nominal, windows: Sequence[WindowMargins], report: dict[str, Any]) -> Figure:
    """Draw left the margins over flight time, with intervals and required values; right the last window that has
    margins, as Nichols chart and Bode plot, with the nominal's loop and those at the corners of its range."""
    figure = Figure(figsize=(13.5, 8.6), layout="constrained")
    figure.suptitle(f"{Path(log.path).name}: stability margins of the loop as identified, 95 % intervals", fontsize=11)
    grid = figure.add_gridspec(len(MARGIN_NAMES), 2, width_ratios=[1.15, 1.0])
    over: list[Any] = []
    for k, name in enumerate(MARGIN_NAMES):
        over.append(figure.add_subplot(grid[k, 0], sharex=over[0] if over else None))
        _over_time(over[k], name, report, nominal)
    over[0].legend(fontsize=7, ncol=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    over[-1].set_xlabel("t [s]")
    last = next((each for each in reversed(windows) if each.window.valid), None)
    if last is not None:
        nichols, gain = figure.add_subplot(grid[:2, 1]), figure.add_subplot(grid[2, 1])
        phase = figure.add_subplot(grid[3, 1], sharex=gain)
        _one_loop((nichols, gain, phase), nominal, last)
    for axis in figure.axes:
        axis.grid(True, color="0.88", linewidth=0.6)
        axis.tick_params(labelsize=8)
    return figure


def _over_time(axis: Any, name: str, report: dict[str, Any], nominal: Nominal) -> None:
    """Draw one margin of the windows and of the tracked estimates, with its required value."""
    windows = report["windows"]
    shown = []
    for estimate, rows in (("tracked", [(w["t_end"], 0.0, w["tracked"]) for w in windows if "tracked" in w]),
                           ("window", [(0.5 * (w["t_start"] + w["t_end"]), 0.5 * (w["t_end"] - w["t_start"]), w)
                                       for w in windows])):
        kept = [(t, half, *(np.nan if one[name][key] is None else one[name][key] for key in ("value", "low", "high")))
                for t, half, one in rows]   # one that has no margins breaks the line
        if not any(one["valid"] for *_, one in rows):
            continue
        t, half, value, low, high = np.array(kept, dtype=float).T
        known = high - low <= MOST_WIDE * np.nanmedian(high - low)
        shown += [value[known], low[known], high[known]]
        if estimate == "tracked":
            axis.fill_between(t, low, high, color=TRACKED_BAND, label="tracked, 95 % interval")
            axis.plot(t, value, color=TRACKED, linewidth=1.3)
        else:
            ends = np.nan_to_num(np.abs([value - low, high - value]))
            axis.errorbar(t, value, xerr=half, yerr=ends, fmt="o", color="0.0", markersize=3, linewidth=0.8,
                          label="window, 95 % interval")
    demand = required_of(nominal.margins, name)
    if demand != 0.0:
        axis.axhline(demand, color="0.0", linestyle="--", linewidth=1.1, label="required")
    for w in windows:
        if not w["valid"]:
            axis.axvspan(w["t_start"], w["t_end"], facecolor="0.96", edgecolor="0.8", hatch="//", linewidth=0, zorder=0)
            axis.text(0.5 * (w["t_start"] + w["t_end"]), 0.05, w["status"], ha="center", fontsize=6, color="0.25",
                      transform=axis.get_xaxis_transform())
    axis.set_ylabel(f"{MARGINS[name].words}\n[{MARGINS[name].unit}]", fontsize=8)
    _scale(axis, np.concatenate(shown) if shown else np.zeros(0), demand)


def _scale(axis: Any, shown: np.ndarray, demand: float) -> None:
    """Set the ordinate to hold the required value and what is shown."""
    known = shown[np.isfinite(shown)]
    if len(known) == 0:
        return
    inner, outer = float(np.min(known)), float(np.max(known))
    low, high = (min(inner, demand), max(outer, demand)) if demand != 0.0 else (inner, outer)
    axis.set_ylim(low - 0.12 * (high - low) - 1e-3, high + 0.12 * (high - low) + 1e-3)


def _one_loop(axes: tuple[Any, Any, Any], nominal: Nominal, window: WindowMargins) -> None:
    """Draw the Nichols chart and Bode plot of a window's loop, the nominal's, and those at the corners of its range."""
    controller, middle = nominal.controller, 0.5 * (window.t_start + window.t_end)
    assert controller is not None
    family = _family(window.window, nominal)
    believed = np.array([*(float(x) for x in nominal.vehicle.at(np.array(middle))), *declared_servo(nominal).mean])
    top = np.log10(np.pi / controller.period)
    omega = np.logspace(DECADES[0], top - DECADES[1], CURVE_POINTS)
    band = _response(loops(plants_of(family), controller), omega)
    nichols, gain, phase = axes
    nichols.plot(band[1][1:].T, band[0][1:].T, color="0.82", linewidth=1.6, zorder=1)
    nichols.plot([], [], color="0.82", linewidth=4, label="as identified, 95 % region")
    for axis, values in ((gain, band[0]), (phase, band[1])):
        axis.fill_between(omega, values.min(axis=0), values.max(axis=0), color="0.82", label="95 % band")
        axis.semilogx(omega, values[0], color="0.0", linewidth=1.3, label="as identified", zorder=4)
    if nominal.uncertainty is not None:
        sigma = np.array([float(x) for x in nominal.uncertainty.at(np.array(middle))])
        box = np.column_stack([believed[:2] * (1.0 + sigma * CORNERS), np.tile(believed[2:], (4, 1))])
        corners = _response(loops(plants_of(box), controller), omega)
        nichols.plot(corners[1].T, corners[0].T, ":", color=NOMINAL_COLOUR, linewidth=0.9, zorder=2)
        nichols.plot([], [], ":", color=NOMINAL_COLOUR, label="corners of the nominal's range")
    response = _response(loops(plants_of(believed[None]), controller), omega)
    decibels, degrees = (each[0] for each in response)
    for axis, x, y in ((nichols, degrees, decibels), (gain, omega, decibels), (phase, omega, degrees)):
        axis.plot(x, y, "--", color=NOMINAL_COLOUR, linewidth=1.3, label="nominal", zorder=3)
    nichols.plot(band[1][0], band[0][0], color="0.0", linewidth=1.4, label="as identified", zorder=4)
    _required_cross(nichols, nominal)
    nichols.set_title(f"window {window.t_start:g}..{window.t_end:g} s", fontsize=9, loc="left")
    gain.axhline(0.0, color="0.4", linewidth=0.7)
    phase.axhline(-180.0, color="0.4", linewidth=0.7)
    gain.set_ylim(-NICHOLS_RANGE, NICHOLS_RANGE)
    gain.set_ylabel("|L| [dB]", fontsize=8)
    phase.set_ylim(*PHASE_AXIS)
    phase.set_ylabel("phase of L [deg]", fontsize=8)
    phase.set_xlabel("frequency [rad/s]", fontsize=8)
    gain.legend(fontsize=7, loc="upper right")


def _family(judgement: Judged, nominal: Nominal) -> np.ndarray:
    """Return a window's parameters, then RIM on the ellipsoid of their 95 % interval: (1 + RIM, 5)."""
    assert judgement.known is not None
    rim = ellipsoid(judgement.known, RIM)
    return np.concatenate([judgement.known.mean[None], rim])


def _response(many: Loops, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return |L| [dB] and phase [deg] (m, p); the phase has no jumps, and is near -180 at the loop's last crossover."""
    gain = many.gain(omega)
    size, phase = 20.0 * np.log10(np.abs(gain)), np.degrees(np.unwrap(np.angle(gain), axis=1))
    last = np.array([int(np.flatnonzero(row > 0.0)[-1]) if (row > 0.0).any() else 0 for row in size])
    turns = np.round((phase[np.arange(len(phase)), last] + 180.0) / 360.0)
    return size, phase - 360.0 * turns[:, None]


def _required_cross(axis: Any, nominal: Nominal) -> None:
    """Draw the critical point, and the required margins around it, which the curve must stay outside of."""
    gain, phase = nominal.margins.gain_db, nominal.margins.phase_deg
    axis.plot([-180.0], [0.0], "+", color="0.0", markersize=9, markeredgewidth=1.6, zorder=5)
    axis.plot([-180.0 - phase, -180.0, -180.0 + phase, -180.0, -180.0 - phase], [0.0, gain, 0.0, -gain, 0.0], "-.",
              color="0.0", linewidth=1.0, zorder=5, label=f"required: {gain:g} dB, {phase:g} degrees")
    axis.set_xlim(-300.0, -90.0)
    axis.set_ylim(-NICHOLS_RANGE, NICHOLS_RANGE)
    axis.set_xticks(range(-300, -89, 30))
    axis.set_xlabel("open-loop phase [deg]", fontsize=8)
    axis.set_ylabel("open-loop gain [dB]", fontsize=8)
    axis.legend(fontsize=7, loc="lower right")

"""Figure of a flight's margins: over time, and one loop as Nichols chart and Bode plot, with 95 % regions."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import NOMINAL_COLOUR, TRACKED, TRACKED_BAND
from sim.nominal import Nominal
from sim.sections import Required

from ..log.log import Log
from ..robustness.airframe import airframe_of
from ..robustness.blocks import plants_of
from ..robustness.flight_margins import MARGINS, Judged, WindowMargins, declared_servo, required_of
from ..robustness.flown import of_nominal
from ..robustness.gains import kept_over
from ..robustness.loops import Loops, loops
from ..robustness.margin_spread import MARGIN_NAMES, ellipsoid
from .drawing import mark_edges, mark_refused

DECADES = (-1.0, 0.02)   # of the frequency axis around the crossover: from, and below half the sampling rate
CURVE_POINTS = 400
GAIN_FACTORS = np.geomspace(0.25, 4.0, 25)  # on kp and kd
RIM = 96                 # loops on the ellipsoid that draw the region
CORNERS = np.array([(a, k) for a in (-1.0, 1.0) for k in (-1.0, 1.0)])
PHASE_AXIS = (-400.0, -80.0)  # deg that the Bode plot shows
MOST_WIDE = 8.0          # times the median interval: a wider one says little, and sets no scale
NICHOLS_RANGE = 40.0     # dB that the Nichols chart shows of either side


def margins_figure(log: Log, nominal: Nominal | None, windows: Sequence[WindowMargins],
                   report: dict[str, Any]) -> Figure:
    """Draw left the margins over flight time, with intervals and required values; right the last window that has
    margins, as Nichols chart and Bode plot, with the nominal's loop and those at the corners of its range, and which
    gains keep what is required."""
    required = Required() if nominal is None else nominal.margins
    figure = Figure(figsize=(13.5, 10.8), layout="constrained")
    figure.suptitle(f"{Path(log.path).name}: stability margins of the loop as identified, 95 % intervals", fontsize=11)
    grid = figure.add_gridspec(len(MARGIN_NAMES), 2, width_ratios=[1.15, 1.0])
    over: list[Any] = []
    for k, name in enumerate(MARGIN_NAMES):
        over.append(figure.add_subplot(grid[k, 0], sharex=over[0] if over else None))
        _over_time(over[k], name, report, required)
    over[0].legend(fontsize=7, ncol=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    over[-1].set_xlabel("t [s]")
    last = next((each for each in reversed(windows) if each.window.valid), None)
    if last is not None:
        nichols, gain = figure.add_subplot(grid[:2, 1]), figure.add_subplot(grid[2, 1])
        phase = figure.add_subplot(grid[3, 1], sharex=gain)
        _one_loop((nichols, gain, phase), nominal, required, last)
        _gains(figure.add_subplot(grid[4, 1]), required, last.window)
    for axis in figure.axes:
        axis.grid(True, color="0.88", linewidth=0.6)
        axis.tick_params(labelsize=8)
    return figure


def _over_time(axis: Any, name: str, report: dict[str, Any], required: Required) -> None:
    """Draw one margin of the windows and of the tracked estimates, with its required value."""
    windows = report["windows"]
    shown, beyond = [], []
    for estimate, rows in (("tracked", [(w["t_end"], 0.0, w["tracked"]) for w in windows if "tracked" in w]),
                           ("window", [(0.5 * (w["t_start"] + w["t_end"]), 0.5 * (w["t_end"] - w["t_start"]), w)
                                       for w in windows])):
        # one that has no margins breaks the line
        kept = [(t, half, *_upward(name, (np.nan if one[name][key] is None else one[name][key]
                                          for key in ("value", "low", "high")))) for t, half, one in rows]
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
            without = np.isnan(value) & np.isfinite(low)  # nothing is lost however far the gain falls
            beyond.append((t, np.where(without, np.inf, value), np.maximum(*ends)))
            axis.errorbar(t, value, xerr=half, yerr=ends, fmt="o", color="0.0", markersize=3, linewidth=0.8,
                          label="window, 95 % interval")
    demand = abs(required_of(required, name)) if MARGINS[name].required else 0.0
    if demand != 0.0:
        axis.axhline(demand, color="0.0", linestyle="--", linewidth=1.1, label="required")
    axis.set_ylabel(MARGINS[name].words + (f"\n[{MARGINS[name].unit}]" if MARGINS[name].unit else ""), fontsize=8)
    _scale(axis, np.concatenate(shown) if shown else np.zeros(0), demand)
    mark_refused(axis, windows)
    for at, middle, reach in beyond:
        mark_edges(axis, at, middle, np.nan_to_num(reach), *axis.get_ylim())


def _upward(name: str, interval: Iterable[float]) -> tuple[float, float, float]:
    """Return a margin's value, low, high so that more is better: the low gain margin as how far the gain may fall."""
    value, low, high = interval
    return (-value, -high, -low) if MARGINS[name].sign < 0.0 else (value, low, high)


def _scale(axis: Any, shown: np.ndarray, demand: float) -> None:
    """Set the ordinate to hold the required value and what is shown."""
    known = shown[np.isfinite(shown)]
    if len(known) == 0:
        return
    inner, outer = float(np.min(known)), float(np.max(known))
    low, high = (min(inner, demand), max(outer, demand)) if demand != 0.0 else (inner, outer)
    axis.set_ylim(low - 0.12 * (high - low) - 1e-3, high + 0.12 * (high - low) + 1e-3)


def _one_loop(axes: tuple[Any, Any, Any], nominal: Nominal | None, required: Required, window: WindowMargins) -> None:
    """Draw the Nichols chart and Bode plot of a window's loop, the nominal's, and those at the corners of its range."""
    middle, controller, known = 0.5 * (window.t_start + window.t_end), window.window.controller, window.window.known
    assert controller is not None and known is not None
    top = np.log10(np.pi / controller.law.period)
    omega = np.logspace(DECADES[0], top - DECADES[1], CURVE_POINTS)
    band = _response(known.loops(_family(window.window), controller.law), omega)
    nichols, gain, phase = axes
    nichols.plot(band[1][1:].T, band[0][1:].T, color="0.82", linewidth=1.6, zorder=1)
    nichols.plot([], [], color="0.82", linewidth=4, label="as identified, 95 % region")
    for axis, values in ((gain, band[0]), (phase, band[1])):
        axis.fill_between(omega, values.min(axis=0), values.max(axis=0), color="0.82", label="95 % band")
        axis.semilogx(omega, values[0], color="0.0", linewidth=1.3, label="as identified", zorder=4)
    if nominal is not None and nominal.controller is not None and nominal.actuator is not None:
        _believed((nichols, gain, phase), nominal, middle, omega)
    nichols.plot(band[1][0], band[0][0], color="0.0", linewidth=1.4, label="as identified", zorder=4)
    _required_cross(nichols, required)
    nichols.set_title(f"Nichols chart of the window {window.t_start:g}..{window.t_end:g} s", fontsize=9, loc="left")
    gain.axhline(0.0, color="0.4", linewidth=0.7)
    phase.axhline(-180.0, color="0.4", linewidth=0.7)
    gain.set_ylim(-NICHOLS_RANGE, NICHOLS_RANGE)
    gain.set_title("Bode plot: gain", fontsize=9, loc="left")
    phase.set_title("Bode plot: phase", fontsize=9, loc="left")
    gain.set_ylabel("|L| [dB]", fontsize=8)
    phase.set_ylim(*PHASE_AXIS)
    phase.set_ylabel("phase of L [deg]", fontsize=8)
    phase.set_xlabel("frequency [rad/s]", fontsize=8)
    gain.legend(fontsize=7, loc="upper right")


def _believed(axes: tuple[Any, Any, Any], nominal: Nominal, middle: float, omega: np.ndarray) -> None:
    """Draw the nominal's loop at `middle` [s] and those at the corners of its range, over omega (p,) [rad/s]."""
    servo, airframe = declared_servo(nominal), airframe_of(nominal, middle)
    law = of_nominal(nominal).law.times(airframe.gain)
    believed = np.array([*(float(x) for x in nominal.vehicle.at(np.array(middle))), *servo.mean, airframe.damping,
                         *(float(x) for mode in airframe.modes for x in (mode.frequency, mode.size))])
    omega = omega[omega < np.pi / law.period]
    nichols = axes[0]

    def response(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _response(loops(plants_of(rows, servo.is_first_order, airframe.modes, airframe.further), law), omega)

    if nominal.uncertainty is not None:
        sigma = np.array([float(x) for x in nominal.uncertainty.at(np.array(middle))])
        box = np.column_stack([believed[:2] * (1.0 + sigma * CORNERS), np.tile(believed[2:], (4, 1))])
        corners = response(box)
        nichols.plot(corners[1].T, corners[0].T, ":", color=NOMINAL_COLOUR, linewidth=0.9, zorder=2)
        nichols.plot([], [], ":", color=NOMINAL_COLOUR, label="corners of the nominal's range")
    decibels, degrees = (each[0] for each in response(believed[None]))
    for axis, x, y in zip(axes, (degrees, omega, omega), (decibels, decibels, degrees), strict=True):
        axis.plot(x, y, "--", color=NOMINAL_COLOUR, linewidth=1.3, label="nominal", zorder=3)


def _gains(axis: Any, required: Required, judgement: Judged) -> None:
    """Draw over factors on kp and kd where a window's loop keeps what is required: with 95 %, as estimated."""
    kp, kd = np.meshgrid(GAIN_FACTORS, GAIN_FACTORS)
    kept = kept_over(judgement, kp.ravel(), kd.ravel(), required).reshape(kp.shape)
    axis.contourf(GAIN_FACTORS, GAIN_FACTORS, kept, levels=[-0.5, 0.5, 1.5, 2.5], colors=["1.0", "0.85", "0.65"])
    axis.plot([1.0], [1.0], "+", color="0.0", markersize=9, markeredgewidth=1.6)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xticks([0.25, 0.5, 1.0, 2.0, 4.0], ["0.25", "0.5", "1", "2", "4"])
    axis.set_yticks([0.25, 0.5, 1.0, 2.0, 4.0], ["0.25", "0.5", "1", "2", "4"])
    axis.minorticks_off()
    axis.set_xlabel("factor on kp", fontsize=8)
    axis.set_ylabel("factor on kd", fontsize=8)
    axis.set_title("dark: keeps what is required with 95 %; light: as estimated; +: as judged", fontsize=7, loc="left")


def _family(judgement: Judged) -> np.ndarray:
    """Return a window's numbers, then RIM on the ellipsoid of their 95 % interval: (1 + RIM, k)."""
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


def _required_cross(axis: Any, required: Required) -> None:
    """Draw the critical point, and the required margins around it, which the curve must stay outside of."""
    gain, phase = required.gain_db, required.phase_deg
    axis.plot([-180.0], [0.0], "+", color="0.0", markersize=9, markeredgewidth=1.6, zorder=5)
    axis.plot([-180.0 - phase, -180.0, -180.0 + phase, -180.0, -180.0 - phase], [0.0, gain, 0.0, -gain, 0.0], "-.",
              color="0.0", linewidth=1.0, zorder=5, label=f"required: {gain:g} dB, {phase:g} degrees")
    axis.set_xlim(-300.0, -90.0)
    axis.set_ylim(-NICHOLS_RANGE, NICHOLS_RANGE)
    axis.set_xticks(range(-300, -89, 30))
    axis.set_xlabel("open-loop phase [deg]", fontsize=8)
    axis.set_ylabel("open-loop gain [dB]", fontsize=8)
    axis.legend(fontsize=7, loc="lower right")

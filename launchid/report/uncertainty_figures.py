"""Draw the uncertainty of a flight: delta of a6 and k1 with their bands."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from launchid_core import EDGES, Estimate, Level
from sim.canvas import NOMINAL_COLOUR, TRACKED, UNIT, panels
from sim.nominal import Nominal

from ..log.log import Log
from .drawing import INTERVAL, legend, mark_edges

KNOWN_DELTA = 1.0   # of the range: a delta known to less does not set the scale
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
    mark_edges(axis, t, delta, np.zeros(len(t)), -limit, limit)
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
        legend(axis, columns, axes[:2] if axis is axes[0] else [axis] if axis is axes[2] else [])
    axes[3].set_xlabel("t [s]")
    return figure

"""Draw the residuals of identified windows, their whiteness, and predictions."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..identification.residuals import INCREMENT, LAG_OF_WHITENESS, Predicted, Residuals
from ..log.log import Log
from .drawing import has_wind, legend, mark_refused

MISSED = 1.5        # horizons from one prediction to the next, above which some are missing between
MARKED_PREDICTIONS = 40  # predictions that are marked one by one


def residual_figure(log: Log, residuals: Residuals, windows: list[dict[str, Any]]) -> Figure:
    """Draw the residuals of identified windows over time, their whiteness, and predictions over horizons.

    windows  of the identify JSON; those that are not valid are hatched
    """
    count = len(residuals.predicted)
    figure = Figure(figsize=(9, 3.4 + 1.6 * count), layout="constrained")
    air = "\nwind is in no prediction: it is part of what is left" if has_wind(windows) else ""
    figure.suptitle(f"{Path(log.path).name}: residuals and predictions of the identified windows{air}", fontsize=11)
    grid = figure.add_gridspec(1 + count, 2, width_ratios=[2.0, 1.0])
    over, white = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    ahead = [figure.add_subplot(grid[1 + k, :], sharex=over) for k in range(count)]
    over.plot(residuals.t, residuals.residual, ".", color="0.1", markersize=1.5)
    rms, alone = (float(np.sqrt(np.mean(x**2))) if len(x) else math.nan for x in (residuals.residual, residuals.noise))
    over.set_title(f"mean acceleration left over {INCREMENT:g} s: {rms:.2g} rad/s$^2$ rms, of sensor noise alone "
                   f"{alone:.2g}", fontsize=8, loc="left")
    over.set_ylabel("residual [rad/s$^2$]", fontsize=8)
    mark_refused(over, windows)
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
    legend(axis)

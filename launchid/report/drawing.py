"""Parts that figures share: 95 % intervals, legends, marks of what is refused or beyond an axis."""

import itertools
from typing import Any

import numpy as np

INTERVAL = 1.96     # standard deviations: 95 %


def mark_edges(axis: Any, t: np.ndarray, value: np.ndarray, half: np.ndarray, low: float, high: float) -> None:
    """Draw triangles at the edge: filled where a value is beyond it, open where its interval is."""
    for edge, marker, beyond, reaches in ((high, "^", value > high, value + half > high),
                                          (low, "v", value < low, value - half < low)):
        for chosen, face, words in ((beyond, "0.1", "value beyond the edge"),
                                    (reaches & ~beyond & (value > low) & (value < high), "white",
                                     "interval beyond the edge")):
            if chosen.any():
                axis.plot(t[chosen], np.full(chosen.sum(), edge), marker, color="0.1", markerfacecolor=face,
                          markersize=4, clip_on=False, zorder=5, label=words)


def mark_refused(axis: Any, windows: list[dict[str, Any]]) -> None:
    """Hatch windows that are not valid, with their status."""
    for status, group in itertools.groupby(windows, key=lambda w: None if w["valid"] else w["status"]):
        refused = list(group)
        if status is not None:
            axis.axvspan(refused[0]["t_start"], refused[-1]["t_end"], facecolor="0.96", edgecolor="0.8", hatch="//",
                         linewidth=0, zorder=0, label="refused, with the reason")
            axis.text(0.5 * (refused[0]["t_start"] + refused[-1]["t_end"]), 0.05, status, ha="center", fontsize=6,
                      color="0.25", transform=axis.get_xaxis_transform(), clip_on=True)


def legend(axis: Any, columns: int = 3, axes: list[Any] | None = None) -> None:
    """Draw a legend above the axis, with each label of it (or of `axes`) once."""
    entries = {label: handle for each in ([axis] if axes is None else axes)
               for handle, label in zip(*each.get_legend_handles_labels(), strict=True)}
    if entries:
        axis.legend(entries.values(), entries.keys(), fontsize=7, ncol=columns, loc="lower left",
                    bbox_to_anchor=(0.0, 1.0), frameon=False)


def has_wind(windows: list[dict[str, Any]]) -> bool:
    """Whether the wind is estimated in any window."""
    return any(w["wind_std"] for w in windows)

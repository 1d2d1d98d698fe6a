"""Parts that figures share: 95 % intervals, legends, marks of what is refused or beyond an axis."""

import itertools
from typing import Any

import numpy as np

INTERVAL = 1.96     # standard deviations: 95 %
HEIGHTS = (0.08, 0.92, 0.5, 0.25, 0.75)  # of a panel, where a word may stand
CLEAR = 0.09        # of a panel's height, that keeps a word clear of a line


def band(axis: Any, t: np.ndarray, low: np.ndarray, high: np.ndarray, color: str, label: str, **more: Any) -> None:
    """Fill between low and high (n,) over t (n,), in a page's chart too (`curves`)."""
    filled = axis.fill_between(t, low, high, color=color, linewidth=0, label=label, **more)
    filled.band = tuple(np.asarray(each, dtype=float) for each in (t, low, high))


def envelope(t: np.ndarray, x: np.ndarray, groups: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (t, lowest, highest) of x (n,) in about `groups` groups of neighbours, each at its middle."""
    starts = np.arange(0, len(x), max(1, len(x) // groups))
    ends = np.append(starts[1:], len(x)) - 1
    return 0.5 * (t[starts] + t[ends]), np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)


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
    """Hatch windows that are not valid, with their status, clear of what is drawn; the scale is to be set before."""
    for status, group in itertools.groupby(windows, key=lambda w: None if w["valid"] else w["status"]):
        refused = list(group)
        if status is not None:
            axis.axvspan(refused[0]["t_start"], refused[-1]["t_end"], facecolor="0.96", edgecolor="0.8", hatch="//",
                         linewidth=0, zorder=0, label="refused, with the reason")
            start, end = refused[0]["t_start"], refused[-1]["t_end"]
            axis.text(0.5 * (start + end), _clear_height(axis, start, end), status, ha="center", va="center",
                      fontsize=6, color="0.25", transform=axis.get_xaxis_transform(), clip_on=True)


def _clear_height(axis: Any, start: float, end: float) -> float:
    """Return the first of HEIGHTS that no line of the axis comes near from start to end, else the clearest."""
    low, high = axis.get_ylim()
    drawn = [HEIGHTS[0] - 1.0]
    for line in axis.lines:
        x, y = (np.asarray(part, dtype=float) for part in line.get_data())
        if line.get_transform() == axis.get_yaxis_transform(which="grid"):
            drawn += list((y - low) / (high - low))
        elif line.get_transform() == axis.transData and len(x):
            inside = (x >= start) & (x <= end)
            at = np.linspace(start, end, 9)
            ends = np.interp(at, x, y, left=np.nan, right=np.nan) if len(x) > 1 else np.zeros(0)
            drawn += [each for each in (np.concatenate([y[inside], ends]) - low) / (high - low) if np.isfinite(each)]
    gaps = [float(np.min(np.abs(np.array(drawn) - height))) for height in HEIGHTS]
    return next((height for height, gap in zip(HEIGHTS, gaps, strict=True) if gap > CLEAR),
                HEIGHTS[int(np.argmax(gaps))])


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

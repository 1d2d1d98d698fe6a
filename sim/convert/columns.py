"""Channels of different rates onto one clock, by a map, without making up data.

The log's rows are those of one column's group (the map's `clock`, else the slower of theta and beta).  Another column
gives a row

    nearest   its sample nearest to the row, each sample to one row at most, no farther than half a period of the clock
    held      its last sample at or before the row, for what a computer says, no older than three of its own periods
    linear    between the samples before and after the row, if those are no farther apart than two of its own periods

and nothing (NaN: not measured) where there is none.
"""

import difflib
import math
from collections.abc import Mapping

import numpy as np

from ..errors import InputError
from ..log import Log, log_of
from .mapping import Map, Source
from .readers import read_channels

HALF = 0.5        # of the clock's period
STALE = 3.0       # own periods
BESIDE = 2.0      # own periods
ROUNDING = 1.0e-6  # of a period, of stamps that are decimals


def converted(path: str, of: Map, required: tuple[str, ...]) -> tuple[Log, tuple[str, ...]]:
    """The log that a map makes of a flight's file, and lines of what was damaged in that."""
    channels = read_channels(path, of.options)
    return log_of(mapped(path, channels, of), path, required), channels.notes


def mapped(path: str, channels: Mapping[str, np.ndarray], of: Map) -> dict[str, np.ndarray]:
    """The log's columns (n,) of a file's channels; InputError naming what the file lacks."""
    found = {source.column: sampled(path, channels, of, source) for source in of.sources}
    clock = of.clock or _slower(found)
    origin = _origin(found[clock][0]) if of.from_first else 0
    times = {name: (stamps - origin) / of.units for name, (stamps, _) in found.items()}
    t = times[clock]
    made = {"t": t}
    for source in of.sources:
        own = found[source.column][1]
        at = times[source.column]
        same = source.column == clock or (len(at) == len(t) and np.array_equal(at, t))
        made[source.column] = own if same else _on_clock(t, at, own, source)
    return made


def _slower(found: dict[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """Of theta and beta the one with fewer rows: then no row lacks the other."""
    names = [str(name) for name in ("theta", "beta", "beta_cmd") if name in found][:2] or list(found)
    return min(names, key=lambda name: len(found[name][0]))


def _origin(stamps: np.ndarray) -> float | int:
    """The first stamp that is a number; an integer stays one, so that no digit of a large one is lost."""
    fair = stamps[np.isfinite(stamps)]
    return fair[0] if len(fair) else 0


def _channel(path: str, channels: Mapping[str, np.ndarray], name: str, map_path: str) -> np.ndarray:
    if name not in channels:
        near = difflib.get_close_matches(name, channels, 3, 0.4) or list(channels)[:3]
        raise InputError(f"{path}: no channel {name!r}, which {map_path} names; there is {', '.join(near) or 'none'} "
                         "(launchid convert FILE --list shows all)")
    return channels[name]


def stamps_name(path: str, channels: Mapping[str, np.ndarray], of: Map, source: Source) -> str:
    """The channel of a source's stamps: its own `time`, or the map's in its group, or that anywhere; InputError."""
    group = source.channels[0].rpartition("/")[0]
    inside = f"{group}/{of.time}" if group else of.time
    name = source.time or (inside if inside in channels else of.time)
    found = name if name in channels else inside
    _channel(path, channels, found, of.path)
    return found


def sampled(path: str, channels: Mapping[str, np.ndarray], of: Map,
             source: Source) -> tuple[np.ndarray, np.ndarray]:
    """Stamps as in the file and values in SI units of one source, (n,) each."""
    parts = [_channel(path, channels, name, of.path) for name in source.channels]
    stamps = channels[stamps_name(path, channels, of, source)]
    for name, part in zip(source.channels, parts, strict=True):
        if len(part) != len(stamps):
            raise InputError(f"{path}: channel {name!r} has {len(part)} rows, its stamps {len(stamps)}; expected "
                             f"stamps of its own, columns.{source.column}.time, in {of.path}")
    values = [part.astype(np.float64) for part in parts]
    if source.axis is None:
        raw = np.sum([weight * value for weight, value in zip(source.weights, values, strict=True)], axis=0)
    else:
        raw = turned(np.stack(values, axis=1), source.axis, source.reference)
    if stamps.dtype.kind in "iu":
        stamps = stamps.astype(np.int64)  # so that one before the first is negative
    return stamps, source.factor * (source.scale * raw + source.offset)


def turned(q: np.ndarray, axis: int, reference: tuple[float, ...] | None) -> np.ndarray:
    """Angle [rad] (n,), continuous, by which attitudes q (n, 4), w first, are turned about a body axis.

    The twist of the swing-twist decomposition of conj(reference) q: exact for a turn about that axis, and regular where
    Euler angles are not (a launcher stands upright).
    """
    fair = np.isfinite(q).all(axis=1)
    angle = np.full(len(q), math.nan)
    if not fair.any():
        return angle
    w0, x0, y0, z0 = q[fair][0] if reference is None else reference
    w, x, y, z = q[fair].T
    real = w0 * w + x0 * x + y0 * y + z0 * z
    turn = (w0 * x - x0 * w - y0 * z + z0 * y, w0 * y + x0 * z - y0 * w - z0 * x,
            w0 * z - x0 * y + y0 * x - z0 * w)[axis]
    angle[fair] = np.unwrap(2.0 * np.arctan2(turn, real), period=2.0 * math.pi)
    return angle


# ---- one clock


def _on_clock(t: np.ndarray, at: np.ndarray, values: np.ndarray, source: Source) -> np.ndarray:
    """values (k,) sampled `at` (k,) [s], on rows t (n,) [s]; NaN where there is none."""
    fair = np.isfinite(at) & np.isfinite(values)
    order = np.argsort(at[fair], kind="stable")
    at, values = at[fair][order], values[fair][order]
    out = np.full(len(t), math.nan)
    if len(at) == 0:
        return out
    rows = np.flatnonzero(np.isfinite(t))
    own, clock = _period(at), _period(np.sort(t[rows]))
    within = source.within
    if source.take == "held":
        before = np.searchsorted(at, t[rows] + ROUNDING * own, side="right") - 1
        good = (before >= 0) & (t[rows] - at[before] <= (STALE * own if within is None else within))
        out[rows[good]] = values[before[good]]
    elif source.take == "linear":
        after = np.clip(np.searchsorted(at, t[rows]), 1, max(len(at) - 1, 1))
        if len(at) > 1:
            near = at[after] - at[after - 1] <= (BESIDE * own if within is None else within)
            itself = (t[rows] == at[after - 1]) | (t[rows] == at[after])
            good = (t[rows] >= at[after - 1]) & (t[rows] <= at[after]) & (near | itself)
            out[rows[good]] = np.interp(t[rows[good]], at, values)
    else:
        _give_nearest(t, rows, at, values, HALF * clock if within is None else within, out)
    return out


def _give_nearest(t: np.ndarray, rows: np.ndarray, at: np.ndarray, values: np.ndarray, within: float,
                  out: np.ndarray) -> None:
    """Each sample to the row nearest to it, of several the nearest; out (n,) inout."""
    order = rows[np.argsort(t[rows], kind="stable")]
    stamps = t[order]
    right = np.clip(np.searchsorted(stamps, at), 1, max(len(stamps) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(stamps) - 1)
    nearest = np.where(np.abs(at - stamps[left]) <= np.abs(stamps[right] - at), left, right)
    distance = np.abs(at - stamps[nearest])
    near = np.flatnonzero(distance <= within * (1.0 + ROUNDING))
    near = near[np.argsort(-distance[near], kind="stable")]
    out[order[nearest[near]]] = values[near]   # of several for one row the last, which is the nearest, stays


def _period(at: np.ndarray) -> float:
    """Median step [s] of increasing stamps; 0 of fewer than two."""
    steps = np.diff(at)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0

"""Bring channels of different rates onto one clock, by a map (MAP.toml), without making up data.

The log's rows are those of one column's group (the map's `clock`, else the slower of theta and beta).  Another column
gives a row one value, by its `take`

    nearest   its sample nearest to the row, each sample to one row at most, no farther than half a period of the clock
    held      its last sample at or before the row, as a computer's output holds, no older than three of its own periods
    linear    between the samples before and after the row, if those are no farther apart than two of its own periods

and NaN (not measured) where there is none.
"""

import difflib
import math
from collections.abc import Mapping

import numpy as np

from sim.errors import InputError

from ..log.log import Log, log_of
from ..log.turns import continuous
from .mapping import AXES, Map, Source
from .readers import read_channels
from .text import NOT_ASKED, Channels
from .units import TIME_UNITS

HALF_PERIOD = 0.5  # of the clock's period
STALE = 3.0       # own periods
NEIGHBOURING_PERIODS = 2.0  # own periods
STAMP_ROUNDING = 1.0e-6  # of a period, of stamps that are decimals
ATTITUDES = ("theta", "theta_ref", "gamma", "alpha")   # what may be logged as 0 to 360 degrees
TILT = 0.2        # rad: a body turned by so much about another axis loses 2 % (1 - cos) of its turn about this one


def converted(path: str, mapping: Map, required: tuple[str, ...]) -> tuple[Log, tuple[str, ...]]:
    """Return the log that a map makes of a flight's file, and notes for the user (what was left out or corrected)."""
    channels = read_channels(path, mapping.options, mapping.channels())
    columns = mapped(path, channels, mapping)
    return mapping.cut.of_whole(log_of(columns, path, required)), (*mapping.notes, *channels.notes, *columns.notes)


def mapped(path: str, channels: Mapping[str, np.ndarray], mapping: Map) -> Channels:
    """Return the log's columns, name -> (n,) in SI units, from a file's channels; InputError names what is missing."""
    columns = Channels()
    with np.errstate(all="ignore"):  # what overflows is no number, which the data check finds
        sources = {source.column: _with_values(*sampled(path, channels, mapping, source, columns.notes))
                   for source in mapping.sources}
        clock = mapping.clock or _slower(sources)
        lengths = {name: len(channels[name]) for source in mapping.sources for name in source.channels}
        if mapping.period is not None and len(set(lengths.values())) > 1:
            found_rows = " and ".join(f"{name} has {n} rows" for name, n in lengths.items())
            raise InputError(f"{path}: {found_rows}; expected one table for the time.period of {mapping.path}")
        if len({stamps.dtype.kind == "M" for stamps, _ in sources.values()}) > 1:
            raise InputError(f"{path}: stamps that are dates and stamps that are numbers; expected one kind "
                             f"(columns.COLUMN.time in {mapping.path})")
        origin = _origin(sources[clock][0]) if mapping.from_first else 0
        times = {name: _seconds(stamps, origin, mapping) for name, (stamps, _) in sources.items()}
        columns["t"] = times[clock]
        of_clock = next(source for source in mapping.sources if source.column == clock)
        for source in mapping.sources:
            at, values = times[source.column], sources[source.column][1]
            if source.column == clock or (len(at) == len(columns["t"]) and np.array_equal(at, columns["t"])):
                columns[source.column] = values
                continue
            rows = columns["t"]
            if stamps_name(path, channels, mapping, source) == stamps_name(path, channels, mapping, of_clock):
                rows = np.where(np.isfinite(sources[clock][1]), rows, math.nan)  # of one table, one message a row
            columns[source.column] = _on_clock(rows, at, values, source)
            if np.isfinite(values).any() and not np.isfinite(columns[source.column]).any():
                raise InputError(f"{path}: no row has both {clock} ({_span(rows)}) and {source.column} ({_span(at)}); "
                                 f"expected stamps of one clock, or another take or within of {source.column}, in "
                                 f"{mapping.path}")
    return columns


def _with_values(stamps: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and values (n,) as they are; if most values are not finite, those of the finite rows alone."""
    filled = np.isfinite(values)
    return (stamps[filled], values[filled]) if 0 < 2 * filled.sum() <= len(filled) else (stamps, values)


def _slower(columns: dict[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """Return that one of theta and beta which has fewer rows: then every row has both."""
    names = [str(name) for name in ("theta", "beta", "beta_cmd") if name in columns][:2] or list(columns)
    return min(names, key=lambda name: len(columns[name][0]))


def _origin(stamps: np.ndarray) -> float | int:
    """Return the first stamp that is a number; an integer or a date [ns] stays exact, so that no digit is lost."""
    fair = stamps[~np.isnat(stamps)].astype(np.int64) if stamps.dtype.kind == "M" else stamps[np.isfinite(stamps)]
    return fair[0] if len(fair) else 0


def _seconds(stamps: np.ndarray, origin: float | int, mapping: Map) -> np.ndarray:
    """Return stamps (n,) in seconds after the origin, NaN for a date that is none."""
    if stamps.dtype.kind == "M":
        return np.where(np.isnat(stamps), math.nan, (stamps.astype(np.int64) - origin) / TIME_UNITS["ns"])
    return (stamps - origin) * mapping.period if mapping.period is not None else (stamps - origin) / mapping.units


def _span(at: np.ndarray) -> str:
    fair = at[np.isfinite(at)]
    return f"{np.min(fair):.6g} to {np.max(fair):.6g} s" if len(fair) else "no stamps"


def _channel(path: str, channels: Mapping[str, np.ndarray], name: str, map_path: str) -> np.ndarray:
    if name in channels:
        return channels[name]
    unread = getattr(channels, "unread", {})
    if unread.get(name, NOT_ASKED) != NOT_ASKED:
        raise InputError(f"{path}: channel {name!r}, which {map_path} names, is there but {unread[name]}")
    there = [*channels, *unread]
    near = difflib.get_close_matches(name, there, 3, 0.4) or there[:3]
    raise InputError(f"{path}: no channel {name!r}, which {map_path} names; there is {', '.join(near) or 'none'} "
                     "(launchid convert FILE --list shows all)")


def stamps_name(path: str, channels: Mapping[str, np.ndarray], mapping: Map, source: Source) -> str:
    """Return the channel of a source's stamps (its own `time`, the map's in its group, else that outside all; "" with a
    fixed period); InputError if the file lacks it."""
    if mapping.period is not None and source.time is None:
        return ""
    group = source.channels[0].rpartition("/")[0]
    inside = f"{group}/{mapping.time}" if group else mapping.time
    names = (source.time,) if source.time else (inside, mapping.time)
    there = {*channels, *getattr(channels, "unread", ())}
    stamps = next((name for name in names if name in there), names[-1] if mapping.time in inside else inside)
    _channel(path, channels, stamps, mapping.path)
    return stamps


def sampled(path: str, channels: Mapping[str, np.ndarray], mapping: Map, source: Source,
            notes: list[str] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps (n,) as in the file and values (n,) in SI units of one source; InputError if a channel is missing.

    notes  inout: gets lines about jumps of a turn that were taken out, and turns about the body's other axes
    """
    parts = [_channel(path, channels, name, mapping.path) for name in source.channels]
    of_stamps = stamps_name(path, channels, mapping, source)
    stamps = channels[of_stamps] if of_stamps else np.arange(len(parts[0]))
    for name, part in zip(source.channels, parts, strict=True):
        if len(part) != len(stamps):
            raise InputError(f"{path}: channel {name!r} has {len(part)} rows, its stamps {len(stamps)}; expected "
                             f"stamps of its own, columns.{source.column}.time, in {mapping.path}")
    values = [part.astype(np.float64) for part in parts]
    if source.axis is None:
        raw = np.sum([weight * value for weight, value in zip(source.weights, values, strict=True)], axis=0)
    else:
        q = np.stack(values, axis=1)
        raw = turned(q, source.axis, source.reference)
        if notes is not None:
            notes += _other_turns(path, source, source.axis, q)
    if stamps.dtype.kind in "iu":
        stamps = stamps.astype(np.int64)  # so that one before the first is negative
    column = source.factor * (source.scale * raw + source.offset)
    if source.axis is None and source.column in ATTITUDES:
        column, rows = continuous(column)
        if len(rows) and notes is not None:
            notes.append(f"{path}: {source.column}: {len(rows)} jump{'s' * (len(rows) > 1)} of a turn (an attitude of "
                         "0 to 360 degrees) taken out")
    return stamps, column


def _other_turns(path: str, source: Source, axis: int, q: np.ndarray) -> list[str]:
    """Return a line, else [], if attitudes q (n, 4), w first, turn by more than TILT about the other axes: then the
    turn about `axis` is no longer the integral of its rate."""
    q = q[np.isfinite(q).all(axis=1)]
    if len(q) < 2:
        return []
    others = [k for k in range(3) if k != axis]
    step = _relative(q[:-1], q[1:])
    step *= np.where(step[:, :1] < 0.0, -1.0, 1.0)
    vector = np.linalg.norm(step[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(vector, step[:, 0])
    turns = np.cumsum(step[:, 1:] * np.divide(angle, vector, out=np.zeros_like(angle), where=vector > 0.0)[:, None],
                      axis=0)[:, others]
    swing = _relative(np.broadcast_to(q[0] if source.reference is None else np.array(source.reference), q.shape), q)
    swung = 2.0 * np.arctan2(np.linalg.norm(swing[:, 1:][:, others], axis=1),
                             np.hypot(swing[:, 0], swing[:, 1 + axis]))
    most = max(float(np.max(np.ptp(turns, axis=0))), float(np.max(swung)))
    if not most > TILT:
        return []
    return [f'{path}: {source.column}: the body turns by {math.degrees(most):.0f} degrees about its other axes, so the '
            f'turn about "{AXES[axis]}" is not the integral of its rate (its pitch); expected less than '
            f"{math.degrees(TILT):.0f} degrees"]


def _relative(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return conj(p) q of quaternions (n, 4), w first: the turn from p to q, in the axes of p."""
    (w0, x0, y0, z0), (w, x, y, z) = p.T, q.T
    return np.stack([w0 * w + x0 * x + y0 * y + z0 * z, w0 * x - x0 * w - y0 * z + z0 * y,
                     w0 * y + x0 * z - y0 * w - z0 * x, w0 * z - x0 * y + y0 * x - z0 * w], axis=1)


def turned(q: np.ndarray, axis: int, reference: tuple[float, ...] | None) -> np.ndarray:
    """Return the continuous angle [rad] (n,) by which attitudes q (n, 4), w first, are turned about body axis 0, 1, 2.

    The twist in the swing-twist decomposition of conj(reference) q (None: the first row), exact for a turn about that
    axis, and regular where Euler angles are not (a launcher stands upright).  NaN for a row that is not finite.
    """
    fair = np.isfinite(q).all(axis=1)
    angle = np.full(len(q), math.nan)
    if not fair.any():
        return angle
    turn = _relative(np.broadcast_to(q[fair][0] if reference is None else np.array(reference), q[fair].shape), q[fair])
    angle[fair] = np.unwrap(2.0 * np.arctan2(turn[:, 1 + axis], turn[:, 0]), period=2.0 * math.pi)
    return angle


# ---- one clock


def _on_clock(t: np.ndarray, at: np.ndarray, values: np.ndarray, source: Source) -> np.ndarray:
    """Return values (k,), sampled `at` (k,) [s], on rows t (n,) [s] by the source's `take`; NaN where there is none."""
    fair = np.isfinite(at) & np.isfinite(values)
    order = np.argsort(at[fair], kind="stable")
    at, values = at[fair][order], values[fair][order]
    out = np.full(len(t), math.nan)
    if len(at) == 0:
        return out
    rows = np.flatnonzero(np.isfinite(t))
    period, clock = _period(at), _period(np.sort(t[rows]))
    within = source.within
    if source.take == "held":
        before = np.searchsorted(at, t[rows] + STAMP_ROUNDING * period, side="right") - 1
        good = (before >= 0) & (t[rows] - at[before] <= (STALE * period if within is None else within))
        out[rows[good]] = values[before[good]]
    elif source.take == "linear":
        after = np.clip(np.searchsorted(at, t[rows]), 1, max(len(at) - 1, 1))
        if len(at) > 1:
            near = at[after] - at[after - 1] <= (NEIGHBOURING_PERIODS * period if within is None else within)
            itself = (t[rows] == at[after - 1]) | (t[rows] == at[after])
            good = (t[rows] >= at[after - 1]) & (t[rows] <= at[after]) & (near | itself)
            out[rows[good]] = np.interp(t[rows[good]], at, values)
    else:
        _give_nearest(t, rows, at, values, HALF_PERIOD * clock if within is None else within, out)
    return out


def _give_nearest(t: np.ndarray, rows: np.ndarray, at: np.ndarray, values: np.ndarray, within: float,
                  out: np.ndarray) -> None:
    """Write into `out` (n,), in place, each of `values` at the row nearest to its stamp; a row keeps its nearest."""
    order = rows[np.argsort(t[rows], kind="stable")]
    stamps = t[order]
    right = np.clip(np.searchsorted(stamps, at), 1, max(len(stamps) - 1, 1))
    left = right - 1
    right = np.minimum(right, len(stamps) - 1)
    nearest = np.where(np.abs(at - stamps[left]) <= np.abs(stamps[right] - at), left, right)
    distance = np.abs(at - stamps[nearest])
    near = np.flatnonzero(distance <= within * (1.0 + STAMP_ROUNDING))
    near = near[np.argsort(-distance[near], kind="stable")]
    out[order[nearest[near]]] = values[near]   # of several for one row the last, which is the nearest, stays


def _period(at: np.ndarray) -> float:
    """Return the median step [s] of increasing stamps (n,); 0 for fewer than two."""
    steps = np.diff(at)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0

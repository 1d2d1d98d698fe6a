"""The check whether a column of the log is from another time than its stamps say, so that a cause stands in for it.

An attitude or a rate that is late is a cause of the catalogue.  One that is early (its stamp is that of another sensor,
or of when it was logged), and a nozzle angle that is late or early, are none, and the nearest cause takes their place:
a nozzle angle that is read late looks like an actuator that answers late, but the vehicle turns with the true one.  So
each column is moved in time; where one so moved explains more than the cause does, the cause is in doubt.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..causes import Cause
from ..data.record import BETA, CHANNELS, Record
from ..model.nuisance import Problem
from ..search.fit import Fit, fit
from ..search.profile import Model, profile
from ..search.selection import Selection, in_a_block, strongest
from .leftover import SHAPE_LIMIT, leftovers

STEP = 0.5       # rows from one try to the next
FURTHEST = 8     # tries


@dataclass(frozen=True, eq=False)
class Mistimed:
    """The moved column that a cause may stand in for: words, and the model of the other causes with it."""

    words: str
    model: Model

    @property
    def is_all(self) -> bool:
        """Whether nothing is left beside it."""
        return all(each.gain <= each.limit for each in leftovers(self.model))


def mistimed(selection: Selection) -> Mistimed | None:
    """The moved column that the strongest cause (or the block that it is part of) may stand in for; None: none."""
    model = selection.model
    first, record = strongest(selection), model.fit.record
    alone = not in_a_block(model.causes, first)
    others = tuple(cause for k, cause in enumerate(model.causes)
                   if k != first and (alone or not in_a_block(model.causes, k)))
    base = _fitted(model, others, record)
    for channel in record.channels:
        for way in (-1.0, 1.0) if CHANNELS.index(channel) == BETA else (-1.0,):
            if base.cost - _fitted(model, others, moved(record, channel, way * STEP)).cost < SHAPE_LIMIT:
                continue
            rows, best = _best(model, others, channel, way)
            more = best.log_likelihood - model.log_likelihood
            if more > SHAPE_LIMIT:
                cause, late = model.causes[first].hypothesis.cause, "late" if rows > 0.0 else "early"
                return Mistimed(f"{cause}: a column {channel} that is {abs(rows) * record.period:.2g} s {late} "
                                f"explains {more:.0f} nats more than it does", best)
    return None


def _fitted(model: Model, others: tuple[Cause, ...], record: Record) -> Fit:
    """The fit of other causes to another record, at the model's noise."""
    return fit(Problem(record, model.fit.filter), others, model.fit.delta)


def _best(model: Model, others: tuple[Cause, ...], channel: str, way: float) -> tuple[float, Model]:
    """(How many rows late the column is, the other causes with it so moved): tries on this way (-1: early) until one
    explains less, and the top of the parabola over the last three."""
    def at(rows: float) -> tuple[float, Model]:
        record = moved(model.fit.record, channel, rows)
        return rows, profile(record, others, model.fit.delta, model.fit.filter)

    tried = [at(0.0), at(way * STEP)]
    while tried[-1][1].log_likelihood > tried[-2][1].log_likelihood and len(tried) < FURTHEST:
        tried.append(at(way * STEP * len(tried)))
    if len(tried) > 2:
        before, top, after = (each.log_likelihood for _, each in tried[-3:])
        bend = before - 2.0 * top + after
        tried.append(at(tried[-2][0] + (0.5 * way * STEP * (before - after) / bend if bend < 0.0 else 0.0)))
    return max(tried, key=lambda each: each[1].log_likelihood)


def moved(record: Record, channel: str, rows: float) -> Record:
    """The record with a column so many rows earlier (negative: later).

    A part of a row by an all-pass filter, which leaves noise as white and as large as it was (Thiran, IEEE Trans.
    Circuit Theory 18 (1971), of order 1); beyond the log's end its last value stays.
    """
    k, z = CHANNELS.index(channel), record.z.copy()
    known = np.isfinite(z[:, k])
    index = np.arange(record.rows)
    x = np.interp(index, index[known], z[known, k])
    whole = max(math.floor(abs(rows) - 0.5), 0) if abs(rows) % 1.0 else round(abs(rows))
    x, known = (x[::-1], known[::-1]) if rows > 0.0 else (x, known)
    at = np.maximum(index - whole, 0)
    x, known, part = x[at], known[at], abs(rows) - whole
    if part > 0.0:
        x, known = _all_pass(x, part), known & known[np.maximum(index - 1, 0)]
    x, known = (x[::-1], known[::-1]) if rows > 0.0 else (x, known)
    z[:, k] = np.where(known, x, math.nan)
    return replace(record, z=z)


def _all_pass(x: np.ndarray, delay: float) -> np.ndarray:
    """x (n,) so many places later, up to 1.5."""
    a, made = (1.0 - delay) / (1.0 + delay), np.empty_like(x)
    before = y = float(x[0])
    for k, now in enumerate(x.tolist()):
        y = a * (now - y) + before
        made[k], before = y, now
    return made

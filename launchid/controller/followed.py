"""Where a filter that follows a mode stood, as the commands tell it: of a log that begins in flight the estimator
over its rows is not yet where the one on board was.

The filter stands still between two readings of the tracked frequency.  Where a reading's commands are not those of the
estimator over the log's rows, the frequency is sought that explains them: the one number of some twenty commands.  What
no frequency explains stays a misfit.  What the filters remember where the log begins is not known either, but acts
linearly, and is fitted with the first frequency.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sim.following import READING_PERIOD
from sim.sections import Controller

from ..sums import least_squares

GRID = 25          # frequencies tried over the range within which the filter may follow
SECTIONS = 22      # golden, about the best of them: to 1e-6 of the range
SKIPPED = 2          # readings until the law has forgotten how it began, a pseudo-derivative of some periods


def coefficients_at(own: Controller, frequency: float) -> list[tuple[float, ...]]:
    """Return b0, b1, b2, a1, a2 of each filter, with those that follow at a frequency [rad/s]."""
    filters = own.following(dict.fromkeys(own.followed, frequency)).filters
    return [(*each.b, *each.a[1:]) for each in filters]


def run_filters(filters: Sequence[Sequence[float]], x: list[float], states: list[list[float]]) -> list[float]:
    """Return commands x (n,) filtered by sections from states (s, 2), inout, as `sim.vehicle.controller.filtered`."""
    for (b0, b1, b2, a1, a2), state in zip(filters, states, strict=True):
        first, second = state
        out = []
        for value in x:
            y = b0 * value + first
            first = b1 * value - a1 * y + second
            second = b2 * value - a2 * y
            out.append(y)
        state[:] = first, second
        x = out
    return x


def told_by_commands(own: Controller, law: np.ndarray, wanted: np.ndarray, tuned: np.ndarray,
                     tolerance: float) -> np.ndarray:
    """Return the filters over time (ticks, s, 5) with those readings replaced whose commands tell another frequency.

    law        (ticks,) [rad] commands before the filters, NaN where not known: then they begin anew
    wanted     (ticks,) [rad] commands behind them, NaN where not known or limited
    tuned      (ticks, s, 5) as the estimator over the log's rows has them;  tolerance [rad] rms of agreement
    """
    followed = [each.follow for each in own.filters if each.follow is not None]
    if len({each.mode for each in followed}) != 1:
        return tuned
    follow, every = followed[0], max(round(READING_PERIOD / own.period), 1)
    ends = (1.0 - follow.reach) * follow.frequency, (1.0 + follow.reach) * follow.frequency
    tuned, known = tuned.copy(), np.isfinite(law)
    for begin in np.flatnonzero(known & ~np.append(False, known[:-1])).tolist():
        left = np.flatnonzero(~known[begin:])
        end = begin + int(left[0]) if len(left) else len(law)
        first = begin + SKIPPED * every
        states: list[list[float]] | None = None
        for start in range(first, end, every):
            part = slice(start, min(start + every, end))
            if np.count_nonzero(np.isfinite(wanted[part])) <= every // 2:
                states = None
                continue
            reading = _Reading(own, law[part].tolist(), wanted[part], states)
            given = tuned[start].tolist()
            if states is None or reading.off(given) > tolerance:
                given = coefficients_at(own, _best(reading.off_at, ends))
                if states is not None or reading.off(given) < reading.off(tuned[start].tolist()):
                    tuned[begin if start == first else start:part.stop] = given
            states = reading.left(tuned[start].tolist())
    return tuned


class _Reading:
    """The commands between two readings: before the filters (n,), wanted behind them, the filters' states where they
    begin, None: not known."""

    def __init__(self, own: Controller, law: list[float], wanted: np.ndarray, states: list[list[float]] | None) -> None:
        self.own, self.count, self.law, self.wanted, self.states = own, len(own.filters), law, wanted, states
        self.known = np.isfinite(wanted)

    def off(self, filters: Sequence[Sequence[float]]) -> float:
        """Return the rms misfit [rad] with these filters."""
        made = np.array(run_filters(filters, self.law, self.begun(filters)))
        return float(np.sqrt(np.mean(np.square(made - self.wanted)[self.known])))

    def off_at(self, frequency: float) -> float:
        """Return the rms misfit [rad] with the filters that follow at a frequency [rad/s]."""
        return self.off(coefficients_at(self.own, frequency))

    def begun(self, filters: Sequence[Sequence[float]]) -> list[list[float]]:
        """Return a copy of the states (s, 2) at the beginning: those of least squares where they are not known."""
        if self.states is not None:
            return [list(each) for each in self.states]
        rest = np.array(run_filters(filters, self.law, np.zeros((self.count, 2)).tolist()))
        still = [0.0] * len(self.law)
        answers = [run_filters(filters, still, unit.reshape(self.count, 2).tolist())
                   for unit in np.eye(2 * self.count)]
        design = np.transpose(answers)[self.known]
        return least_squares(design, (self.wanted - rest)[self.known]).reshape(self.count, 2).tolist()

    def left(self, filters: Sequence[Sequence[float]]) -> list[list[float]]:
        """Return the states (s, 2) after it."""
        states = self.begun(filters)
        run_filters(filters, self.law, states)
        return states


def _best(off: Callable[[float], float], ends: tuple[float, float]) -> float:
    """Return the frequency [rad/s] between two at which the misfit `off` is least."""
    grid = np.linspace(*ends, GRID).tolist()
    at = min(range(GRID), key=lambda k: off(grid[k]))
    low, high = grid[max(at - 1, 0)], grid[min(at + 1, GRID - 1)]
    for _ in range(SECTIONS):
        left, right = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, right) if off(left) < off(right) else (left, high)
    return 0.5 * (low + high)

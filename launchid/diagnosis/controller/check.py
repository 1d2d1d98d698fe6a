"""The check whether the logged command is the nominal controller's.  With the reference it can be recomputed exactly,
so any difference is a difference of gains, of computing time, or of the derivative's filter.

A log as fast as the controller (or faster) holds every error the controller saw, but for those before its first row:
what the derivative's filter remembers of them is free where the log begins in flight, and what other filters remember
is waited for until it is forgotten.  Of a slower one `gaps` has the check.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.sections import Multisine

from ...controller_replay import later, lowest
from ...sums import combined, least_squares, products, square
from ..data.record import THETA, Record
from .command import controller_gains, recomputed, without_limit
from .kind import FEWEST, FILTER, NEAR_LIMIT, NONE, ROUNDING, UNKNOWN, ControllerCheck

SAME_RECOMPUTED = 2.0e-3  # relative, of a gain; of the period for a delay: closer is the same
EXPLAINED = 0.05        # of the rms difference that may be left for a mismatch to be named
BETTER = 0.5            # of what an explanation leaves: another that is less simple must leave less
LONGEST_LAG = 6.0       # periods of computing time searched
LAG_STEP = 0.05         # periods
ALL_FILTERS = np.geomspace(0.05, 20.0, 60)  # of the derivative's time constant
WHOLE_LAGS = (0.0, 1.0, 2.0, 3.0)  # periods of computing time tried with each
FORGOTTEN = 1e-5        # of what filters remember: less is nothing
COMMENSURATE = 1e-6     # relative, of the controller's period to the log's grid


def check_controller(record: Record) -> ControllerCheck | None:
    """The check of the log's controller; None where it is not possible: no command, no reference, or no controller, or
    a log slower than it."""
    if record.nominal.controller is None or record.input != "beta_cmd" or not np.isfinite(record.reference).any() \
            or not np.isfinite(record.z[:, THETA]).any() or record.fine > 1 \
            or record.every != record.tick:
        return None
    if abs(_period(record) / record.nominal.controller.period - 1.0) > COMMENSURATE:
        return None  # rows and periods drift apart, so no row holds the error that a command answers
    found = _checked(record, begins=True)
    if found is None or found.kind == NONE:
        return found
    other = _checked(record, begins=False)
    if other is None and found.kind == UNKNOWN and record.nominal.controller.filters:
        return None  # they may remember what was before the log
    if other is None or other.kind == UNKNOWN:
        return found
    return other if other.kind == NONE or found.kind == UNKNOWN or other.after < BETTER * found.after else found


def _checked(record: Record, begins: bool) -> ControllerCheck | None:
    """The check of the log's commands;  begins  the controller's first error is the log's, with nothing remembered."""
    stride = slice(record.held_phase, None, record.held)
    logged = record.commands[stride]
    limit = controller_gains(record.nominal)[4]
    expected = recomputed(record)[stride]
    fair = (np.abs(logged) < NEAR_LIMIT * limit) & (np.abs(expected) < NEAR_LIMIT * limit)
    fair[:2 if begins else round(LONGEST_LAG) + 2] = False  # else it lacks the error before its first
    whole = _whole(record)[stride]
    forgotten = _forgotten(record)
    forgets = not whole.all() and forgotten == 0
    if forgotten > 0 and not (begins and whole.all()):
        fair[:forgotten] = False
        fair &= _so_long(whole, forgotten)
    elif forgets:
        fair &= _so_long(whole, round(LONGEST_LAG) + 2) & np.concatenate([[False], fair[:-1]])
    if fair.sum() < FEWEST:
        return None if forgets else _always_limited(record, logged, expected)
    free = not (begins or forgets or forgotten > 0)
    before = _rms(_own_part(record, logged - expected, forgets), fair, _remembered(record, len(fair), free))
    if before < max(ROUNDING, record.nominal.diagnosis.command):
        return ControllerCheck(NONE, before, before)
    told = _Told(record, logged, fair, forgets, free)
    best = told.best()
    if best.after > ROUNDING:
        filtered = _filter(told)
        best = filtered if filtered is not None and filtered.after < BETTER * best.after else best
    best = replace(best.of_kind(SAME_RECOMPUTED, _period(record)), before=before,
                   evidence=float(fair.sum() * math.log(before / max(best.after, ROUNDING))))
    most = ROUNDING if best.time_constant is not None and best.kind != FILTER else max(EXPLAINED * before, ROUNDING)
    return replace(best, kind=UNKNOWN) if best.kind == NONE or best.after > most else best


def _always_limited(record: Record, logged: np.ndarray, expected: np.ndarray) -> ControllerCheck | None:
    """The check of commands (periods,) [rad] hardly any of which shows gains.  They are another controller's, if the
    nominal's would be at their limit where most of those logged are not (an attitude that is far from the logged
    reference); else None."""
    own, limit = record.nominal.controller, controller_gains(record.nominal)[4]
    differ = (np.abs(expected) >= NEAR_LIMIT * limit) & (np.abs(logged) < NEAR_LIMIT * limit)
    if own is None or own.filters or differ.sum() < max(FEWEST, 0.5 * len(differ)):
        return None
    apart = float(np.sqrt(np.mean((logged - expected)[differ]**2)))
    return ControllerCheck(UNKNOWN, apart, apart)


def _forgotten(record: Record) -> int:
    """Periods until the controller, with filters, has forgotten how the log began: all where one never does; 0 without
    filters."""
    own = record.nominal.controller
    assert own is not None
    if not own.filters:
        return 0
    lag = own.derivative_time_constant / (own.derivative_time_constant + own.period)
    slowest = max(lag, *(float(np.max(np.abs(np.roots(section.a)))) for section in own.filters))
    if slowest ** record.rows > FORGOTTEN:
        return record.rows
    return round(LONGEST_LAG) + 2 + math.ceil(math.log(FORGOTTEN) / math.log(max(slowest, FORGOTTEN)))


def _whole(record: Record) -> np.ndarray:
    """(n,) bool: rows with attitude, reference and command."""
    whole = np.isfinite(record.z[:, THETA]) & np.isfinite(record.reference)
    return whole if record.logged is None else whole & record.logged


def _so_long(whole: np.ndarray, rows: int) -> np.ndarray:
    """(n,) bool: the row and so many before it are."""
    count = np.concatenate([np.zeros(rows + 1), np.cumsum(~whole)])
    return np.asarray(count[rows + 1:] - count[:-rows - 1] == 0.0)


def _own_part(record: Record, x: np.ndarray, forgets: bool) -> np.ndarray:
    """Commands (or differences) x (periods,) [rad]; where rows were lost what the derivative's filter remembers of the
    errors before is taken off, x(k) - alpha x(k-1): it decays by alpha = tau/(tau + T) a period."""
    if not forgets:
        return x
    tau, period = controller_gains(record.nominal)[2:4]
    return np.asarray(x - tau / (tau + period) * np.concatenate([x[:1], x[:-1]]))


def _period(record: Record) -> float:
    """The controller's [s]."""
    return record.tick * record.held * record.step


def _rms(x: np.ndarray, rows: np.ndarray, beside: np.ndarray) -> float:
    """The RMS of x (n,) in these rows, the best multiples of `beside` (n, columns) taken off."""
    rest = x[rows]
    if beside.size:
        rest = rest - combined(beside[rows], least_squares(beside[rows], rest))
    return float(np.sqrt(np.mean(rest**2)))


def _remembered(record: Record, periods: int, free: bool) -> np.ndarray:
    """(periods, 1) what the derivative's filter makes of what it remembers at the first row, alpha^k; (periods, 0)
    where that is known."""
    tau, period = controller_gains(record.nominal)[2:4]
    return np.power(tau / (tau + period), np.arange(periods))[:, None][:, :1 if free and tau > 0.0 else 0]


@dataclass(frozen=True, eq=False)
class _Told:
    """Commands logged (periods,) [rad], those that tell gains, fair (periods,) bool; where rows were lost of both
    sides the `_own_part` (forgets), where the log begins in flight what is remembered is free."""

    record: Record
    logged: np.ndarray
    fair: np.ndarray
    forgets: bool
    free: bool

    def best(self, lags: Iterable[float] | None = None) -> ControllerCheck:
        """Gains and computing time that explain the commands best;  lags [periods] that are tried; None: all."""
        parts = self._parts()
        lags = self._lags(parts) if lags is None else lags
        return min((self._gains_and_lag(parts, lag) for lag in lags), key=lambda check: check.after)

    def with_filter(self, tau: float) -> "_Told":
        """The same if the derivative had this time constant [s]."""
        controller = self.record.nominal.controller
        assert controller is not None
        nominal = replace(self.record.nominal, controller=replace(controller, derivative_time_constant=tau))
        return replace(self, record=replace(self.record, nominal=nominal))

    def _parts(self) -> "_Parts":
        """The parts of the commands logged."""
        record, controller = self.record, self.record.nominal.controller
        assert controller is not None
        record = without_limit(record)

        def made(kp: float, kd: float, test: Multisine | None) -> np.ndarray:
            nominal = replace(record.nominal, controller=replace(controller, kp=kp, kd=kd), test_input=test)
            command = recomputed(replace(record, nominal=nominal))[record.held_phase::record.held]
            return _own_part(record, command, self.forgets)

        return _Parts(made(controller.kp, 0.0, None), made(0.0, controller.kd, None),
                      made(0.0, 0.0, record.nominal.test_input), _own_part(record, self.logged, self.forgets),
                      _remembered(record, len(self.logged), self.free))

    def _lags(self, parts: "_Parts") -> list[float]:
        """Computing times [periods] worth a fit: whole ones, and the best of a grid, refined."""
        grid = np.arange(0.0, LONGEST_LAG, LAG_STEP)
        total = parts.kp + parts.kd
        errors = [_rms(parts.logged - later(parts.test, float(lag)), self.fair,
                       np.column_stack([later(total, float(lag)), parts.remembered])) for lag in grid]
        best = float(grid[int(np.argmin(errors))])
        fine = np.clip(best + np.linspace(-LAG_STEP, LAG_STEP, 41), 0.0, None)
        return [*WHOLE_LAGS, *(float(lag) for lag in fine)]

    def _gains_and_lag(self, parts: "_Parts", lag: float) -> ControllerCheck:
        wanted = (parts.logged - later(parts.test, lag))[self.fair]
        design = np.column_stack([later(parts.kp, lag), later(parts.kd, lag), parts.remembered])[self.fair]
        values = least_squares(design, wanted)
        values[~design.any(axis=0)] = 1.0  # a part that the nominal does not have
        after = float(np.sqrt(np.mean((wanted - combined(design, values))**2)))
        spread = max(after, ROUNDING) * np.sqrt(np.maximum(np.diag(np.linalg.pinv(products(design, design))), 0.0))
        slope = np.gradient(combined(design, values) + later(parts.test, lag)[self.fair])
        lag_std = max(after, ROUNDING) / max(math.sqrt(square(slope)), 1e-12)
        tick = _period(self.record)
        return ControllerCheck("", 0.0, after, float(values[0]), float(values[1]), lag * tick,
                               (float(spread[0]), float(spread[1]), lag_std * tick))


class _Parts(NamedTuple):
    """The parts of commands, (periods,) [rad] each: kp e and kd d, in which a command is linear, and the test input,
    which no gain scales; the commands logged; (periods, 0 or 1) what is remembered of before the log."""

    kp: np.ndarray
    kd: np.ndarray
    test: np.ndarray
    logged: np.ndarray
    remembered: np.ndarray


def _filter(told: _Told) -> ControllerCheck | None:
    """Fit the derivative's time constant with gains and delay; None if the nominal has no filter."""
    controller = told.record.nominal.controller
    assert controller is not None
    if controller.derivative_time_constant <= 0.0:
        return None

    def best_with(tau: float, lags: Iterable[float]) -> ControllerCheck:
        return replace(told.with_filter(tau).best(lags), time_constant=tau)

    taus = controller.derivative_time_constant * ALL_FILTERS
    tries = [best_with(float(tau), WHOLE_LAGS) for tau in taus]
    k = int(np.argmin([check.after for check in tries]))
    lag = (tries[k].delay / _period(told.record),)
    tau = lowest(lambda tau: best_with(tau, lag).after, float(taus[max(k - 1, 0)]),
                 float(taus[min(k + 1, len(taus) - 1)]), 40)  # golden sections: to 1e-8 of the bracket
    return best_with(tau, lag)

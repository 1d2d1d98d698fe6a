"""Check whether the logged command is the nominal controller's.  With the reference it can be recomputed exactly
(`replay`), so any difference is a difference of gains, of computing time, or of the derivative's filter.
A log slower than its controller is checked by `gaps`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..log.record import Z_THETA, Z_THETA_DOT, Record
from .command import recomputed_at
from .replay import KD, KI, KP, Explanation, Replay, constants_of, lowest, replayed, rms
from .ticks import Ticks, command_noise, over_grid

GAIN, LATE_COMMAND, OTHER_FILTER, UNKNOWN_LAW, NO_MISMATCH = "gain", "delay", "filter", "unknown", "none"
COMMAND_ROUNDING = 2.0e-5  # rad rms: what rounding in a log's digits may make of an exact command
SAME_RECOMPUTED = 2.0e-3  # relative, of a gain; of the period for a delay: closer is the same
GAIN_SIGMAS = 3.0       # standard deviations within which an integral's gain is the same, too
DIFFERENCE_LEFT = 0.05  # of the rms difference that may be left for a mismatch to be named
BETTER = 0.5            # of what gains and delay leave: another filter must leave less
ALL_FILTERS = np.geomspace(0.05, 20.0, 60)  # of the derivative's time constant
WHOLE_LAGS = (0.0, 1.0, 2.0, 3.0)  # periods of computing time tried with each
LEAST_OF_LAW = 0.5      # of the square of commands between ticks, that the law must make of the attitudes
COMMENSURATE = 1e-6     # relative, of the controller's period to the log's grid


@dataclass(frozen=True)
class ControllerCheck:
    """The difference of the logged commands from the nominal controller's, and its best explanation.

    before, after  rms [rad] of the difference, and after the best explanation
    kind         "gain", "delay", "filter", these joined by " and ", "unknown", or "none" when it is the nominal's
    delay        [s] of computing time
    std          of kp_scale, kd_scale, delay
    evidence     nats, for a white difference
    time_constant  [s] of the derivative, where that is part of the explanation
    integral_scale  of ki, in a rate law, where that is the explanation
    """

    kind: str
    before: float
    after: float
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    delay: float = 0.0
    std: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_constant: float | None = None
    evidence: float = 0.0
    integral_scale: float | None = None

    @property
    def is_named(self) -> bool:
        """Whether the cause `controller_mismatch` (gains, computing time) explains it, with another filter or not."""
        return not self.is_foreign and self.kind != NO_MISMATCH

    @property
    def is_foreign(self) -> bool:
        """Whether another law gave the commands: no gains and no computing time make them the nominal controller's."""
        return self.kind in (UNKNOWN_LAW, OTHER_FILTER)

    @property
    def words(self) -> str:
        """The difference as text: how far apart the commands are, or which filter or integral would explain it."""
        if self.kind == OTHER_FILTER and self.time_constant is not None:
            return f"a derivative time constant of {self.time_constant:.4g} s would explain it"
        if self.integral_scale is not None:
            return f"{self.integral_scale:.4g} times the nominal's ki and {self.kp_scale:.4g} times its kp " \
                   "would explain it"
        return f"{self.before:.2g} rad rms apart, {self.after:.2g} after the best gains and delay"

    def of_kind(self, same: float, period: float) -> "ControllerCheck":
        """Return the check with `kind` set: parts that differ by more than `same`, relative; a delay, of period [s]."""
        parts = {GAIN: abs(self.kp_scale - 1.0) > same or abs(self.kd_scale - 1.0) > same,
                 LATE_COMMAND: self.delay > same * period, OTHER_FILTER: self.time_constant is not None}
        return replace(self, kind=" and ".join(name for name, differs in parts.items() if differs) or NO_MISMATCH)


def check_controller(record: Record) -> ControllerCheck | None:
    """Check a log's commands; None if it has no command, no reference or no controller, or rows are slower than it."""
    own = record.law if record.law is not None else record.nominal.controller
    if record.fine > 1 and record.law is None:
        return _check_between(record)
    if own is None or record.input != "beta_cmd" or record.fine > 1 or record.every != record.tick \
            or abs(record.held * record.period / own.period - 1.0) > COMMENSURATE:
        return None
    seen, reference = (record.z[:, Z_THETA_DOT], record.rate_reference) if own.is_rate_law else \
        (record.z[:, Z_THETA], record.reference)
    if not np.isfinite(seen - reference).any() or own.followed:
        return None
    rates = (record.z[:, Z_THETA_DOT], record.rate_reference) if len(own.reads) > 1 else ()
    if rates and not np.isfinite(rates[0] - rates[1]).any():
        return None
    logged = record.commands if record.logged is None else np.where(record.logged, record.commands, math.nan)
    made = replayed(replace(record.nominal, controller=own), float(record.t[0]), record.period, record.held, logged,
                    seen, reference, *rates)
    if isinstance(made, str):
        return None
    ticks = np.isfinite(made.misfit)
    before = rms(made.misfit[ticks])
    if before <= max(made.tolerance, COMMAND_ROUNDING):
        return ControllerCheck(NO_MISMATCH, before, before)
    best, tau = made.explained(ticks), None
    if not np.isfinite(best.gains).all():
        return ControllerCheck(UNKNOWN_LAW, before, before)
    if best.after > COMMAND_ROUNDING and own.derivative_time_constant > 0.0 and not own.is_rate_law:
        other, with_filter = _filtered(made, ticks)
        if with_filter.after < BETTER * best.after:
            best, tau = with_filter, other
    return _judged(made, best, tau, before, int(ticks.sum()))


def _check_between(record: Record) -> ControllerCheck | None:
    """Check a log whose rows fall between the controller's ticks, so that its commands are known to noise: they
    are another law's where the nominal's makes less than half of them from the attitudes.  None: the nominal's law
    may have made them."""
    own, theta = record.nominal.controller, record.z[:, Z_THETA]
    if own is None or record.input != "beta_cmd" or not np.isfinite(theta - record.reference).any():
        return None
    ticks = Ticks(0.0, own.period / record.step, 0.0)
    off = rms(over_grid(ticks, record, recomputed_at(ticks, record)) - record.commands)
    most = math.hypot(LEAST_OF_LAW**0.5 * float(np.std(record.commands)), 2.0 * command_noise(record))
    return ControllerCheck(UNKNOWN_LAW, off, off) if off > most else None


def _judged(made: Replay, best: Explanation, tau: float | None, before: float, count: int) -> ControllerCheck:
    """Return the check that follows from the best explanation of `count` commands."""
    own = made.nominal.controller
    assert own is not None
    believed = constants_of(made.nominal)[[KP, KI if own.is_rate_law else KD]]
    # a part that the nominal does not have
    is_new = (believed == 0.0) & (np.abs(best.gains) > GAIN_SIGMAS * best.std[:2])
    scale = np.where(believed == 0.0, 1.0, best.gains / np.where(believed == 0.0, 1.0, believed))
    std = np.where(believed == 0.0, 0.0, best.std[:2] / np.where(believed == 0.0, 1.0, np.abs(believed)))
    found = ControllerCheck("", before, best.after, float(scale[0]), 1.0 if own.is_rate_law else float(scale[1]),
                            best.delay, (float(std[0]), 0.0 if own.is_rate_law else float(std[1]), float(best.std[2])),
                            tau, count * math.log(before / max(best.after, COMMAND_ROUNDING)))
    found = found.of_kind(SAME_RECOMPUTED, own.period)
    most = COMMAND_ROUNDING if tau is not None and found.kind != OTHER_FILTER else max(DIFFERENCE_LEFT * before,
                                                                                       COMMAND_ROUNDING)
    is_told = best.after <= most and not is_new.any()
    if own.is_rate_law and is_told and abs(scale[1] - 1.0) > max(SAME_RECOMPUTED, GAIN_SIGMAS * std[1]):
        return replace(found, kind=UNKNOWN_LAW, integral_scale=float(scale[1]))
    return found if is_told and found.kind != NO_MISMATCH else replace(found, kind=UNKNOWN_LAW)


def _filtered(made: Replay, ticks: np.ndarray) -> tuple[float, Explanation]:
    """Return the derivative's time constant [s] that explains the commands best, and the explanation with it."""
    own = made.nominal.controller
    assert own is not None

    def best_with(tau: float, lags: tuple[float, ...]) -> Explanation:
        nominal = replace(made.nominal, controller=replace(own, derivative_time_constant=tau))
        return replace(made, nominal=nominal).explained(ticks, lags)

    taus = own.derivative_time_constant * ALL_FILTERS
    tries = [best_with(float(tau), WHOLE_LAGS) for tau in taus]
    k = int(np.argmin([each.after for each in tries]))
    lag = (tries[k].delay / own.period,)
    tau = lowest(lambda tau: best_with(tau, lag).after, float(taus[max(k - 1, 0)]),
                 float(taus[min(k + 1, len(taus) - 1)]), 40)  # golden sections: to 1e-8 of the bracket
    return tau, best_with(tau, lag)

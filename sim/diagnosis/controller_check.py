"""Is the logged command the nominal controller's?  With the reference it can be recomputed exactly, so any difference
is a difference of gains, of computing time, or of the derivative's filter.

A log as fast as the controller (or faster) holds every error the controller saw.  In a slower one the errors between
rows are estimated, and the difference is judged against what is left of it instead of against nothing.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from .record import THETA, Record, controller_gains, recomputed

EXACT = 2.0e-5          # rad rms: what rounding in a log's digits may make of an exact command
SAME = 2.0e-3           # relative, of a gain; of the period for a delay: closer is the same
EXPLAINED = 0.05        # of the rms difference that may be left for a mismatch to be named
LONGEST_LAG = 6.0       # periods of computing time searched
LAG_STEP = 0.05         # periods
FILTERS = np.geomspace(0.05, 20.0, 200)   # of the derivative's time constant
SIGNIFICANT = 30.0      # nats that a mismatch must gain where the command is not exactly recomputable
SLOW_SAME = 0.04        # relative, of a gain in a slow log: predicted errors bias the derivative's by 2 %
SLOW_NOISE = 4.0        # times what the attitude's noise between rows makes: more is no difference of gains
FEWEST = 20             # commands, or blocks, without which nothing is said
NEAR_LIMIT = 0.999      # of the deflection limit: beyond it a command says nothing about gains


@dataclass(frozen=True)
class ControllerCheck:
    """rms [rad] of logged less recomputed command, before and after the best explanation.

    kind         "gain", "delay", "gain and delay", "filter", "unknown", or "none" when it is the nominal's
    evidence     nats, as if the difference were white noise
    time_constant  [s] of the derivative, where that is the explanation
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

    @property
    def is_named(self) -> bool:
        """The catalogue's `controller_mismatch` explains it."""
        return self.kind in ("gain", "delay", "gain and delay")


def check_controller(record: Record, attitude: np.ndarray | None = None) -> ControllerCheck | None:
    """None where it cannot be told: no command, no reference, or no controller.

    attitude  (ticks,) [rad] predicted, for the ticks between the rows of a log slower than the controller
    """
    if record.nominal.controller is None or record.input != "beta_cmd" or not np.isfinite(record.reference).any():
        return None
    if record.every != record.tick:
        return _slow(record, attitude)
    stride = slice(record.held_phase, None, record.held)
    logged = record.commands[stride]
    limit = controller_gains(record.nominal)[4]
    expected = recomputed(record)
    fair = (np.abs(logged) < NEAR_LIMIT * limit) & (np.abs(expected[stride]) < NEAR_LIMIT * limit)
    fair[:2] = False  # a log that begins in flight lacks the error before its first
    fair &= _measured(record)[stride]
    if fair.sum() < FEWEST:
        return None
    before = _rms(logged - expected[stride], fair)
    if before < EXACT:
        return ControllerCheck("none", before, before)
    parts = _parts(record)
    best = min((_gains_and_lag(record, parts, logged, fair, stride, lag)
                for lag in _lags(parts, logged, fair, stride)), key=lambda check: check.after)
    filtered = _filter(record, logged, fair, stride, before)
    if filtered is not None and filtered.after < 0.5 * best.after:
        best = filtered
    named = _kind(best, record)
    unexplained = named == "none" or best.after > max(EXPLAINED * before, EXACT)
    return replace(best, kind="unknown" if unexplained else named, before=before,
                   evidence=float(fair.sum() * math.log(before / max(best.after, EXACT))))


def _slow(record: Record, attitude: np.ndarray | None) -> ControllerCheck | None:
    """A log slower than the controller.  With alpha = tau/(tau + T) and m ticks a row,

        c(k+1) - alpha^m c(k) = kp (e(k+1) - alpha^m e(k)) + kd sum alpha^(m-j) (e(j) - e(j-1))/(tau + T)

    is linear in the gains; the errors between the rows are predicted ones, their noise is what is left.
    """
    if attitude is None or "theta_dot" not in record.channels:
        return None  # without a rate the predicted errors are too poor to judge gains by
    m, n = record.every // record.tick, record.rows
    kp, kd, tau, period, limit = controller_gains(record.nominal)
    alpha = tau / (tau + period)
    known = np.isfinite(record.reference)
    reference = np.interp(np.arange(n * m) / m, np.arange(n)[known], record.reference[known])
    error = attitude - reference
    measured = np.isfinite(record.z[:, THETA])
    error[::m] = np.where(measured, record.z[:, THETA], attitude[::m]) - reference[::m]
    command = record.commands[::m]
    fair = measured[1:] & measured[:-1] & (np.maximum(np.abs(command[1:]), np.abs(command[:-1])) < NEAR_LIMIT * limit)
    if fair.sum() < FEWEST or record.nominal.test_input is not None or kd == 0.0 or kp == 0.0:
        return None
    steps = sum(alpha**(m - j) * (error[j:(n - 1) * m + j:m][:n - 1] - error[j - 1:(n - 1) * m + j - 1:m][:n - 1])
                for j in range(1, m + 1)) / (tau + period)
    wanted = (command[1:] - alpha**m * command[:-1])[fair]
    design = np.column_stack([kp * (error[m::m] - alpha**m * error[:-m:m]), kd * steps])[fair]
    rest = wanted - design.sum(axis=1)
    gains, *_ = np.linalg.lstsq(design, wanted, rcond=None)
    left = wanted - design @ gains
    before, after = float(np.sqrt(np.mean(rest**2))), float(np.sqrt(np.mean(left**2)))
    noise = SLOW_NOISE * kd / (tau + period) * (1.0 - alpha) * max(record.nominal.sensors.theta_std, EXACT)
    std = after * np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    gained = float(fair.sum() * math.log(before / after))
    if after > noise:
        return ControllerCheck("unknown", before, after, evidence=gained)
    if gained < SIGNIFICANT or max(abs(gains - 1.0)) < SLOW_SAME:
        return ControllerCheck("none", before, before)
    return ControllerCheck("gain", before, after, float(gains[0]), float(gains[1]), 0.0,
                           (float(std[0]), float(std[1]), 0.0), evidence=gained)


def _measured(record: Record) -> np.ndarray:
    """Ticks whose own and last attitude were measured."""
    seen = np.isfinite(record.z[:, THETA]) & np.isfinite(record.reference)
    return seen & np.concatenate([[False], seen[:-1]])


def _rms(x: np.ndarray, rows: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x[rows]**2)))


def _parts(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """kp e and kd d [rad] of every tick: the command is linear in both gains."""
    controller = record.nominal.controller
    assert controller is not None
    wide = replace(record.nominal.actuator, deflection_limit=math.inf) if record.nominal.actuator else None
    made = []
    for kp, kd in ((controller.kp, 0.0), (0.0, controller.kd)):
        nominal = replace(record.nominal, controller=replace(controller, kp=kp, kd=kd), actuator=wide, test_input=None)
        made.append(recomputed(replace(record, nominal=nominal)))
    return made[0], made[1]


def _lags(parts: tuple[np.ndarray, np.ndarray], logged: np.ndarray, fair: np.ndarray,
          stride: slice) -> list[float]:
    """Computing times [periods] worth a fit: none, and the best of a grid, refined."""
    total = parts[0] + parts[1]
    kernel_lags = np.arange(0.0, LONGEST_LAG, LAG_STEP)
    errors = []
    for lag in kernel_lags:
        late = _late(total, float(lag))
        design = late[stride][fair]
        scale = float(design @ logged[fair]) / max(float(design @ design), 1e-300)
        errors.append(_rms(logged - scale * late[stride], fair))
    best = float(kernel_lags[int(np.argmin(errors))])
    fine = np.clip(best + np.linspace(-LAG_STEP, LAG_STEP, 41), 0.0, None)
    return [0.0, *(float(lag) for lag in fine)]


def _late(x: np.ndarray, lag: float) -> np.ndarray:
    """What is issued when computing takes `lag` periods: the mean over a period, as the effect's (`controller.py`)."""
    whole, part = int(lag), lag - int(lag)
    return (1.0 - part) * _shifted(x, whole) + part * _shifted(x, whole + 1)


def _shifted(x: np.ndarray, by: int) -> np.ndarray:
    return x if by == 0 else np.concatenate([np.zeros(by), x[:-by]])


def _gains_and_lag(record: Record, parts: tuple[np.ndarray, np.ndarray], logged: np.ndarray, fair: np.ndarray,
                   stride: slice, lag: float) -> ControllerCheck:
    columns = [_late(part, lag)[stride] for part in parts]
    design = np.column_stack([c[fair] for c in columns])
    gains, *_ = np.linalg.lstsq(design, logged[fair], rcond=None)
    rest = np.zeros_like(logged)
    rest[fair] = logged[fair] - design @ gains
    after = _rms(rest, fair)
    spread = max(after, EXACT) * np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    slope = np.gradient(design @ gains)
    lag_std = max(after, EXACT) / max(float(np.sqrt(slope @ slope)), 1e-12)
    tick = record.tick * record.held * record.step
    return ControllerCheck("", 0.0, after, float(gains[0]), float(gains[1]), lag * tick,
                           (float(spread[0]), float(spread[1]), lag_std * tick))


def _filter(record: Record, logged: np.ndarray, fair: np.ndarray, stride: slice,
            before: float) -> ControllerCheck | None:
    """The derivative's time constant that would explain the difference."""
    controller = record.nominal.controller
    assert controller is not None
    if controller.derivative_time_constant <= 0.0:
        return None

    def after(tau: float) -> float:
        nominal = replace(record.nominal, controller=replace(controller, derivative_time_constant=tau))
        return _rms(logged - recomputed(replace(record, nominal=nominal))[stride], fair)

    taus = controller.derivative_time_constant * FILTERS
    values = [after(float(tau)) for tau in taus]
    k = int(np.argmin(values))
    low, high = taus[max(k - 1, 0)], taus[min(k + 1, len(taus) - 1)]
    for _ in range(30):
        left, right = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, right) if after(float(left)) < after(float(right)) else (left, high)
    tau = float(0.5 * (low + high))
    return ControllerCheck("filter", before, after(tau), time_constant=tau)


def _kind(check: ControllerCheck, record: Record) -> str:
    if check.kind == "filter":
        return "filter"
    tick = record.tick * record.held * record.step
    gains = abs(check.kp_scale - 1.0) > SAME or abs(check.kd_scale - 1.0) > SAME
    late = check.delay > SAME * tick
    return "gain and delay" if gains and late else "gain" if gains else "delay" if late else "none"



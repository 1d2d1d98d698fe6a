"""The servo of a log: natural frequency, damping ratio and delay by maximum likelihood, beside a6 and k1.

Fisher scoring on the information and the score of the bound's filter (`bound.information`).  Its unknowns are, window
by window, the initial state and relative a6 and k1, and one servo for the whole log, for which the nominal's sigmas are
a normal prior.  The windows' own unknowns are eliminated one window at a time (a Schur complement), the servo is solved
for, and they are solved for again.

An estimate of a6 and k1 that was made with a servo moves with it: by how much is asked of the on-board estimator
itself, which is run again with each number of the servo moved by a standard deviation.  So what is not known of the
servo is in the covariance of a6, k1 and servo, as the inverse of the joint information has it.

On the host: the on-board filter does not estimate the servo yet.  Assumptions: one servo for the whole log; noises as
declared.
"""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np

from launchid_core import Config, Estimate

from ..believed import MODELLED, onboard_model
from ..bound.flights import noise_variances, servo_sigma, switched
from ..bound.information import WITH_SERVO, window_information
from ..bound.matrices import without_offset
from ..bound.world import World, over_steps, world_of
from ..errors import InputError
from ..identified import Identified, identified
from ..log import Log
from ..nominal import Nominal
from .flight_margins import Servo, known_servo

WINDOW = 5.0         # s, in which a6 and k1 are constant shares of the nominal's
RIGID = 0.5          # relative, one sigma of those shares: what a window says nothing of stays where it is
MOST_ROUNDS = 40
CLOSE = 1e-2         # standard deviations: of the last step
LARGEST_STEP = 0.2   # of the servo's frequency and damping in one round
LARGEST_DELAY_STEP = 0.01  # s
LEAST = 0.05         # of the nominal's: below it no servo's frequency or damping is looked for
ROWS_LEAST = 50


class Flown:
    """A log as the bound's filter takes it: rows of the clock, those not measured NaN, commands held."""

    def __init__(self, log: Log, nominal: Nominal) -> None:
        if "beta_cmd" not in log.columns or np.count_nonzero(log.in_range("beta_cmd")) < ROWS_LEAST:
            raise InputError(f"{log.path}: column beta_cmd is missing; a servo of which [actuator] gives a sigma "
                             "cannot be known without its command: log it, or declare the servo known")
        first = int(np.argmax(log.in_range("t")))
        k = np.round((log.t - log.t[first]) / log.period)
        good = log.in_range("t") & (k >= 0.0) & (k < 4.0 * len(log.t))
        rows = np.flatnonzero(good)
        rows = rows[np.concatenate([[True], np.diff(np.maximum.accumulate(k[rows])) > 0.0])]
        self.period = log.period
        self.t = log.t[rows]
        self.z = np.column_stack([np.where(log.in_range(name)[rows], getattr(log, name)[rows], np.nan)
                                  if name in log.columns else np.full(len(rows), np.nan)
                                  for name in ("theta", "theta_dot", "beta")])
        command = np.where(log.in_range("beta_cmd")[rows], log.beta_cmd[rows], np.nan)
        last = np.maximum.accumulate(np.where(np.isfinite(command), np.arange(len(rows)), 0))
        self.command = np.nan_to_num(command[last])
        self.gamma = np.nan_to_num(log.gamma[rows]) if "gamma" in log.columns else np.zeros(len(rows))
        self.window = np.floor((self.t - self.t[0]) / WINDOW + 1e-9).astype(np.int64)
        self.world = self._world(nominal)

    def _world(self, nominal: Nominal) -> World:
        """The world that [wind] and [offsets] leave open, with the log's flight path."""
        path = SimpleNamespace(t=self.t, period=self.period, wind=-self.gamma, true_gamma=np.zeros(len(self.t)))
        world = world_of(nominal, path)
        inertial = nominal.sensors.alpha_source == "inertial"
        return world._replace(air=world.air - over_steps(self.gamma)) if inertial and self.gamma.any() else world


def servo_of_log(log: Log, nominal: Nominal) -> tuple[np.ndarray, np.ndarray]:
    """Mean (3,) and covariance (3, 3) of natural frequency [rad/s], damping ratio and delay [s].

    InputError: the log has no command, or the nominal an effect that the filter does not hold.
    """
    for effect in nominal.effects:
        if effect.name not in MODELLED:
            raise InputError(f"{nominal.path}: effect {effect.name!r}: a servo that is not known is not estimated "
                             f"beside it; expected none, or one of {', '.join(MODELLED)}")
    flown, sigma = Flown(log, nominal), servo_sigma(nominal)
    model = onboard_model(nominal)
    believed = np.array([model.natural_frequency, model.damping_ratio, model.delay])
    unit = np.array([believed[0], max(believed[1], LEAST), 1.0])
    servo, shares = believed.copy(), np.zeros((int(flown.window[-1]) + 1, 2))
    unknown = np.flatnonzero(sigma > 0.0)
    prior = np.diag(sigma[unknown] ** -2.0)
    for _ in range(MOST_ROUNDS):
        information, score = _scored(flown, nominal, servo, shares)
        information, score = _about_nominal(information, score, servo, shares, unit)
        rigid = information[:, :2, :2] + np.eye(2) / RIGID**2
        pull = score[:, :2] - shares / RIGID**2
        cross = information[:, :2, 2 + unknown]
        by = np.linalg.solve(rigid, cross)
        curvature = (information[:, 2 + unknown][:, :, 2 + unknown] - cross.mT @ by).sum(axis=0) + prior
        slope = (score[:, 2 + unknown] - np.einsum("wij,wi->wj", by, pull)).sum(axis=0)
        slope -= prior @ ((servo - believed) / unit)[unknown]
        covariance = np.linalg.inv(curvature)
        wanted = covariance @ slope
        most = np.where(unknown == 2, LARGEST_DELAY_STEP, LARGEST_STEP)
        step = wanted * min(1.0, float(np.min(most / np.maximum(np.abs(wanted), 1e-300))))  # whole: its direction stays
        shares = np.clip(shares + np.linalg.solve(rigid, pull[:, :, None])[:, :, 0] - by @ step, -0.9, 4.0)
        before = servo.copy()
        servo[unknown] += unit[unknown] * step
        servo = np.maximum(servo, [LEAST * believed[0], LEAST * believed[1], 0.0])
        if np.all(np.abs((servo - before) / unit)[unknown] <= CLOSE * np.sqrt(np.diag(covariance))):
            break
    else:
        raise InputError(f"{log.path}: no servo near the one that {nominal.path} declares is the log's; expected one "
                         "within a few of its sigmas, and commands that act")
    whole = np.zeros((3, 3))
    whole[np.ix_(unknown, unknown)] = covariance * np.outer(unit[unknown], unit[unknown])
    return servo, whole


def _scored(flown: Flown, nominal: Nominal, servo: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (w, 5, 5) and score (w, 5) about relative a6, k1, frequency, damping and the delay [s], at a servo
    and shares (w, 2) of a6 and k1 above the nominal's; each window's start is eliminated."""
    windows = len(shares)
    information, score = np.zeros((windows, WITH_SERVO, WITH_SERVO)), np.zeros((windows, WITH_SERVO))
    a6, k1 = nominal.vehicle.at(flown.t + 0.5 * flown.period)
    older, newer, switch = switched(flown.command, float(servo[2]), flown.period)
    window_information(flown.t, flown.z, older, a6 * (1.0 + shares[flown.window, 0]),
                       k1 * (1.0 + shares[flown.window, 1]), servo[:2].copy(), noise_variances(nominal, flown.period),
                       flown.window, information, np.zeros(len(flown.t)), flown.world, newer, switch, score)
    start = information[:, :4, :4] + 1e-9 * np.eye(4)
    explained = np.linalg.solve(start, score[:, :4, None])[:, :, 0]
    return without_offset(information), score[:, 4:] - np.einsum("wij,wi->wj", information[:, :4, 4:], explained)


def _about_nominal(information: np.ndarray, score: np.ndarray, servo: np.ndarray, shares: np.ndarray,
                   unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same relative to the nominal's values, where they were relative to those at which they were taken."""
    scale = np.concatenate([1.0 / (1.0 + shares), np.tile([unit[0] / servo[0], unit[1] / servo[1], 1.0],
                                                          (len(shares), 1))], axis=1)
    return information * scale[:, :, None] * scale[:, None, :], score * scale


def with_servo(nominal: Nominal, servo: np.ndarray) -> Nominal:
    """The nominal whose servo is this one, its own effects on it taken into account, and known."""
    effects = tuple(each for each in nominal.effects if each.name not in ("actuator_delay", "actuator_bandwidth"))
    assert nominal.actuator is not None
    frequency, damping, delay = map(float, servo)
    actuator = dataclasses.replace(nominal.actuator, natural_frequency=frequency, damping_ratio=damping, delay=delay,
                                   natural_frequency_sigma=0.0, damping_ratio_sigma=0.0, delay_sigma=0.0)
    return dataclasses.replace(nominal, actuator=actuator, effects=effects)


def identified_with_servo(log: Log, nominal: Nominal, config: Config) -> tuple[Identified, Servo]:
    """The log's a6 and k1, behind the nominal's servo or, where it is not known, behind the servo that the log
    shows."""
    servo = known_servo(nominal)
    assert nominal.actuator is not None
    if nominal.actuator.is_known:
        return identified(config, log), servo
    mean, covariance = servo_of_log(log, nominal)

    def seen(at: np.ndarray) -> Identified:
        model = onboard_model(with_servo(nominal, at), log.period, log.path)
        return identified(dataclasses.replace(config, model=model), log)

    result, by_servo = seen(mean), {}
    std = np.sqrt(np.diag(covariance))
    moved = {k: seen(mean + std[k] * np.eye(3)[k]) for k in range(3) if std[k] > 0.0}
    for w, e in enumerate(result.judged.estimates):
        for estimate in ("window", "tracked"):
            slopes = np.zeros((2, 3))
            for k, other in moved.items():
                if w < len(other.judged.estimates):
                    slopes[:, k] = (_rigid(other.judged.estimates[w], estimate) - _rigid(e, estimate)) / std[k]
            by_servo[w, estimate] = np.nan_to_num(slopes)
    return result, Servo(mean, covariance, by_servo)


def _rigid(e: Estimate, estimate: str) -> np.ndarray:
    """(a6, k1) of a window's own data or tracked at its end; NaN where there are none."""
    if estimate == "tracked" and e.tracked is not None:
        return np.array([e.tracked.a6, e.tracked.k1])
    return np.array([e.a6, e.k1]) if estimate == "window" else np.full(2, math.nan)

"""Give a log of commands without a nozzle sensor the nozzle that its commands make.

Without a nominal the command itself is the input; its delay and lag are fitted, as those of any input.  With one the
nozzle is the answer of the nominal's servo, and the filter predicts it from the commands.  What the filter takes as the
nozzle's measurement is that answer with white noise of UNSEEN, which is declared to it: a sensor that tells nothing, so
that no number rests on a nozzle that nobody saw.
"""

import math
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from sim.nominal import Nominal

from .check import CheckedLog
from .live import part, rows_of
from .log import Log
from .rates import HELD_WORD

Believed = TypeVar("Believed", bound=Nominal | None)

UNSEEN = 0.1   # rad, one sigma of the sensor that tells nothing: as far as any nozzle goes
FORGOTTEN = 36.0   # time constants of a servo, after which a double holds nothing of it
SLOWEST = 1.0      # rad/s, of a servo


def is_of_commands(log: Log) -> bool:
    """Whether a log has commands, and no measured nozzle, or one that was predicted from them."""
    if log.beta_noise > 0.0 or np.array_equal(log.beta, log.beta_cmd, equal_nan=True):
        return bool(np.isfinite(log.beta_cmd).any())
    return not np.isfinite(log.beta).any() and bool(np.isfinite(log.beta_cmd).any())


def with_nozzle(seen: CheckedLog, nominal: Believed, *,
                is_held: bool = False) -> tuple[CheckedLog, Believed, tuple[str, ...]]:
    """Return (the checked log with a nozzle, the nominal that knows how little it is worth, a note on it), of a log of
    commands alone; any other log as it is.

    Parameters
    ----------
    seen : CheckedLog
    nominal : Nominal or None
        Its [actuator] predicts the nozzle; without it the command is the input.
    is_held : bool
        Give the nozzle's mean over the step to the next row, as of a beta that is held, in place of its value there.
    """
    log = seen.log
    if np.isfinite(log.beta).any() or not is_of_commands(log):
        return seen, nominal, ()
    columns = (*log.columns[:2], "beta", *log.columns[2:])
    if nominal is None or nominal.actuator is None:
        return _given(seen, columns, log.beta_cmd, 0.0), nominal, (
            f"{log.path}: no column beta: the command is the input, and its delay and lag are fitted",)
    given = _given(seen, columns, (predicted_means if is_held else predicted)(log, nominal), UNSEEN)
    if is_held:
        rates = {**given.rates, "beta": replace(given.rates["beta"], kind=HELD_WORD)}
        given = replace(given, data=replace(given.data, rates=rates))
    return given, cast("Believed", blind(nominal)), (said_of(log, nominal),)


def blind(nominal: Nominal) -> Nominal:
    """Return the nominal whose nozzle nobody sees."""
    return replace(nominal, sensors=replace(nominal.sensors, beta_std=UNSEEN, beta_step=0.0))


def said_of(log: Log, nominal: Nominal) -> str:
    """Return the note on a nozzle that is predicted."""
    return (f"{log.path}: no column beta: the nozzle is predicted from beta_cmd by [actuator] of "
            f"{nominal.path or nominal.name}")


def _given(seen: CheckedLog, columns: tuple[str, ...], beta: np.ndarray, noise: float) -> CheckedLog:
    """Return the checked log with this nozzle (n,) [rad], of which no sensor adds anything."""
    made = replace(seen, log=replace(seen.log, columns=columns, beta=beta, beta_noise=noise))
    if seen.sensed is None:
        return made
    own = {name: x for name, x in seen.sensed.columns.items() if name != "beta"}
    return replace(made, sensed=replace(seen.sensed, columns=own, nozzle_scale=1.0))


class LiveNozzle:
    """Predict the nozzle of rows that come piece by piece; of earlier rows as many are kept as the servo remembers."""

    def __init__(self, nominal: Nominal) -> None:
        self._nominal = nominal
        self._before: Log | None = None
        servo = nominal.actuator
        assert servo is not None
        slowest = 1.0 / servo.time_constant if servo.time_constant > 0.0 else servo.natural_frequency * (
            servo.damping_ratio - math.sqrt(max(servo.damping_ratio**2 - 1.0, 0.0)))
        self._memory = servo.delay + FORGOTTEN / max(slowest, SLOWEST)

    def add(self, log: Log) -> Log:
        """Return further rows, with the nozzle predicted from their commands."""
        whole = log if self._before is None else rows_of(self._before, log)
        known = whole.t[np.isfinite(whole.t)]
        beta = whole.beta_cmd if len(known) < 2 else predicted(whole, self._nominal)
        if len(known):
            kept = np.flatnonzero(whole.t >= known.max() - self._memory)
            self._before = part(whole, int(kept[0]) if len(kept) else 0, len(whole.t))
        columns = (*log.columns[:2], "beta", *log.columns[2:])
        return replace(log, columns=columns, beta=beta[len(beta) - len(log.t):], beta_noise=UNSEEN)


def measured_alone(log: Log) -> Log:
    """Return the log without a nozzle that is only predicted: what a test of the servo may use."""
    return replace(log, beta=np.full(len(log.t), math.nan)) if log.beta_noise > 0.0 else log


def predicted(log: Log, nominal: Nominal) -> np.ndarray:
    """Return the nozzle (n,) [rad] that the servo of the nominal makes of the logged commands; NaN where none is known.

    By the servo's frequency response on an even grid, the commands held from row to row.
    """
    actuator, period = nominal.actuator, log.period
    assert actuator is not None
    rows, _, t, u = commands_of(log)
    s = 2j * math.pi * np.fft.rfftfreq(2 * len(t), period)
    response = np.exp(-s * (actuator.delay + 0.5 * period))
    if actuator.time_constant > 0.0:
        response = response / (1.0 + s * actuator.time_constant)
    else:
        w, zeta = actuator.natural_frequency, actuator.damping_ratio
        response = response / (1.0 + 2.0 * zeta * s / w + (s / w) ** 2)
    moved = u[0] + np.fft.irfft(np.fft.rfft(u - u[0], 2 * len(t)) * response, 2 * len(t))[:len(t)]
    return np.where(rows, np.interp(log.t, t, moved), math.nan)


def commands_of(log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (rows (n,) bool with a command, their stamps in order, an even grid [s], the command held there)."""
    rows = np.isfinite(log.t) & np.isfinite(log.beta_cmd)
    order = np.argsort(log.t[rows], kind="stable")
    at, command = log.t[rows][order], log.beta_cmd[rows][order]
    t = np.arange(at[0], at[-1] + log.period, log.period)
    return rows, at, t, command[np.clip(np.searchsorted(at, t + 0.5 * log.period, side="right") - 1, 0, None)]


def predicted_means(log: Log, nominal: Nominal) -> np.ndarray:
    """Return the mean (n,) [rad] of the servo's nozzle from each row to the next, as of a beta that is held; NaN where
    no command is known.

    Steps of the command are exact in it, between the rows too: it is the second difference of the servo's answer to a
    ramp, convolved with the commands.
    """
    rows, at, t, u = commands_of(log)
    period = log.period
    ages = period * np.arange(-1, len(t) + 1)
    answer = np.diff(ramp_response(ages, nominal), 2) / period
    mean = np.fft.irfft(np.fft.rfft(u - u[0], 2 * len(t)) * np.fft.rfft(answer, 2 * len(t)), 2 * len(t))[:len(t)]
    whole = np.concatenate([[0.0], period * np.cumsum(mean)])
    edges = np.append(at, at[-1] + period)
    area = np.diff(np.interp(edges, np.append(t, t[-1] + period), whole))
    given, order = np.full(len(log.t), math.nan), np.argsort(log.t[rows], kind="stable")
    given[np.flatnonzero(rows)[order]] = u[0] + area / np.maximum(np.diff(edges), 1e-12)
    return given


def ramp_response(age: np.ndarray, nominal: Nominal) -> np.ndarray:
    """Return the integral (n,) [s] of the servo's answer to a unit step, `age` (n,) [s] after it."""
    servo = nominal.actuator
    assert servo is not None
    x = np.maximum(age - servo.delay, 0.0)
    if servo.time_constant > 0.0:
        return np.asarray(x - servo.time_constant * -np.expm1(-x / servo.time_constant))
    w, zeta = servo.natural_frequency, servo.damping_ratio
    apart = np.sqrt(complex(zeta**2 - 1.0)) if zeta != 1.0 else 1e-6   # equal poles: as near as rounding allows
    first, second = -w * (zeta - apart), -w * (zeta + apart)
    sway = second * (np.expm1(first * x)) / first - first * np.expm1(second * x) / second
    return np.asarray(x + (sway / (first - second)).real)

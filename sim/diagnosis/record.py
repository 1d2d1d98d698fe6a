"""A log on a uniform grid, beside the nominal's parameters on it: what every fit of the diagnosis reads.

Rows are the log's, put at the nearest multiple of the period; missing rows are rows without measurement.  Time is
cut three ways: integration steps, controller ticks (each holds one command) and rows.  A log slower than the
controller lacks commands between its rows; they are recomputed (`fill`) or, without a reference, linear.

Assumptions: the first row is at a controller tick; stamps jitter by less than half a period.
"""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from ..effects import controller as controller_effects
from ..effects import effect, values
from ..errors import InputError
from ..flight import CLOCK_DIGITS, excitation, packed
from ..log import Log
from ..nominal import Nominal
from ..sections import Actuator
from ..vehicle.controller import pd_command, pseudo_derivative
from ..vehicle.kernels import kernel
from .data_check import DataCheck

CHANNELS = ("theta", "theta_dot", "beta")
THETA, THETA_DOT, BETA = range(3)
LONGEST_STEP = 0.003     # s: Runge-Kutta 4 on a servo of 50 rad/s is then exact to 1e-4 of what it moves
SERVO_STEP = 0.2         # rad a step, of the servo
LATEST_START = 1.0e4     # s: a log that starts later (a calendar's clock) is shifted to start at 0
MOST_ROWS = 2_000_000    # of the grid: more is a log with absurd stamps
DIRECT = 1.5             # rad a step: the servo that stands for none is as fast as the step resolves
DIRECT_DAMPING = 0.7
DIRECT_PARTS = 3         # steps a row then: its lag is a third of a row


@dataclass(frozen=True, eq=False)
class Record:
    """One log as the predictor reads it.

    z           (n, 3) theta [rad], theta_dot [rad/s], beta [rad]; NaN where not measured
    commands    (ticks,) [rad] before delay and noise
    input       where they are from: "beta_cmd", "controller" (recomputed), or "beta": the measured nozzle angle, where
                nothing else is known or the nominal has no [actuator]
    a6, k1      (2 steps + 1,) [1/s^2] of the nominal's [vehicle] at every half step from `first_step` 0 on
    first_step  step index of the first row (log's clock / step)
    step [s], every (steps a row), tick (steps a command of `commands`)
    held        rows that share one command and its noise, 1 unless the log is faster than the controller;
                held_phase: rows from the first to the first at which a command is issued
    logged      (n,) bool, rows that hold their command; None: the command is none of the log's
    fill_gain   of a log slower than the controller: command [rad] per attitude noise [rad] in the recomputed ticks
    shift       [s] log's clock = grid's clock + shift
    """

    nominal: Nominal
    actuator: Actuator
    z: np.ndarray
    commands: np.ndarray
    input: str
    reference: np.ndarray      # (n,) rad, NaN where not known
    a6: np.ndarray
    k1: np.ndarray
    first_step: int
    step: float
    every: int
    tick: int
    shift: float
    held: int = 1
    held_phase: int = 0
    fill_gain: float = 0.0
    logged: np.ndarray | None = None

    @property
    def rows(self) -> int:
        return len(self.z)

    @property
    def period(self) -> float:
        """[s] between rows"""
        return self.every * self.step

    @property
    def resolution(self) -> float:
        """[s] the coarser of the grid's step and the nominal's: frequencies must be resolved by both"""
        return max(self.step, self.nominal.simulation.step if self.nominal.simulation is not None else 0.0)

    @functools.cached_property
    def tau(self) -> np.ndarray:
        """(2 steps + 1,) at every half step: time from -1 at the first row to 1 at the last"""
        half = np.arange(len(self.a6)) - 2 * self.first_step
        return np.clip(half / max((self.rows - 1) * self.every, 1) - 1.0, -1.0, 1.0)

    @property
    def t(self) -> np.ndarray:
        """(n,) [s] the grid's clock, which is what effects with a time read"""
        return np.round((self.first_step + self.every * np.arange(self.rows)) * self.step, CLOCK_DIGITS)

    @property
    def channels(self) -> tuple[str, ...]:
        """The measured ones"""
        return tuple(name for k, name in enumerate(CHANNELS) if np.isfinite(self.z[:, k]).any())

    @property
    def command_is_known(self) -> bool:
        """False when the measured nozzle angle stands in for it: nothing about the actuator can be told then."""
        return self.input != "beta"


def integration_step(period: float, tick: float, frequency: float) -> float:
    """The longest step [s] that divides both periods and resolves the servo's frequency [rad/s]."""
    longest = min(LONGEST_STEP, SERVO_STEP / frequency)
    for parts in range(max(1, math.ceil(period / longest - 1e-9)), 200):
        step = period / parts
        ratio = tick / step
        if abs(ratio - round(ratio)) < 1e-6 and round(ratio) >= 1:
            return step
    return period / max(1, math.ceil(period / longest - 1e-9))


def record(log: Log, nominal: Nominal, data: DataCheck) -> Record:
    """The log on its grid; InputError if it holds no input (neither command, nor reference and controller, nor nozzle).

    log, nominal  as read;  data  its check: rows and values that may be used
    """
    usable = data.usable
    if usable.sum() < 2:
        raise InputError(f"{log.path}: fewer than two rows with usable time stamps; expected a log")
    t = log.t[usable]
    period = _period(t, nominal)
    shift = 0.0 if 0.0 <= t[0] <= LATEST_START else float(t[0])
    index = np.round((t - t[0]) / period).astype(np.int64)
    first = np.concatenate([[True], np.diff(index) > 0])  # two stamps on one place of the grid: the earlier counts
    n = int(index[-1]) + 1
    if n > MOST_ROWS:
        raise InputError(f"{log.path}: column t: {t[0]:g} to {t[-1]:g} s at {period:g} s are {n} rows; "
                         f"expected at most {MOST_ROWS}")
    tick_period = nominal.controller.period if nominal.controller is not None else period
    if abs(tick_period / period - round(tick_period / period)) > 1e-6 and \
            abs(period / tick_period - round(period / tick_period)) > 1e-6:
        tick_period = period
    servo = nominal.actuator.natural_frequency if nominal.actuator is not None else SERVO_STEP * DIRECT_PARTS / period
    step = integration_step(period, tick_period, servo)
    every, tick = round(period / step), round(tick_period / step)

    def column(name: str) -> np.ndarray:
        values = np.where(data.masks[name], getattr(log, name), math.nan)[usable] if name in data.masks else \
            getattr(log, name)[usable]
        grid = np.full(n, math.nan)
        grid[index[first]] = values[first]
        return grid

    z = np.column_stack([column(name) for name in CHANNELS])
    reference, command = column("theta_ref"), column("beta_cmd")
    nominal = _shifted(nominal, shift)
    actuator = nominal.actuator or Actuator(natural_frequency=DIRECT / step, damping_ratio=DIRECT_DAMPING)
    first_step = round((t[0] - shift) / step)
    steps = first_step + n * every
    half = np.arange(2 * steps + 1) * (0.5 * step)
    a6, k1 = nominal.vehicle.at(half + shift)
    draft = Record(nominal, actuator, z, np.zeros(0), "", reference, np.ascontiguousarray(a6), np.ascontiguousarray(k1),
                   first_step, step, every, tick, shift)
    return _with_commands(draft, command, log.path)


def _shifted(nominal: Nominal, shift: float) -> Nominal:
    """The nominal with the times of its effects on the grid's clock."""
    if shift == 0.0 or not nominal.effects:
        return nominal
    moved = [effect(of.name, **{name: value - shift if name == "time" and not isinstance(value, str) else value
                                for name, value in values(of).items()}) for of in nominal.effects]
    return replace(nominal, effects=tuple(moved))


def _period(t: np.ndarray, nominal: Nominal) -> float:
    """Median step [s], taken as a whole number (or part) of controller periods where it is within 1 % of one."""
    period = float(np.median(np.diff(t)))
    if nominal.controller is None:
        return period
    tick = nominal.controller.period
    near = round(period / tick) * tick if period >= tick else tick / max(1, round(tick / period))
    return near if near > 0.0 and abs(period / near - 1.0) < 0.01 else period


def _with_commands(draft: Record, command: np.ndarray, path: str) -> Record:
    """The command of every tick."""
    nominal = draft.nominal
    known = np.isfinite(command)
    recomputable = nominal.controller is not None and np.isfinite(draft.reference).any() \
        and np.isfinite(draft.z[:, THETA]).any()
    if draft.tick > draft.every:
        held = draft.tick // draft.every
        draft = replace(draft, tick=draft.every, held=held, held_phase=_phase(command, held))
    direct = nominal.actuator is None and np.isfinite(draft.z[:, BETA]).any()
    if direct:
        known = np.zeros(draft.rows, bool)
    elif not known.any() and recomputable:
        return replace(draft, commands=recomputed(draft), input="controller")
    source = "beta_cmd"
    if not known.any():
        command, source = draft.z[:, BETA], "beta"
        known = np.isfinite(command)
        if not known.any():
            raise InputError(f"{path}: no beta_cmd, no beta, and no theta_ref with a [controller] to recompute the "
                             "command from; expected one of them")
    if source == "beta":  # it is the input, so it tells nothing besides, and no servo is between
        draft = replace(draft, z=np.column_stack([draft.z[:, :BETA], np.full(draft.rows, math.nan)]),
                        actuator=Actuator(natural_frequency=DIRECT / draft.step, damping_ratio=DIRECT_DAMPING))
    rows = np.arange(draft.rows)
    held = command[np.maximum.accumulate(np.where(known, rows, 0))]
    held[~np.isfinite(held)] = command[known][0]
    if source == "beta":  # its mean between rows, early by the lag of the servo that stands for none
        early = 0.5 + 2.0 * DIRECT_DAMPING / DIRECT / draft.every
        held = held + early * np.diff(held, append=held[-1])
    m = draft.every // draft.tick
    ticks = held if m == 1 else np.interp(np.arange(draft.rows * m) / m, rows, held)
    return replace(draft, commands=ticks, input=source, logged=known if source == "beta_cmd" else None)


def _phase(command: np.ndarray, held: int) -> int:
    """Rows from the first to the first at which the controller issues, in a log faster than the controller."""
    changes = np.flatnonzero(np.abs(np.diff(command)) > 0.0) + 1
    return int(np.bincount(changes % held, minlength=held).argmax()) if len(changes) else 0


# ---- the controller


@kernel
def run_controller(gains, fx, error, excitation, commands, derivative):
    """The nominal's PD over errors (ticks,) [rad]; first tick: e_previous = e(0), d = 0.

    gains (5,)            in   kp, kd [s], derivative time constant [s], period [s], deflection limit [rad]
    fx (n, N_COLUMNS)     in   controller effects
    error, excitation (ticks,) [rad] in
    commands, derivative (ticks,) out  before the computing time
    """
    kp, kd = controller_effects.gains(fx, gains[0], gains[1])
    d, before = 0.0, error[0]
    for k in range(len(error)):
        d = pseudo_derivative(gains[2], gains[3], error[k], before, d)
        before = error[k]
        derivative[k] = d
        commands[k] = pd_command(kp, kd, gains[4], error[k], d, excitation[k])


def controller_gains(nominal: Nominal) -> np.ndarray:
    """(5,) as `run_controller` reads them."""
    c = nominal.controller
    assert c is not None
    limit = nominal.actuator.deflection_limit if nominal.actuator is not None else math.inf
    return np.array([c.kp, c.kd, c.derivative_time_constant, c.period, limit])


def later(x: np.ndarray, lag: float) -> np.ndarray:
    """Commands x (periods,) issued when computing takes `lag` periods: the mean over a period, as the effect's
    (`sim.effects.controller`); before the first the command was 0."""
    whole, part = int(lag), lag - int(lag)
    shifted = [x if by == 0 else np.concatenate([np.zeros(min(by, len(x))), x[:-by]]) for by in (whole, whole + 1)]
    return shifted[0] if part == 0.0 else (1.0 - part) * shifted[0] + part * shifted[1]


def recomputed(r: Record, attitude: np.ndarray | None = None) -> np.ndarray:
    """The nominal controller's command [rad] of every tick of `commands` from the measured attitude and the reference.

    attitude  (ticks,) [rad] where rows measured none; None: linear between rows
    """
    m = r.every // r.tick
    ticks = np.arange(r.rows * m) / m
    rows = np.arange(r.rows)
    measured, known = np.isfinite(r.z[:, THETA]), np.isfinite(r.reference)
    theta = np.interp(ticks, rows[measured], r.z[measured, THETA])
    if attitude is not None:
        seen = np.zeros(r.rows * m, bool)
        seen[::m] = measured
        theta = np.where(seen, theta, attitude)
    error = theta - np.interp(ticks, rows[known], r.reference[known])
    issued = error[r.held_phase::r.held]
    commands, derivative = np.empty_like(issued), np.empty_like(issued)
    gains = controller_gains(r.nominal)
    first = (r.first_step + r.held_phase * r.every) // (r.tick * r.held)
    test = excitation(r.nominal, first + len(issued), gains[3])[first:]
    fx = packed(r.nominal).controller
    run_controller(gains, fx, issued, test, commands, derivative)
    commands = np.repeat(later(commands, controller_effects.latency(fx) / gains[3]), r.held)
    return np.concatenate([np.full(r.held_phase, commands[0]), commands])[:len(error)]

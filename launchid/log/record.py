"""A log on a uniform grid, as every fit of the diagnosis reads it.

Rows are the log's, one to each period; missing rows are rows without measurement.  Time is cut three ways: steps of the
grid, controller ticks (each holds one command) and rows.  Where stamps jitter, or rows fall between the controller's
ticks, a row is at the step next to its own stamp; steps and ticks are short enough for that.

Assumptions: of a uniform log whose period goes with the controller's the first row is at one of its ticks; stamps
jitter by less than half a period.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from sim.effects import effect, values
from sim.errors import InputError
from sim.nominal import Nominal
from sim.plant import CLOCK_DIGITS
from sim.sections import Actuator, Controller
from sim.vehicle.actuator import fastest_pole

from .channels import SENSOR_COLUMNS as CHANNELS
from .detect import DataCheck
from .log import Log

Z_THETA, Z_THETA_DOT, Z_BETA = range(3)
FAR_FASTER = 10.0        # times: a servo's pole so much faster than rows and its other pole is done before either tells
LATEST_FLIGHT = 1.0e4    # s: a log that starts later (a calendar's clock) is shifted to start at 0
CLOCKED = ("time", "middle")  # parameters of effects that are times on the log's clock
GRID_ROWS = 2_000_000    # of the grid: more is a log with absurd stamps
DIRECT_INPUT = 4.5       # rad a row: the servo that stands for none lags by a third of a row
SLOWEST_DIRECT = 500.0   # rad/s: but by no more than 3 ms
DIRECT_DAMPING = 0.7
JITTER = 0.01            # of a period, rms: less is a uniform log
JITTER_STEPS = 12        # steps of a jittered row: a stamp is met to a twenty-fourth of a period
JITTER_TICKS = 4         # commands of one: an input is placed to an eighth of a period
LONG_STEP = 1.75         # median periods: longer steps are gaps (`stamps.LOST_STAMP`) and say nothing about the period


@dataclass(frozen=True, eq=False)
class Record:
    """One log on a uniform grid, with its commands and nominal.

    z           (n, 3) theta [rad], theta_dot [rad/s], beta [rad]; NaN where not measured
    commands    (ticks,) [rad] before delay and noise
    input       where they are from: "beta_cmd", "controller" (recomputed), or "beta": the measured nozzle angle, where
                nothing else is known or the nominal has no [actuator]
    first_step  step index of the first row (log's clock / step)
    step [s], every (steps a row), tick (steps a command of `commands`)
    held        rows that share one command and its noise, 1 unless the log is faster than the controller;
                held_phase: rows from the first to the first at which a command is issued
    logged      (n,) bool, rows that hold their command; None: the command is none of the log's
    at          (n,) steps from the first row to each;  fine  ticks a row, of parts of a command (rows between ticks)
    path        (2, k) stamps [s, the log's clock] and angles [rad] of the measured flight path
    between     [rad] one sigma by which commands that no row saw are off
    unsure      [nats] a row that these commands may feign, so that a cause must explain more
    law         of the nominal, of a rate or with filters: only whether the log's commands are its own is asked
    shift       [s] log's clock = grid's clock + shift
    """

    nominal: Nominal
    actuator: Actuator
    z: np.ndarray
    commands: np.ndarray
    input: str
    reference: np.ndarray      # (n,) rad, NaN where not known
    first_step: int
    step: float
    every: int
    tick: int
    shift: float
    at: np.ndarray
    held: int = 1
    held_phase: int = 0
    between: float = 0.0
    unsure: float = 0.0
    law: Controller | None = None
    rate_reference: np.ndarray = field(default_factory=lambda: np.zeros(0))   # (n,) rad/s, NaN where not known
    logged: np.ndarray | None = None
    fine: int = 1
    path: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)))

    @property
    def rows(self) -> int:
        return len(self.z)

    @property
    def period(self) -> float:
        """The time [s] between rows."""
        return self.every * self.step

    @property
    def t(self) -> np.ndarray:
        """The rows' times (n,) [s] on the grid's clock, which effects with a time use."""
        return np.round((self.first_step + self.at) * self.step, CLOCK_DIGITS)

    @property
    def centre(self) -> float:
        """The middle [s] between first and last row on the grid's clock, about which `control_slope` turns."""
        return (self.first_step + 0.5 * self.every * (self.rows - 1)) * self.step


def no_servo(period: float) -> Actuator:
    """Return a servo so fast that it stands for none, for rows `period` [s] apart."""
    return Actuator(natural_frequency=max(DIRECT_INPUT / period, SLOWEST_DIRECT), damping_ratio=DIRECT_DAMPING)


def as_seen(servo: Actuator, period: float) -> Actuator:
    """Return the servo as rows `period` [s] apart can show it: if its second pole is far faster than rows and
    first pole, a first-order servo with the same lag.  A servo of first order may have been written so, and is then no
    other: what slows it slows the pole that is seen."""
    if servo.is_first_order or not servo.damping_ratio > 1.0:
        return servo
    fast = fastest_pole(servo.frequency, servo.damping_ratio)
    slow = servo.frequency**2 / fast
    if fast < FAR_FASTER * max(slow, 1.0 / period):
        return servo
    return replace(servo, natural_frequency=math.nan, damping_ratio=math.nan, time_constant=servo.lag)


def on_grid(log: Log, nominal: Nominal, data: DataCheck, between: bool = False) -> tuple[Record, np.ndarray]:
    """Return the log on its grid, still without commands, and the logged command (n,) [rad], NaN where there is none.

    log   as it was checked;  data  its check: rows and values that may be used;  between  rows are known to fall
    between the controller's ticks.  InputError where no grid holds it
    """
    usable = data.usable
    if usable.sum() < 2:
        raise InputError(f"{log.path}: fewer than two rows with usable time stamps; expected a log")
    t = log.t[usable]
    period = _period(t, nominal)
    place = (t - t[0]) / period
    index = np.round(place).astype(np.int64)
    off = place - index
    first = np.concatenate([[True], np.diff(index) > 0])  # two stamps on one place of the grid: the earlier counts
    n = int(index[-1]) + 1
    if n > GRID_ROWS:
        raise InputError(f"{log.path}: column t: {t[0]:g} to {t[-1]:g} s at {period:g} s are {n} rows; "
                         f"expected at most {GRID_ROWS}")
    own = nominal.controller
    tick_period = own.period if own is not None else period
    is_off_tick = abs(tick_period / period - round(tick_period / period)) > 1e-6 and \
        abs(period / tick_period - round(period / tick_period)) > 1e-6
    if between or is_off_tick or float(np.sqrt(np.mean(off**2))) > JITTER:
        step, every, tick, fine = period / JITTER_STEPS, JITTER_STEPS, JITTER_STEPS // JITTER_TICKS, JITTER_TICKS
    else:
        step = min(period, tick_period)
        every, tick, fine = round(period / step), round(tick_period / step), 1

    def column(name: str) -> np.ndarray:
        values = np.where(data.masks[name], getattr(log, name), math.nan)[usable] if name in data.masks else \
            getattr(log, name)[usable]
        grid = np.full(n, math.nan)
        grid[index[first]] = values[first]
        return grid

    z = np.column_stack([column(name) for name in CHANNELS])
    reference, command = column("theta_ref"), column("beta_cmd")
    first_step = round(t[0] / step) if 0.0 <= t[0] <= LATEST_FLIGHT else 0
    shift = round(float(t[0]) - first_step * step, CLOCK_DIGITS)
    # whose command is not recomputed
    law = own if own is not None and (own.filters or own.law != "attitude") else None
    moved = [effect(of.name, **{name: value - shift if name in CLOCKED and not isinstance(value, str) else value
                                for name, value in values(of).items()}) for of in nominal.effects]
    nominal = replace(nominal, effects=tuple(moved), controller=own if law is None else None)
    actuator = no_servo(period) if nominal.actuator is None else as_seen(nominal.actuator, period)
    at = every * np.arange(n, dtype=np.int64)
    if fine > 1:
        at[index[first]] += np.round(off[first] * every).astype(np.int64)
    path = np.stack([t, log.flight_path[usable]])
    draft = Record(nominal, actuator, z, np.zeros(0), "", reference, first_step, step, every, tick, shift, at,
                   fine=fine, path=path[:, np.isfinite(path[1])], law=law, rate_reference=column("rate_ref"))
    return draft, command


def _period(t: np.ndarray, nominal: Nominal) -> float:
    """Return the median step [s], of a jittered log the mean without gaps, rounded to a whole number (or part) of
    controller periods if within 1 % of one."""
    steps = np.diff(t)
    period = float(np.median(steps))
    usual = steps[steps < LONG_STEP * period]
    if np.any(np.abs(usual / period - 1.0) > JITTER):
        period = float(np.mean(usual))
    if nominal.controller is None:
        return period
    tick = nominal.controller.period
    near = round(period / tick) * tick if period >= tick else tick / max(1, round(tick / period))
    return near if near > 0.0 and abs(period / near - 1.0) < 0.01 else period

"""A nominal with effects and slightly different a6, k1, run along a log."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sim.effects import Effect, plant
from sim.effects.actuator import WASHOUT
from sim.flight import packed
from sim.sections import AT_REST
from sim.vehicle.record import NOISE, SECTION, TICK, Vehicle, assembled

from ..data.record import BETA, THETA, THETA_DOT, Record
from ..data.used import SINE
from .linear import Modes, slots_of
from .predictor import follow, horizon_errors, tick_attitudes

DEVIATIONS = 5
FASTEST = 0.65  # of the servo's lag: a timing that is off leaves so much of it


@dataclass(frozen=True)
class Point:
    """The changes to the nominal: effects, and deviations within the tolerance.

    deviations  relative, of a6 and of k1 in the middle of the log, how much more they are at its end than in the
                middle; and [s] how much later the servo answers
    """

    effects: tuple[Effect, ...] = ()
    deviations: tuple[float, ...] = (0.0,) * DEVIATIONS


def begins_at_rest(record: Record) -> bool:
    """The nominal knows the state at the record's first row: the log's start is evidence."""
    return record.nominal.diagnosis.begins == AT_REST and record.first_step == 0 and record.shift == 0.0


def vehicle(record: Record, point: Point, extra: np.ndarray | None = None) -> Vehicle:
    """The simulator's vehicle at the log's first row, on the log's commands, without noise.

    extra  (ticks,) [rad/s^2] a further acceleration, None: none
    """
    a6_middle, k1_middle, a6_slope, k1_slope, later = point.deviations
    nominal = record.nominal
    if nominal.terms and a6_middle != 0.0:  # a body that swings has its stiffness there
        terms = tuple((term, value * (1.0 + a6_middle) if term == SINE else value) for term, value in nominal.terms)
        nominal = replace(nominal, terms=terms)
    changes = packed(nominal, point.effects, record.centre)
    a6 = record.a6 * (1.0 + a6_middle + a6_slope * record.tau)
    k1 = record.k1 * (1.0 + k1_middle + k1_slope * record.tau)
    half = np.arange(len(a6)) * (0.5 * record.step)
    a6, k1 = plant.parameters(changes, half, a6, k1)
    servo = record.actuator
    ticks = np.zeros(len(record.commands), TICK)
    if extra is not None:
        ticks["acceleration"] = extra
    drift = record.nominal.drift if not record.path_is_known else None
    made = assembled(
        {"step": record.step, "period": record.tick * record.step, "damping": servo.damping_ratio,
         "frequency": servo.frequency / max(1.0 + later / servo.lag, FASTEST), "first_order": servo.is_first_order,
         "delay": servo.delay, "limit": math.inf, "lost_angle": record.farthest, "at": record.first_step,
         "control_every": record.tick, "log_every": record.every, "at_once": record.at_once},
        changes, ticks, np.zeros(0, NOISE), a6, k1, record.commands, np.zeros(0, SECTION),
        wind=record.wind if len(record.wind) else None,
        drift=None if drift is None else np.ascontiguousarray(drift.at(half + record.shift)), is_plain=False)
    state = made.flight[0]  # a bias is in the first row as in all: the vehicle is not where it seems to be
    if not begins_at_rest(record):
        state.theta = _first(record.z[:, THETA]) - changes.attitude_bias
        state.theta_dot = _first(record.z[:, THETA_DOT]) - changes.gyro_bias
    state.beta = _first(record.z[:, BETA]) - changes.nozzle_sensor_bias if np.isfinite(record.z[:, BETA]).any() \
        else record.commands[0]
    if not begins_at_rest(record):
        _settle(made, state.beta)
    return made


def _settle(v: Vehicle, beta: float) -> None:
    """Effects that remember, inout, as a nozzle that has long stood at beta [rad] leaves them: a log need not begin
    where the flight does.  An input that washes out begins to do so with the log: it would hold no angle for long."""
    bends = v.modes["bends"] != 0.0
    v.modes["x"][bends] = v.modes["gain"][bends] * beta
    v.inputs["x"][v.inputs["kind"] != WASHOUT] = beta


def _first(values: np.ndarray) -> float:
    """The first measured value, 0 if there is none."""
    measured = values[np.isfinite(values)]
    return float(measured[0]) if len(measured) else 0.0


class Gains(Protocol):
    """Kalman gains and the modes they were made for (`noise.Filter`)."""

    @property
    def gains(self) -> np.ndarray: ...

    @property
    def modes(self) -> Modes: ...


def path_slope(v: Vehicle) -> float:
    """z_alpha [1/s] of the vehicle's flight path, its mean over the log."""
    own = float(np.mean(v.drift[0])) if v.drift.shape[1] else 0.0
    return own + float(v.flight[0].z_alpha)


def world_of(record: Record, v: Vehicle) -> np.ndarray:
    """(states, 2) of the world about this vehicle (`World.table`)."""
    return record.world.table(record.period, path_slope(v))


def innovations(record: Record, of: Gains, point: Point, extra: np.ndarray | None = None) \
        -> tuple[np.ndarray, np.ndarray, bool]:
    """(innovations (n, 3), corrected states (n, 4), whether the model stayed with the log)."""
    e, states = np.empty_like(record.z), np.empty((record.rows, 4))
    v = vehicle(record, point, extra)
    stayed = follow(v, slots_of(v, of.modes), world_of(record, v), record.a6, record.at, record.z,
                    of.gains, record.held, record.held_phase, e, states)
    return e, states, bool(stayed)


def predicted_attitude(record: Record, of: Gains) -> np.ndarray:
    """The readings (ticks,) [rad] of the attitude sensor at every controller tick, under the nominal."""
    attitudes = np.zeros(len(record.commands))
    v = vehicle(record, Point())
    tick_attitudes(v, slots_of(v, of.modes), world_of(record, v), record.a6, record.at, record.z,
                   of.gains, attitudes)
    return attitudes


def prediction_errors(record: Record, of: Gains, point: Point, horizons: Sequence[float],
                      spacing: float) -> np.ndarray:
    """Errors (s, h, 3) of predictions over horizons [s] begun every `spacing` [s] from the corrected state."""
    rows = max(1, round(spacing / record.period))
    ahead = np.array([max(1, round(h / record.period)) for h in horizons], np.int64)
    errors = np.full((-(-record.rows // rows), len(ahead), 3), math.nan)
    v = vehicle(record, point)
    horizon_errors(v, slots_of(v, of.modes), world_of(record, v), record.a6, record.at, record.z,
                   of.gains, record.held, record.held_phase, rows, ahead, errors)
    return errors

"""A nominal with effects and slightly different a6, k1, run along a log."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sim.effects import Effect, actuator, plant, sensor
from sim.effects.table import CODE, MEMORY, P0, Table
from sim.flight import packed
from sim.sections import AT_REST
from sim.vehicle import step as st

from ..data.record import BETA, THETA, THETA_DOT, Record
from ..data.used import SINE
from .linear import Modes, slots_of
from .predictor import AT_ONCE, follow, horizon_errors, tick_attitudes

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


def vehicle(record: Record, point: Point, extra: np.ndarray | None = None) -> st.Vehicle:
    """The simulator's vehicle at the log's first row, on the log's commands, without noise.

    extra  (ticks,) [rad/s^2] a further acceleration, None: none
    """
    a6_middle, k1_middle, a6_slope, k1_slope, later = point.deviations
    nominal = record.nominal
    if nominal.terms and a6_middle != 0.0:  # a body that swings has its stiffness there
        terms = tuple((term, value * (1.0 + a6_middle) if term == SINE else value) for term, value in nominal.terms)
        nominal = replace(nominal, terms=terms)
    table = packed(nominal, point.effects, record.centre)
    a6 = record.a6 * (1.0 + a6_middle + a6_slope * record.tau)
    k1 = record.k1 * (1.0 + k1_middle + k1_slope * record.tau)
    if len(table.plant) > 0 and plant.change_parameters(table.plant):
        half = np.arange(len(a6)) * (0.5 * record.step)
        plant.parameters_over_time(table.plant, half, a6, k1)
    servo = record.actuator
    frequency = servo.frequency / max(1.0 + later / servo.lag, FASTEST)
    constant = np.zeros(st.N_CONSTANTS)
    constant[[st.STEP, st.PERIOD, st.FREQUENCY, st.DAMPING, st.DELAY, st.FIRST_ORDER]] = (
        record.step, record.tick * record.step, frequency, servo.damping_ratio, servo.delay, servo.is_first_order)
    constant[st.LIMIT], constant[st.LOST_ANGLE] = math.inf, record.farthest
    counter = np.zeros(st.N_COUNTERS + 1, np.int64)
    counter[[st.AT, st.CONTROL_EVERY, st.LOG_EVERY, AT_ONCE]] = (
        record.first_step, record.tick, record.every, record.at_once)
    state = np.zeros(st.N_STATE)
    nulls = sensor.nulls(table.sensor)  # a bias is in the first row as in all: the vehicle is not where it seems to be
    state[st.THETA] = _first(record.z[:, THETA]) - nulls[0]
    state[st.THETA_DOT] = _first(record.z[:, THETA_DOT]) - nulls[1]
    if begins_at_rest(record):
        state[st.THETA] = state[st.THETA_DOT] = 0.0
    state[st.BETA] = _first(record.z[:, BETA]) - nulls[2] if np.isfinite(record.z[:, BETA]).any() \
        else record.commands[0]
    if not begins_at_rest(record):
        _settle(table, state[st.BETA])
    late = len(table.sensor) > 0
    drift = record.nominal.drift if not record.path_is_known else None
    drifting = np.zeros((2, 0))
    if drift is not None:
        drifting = np.ascontiguousarray(drift.at(np.arange(len(a6)) * (0.5 * record.step) + record.shift))
    history = np.zeros((2, record.first_step + record.rows * record.every + 1 if late else 0))
    none = np.zeros(0)
    return st.Vehicle(constant, state, counter, a6, k1, none, none,
                      np.zeros(len(record.commands)) if extra is None else extra, none, none, none, record.commands,
                      none, none, history, *table, record.wind, drifting)


def _settle(table: Table, beta: float) -> None:
    """Effects that remember, inout, as a nozzle that has long stood at beta [rad] leaves them: a log need not begin
    where the flight does.  An input that washes out begins to do so with the log: it would hold no angle for long."""
    for row in table.plant:
        if row[CODE] == plant.BENDING:
            row[MEMORY] = row[P0] * beta
    for row in table.actuator:
        if row[CODE] in (actuator.ACTUATOR_BACKLASH, actuator.ACTUATOR_BANDWIDTH):
            row[MEMORY] = beta


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


def path_slope(v: st.Vehicle) -> float:
    """z_alpha [1/s] of the vehicle's flight path, its mean over the log."""
    own = float(np.mean(v.drift[0])) if v.drift.shape[1] else 0.0
    return own + float(np.sum(v.plant[v.plant[:, CODE] == plant.LATERAL_DRIFT, P0]))


def world_of(record: Record, v: st.Vehicle) -> np.ndarray:
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

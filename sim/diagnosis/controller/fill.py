"""Commands between the rows of a log slower than the controller.

Every logged command holds what the derivative's filter knew, so the errors that the log does not have follow from the
commands it has: the controller is run through the gap, and run backwards where its own output is known.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...effects import controller as controller_effects
from ...flight import excitation, packed
from ...vehicle.controller import pseudo_derivative
from ...vehicle.kernels import kernel
from ..data.record import THETA, Record
from .command import controller_gains


class Controller(NamedTuple):
    """Gains over the nominal's, the derivative's time constant [s], and how many periods computing takes."""

    kp_scale: float
    kd_scale: float
    time_constant: float
    late: int = 0


def as_believed(record: Record) -> Controller:
    """The nominal's."""
    return Controller(1.0, 1.0, float(controller_gains(record.nominal)[2]))


class OnBoard(NamedTuple):
    """The controller that the nominal believes on board, its effects included: gains, derivative time constant and
    period [s], limit [rad], computing time in periods."""

    kp: float
    kd: float
    tau: float
    period: float
    limit: float
    late: int


def on_board(record: Record) -> OnBoard:
    """The nominal's controller with the effects that the nominal has."""
    kp, kd, tau, period, limit = (float(x) for x in controller_gains(record.nominal))
    fx = packed(record.nominal).controller
    kp, kd = controller_effects.gains(fx, kp, kd)
    return OnBoard(float(kp), float(kd), tau, period, limit, round(controller_effects.latency(fx) / period))


def errors_seen(record: Record, attitude: np.ndarray) -> np.ndarray:
    """The errors (ticks,) [rad], attitude less reference: measured at the rows, of the predicted `attitude` between."""
    m, n = record.every // record.tick, record.rows
    known, measured = np.isfinite(record.reference), np.isfinite(record.z[:, THETA])
    reference = np.interp(np.arange(n * m) / m, np.arange(n)[known], record.reference[known])
    error = attitude - reference
    error[::m] = np.where(measured, record.z[:, THETA], attitude[::m]) - reference[::m]
    return error


def shifted(x: np.ndarray, by: int) -> np.ndarray:
    """The array later by whole places, its first value before."""
    by = min(by, len(x))
    return x if by == 0 else np.concatenate([np.repeat(x[:1], by, axis=0), x[:-by]])


def test_of(record: Record, first: int, ticks: int) -> np.ndarray:
    """(ticks,) [rad] the nominal's test input from this tick of its controller on; before tick 0 there was none."""
    test = excitation(record.nominal, max(first + ticks, 0), float(controller_gains(record.nominal)[3]))
    return np.concatenate([np.zeros(max(-first, 0)), test[max(first, 0):]])[:ticks]


def test_issued(record: Record, late: int) -> np.ndarray:
    """The test input (ticks,) [rad] at every tick of the commands, issued when computing takes so many periods."""
    return test_of(record, record.first_step // record.tick - late, len(record.commands))


def filled(record: Record, attitude: np.ndarray, of: Controller) -> Record:
    """The record with the commands of this controller between its rows.

    attitude  (ticks,) [rad] predicted
    """
    m, own = record.every // record.tick, on_board(record)
    kp, kd, late = of.kp_scale * own.kp, of.kd_scale * own.kd, of.late + own.late
    if kd == 0.0 or (late % m and m > 2):
        return record
    error, test = shifted(errors_seen(record, attitude), late), test_issued(record, late)
    measured = np.isfinite(record.z[:, THETA])
    if late % m == 0:
        return _between(record, kp, kd, of.time_constant, error, test, shifted(measured, late // m))
    seen = np.zeros(len(error), bool)
    seen[::m] = measured
    logged = (np.arange(len(error)) % m == 0) & (np.abs(record.commands) < own.limit)
    commands = record.commands - test
    run_backwards(kp, kd, of.time_constant, own.period, math.inf, math.inf, logged, shifted(seen, late), error,
                  commands)
    commands = np.clip(commands + test, -own.limit, own.limit)
    commands[::m] = record.commands[::m]
    return replace(record, commands=commands)


def _between(record: Record, kp: float, kd: float, tau: float, error: np.ndarray, test: np.ndarray,
             measured: np.ndarray) -> Record:
    """The record with errors that are measured for the rows and predicted for the ticks between them.

    The derivative's state follows from the command at either end of a gap, so the errors between must carry the one to
    the other: with one tick between rows that fixes its error exactly, with more it corrects the predicted ones by the
    least change.
    """
    m, commands = record.every // record.tick, record.commands.copy()
    _, _, _, period, limit = controller_gains(record.nominal)
    row = (commands[::m] - test[::m] - kp * error[::m]) / kd
    fair = (np.abs(commands[::m]) < limit) & measured & (record.logged if record.logged is not None else True)
    alpha = tau / (tau + period)
    weights = -alpha**np.arange(m - 2, -1, -1.0) * (1.0 - alpha) / (tau + period)
    arrived, gaps = row[:-1].copy(), record.rows - 1
    for j in range(1, m + 1):
        arrived = pseudo_derivative(tau, period, error[j:gaps * m + j:m][:gaps], error[j - 1:gaps * m + j - 1:m][:gaps],
                                    arrived)
    missing = np.where(fair[:-1] & fair[1:], row[1:] - arrived, 0.0)
    for j in range(1, m):
        error[j:gaps * m:m] += weights[j - 1] / float(weights @ weights) * missing
    derivative = row
    for j in range(1, m):
        derivative = pseudo_derivative(tau, period, error[j::m], error[j - 1::m][:len(error[j::m])], derivative)
        commands[j::m] = np.clip(kp * error[j::m] + kd * derivative + test[j::m], -limit, limit)
    return replace(record, commands=commands, fill_gain=float(abs(kp + kd / (tau + period))) if m > 2 else 0.0)


@kernel
def run_backwards(kp, kd, tau, period, limit, most, logged, measured, error, commands):
    """The commands of ticks that are not logged, where the controller's errors of those that are are not measured.

    What an error was follows from the command that is logged; a wrong start is forgotten as by the filter, or at once
    where it makes an error leave the predicted one by more than `most`.

    kp, kd [s], tau [s], period [s], limit [rad]   in   the controller's
    most [rad]                                      in   that noise makes of an error
    logged, measured (ticks,)                       in   which commands and which errors are
    error (ticks,) [rad]                            inout  predicted where not measured; out: what it must have been
    commands (ticks,) [rad]                         inout  those logged known, the others out
    """
    late, d, before = tau + period, 0.0, error[0]
    for i in range(len(commands)):
        e = error[i]
        known = logged[i] and abs(commands[i]) < limit
        heard = measured[i]
        if known and not heard:
            error[i] = (commands[i] - kd * (tau * d - before) / late) / (kp + kd / late)
            heard = kd != 0.0 and abs(error[i] - e) > most
            e = e if heard else error[i]
        d = pseudo_derivative(tau, period, e, before, d)
        before = e
        if not logged[i]:
            commands[i] = min(max(kp * e + kd * d, -limit), limit)
        elif known and heard:
            d = (commands[i] - kp * e) / kd

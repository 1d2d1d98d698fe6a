"""Commands between the rows of a log slower than the controller, where they follow exactly.

Every logged command holds what the derivative's filter knew, so with the reference the errors that the log does not
have follow from the commands that it has: the derivative's state is known at either end of a gap.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.flight import excitation, packed

from ..data.record import THETA, Record
from .command import controller_gains, in_doubt
from .ticks import noise_std


class OnBoard(NamedTuple):
    """The controller on board, its effects included: gains, derivative time constant and period [s], limit [rad],
    computing time in periods."""

    kp: float
    kd: float
    tau: float
    period: float
    limit: float
    late: int


def on_board(record: Record) -> OnBoard:
    """The nominal's controller with the effects that the nominal has."""
    kp, kd, tau, period, limit = (float(x) for x in controller_gains(record.nominal))
    changes = packed(record.nominal)
    return OnBoard(changes.kp_scale * kp, changes.kd_scale * kd, tau, period, limit,
                   round(changes.computing_time / period))


def pseudo_derivative(tau: float, period: float, error: np.ndarray, before: np.ndarray,
                      derivative: np.ndarray) -> np.ndarray:
    """The controller's (`vehicle.controller`), of arrays."""
    return np.asarray((tau * derivative + error - before) / (tau + period))


def errors_seen(record: Record, attitude: np.ndarray) -> np.ndarray:
    """The errors (ticks,) [rad], attitude less reference: measured at the rows, of the predicted `attitude` between."""
    m, n = record.every // record.tick, record.rows
    known, measured = np.isfinite(record.reference), np.isfinite(record.z[:, THETA])
    reference = np.interp(np.arange(n * m) / m, np.arange(n)[known], record.reference[known])
    error = attitude - reference
    error[::m] = np.where(measured, record.z[:, THETA], attitude[::m]) - reference[::m]
    return error


def shifted(x: np.ndarray, by: int) -> np.ndarray:
    """Delay an array by `by` places, repeating its first value."""
    by = min(by, len(x))
    return x if by == 0 else np.concatenate([np.repeat(x[:1], by, axis=0), x[:-by]])


def test_issued(record: Record, late: int) -> np.ndarray:
    """The test input (ticks,) [rad] at every tick of the commands, issued when computing takes so many periods; before
    tick 0 there was none."""
    first, ticks = record.first_step // record.tick - late, len(record.commands)
    test = excitation(record.nominal, max(first + ticks, 0), float(controller_gains(record.nominal)[3]))
    return np.concatenate([np.zeros(max(-first, 0)), test[max(first, 0):]])[:ticks]


def filled(record: Record, attitude: np.ndarray, of: OnBoard) -> Record:
    """The record with the commands of this controller, late by whole rows, between its rows.

    With one tick between rows the commands at either end fix its error exactly; with more they correct the predicted
    ones by the least change, and noise between rows leaves the commands off.

    attitude  (ticks,) [rad] predicted
    """
    m, commands = record.every // record.tick, record.commands.copy()
    kp, kd, tau, period, limit, late = of
    error, test = shifted(errors_seen(record, attitude), late), test_issued(record, late)
    measured = shifted(np.isfinite(record.z[:, THETA]), late // m)
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
    made = replace(record, commands=commands, between=0.0, unsure=0.0)
    off = abs(kp + kd / (tau + period)) * noise_std(record)
    return made if m == 2 else in_doubt(made, off, m - 1.0)

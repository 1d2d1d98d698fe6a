"""Find every command that the controller issued, and check whether it is the nominal's.

A log as fast as its controller has them all.  Of a slower one with reference and commands those between rows follow
exactly, where the controller is the nominal's or has gains that the log tells, from what a model of the vehicle saw
there; this package has no such model, so it is an argument.  Everywhere else nobody knows them: they stay on the
lines of `command`.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim.effects import CATALOGUE

from ..log.record import Z_BETA, Record
from .check import NO_MISMATCH, UNKNOWN_LAW, ControllerCheck, check_controller
from .command import unsure
from .gaps import INTEGRAL, MISMATCH_NATS, Gaps, Seen, check_gaps, follows, on_board, with_commands_between

FILLINGS = 2           # passes over a slow log: the second has the first's commands to predict with


def with_commands(record: Record, follow: Callable[[Record], Seen | None]) -> tuple[Record, ControllerCheck | None]:
    """Return the record with its missing commands, where they follow, and the controller's check.

    follow  predicts between the rows with a model of the vehicle; None: the model does not stay with the log
    """
    is_slow = record.every > record.tick and record.fine == 1 and record.input != "beta" \
        and record.nominal.controller is not None   # it has not every command that was issued
    if record.law is not None or not is_slow:
        return record, check_controller(record)
    if record.input == "controller" or not np.isfinite(record.reference).any() or \
            not follows(on_board(record), record.every // record.tick):
        return record, None
    made, checked, own = record, None, on_board(record)
    is_told = any(CATALOGUE[each.name].where == "controller" for each in record.nominal.effects)   # by another log
    for _ in range(FILLINGS):
        seen = follow(made)
        if seen is None:
            return record, None
        checked = check_gaps(made, seen)
        if checked is not None and checked.kind == UNKNOWN_LAW:
            return record, checked
        told = own if checked is None else own._replace(
            kp=checked.kp_scale * own.kp, kd=checked.kd_scale * own.kd, tau=checked.time_constant or own.tau,
            late=own.late + round(checked.delay / own.period))
        made = with_commands_between(made, seen.attitude, told)
    if checked is not None and checked.kind != NO_MISMATCH:
        assert seen is not None
        believed = with_commands_between(record, seen.attitude, own)
        if not _confirms(follow(made), follow(believed)):
            gaps = Gaps(record, seen)
            is_believed = gaps.is_noise(gaps.left(own.tau, ()).rest)
            return believed, replace(checked, kind=NO_MISMATCH if is_believed else UNKNOWN_LAW)
        gaps = Gaps(record, seen, round(checked.delay / own.period) // (record.every // record.tick))
        both, with_integral = (gaps.left(checked.time_constant or own.tau, free) for free in ((0, 1), (0, 1, INTEGRAL)))
        if with_integral.over(both) > MISMATCH_NATS:   # a law that the nominal has not
            return record, replace(checked, kind=UNKNOWN_LAW)
        is_told = True
    if is_told:
        made = replace(made, unsure=unsure(record.every / record.tick - 1.0))
    return made, checked


def _confirms(told: Seen | None, believed: Seen | None) -> bool:
    """Whether the nozzle, if measured, clearly supports the controller that the gaps tell (`told`) over the nominal's:
    it answers every command, and no wrong sensor moves it."""
    if told is None or believed is None:
        return False
    (one, rows), (other, _) = ((np.nansum(each.innovations[:, Z_BETA]**2),
                                np.isfinite(each.innovations[:, Z_BETA]).sum())
                               for each in (told, believed))
    return rows == 0 or bool(0.5 * rows * math.log(other / one) > MISMATCH_NATS)

"""Every command that the controller issued, and whether it is the nominal's.

A log as fast as its controller has them all.  Of a slower one with reference and commands those between rows follow
exactly, where the controller is the nominal's or has gains that the log tells, from what a model of the vehicle saw
there; the controller's room knows none, so the model is handed in.  Everywhere else nobody knows them: they stay on the
lines of `command`.
"""

import math
from dataclasses import replace
from typing import Protocol

import numpy as np

from sim.effects import CATALOGUE

from ..data.record import BETA, Record
from .check import check_controller
from .command import unsure
from .fill import filled, on_board
from .gaps import CLEARLY, Seen, check_gaps, follows, is_believed, told_by
from .kind import NONE, UNKNOWN, ControllerCheck
from .rates import check_rate

FILLINGS = 2           # passes over a slow log: the second has the first's commands to predict with


class Follower(Protocol):
    """A model that follows a log."""

    def seen(self, record: Record) -> Seen | None:
        """The predictions between the rows; None: the model does not stay with the log."""


def with_commands(record: Record, follower: Follower) -> tuple[Record, ControllerCheck | None]:
    """The record with its missing commands, where they follow, and the controller's check."""
    if record.law is not None and record.law.is_rate_law:
        return record, check_rate(record)
    if record.law is not None:
        flown = replace(record, nominal=replace(record.nominal, controller=record.law))
        return record, check_controller(flown)
    if not is_slow(record):
        return record, check_controller(record)
    if record.input == "controller" or not np.isfinite(record.reference).any() or \
            not follows(on_board(record), record.every // record.tick):
        return record, None
    made, checked, own = record, None, on_board(record)
    for _ in range(FILLINGS):
        seen = follower.seen(made)
        if seen is None:
            return record, None
        checked = check_gaps(made, seen)
        if checked is not None and checked.kind == UNKNOWN:
            return record, checked
        made = filled(made, seen.attitude, own if checked is None else told_by(checked, own))
    if checked is not None and checked.kind != NONE:
        assert seen is not None
        believed = filled(record, seen.attitude, own)
        if not _confirms(follower.seen(made), follower.seen(believed)):
            return believed, replace(checked, kind=NONE if is_believed(record, seen) else UNKNOWN)
    told = checked is not None and checked.kind != NONE
    if told or any(CATALOGUE[each.name].where == "controller" for each in record.nominal.effects):  # what some log told
        made = replace(made, unsure=unsure(record.every / record.tick - 1.0))
    return made, checked


def _confirms(told: Seen | None, believed: Seen | None) -> bool:
    """Whether the nozzle, where it is measured, has clearly more for the controller that the gaps tell than for the
    nominal's: it sees every command's answer, and no sensor that is wrong moves it."""
    if told is None or believed is None:
        return False
    (one, rows), (other, _) = ((np.nansum(each.innovations[:, BETA]**2), np.isfinite(each.innovations[:, BETA]).sum())
                               for each in (told, believed))
    return rows == 0 or bool(0.5 * rows * math.log(other / one) > CLEARLY)


def is_slow(record: Record) -> bool:
    """The log has not every command that its controller issued."""
    return record.every > record.tick * record.thinned and record.fine == 1 and record.input != "beta" \
        and record.nominal.controller is not None

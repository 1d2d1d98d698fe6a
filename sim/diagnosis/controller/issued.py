"""Every command that the controller issued, and whether it is the nominal's.

A log as fast as its controller has them all.  Of a slower one with reference and commands those between rows follow
exactly, where the controller is the nominal's or has gains that the log tells, from what a model of the vehicle saw
there; the controller's room knows none, so the model is handed in.  Everywhere else nobody knows them: they stay on the
lines of `command`.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from ...flight import packed
from ..data.record import Record
from .check import check_controller
from .command import unsure
from .fill import filled, on_board
from .gaps import Seen, check_gaps, follows
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
    made, checked = record, None
    for _ in range(FILLINGS):
        seen = follower.seen(made)
        if seen is None:
            return record, None
        checked, own = check_gaps(made, seen), on_board(record)
        if checked is not None and checked.kind == UNKNOWN:
            return record, checked
        if checked is not None and checked.kind != NONE:
            own = own._replace(kp=checked.kp_scale * own.kp, kd=checked.kd_scale * own.kd,
                               tau=checked.time_constant or own.tau, late=own.late + checked.late(own.period))
        made = filled(made, seen.attitude, own)
    told = checked is not None and checked.kind != NONE
    if told or len(packed(record.nominal).controller):  # the nominal's are what some log told
        made = replace(made, unsure=unsure(record.every / record.tick - 1.0))
    return made, checked


def is_slow(record: Record) -> bool:
    """The log has not every command that its controller issued."""
    return record.every > record.tick * record.thinned and record.fine == 1 and record.input != "beta" \
        and record.nominal.controller is not None

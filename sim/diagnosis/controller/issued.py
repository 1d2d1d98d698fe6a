"""Every command that the controller issued, and whether it is the nominal's.

A log as fast as its controller has them all.  Of a slower one those between the rows are filled in, from what a model
of the vehicle saw there; the controller's room knows none, so the model is handed in.  Where there is no reference to
fill them in by, or no command at all, they are what the controller makes of that model's attitude: off by what it makes
of the noise that it saw there (`asked`).  Where rows fall between its ticks, whatever their period, what no row saw is
made in the same way (`unseen`).
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from ..data.record import THETA, Record
from .asked import LINES, RECOMPUTED, WITHOUT_NOZZLE, asked, of_noise, unsure
from .check import check_controller
from .command import recomputed
from .fill import Controller, as_believed, filled
from .gaps import Seen
from .kind import NONE, UNKNOWN, ControllerCheck
from .rates import check_rate
from .refined import Vehicle, refined
from .ticks import SLOWER
from .unseen import with_unseen

FILLINGS = 2           # passes over a slow log: the second has the first's commands to predict with


class Follower(Protocol):
    """A model that follows a log."""

    def seen(self, record: Record) -> Seen | None:
        """The predictions between the rows; None: the model does not stay with the log."""

    def vehicle(self, record: Record) -> Vehicle:
        """The same at the declared noise."""


def with_commands(record: Record, follower: Follower) -> tuple[Record, ControllerCheck | None]:
    """The controller's check; and of a log slower than the controller the missing commands, where the check allows."""
    if record.law is not None and record.law.is_rate_law:
        return record, check_rate(record)
    if record.law is not None:
        flown = replace(record, nominal=replace(record.nominal, controller=record.law))
        return record, check_controller(flown) if record.every == record.tick else None
    if record.issued is not None:
        return _between_ticks(record, follower)
    own = record.nominal.controller
    if record.input == "beta" and own is not None and record.period > SLOWER * own.period:  # it moved between its rows
        unseen = record.period / own.period - 1.0
        return replace(record, unsure=unsure(record, LINES / WITHOUT_NOZZLE, max(unseen, unseen**2))), None
    if not is_slow(record):
        return record, check_controller(record)
    if record.input == "controller":
        return _recomputed(record, follower), None
    if not np.isfinite(record.reference).any():
        return _without_reference(record, follower), None
    checked, unfilled, r = None, record, record
    for _ in range(FILLINGS):
        seen = follower.seen(r)
        if seen is None:
            return unfilled, None
        checked = check_controller(r, seen)
        if checked is not None and checked.kind == UNKNOWN:
            return unfilled, checked
        believed = as_believed(r)
        r = filled(r, seen.attitude, believed if checked is None or checked.kind == NONE else Controller(
            checked.kp_scale, checked.kd_scale, checked.time_constant or believed.time_constant,
            checked.late(r.tick * r.step)))
    if checked is not None and checked.kind != NONE:
        assert seen is not None
        checked, likeliest = refined(r, seen, checked, follower.vehicle(r))
        r = filled(r, seen.attitude, likeliest)
    return replace(r, unsure=unsure(r, RECOMPUTED)) if r.fill_gain > 0.0 else r, checked


def _between_ticks(record: Record, follower: Follower) -> tuple[Record, ControllerCheck | None]:
    """The record of a log whose rows fall between the controller's ticks, with the commands that no row saw."""
    if record.input == "controller":
        record, _ = with_unseen(record, np.interp(record.tick * np.arange(len(record.commands)), *_measured(record)))
    seen = follower.seen(record)
    return (record, None) if seen is None else with_unseen(record, seen.attitude)


def _measured(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """(Steps, attitudes [rad]) of the rows that measure one."""
    known = np.isfinite(record.z[:, THETA])
    return record.at[known], record.z[known, THETA]


def _recomputed(record: Record, follower: Follower) -> Record:
    """The record of a log without commands: those that the controller makes of the model's attitude, off by its
    noise."""
    seen = follower.seen(record)
    commands = record.commands if seen is None else recomputed(record, seen.attitude)
    return replace(record, commands=commands, fill_gain=of_noise(record), unsure=unsure(record, RECOMPUTED))


def _without_reference(record: Record, follower: Follower) -> Record:
    """The record of a log without reference; where the model does not stay with the log, its commands stay on lines."""
    seen = follower.seen(record)
    if seen is None:
        return replace(record, fill_gain=of_noise(record), unsure=unsure(record, LINES))
    return asked(record, seen.attitude)


def is_slow(record: Record) -> bool:
    """The log has not every command that its controller issued."""
    return record.every > record.tick * record.thinned and record.fine == 1 and record.input != "beta" \
        and record.nominal.controller is not None

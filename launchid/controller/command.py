"""Find the command of every tick: logged, recomputed by the nominal controller, or the measured nozzle angle.

With the reference the controller's errors are known, so what it must have commanded is, too.  Commands that no row saw,
of a log slower than the controller or of rows between its ticks, lie on lines between those that are logged, off by
noise as large as such lines are off in this log (`Record.between`); `issued` has the exact ones where they follow.
"""

import math
from dataclasses import replace

import numpy as np

from sim.errors import InputError
from sim.flight import excitation
from sim.nominal import Nominal

from ..log.detect import DataCheck
from ..log.log import Log
from ..log.record import Z_BETA, Z_THETA, Record, no_servo, on_grid
from ..series import filled
from .replay import LAW_PERIOD, constants_of, issued
from .ticks import SLOWER, Ticks, between, carried, command_noise, falls_between, issued_at, over_grid, ticks_of

LONGEST_HELD = 10  # rows of one command: over more nobody commands
UNSURE = 0.03    # nats a row that a command may feign which no row saw (`measure`)
REPEATED_ROWS = 0.2  # of the rows repeat their command: the log is faster than what issues it


def record(log: Log, nominal: Nominal, data: DataCheck) -> Record:
    """Return the log on its grid with its commands; InputError if it holds no input (neither command, nor reference and
    controller, nor nozzle).

    log, nominal  the log as checked;  data  its check: rows and values that may be used
    """
    draft, command = on_grid(log, nominal, data)
    if draft.fine == 1 and draft.every <= draft.tick and falls_between(_held(draft, command), command):
        draft, command = on_grid(log, nominal, data, between=True)
    if not np.isfinite(draft.z[:, :Z_BETA]).any():
        raise InputError(f"{log.path}: no theta and no theta_dot that can be used; expected one of them")
    return _with_commands(draft, command, log.path)


def _with_commands(draft: Record, command: np.ndarray, path: str) -> Record:
    """Return the record with the command of every tick; InputError, naming `path`, if there is none."""
    nominal = draft.nominal
    known = np.isfinite(command)
    is_slow = draft.fine > 1 or draft.every > draft.tick
    recomputable = nominal.controller is not None and np.isfinite(draft.reference).any() \
        and np.isfinite(draft.z[:, Z_THETA]).any() and not (is_slow and np.isfinite(draft.z[:, Z_BETA]).any())
    draft = _held(draft, command)
    direct = nominal.actuator is None and np.isfinite(draft.z[:, Z_BETA]).any()
    if direct:
        known = np.zeros(draft.rows, bool)
    elif not known.any() and recomputable:
        return _answered(draft)
    source = "beta_cmd"
    if not known.any():
        command, source = draft.z[:, Z_BETA], "beta"
        known = np.isfinite(command)
        if not known.any():
            raise InputError(f"{path}: no beta_cmd, no beta, and no theta_ref with a [controller] to recompute the "
                             "command from; expected one of them")
    if source == "beta":  # it is the input, so it tells nothing besides, and no servo is between
        draft = replace(draft, z=np.column_stack([draft.z[:, :Z_BETA], np.full(draft.rows, math.nan)]),
                        actuator=no_servo(draft.period))
    else:
        command = _shared(command, draft.held, draft.held_phase)
        known = np.isfinite(command)
        draft = replace(draft, logged=known)
    lost = ~known if source == "beta" else ~known & ~np.isfinite(draft.z).any(axis=1)
    rows = np.arange(draft.rows)
    if lost.any():
        command = np.where(lost, filled(command, known=known), command)
        known = known | lost
    issued = command[np.maximum.accumulate(np.where(known, rows, 0))]
    issued[~np.isfinite(issued)] = command[known][0]
    if source == "beta_cmd":
        logged = np.where(lost, math.nan, command)
        own = ticks_of(draft, logged)
        if own is not None:
            return _between_rows(draft, own, logged)
    elif nominal.controller is not None and draft.period > SLOWER * nominal.controller.period:
        unseen = draft.period / nominal.controller.period - 1.0
        draft = replace(draft, unsure=unsure(unseen))  # it moved between its rows
    if draft.fine > 1:
        return replace(draft, commands=_placed(draft, command, known, source), input=source)
    if source == "beta":  # its mean between rows, early by the lag of the servo that stands for none
        early = 0.5 + draft.actuator.lag / draft.period
        issued = issued + early * np.diff(issued, append=issued[-1])
    m = draft.every // draft.tick
    ticks = issued if m == 1 else np.interp(np.arange(draft.rows * m) / m, rows, issued)
    return replace(draft, commands=ticks, input=source)


def _between_rows(draft: Record, ticks: Ticks, logged: np.ndarray) -> Record:
    """Return the record of a log that did not see every command; logged (n,) [rad] of the rows, NaN where there is
    none: the others lie on the lines between them."""
    commands = issued_at(ticks, draft, logged)
    line, off, jumps = carried(logged)
    unseen = np.flatnonzero(~np.isfinite(commands))
    commands[unseen] = np.interp(unseen, ticks.of(draft.at), line)
    draft = in_doubt(between(draft, ticks), float(np.sqrt(np.mean(off[~jumps]**2))), len(unseen) / draft.rows)
    return replace(draft, commands=over_grid(ticks, draft, commands), input="beta_cmd")


def _held(draft: Record, command: np.ndarray) -> Record:
    """Return the record with `held` set: the rows that share a command, where the log is faster than the controller."""
    if draft.tick <= draft.every:
        return draft
    held = draft.tick // draft.every
    changes = np.flatnonzero(np.abs(np.diff(command)) > 0.0) + 1
    first = int(np.bincount(changes % held, minlength=held).argmax()) if len(changes) else 0   # at which it issues
    return replace(draft, tick=draft.every, held=held, held_phase=first)


def in_doubt(draft: Record, off: float, unseen: float) -> Record:
    """Return the record with doubt in the commands that no row saw: `unseen` of them a row, each off by `off` [rad],
    one sigma (between ticks, where a command of the grid is a mean over a row, by their mean)."""
    mean = math.sqrt(unseen) / (1.0 + unseen) if draft.fine > 1 else 1.0
    return replace(draft, between=off * mean, unsure=unsure(unseen))


def unsure(unseen: float) -> float:
    """Return the evidence [nats a row] that commands may fake of which `unseen` a row were not logged."""
    return UNSURE * math.sqrt(unseen)


def _answered(draft: Record) -> Record:
    """Return the record of a log without commands, with those that the controller makes of the measured attitude; its
    answer to noise that no row saw is not among them."""
    own = ticks_of(draft, np.full(draft.rows, math.nan))
    if own is None:   # of a log as fast as the controller that of every row, linear over rows without an attitude
        error, held, phase = filled(draft.z[:, Z_THETA]) - filled(draft.reference), draft.held, draft.held_phase
        first = (draft.first_step + phase * draft.every) // (draft.tick * held)
        commands = np.repeat(_answer(draft, error[phase::held], first), held)
        commands = np.concatenate([np.full(phase, commands[0]), commands])[:draft.rows]
        return replace(draft, commands=commands, input="controller")
    commands = recomputed_at(own, draft)
    draft = in_doubt(between(draft, own), command_noise(draft), len(commands) / draft.rows - (draft.fine == 1))
    return replace(draft, commands=over_grid(own, draft, commands), input="controller")


def _shared(command: np.ndarray, held: int, phase: int) -> np.ndarray:
    """Return commands (n,) [rad] in which a row without its own has it from another row of the same held command."""
    made, rows = command.copy(), np.arange(len(command))
    for by in range(1, held):
        for other in (rows - by, rows + by):
            inside = (other >= 0) & (other < len(rows))
            same = inside & ((rows - phase) // held == (other - phase) // held) & ~np.isfinite(made)
            made[same] = command[other[same]]
    return made


def _placed(draft: Record, command: np.ndarray, known: np.ndarray, source: str) -> np.ndarray:
    """Return the commands (ticks,) [rad] of a jittered log: each held from its own stamp on, or, where a command is
    held over rows, from the middle between the rows that it changed between; the measured nozzle linear between
    them."""
    ticks = draft.tick * (np.arange(draft.rows * draft.every // draft.tick) + 0.5)
    at, values = draft.at[known].astype(np.float64), command[known]
    changed = np.diff(values) != 0.0
    if source != "beta" and _is_held(changed):
        at[1:] = np.where(changed, 0.5 * (at[1:] + at[:-1]), at[1:])
    if source == "beta":
        return np.interp(ticks + draft.actuator.lag / draft.step, at, values)
    return np.asarray(values[np.maximum(np.searchsorted(at, ticks, side="right") - 1, 0)])


def _is_held(changed: np.ndarray) -> bool:
    """Whether commands, of which changed (n - 1,) tells the changes, are held over rows: they change less often
    than the rows come, where they change at all."""
    apart = np.diff(np.flatnonzero(changed))
    apart = apart[apart <= LONGEST_HELD]
    return len(apart) > 0 and float(np.mean(apart)) * (1.0 - REPEATED_ROWS) > 1.0


# ---- recomputed


def recomputed_at(ticks: Ticks, r: Record) -> np.ndarray:
    """Return the nominal controller's commands (ticks,) [rad], from reference and attitude (on lines between rows), of
    a log that did not see every tick."""
    count = len(issued_at(ticks, r, np.full(r.rows, math.nan)))
    at, seen = ticks.phase + ticks.period * np.arange(count), np.isfinite(r.z[:, Z_THETA])
    theta = np.interp(at, r.at, carried(r.z[:, Z_THETA])[0])
    rows, index = np.isin(r.at, at) & seen, np.isin(at, r.at[seen])
    theta[index] = r.z[rows, Z_THETA]
    return _answer(r, theta - np.interp(at, r.at, filled(r.reference)),
                   round((r.first_step + ticks.phase) / ticks.period))


def _answer(r: Record, error: np.ndarray, first: int) -> np.ndarray:
    """Return the nominal controller's commands (periods,) [rad] to errors (periods,) [rad] from period `first` on."""
    constants = constants_of(r.nominal)
    test = excitation(r.nominal, first + len(error), constants[LAW_PERIOD])[first:]
    return issued(r.nominal, constants, error, test)[0]

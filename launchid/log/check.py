"""Check a log before a command uses it: mend stamps and turns, mask bad values, warn in one line of what is wrong.

`log.detect` finds faults of columns by themselves and of columns against each other, `log.vehicle` those that only the
vehicle's equation shows (beta and its command both reversed).
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal, constant_profile
from sim.sections import Sensors

from .channels import LARGEST_ANGLE
from .detect import VALUES, DataCheck, check, related
from .fault import Fault
from .log import Log
from .rates import Rate
from .sensors import Sensed, sensed
from .slope import foreign_scale, is_other_motion
from .stamps import even_grid
from .turns import unwrapped
from .vehicle import plant_faults

COLUMN_FAULTS = ("unit", "sign", "swapped", "motion", "origin")  # of a whole column: it is of another quantity
DOUBTFUL = ("scale",)  # of a whole column: which of two is right only a nominal could tell
CLOCK_FAULTS = ("unit", "order")   # of t: there is no period, and nothing can be computed
FEWEST_IDEAL = 20       # rows
NOISE_FREE = 1e-3       # of the rms increment from row to row: no sensor is as good, the simulator's step is
OTHER_UNIT = 2.6        # either way, of theta_dot over the slope of theta: scales of sensors are 0.4 to 2.5
SMALL_UNITS = (("milliradians", 1e3), ("degrees", 180.0 / math.pi), ("centidegrees", 18e3 / math.pi),
               ("millidegrees", 180e3 / math.pi), ("microradians", 1e6))
SAME_NAME = 0.05        # relative, of a factor that is a unit's
REPEATED = ("theta", "theta_dot", "beta")  # that a row written twice repeats
BRIDGED = 2             # rows in a row without theta or beta that are missing measurements; more are a gap


@dataclass(frozen=True, eq=False)
class CheckedLog:
    """A log after the data check, as every command uses it.

    log     to be used: NaN where the check found a bad value, rounded stamps on their grid, whole turns put back
    raw     as it was read;  faults  that were found;  mended  what was put right
    data    the check's masks, and the rates at which columns were sampled;  nominal  that it was checked with, or None
    sensed  its columns without what its sensors add, which estimates are made of; None: not asked
    """

    log: Log
    raw: Log
    faults: tuple[Fault, ...]
    mended: tuple[Fault, ...]
    data: DataCheck
    nominal: Nominal | None = None
    sensed: Sensed | None = None

    @property
    def estimated(self) -> Log:
        """The log that estimates are made of: without what its sensors add, if that was asked."""
        mended: dict[str, Any] = {} if self.sensed is None else self.sensed.columns
        return replace(self.log, **mended) if mended else self.log

    @property
    def notes(self) -> tuple[str, ...]:
        """One line for each thing that was mended (stamps put on a grid, turns put back), with the log's path."""
        return tuple(f"{self.raw.path}: {fault.message}" for fault in self.mended)

    @property
    def bridged(self) -> float:
        """Step between usable rows [s] up to which the rows between are missing measurements, not a gap: BRIDGED rows;
        0 if no row lacks theta or beta, or all do."""
        log, there = self.log, np.isfinite(self.log.t)
        missing = there & ~(np.isfinite(log.theta) & np.isfinite(log.beta))
        return (BRIDGED + 1.5) * log.period if missing.any() and not missing[there].all() else 0.0

    @property
    def rates(self) -> dict[str, Rate]:
        """theta, theta_dot, beta -> the `Rate` at which the column was sampled."""
        return self.data.rates

    @property
    def foreign(self) -> str:
        """Which columns hold another quantity than their names say, in words; "" if none.  If any does, no number that
        is identified from the log can be right."""
        return foreign(self.faults)

    @property
    def doubtful(self) -> str:
        """Faults that make all numbers doubtful if no nominal decides (a scale of theta_dot), in words, or ""."""
        return "; ".join(fault.message for fault in self.faults if fault.kind in DOUBTFUL)

    @property
    def line(self) -> tuple[str, ...]:
        """The data check's faults as a warning of one line, with the log's path; () if it found none."""
        return (f"{self.raw.path}: the data check: {'; '.join(fault.message for fault in self.faults)}",) \
            if self.faults else ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """All lines that a user should read: the faults, what was mended, and whether the log has no sensor noise."""
        sensors = self.sensed.faults if self.sensed is not None else ()
        return (*self.line, *self.notes, *(f"{self.raw.path}: {fault.message}" for fault in sensors),
                *ideal_note(self.log))


def checked(log: Log, nominal: Nominal | None = None, *, strict: bool = False,
            refuse_columns: bool = False) -> CheckedLog:
    """Check a log: the only way from a Log as it was read to one that a command may use.

    nominal  None: columns are judged by themselves and by each other alone
    InputError if t is not in seconds or its rows are out of order; if `strict` and there is any fault; if
    `refuse_columns` and a column holds another quantity than its name says.
    """
    made = replace(examined(log, nominal or _unknown(log.period)), nominal=nominal)
    if not made.foreign and not clock_faults(made.data):
        found = sensed(made.log, made.data, nominal)
        own = {(fault.kind, fault.channel) for fault in found.faults}
        made = replace(made, sensed=found, faults=tuple(
            fault for fault in made.faults if (fault.kind, fault.channel) not in own))
    for fault in clock_faults(made.data):
        raise InputError(f"{log.path}: column t: {fault.message.removeprefix('t ')}")
    if made.line and (strict or (refuse_columns and made.foreign)):
        raise InputError(made.line[0])
    if strict and made.sensed is not None and made.sensed.faults:
        raise InputError(f"{log.path}: {made.sensed.faults[0].message}")
    return made


def examined(log: Log, nominal: Nominal) -> CheckedLog:
    """Check a log as `checked`, but refuse none for its faults: a diagnosis judges bad ones too."""
    mended, grid = _on_grid(log)
    mended, turns = unwrapped(mended)
    data = check(mended, nominal)
    found = data.faults if foreign(data.faults) or clock_faults(data) else (
        *data.faults, *plant_faults(mended, nominal, data.masks), *rate_faults(mended, data))
    return CheckedLog(measured(mended, data), log, found, (*grid, *turns), data)


def clock_faults(data: DataCheck) -> list[Fault]:
    """Return the faults of t that leave no sample period: another unit than seconds, rows out of order."""
    return [fault for fault in data.faults if fault.channel == "t" and fault.kind in CLOCK_FAULTS]


def measured(log: Log, data: DataCheck) -> Log:
    """Return the log with NaN where the check found a value bad; values that an estimator itself rejects stay."""
    with np.errstate(invalid="ignore"):
        rejected = ~data.usable | np.any([np.abs(getattr(log, name)) > LARGEST_ANGLE for name in VALUES], axis=0)
    columns: dict[str, Any] = {name: _measured(log, name, data, rejected) for name in VALUES if name in log.columns}
    return replace(log, **columns)


def faults(log: Log, nominal: Nominal | None) -> tuple[Fault, ...]:
    """Return the faults that `checked` finds, which may raise; without a nominal no fault is found that needs one."""
    return checked(log, nominal).faults


def columns_alone(log: Log) -> DataCheck:
    """Run the data check without a nominal, on a log whose t may have no period."""
    return check(log, _unknown(log.check_clock() or 1.0))


def _unknown(period: float) -> Nominal:
    """Return a nominal of this sample period [s] with a6, k1 and all noise levels 0."""
    return Nominal(name="", vehicle=constant_profile(0.0, 0.0), terms=(), sensors=Sensors(
        period=period, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0))


def _on_grid(log: Log) -> tuple[Log, list[Fault]]:
    """Return (the log with stamps that were rounded to a tick put on their even grid, a Fault that says so or none)."""
    log.check_clock()
    rows = np.flatnonzero(np.isfinite(log.t))
    made = even_grid(log.t[rows], _is_twice(log, rows)) if len(rows) else None
    if made is None:
        return log, []
    grid, period, tick = made
    t = log.t.copy()
    t[rows] = grid
    return replace(log, t=t), [Fault("stamps", "t", float(grid[0]), float(grid[-1]), 0,
                                     f"stamps are rounded to {tick:.4g} s; rows are {period:.5g} s apart: put on that "
                                     "grid")]


def _is_twice(log: Log, rows: np.ndarray) -> bool:
    """Whether most of these rows (k,) that have the stamp of the row before have its values too."""
    again = rows[1:][np.diff(log.t[rows]) == 0.0]
    columns = [getattr(log, name) for name in REPEATED if name in log.columns]
    same = np.logical_and.reduce([(x[again] == x[again - 1]) | ~np.isfinite(x[again]) for x in columns])
    return len(again) > 0 and bool(np.mean(same) > 0.5)


def _measured(log: Log, name: str, data: DataCheck, rejected: np.ndarray) -> np.ndarray:
    """Return a column (n,) with NaN where the check found its value bad.

    rejected (n,) bool: rows with a bad stamp or an absurd value, which stay: every estimator rejects and counts them
    A beta or beta_cmd that repeats stays too, for a held input acts as it stands; so does a column that is at fault as
    a whole, of which no number is used.
    """
    x = getattr(log, name)
    if any(fault.kind in COLUMN_FAULTS and fault.channel in (name, None) for fault in data.faults):
        return np.asarray(x)
    good = data.masks[name] | rejected
    if name in ("beta", "beta_cmd"):   # an input that stays as it is acts so: a step, a command that is held
        is_same = np.isfinite(x) & (x == np.concatenate([x[:1], x[:-1]]))
        good = rejected | data.sound[name] | (is_same & data.masks["theta"])
    return np.where(good, x, math.nan)


def rate_faults(log: Log, data: DataCheck) -> list[Fault]:
    """Return [Fault] if theta_dot is another motion than the slope of theta, or a multiple of it, else []: for a
    diagnosis that is an effect of a sensor, for an estimator it is not."""
    t, columns = related(log, data.usable, data.masks)
    period = float(t[1] - t[0]) if columns else 0.0
    both = data.masks["theta"] & data.masks["theta_dot"]
    known = np.interp(t, log.t[data.usable], both[data.usable]) > 1.0 - 1e-9 if columns else np.zeros(0, bool)
    if columns and is_other_motion(columns, period, known):
        return [Fault("motion", None, float(t[0]), float(t[-1]), len(t),
                      "theta_dot is not the slope of theta over any time: the body turns about its other axes too, or "
                      "the two are of different devices")]
    scale = foreign_scale(columns, period, known) if columns else None
    if scale is None:
        return []
    if not 1.0 / OTHER_UNIT < scale[0] < OTHER_UNIT:
        return [_other_unit(t, *scale)]
    return [Fault("scale", "theta_dot", float(t[0]), float(t[-1]), len(t),
                  f"theta_dot is {scale[0]:.3g} times the slope of theta (+- {scale[1]:.1g}): a6 and k1 may be off by "
                  "as much, which their standard deviations do not know; correct the scale of either")]


def _other_unit(t: np.ndarray, scale: float, std: float) -> Fault:
    """Return the Fault of theta_dot, or of theta, in another unit: theta_dot is `scale` times the slope of theta."""
    column, factor = ("theta_dot", scale) if scale > 1.0 else ("theta", 1.0 / scale)
    unit = next((f"looks like {name}{'/s' if column == 'theta_dot' else ''}; divide it by {size:.6g}"
                 for name, size in SMALL_UNITS if abs(factor / size - 1.0) < SAME_NAME),
                f"is in another unit; divide it by {factor:.4g}")
    return Fault("unit", column, float(t[0]), float(t[-1]), len(t),
                 f"theta_dot is {scale:.3g} times the slope of theta (+- {std:.1g}): {column} {unit}")


def foreign(noted: tuple[Fault, ...]) -> str:
    """Return the messages of faults by which a column holds another quantity than its name says; "" if none."""
    return "; ".join(fault.message for fault in noted if fault.kind in COLUMN_FAULTS)


def profile_note(nominal: Nominal | None, last: float, what: str) -> tuple[str, ...]:
    """Return one line if the vehicle's profile ends before `what` (in words), which ends at `last` [s]; else ()."""
    if nominal is None or len(nominal.vehicle.t) == 1 or not nominal.vehicle.t[-1] < last - 1e-9:
        return ()
    return (f"{nominal.vehicle.path or nominal.path}: the profile ends at {nominal.vehicle.t[-1]:g} s, {what} at "
            f"{last:g} s: a6 and k1 are held from there on",)


def ideal_note(log: Log) -> tuple[str, ...]:
    """Return one line if a log has no sensor noise, else (): theta_dot is the integral of theta_ddot, and theta that of
    theta_dot, to far less than any sensor's noise.

    Limitation: with rows as far apart as the controller's period the trapezium is not exact enough, and () is returned.
    """
    known = np.logical_and.reduce([log.in_range(name) for name in ("t", "theta", "theta_dot", "theta_ddot")])
    if np.count_nonzero(known) < FEWEST_IDEAL:
        return ()
    t, x, v, a = (column[known] for column in (log.t, log.theta, log.theta_dot, log.theta_ddot))
    h = np.diff(t)
    for signal, slope, curvature in ((v, a, None), (x, v, a)):
        bend = 0.0 if curvature is None else h**2 / 12.0 * np.diff(curvature)  # of the trapezium, to the fifth order
        step = np.diff(signal)
        off = step - (0.5 * h * (slope[1:] + slope[:-1]) - bend)
        if not np.median(np.abs(off)) < NOISE_FREE * np.sqrt(np.mean(step**2)):
            return ()
    return (f"{log.path}: theta, theta_dot and theta_ddot are each other's integrals without noise: this looks like "
            "the simulator's ideal suite, the truth and not what sensors measure; declared noises do not apply to it",)

"""The data check in front of the commands: what seems wrong with a log, in one line, before its numbers are believed.

The detector (`launchid.log.detect`) sees a unit or a sign against another column; what only the vehicle could tell
(beta and its command both reversed) `log.vehicle` sees.
"""

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal, constant_profile
from sim.sections import Sensors

from .detect import DataCheck, check, related
from .fault import Fault
from .log import Log
from .slope import foreign_scale, is_other_motion
from .turns import unwrapped
from .vehicle import plant_faults

COLUMN_FAULTS = ("unit", "sign", "swapped", "motion", "origin")  # of a whole column: it is of another quantity
CLOCK_FAULTS = ("unit", "order")   # of t: there is no period, and nothing can be computed
FEWEST_IDEAL = 20       # rows
EXACT = 1e-3            # of the rms increment from row to row: no sensor is as good, the simulator's step is
MASKED = "; these rows are left out"          # by the diagnosis; an estimator judges each row by itself


def faults(log: Log, nominal: Nominal | None) -> tuple[Fault, ...]:
    """The faults that the data check finds; without a nominal those that the columns show of each other.

    InputError where the log's clock is none: in another unit than seconds, or of rows that are out of order.
    """
    if nominal is None:  # of a vehicle and of sensors that say nothing
        nominal = Nominal(name="", vehicle=constant_profile(0.0, 0.0), terms=(), sensors=Sensors(
            period=log.period, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0))
    log, _ = unwrapped(log)
    data = check(log, nominal)
    for fault in data.faults:
        if fault.channel == "t" and fault.kind in CLOCK_FAULTS:
            raise InputError(f"{log.path}: column t: {fault.message.removeprefix('t ')}")
    if foreign(data.faults):
        return data.faults
    return (*data.faults, *plant_faults(log, nominal, data.masks), *rate_faults(log, data))


def rate_faults(log: Log, data: DataCheck) -> list[Fault]:
    """Faults of a theta_dot that is another motion than the slope of theta, or a multiple of it: for a diagnosis an
    effect of a sensor, which no estimator asks for."""
    t, columns = related(log, data.usable, data.masks)
    period = float(t[1] - t[0]) if columns else 0.0
    if columns and is_other_motion(columns, period):
        return [Fault("motion", None, float(t[0]), float(t[-1]), len(t),
                      "theta_dot is not the slope of theta over any time: the body turns about its other axes too, or "
                      "the two are of different devices")]
    scale = foreign_scale(columns, period) if columns else None
    if scale is None:
        return []
    return [Fault("scale", "theta_dot", float(t[0]), float(t[-1]), len(t),
                  f"theta_dot is {scale[0]:.3g} times the slope of theta (+- {scale[1]:.1g}): a6 and k1 may be off by "
                  "as much, which their standard deviations do not know; correct the scale of either")]


def warned(log: Log, noted: tuple[Fault, ...], strict: bool, refuse_columns: bool = False) -> tuple[str, ...]:
    """The data check's warning in one line; () if it found nothing.

    InputError instead if `strict`, or if a column is of another quantity than its name says and that is refused.
    """
    if not noted:
        return ()
    line = f"{log.path}: the data check: {'; '.join(fault.message.removesuffix(MASKED) for fault in noted)}"
    if strict or (refuse_columns and foreign(noted)):
        raise InputError(line)
    return (line,)


def data_warnings(log: Log, nominal: Nominal | None, strict: bool, refuse_columns: bool = False) -> tuple[str, ...]:
    """Both in one: look at a log, and say what is found."""
    return warned(log, faults(log, nominal), strict, refuse_columns)


def foreign(noted: tuple[Fault, ...]) -> str:
    """The columns that are of another quantity than their names say, in words; "": none.  No advice but to correct
    them has a meaning then."""
    return "; ".join(fault.message for fault in noted if fault.kind in COLUMN_FAULTS)


def profile_note(nominal: Nominal | None, last: float, what: str) -> tuple[str, ...]:
    """A note where a vehicle's profile ends before what is flown or identified with it does, at `last` [s]."""
    if nominal is None or len(nominal.vehicle.t) == 1 or not nominal.vehicle.t[-1] < last - 1e-9:
        return ()
    return (f"{nominal.vehicle.path or nominal.path}: the profile ends at {nominal.vehicle.t[-1]:g} s, {what} at "
            f"{last:g} s: a6 and k1 are held from there on",)


def ideal_note(log: Log) -> tuple[str, ...]:
    """A note where a log is the truth without sensors: theta_dot is the integral of theta_ddot, and theta that of
    theta_dot, to far less than any sensor's noise.

    Limitation: at rows as far apart as the controller's period the trapezium is not as exact, and nothing is said.
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
        if not np.median(np.abs(off)) < EXACT * np.sqrt(np.mean(step**2)):
            return ()
    return (f"{log.path}: theta, theta_dot and theta_ddot are each other's integrals without noise: this looks like "
            "the simulator's ideal suite, the truth and not what sensors measure; declared noises do not apply to it",)

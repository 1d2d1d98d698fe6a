"""The data check in front of the commands: what seems wrong with a log, in one line, before its numbers are believed.

The detector is the diagnosis' own (`sim.diagnosis.data`), which sees a unit or a sign against another column; what only
the vehicle could tell (beta and its command both reversed) `plant_check` sees.
"""

from .diagnosis.data.check import check
from .diagnosis.data.fault import Fault
from .errors import InputError
from .log import Log
from .nominal import Nominal, constant_profile
from .plant_check import plant_faults
from .sections import Sensors

COLUMN_FAULTS = ("unit", "sign", "swapped")  # of a whole column: numbers from it are of another quantity
MASKED = "; these rows are left out"          # by the diagnosis; an estimator judges each row by itself


def faults(log: Log, nominal: Nominal | None) -> tuple[Fault, ...]:
    """What the data check finds; without a nominal what the columns tell of each other."""
    if nominal is None:  # of a vehicle and of sensors that say nothing
        nominal = Nominal(name="", vehicle=constant_profile(0.0, 0.0), terms=(), sensors=Sensors(
            period=log.period, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0))
    made = check(log, nominal)
    for fault in made.faults:
        if fault.kind == "unit" and fault.channel == "t":
            raise InputError(f"{log.path}: column t: {fault.message.removeprefix('t ')}")
    if any(fault.kind in COLUMN_FAULTS for fault in made.faults):
        return made.faults
    return (*made.faults, *plant_faults(log, nominal, made.masks))


def data_warnings(log: Log, nominal: Nominal | None, strict: bool, refuse_columns: bool = False) -> tuple[str, ...]:
    """What the data check finds in one line, nothing if that is nothing.

    InputError instead if `strict`, or if a column is in another unit, of the other sign or under another's name and
    that is refused.
    """
    found = faults(log, nominal)
    if not found:
        return ()
    line = f"{log.path}: the data check: {'; '.join(fault.message.removesuffix(MASKED) for fault in found)}"
    if strict or (refuse_columns and any(fault.kind in COLUMN_FAULTS for fault in found)):
        raise InputError(line)
    return (line,)


def profile_note(nominal: Nominal | None, last: float, what: str) -> tuple[str, ...]:
    """That a vehicle's profile ends before what is flown or identified with it does, at `last` [s]."""
    if nominal is None or len(nominal.vehicle.t) == 1 or not nominal.vehicle.t[-1] < last - 1e-9:
        return ()
    return (f"{nominal.vehicle.path or nominal.path}: the profile ends at {nominal.vehicle.t[-1]:g} s, {what} at "
            f"{last:g} s: a6 and k1 are held from there on",)

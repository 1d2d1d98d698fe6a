"""Find the faults of a log, and mask the values at fault.

Time stamps, infinite values, dropouts, stale runs, end stops, spikes, units, signs, exchanged columns and columns of a
slower channel are checked.  A physical effect passes: what a vehicle, an actuator or a sensor may do is no fault.

Limitations: a sign or a unit shows only against another column (see `relations`); stale values of a coarsely quantised
channel show only by their length or the jump at their end; a fault in a part of the log only is not found as one of
sign or unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from sim.sections import Nominal

from ..series import filled
from . import channels, relations, stamps
from .fault import Fault
from .log import SHORTEST_STEP, Log
from .rates import Rate, rate_of, slower
from .slope import Columns, unit_of_time
from .stops import Ends
from .vehicle import guided_faults

__all__ = ["DataCheck", "Fault", "check"]

VALUES = (*channels.SENSOR_COLUMNS, "theta_ddot", "beta_cmd", "theta_ref")
FEWEST_RELATED = 60   # usable rows: less do not tell units and signs


@dataclass(frozen=True, eq=False)
class DataCheck:
    """Faults of a log of n rows, and which of its values can be used.

    faults  in the order stamps, single columns, between columns, slower columns
    usable  (n,) bool: the row's stamp is finite and after all usable ones before
    masks   column -> (n,) bool: the value may be used, for it is measured, its stamp usable and no fault found; all
            False if the column's unit, sign or name is wrong
    rates   of theta, theta_dot, beta;  sound  masks that are True too for values that a logger repeated or interpolated
    """

    faults: tuple[Fault, ...]
    usable: np.ndarray
    masks: dict[str, np.ndarray]
    rates: dict[str, Rate] = field(default_factory=dict)
    sound: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def is_bad(self) -> bool:
        """Whether the check found any fault."""
        return len(self.faults) > 0


def check(log: Log, nominal: Nominal | None, ends: Mapping[str, Ends] = MappingProxyType({})) -> DataCheck:
    """Find the faults of a log with any readable content; raise nothing.

    nominal  gives the sample period (for the unit of t) and the equations of actuator and controller; None: each column
             is judged by itself alone
    ends     column -> `stops.ends_of` of all rows so far, where the log is their last part
    """
    usable = stamps.usable_rows(log.t)
    faults = stamps.stamp_faults(log.t, usable)
    rates = {name: rate_of(log.t, getattr(log, name)) for name in channels.SENSOR_COLUMNS}
    masks, single = channels.judged(log.t, {name: getattr(log, name) for name in VALUES}, usable,
                                    {name: rate.own for name, rate in rates.items()}, ends)
    faults += single
    if "alpha" in log.columns:
        masks["alpha"] = np.isfinite(log.alpha) & usable
    if nominal is not None and not any(fault.kind == "order" for fault in faults):
        faults += _between(log, nominal, usable, masks)
    sound = {name: mask.copy() for name, mask in masks.items()}
    for name, rate in rates.items():  # last, since between the channels every row counts
        faults += slower(name, log.t, rate, masks[name])
    return DataCheck(tuple(faults), usable, masks, rates, sound)


def _between(log: Log, nominal: Nominal, usable: np.ndarray, masks: dict[str, np.ndarray]) -> list[Fault]:
    """Return the faults of t and between columns; set the masks of columns at fault False, in place."""
    times, columns = related(log, usable, masks)
    by_slope = unit_of_time(columns, float(times[1] - times[0])) if columns else None
    faults, factor = stamps.unit_fault(log.t[usable], nominal, by_slope)
    faults += stamps.origin_fault(log.t[usable] / factor, nominal)
    times = times / factor
    if not columns or not times[1] - times[0] >= SHORTEST_STEP:
        return faults
    changes = list(relations.relation_faults(columns, float(times[1] - times[0]), nominal, times))
    faults += [fault for _, fault in changes] if changes else guided_faults(log, nominal, masks)
    for change, _ in changes:
        for name in change.channels:
            masks[name][:] = False
    return faults


def related(log: Log, usable: np.ndarray, masks: dict[str, np.ndarray]) -> tuple[np.ndarray, Columns]:
    """Return (uniform times (m,) in the log's unit of t, column -> (m,) interpolated on them, of columns measured in
    most rows); no columns if the log is too short to tell units and signs."""
    t = log.t[usable]
    grid = stamps.uniform_times(t) if len(t) >= FEWEST_RELATED else np.zeros(0)
    columns: Columns = {}
    for name in relations.RELATED_COLUMNS if len(grid) >= FEWEST_RELATED else ():
        good = masks[name][usable] if name in masks else np.zeros(len(t), bool)
        if 2 * np.count_nonzero(good) > len(t):
            columns[name] = filled(getattr(log, name)[usable], t, good, grid)
    return grid, columns

"""The data check: is the log what its columns say, before anything is concluded from it.

Time stamps, infinite values, dropouts, stale runs, spikes, units, signs, exchanged
columns.  A physical effect is not bad data: what a vehicle, an actuator or a sensor
may do passes.  What is wrong is named and masked.

Limitations: a sign or a unit shows only against another column (see `relations`);
stale values of a coarsely quantised channel show only by their length or the jump
at their end; a fault for a part of the log only is not a sign or unit fault.
"""

from dataclasses import dataclass

import numpy as np

from ..log import Log
from ..sections import Nominal
from . import channels, relations, stamps
from .fault import Fault

__all__ = ["DataCheck", "Fault", "check"]

MEASURED = ("theta", "theta_dot", "beta")  # by sensors: these may freeze and spike
VALUES = (*MEASURED, "theta_ddot", "beta_cmd", "theta_ref")
FEWEST_ROWS = 60   # usable rows: less do not tell units and signs


@dataclass(frozen=True, eq=False)
class DataCheck:
    """What is wrong with a log of n rows, and what of it can be used.

    faults  in the order stamps, single channels, between channels
    usable  (n,) bool: the row's stamp is finite and after all usable ones before
    masks   channel -> (n,) bool: the value may be used (measured, no fault; a channel whose unit, sign or place is
            wrong has none).  Where the stamp is unusable so is the value
    """

    faults: tuple[Fault, ...]
    usable: np.ndarray
    masks: dict[str, np.ndarray]

    @property
    def is_bad(self) -> bool:
        """Any fault at all."""
        return len(self.faults) > 0


def check(log: Log, nominal: Nominal) -> DataCheck:
    """Judge a log of any content; never raises for what a readable log may hold.

    nominal  for the sample period (unit of time), the actuator's and the controller's equations
    """
    usable = stamps.usable_rows(log.t)
    faults = stamps.stamp_faults(log.t, usable)
    unit, factor = stamps.time_unit(log.t[usable], nominal.sensors.period)
    if unit:
        faults.append(_time_fault(log.t[usable], unit, factor, nominal.sensors.period))
    masks: dict[str, np.ndarray] = {}
    for name in VALUES:
        x = getattr(log, name)
        masks[name] = np.isfinite(x) & usable
        faults += channels.out_of_range(name, log.t, x, masks[name])
        faults += channels.missing_runs(name, log.t, x)
    resting = _resting(log)
    for name in MEASURED:
        x = getattr(log, name)
        command = _filled(log.beta_cmd, masks["beta_cmd"]) if name == "beta" else np.full(len(x), np.nan)
        faults += channels.frozen_runs(name, log.t, x, masks[name], resting)
        faults += channels.spikes(name, log.t, x, masks[name], command)
    faults += _between(log, nominal, usable, masks, factor)
    return DataCheck(tuple(faults), usable, masks)


def _filled(x: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """x (n,) with what may not be used interpolated by row; NaN throughout if that is more than half."""
    rows = np.flatnonzero(mask)
    if 2 * len(rows) <= len(x):
        return np.full(len(x), np.nan)
    return np.interp(np.arange(len(x)), rows, x[rows])


def _resting(log: Log) -> np.ndarray:
    """(n,) bool: up to this row two or more measured channels have been exactly zero: an ideal vehicle on the pad."""
    still = np.sum([np.asarray(getattr(log, name) == 0.0, int) for name in MEASURED], axis=0) >= 2
    return np.asarray(np.logical_and.accumulate(still))


def _time_fault(t: np.ndarray, unit: str, factor: float, period: float) -> Fault:
    step = float(np.median(np.diff(t)))
    return Fault("unit", "t", float(t[0]), float(t[-1]), len(t),
                 f"t looks like {unit} over the whole log: its step is {step:.4g}, the nominal's {period:.4g} s; "
                 f"divide it by {factor:g}")


def _between(log: Log, nominal: Nominal, usable: np.ndarray, masks: dict[str, np.ndarray],
             units_in_a_second: float) -> list[Fault]:
    """Faults between the channels; the channels they concern lose their masks."""
    t = log.t[usable] / units_in_a_second
    if len(t) < FEWEST_ROWS:
        return []
    grid = stamps.uniform_times(t)
    columns: dict[str, np.ndarray] = {}
    for name in relations.CHANNELS:
        good = masks[name][usable]
        if 2 * np.count_nonzero(good) > len(t):
            columns[name] = np.interp(grid, t[good], getattr(log, name)[usable][good])
    period = float(grid[1] - grid[0]) if len(grid) > 1 else 0.0
    faults = []
    if len(grid) >= FEWEST_ROWS:
        for change, fault in relations.relation_faults(columns, period, nominal, grid):
            faults.append(fault)
            for name in change.channels:
                masks[name][:] = False
    return faults

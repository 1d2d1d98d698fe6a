"""Take off a log what its sensors add: a gyro's scale and lag, a lag of the attitude, a scale of the nozzle's sensor.

They are found between columns (`gyro`, `nozzle`), and what the nominal declares of them is no fault. The columns that
are estimated from are without them; those that a controller saw, and a diagnosis judges, stay as they were logged.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from sim.nominal import Nominal
from sim.plant import packed

from ..series import filled
from .detect import DataCheck, related
from .fault import Fault
from .gyro import Gyro, gyro_of, is_delayed, without_lag
from .log import Log
from .nozzle import nozzle_gain
from .steps import STEPPED, systematic_step

SCALE_SIGMAS = 4.0     # standard deviations of a scale that is there
LEAST_SCALE = 0.003    # relative: less moves a6 and k1 by less than their deviations
LAG_SIGMAS = 3.0       # standard deviations of a lag that is there
LEAST_LAG = 0.002      # s
MOST_LAG = 0.1         # s: more is no sensor's
MOST_SCALE = 1.5       # either way: more is another unit
LEAST_GAIN = 0.005     # relative, of the nozzle's sensor
SURE_GAIN = 0.005      # standard deviation of its gain, above which something else is between command and nozzle


@dataclass(frozen=True, eq=False)
class Sensed:
    """Columns of a log without what its sensors add, what that was, and the nozzle's scale.

    columns  name -> (n,), to be estimated from;  faults  of the sensors, that they are free of;  nozzle_scale  of beta
    over what the nominal's servo makes of the command: of the sensor, or of the servo;  coarse  in words that theta's
    steps are too coarse for the filter, else ""
    """

    columns: dict[str, np.ndarray] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()
    nozzle_scale: float = 1.0
    coarse: str = ""


def sensed(log: Log, data: DataCheck, nominal: Nominal | None) -> Sensed:
    """Return what the sensors of a checked log add, and its columns without."""
    logged = log
    t, columns = related(log, data.usable, data.masks)
    if not columns:
        return Sensed()
    period, found, gain = float(t[1] - t[0]), list[Fault](), 1.0
    both = data.masks["theta"] & data.masks["theta_dot"]
    known = np.interp(t, log.t[data.usable], both[data.usable]) > 1.0 - 1e-9

    def fault(kind: str, channel: str, message: str) -> None:
        found.append(Fault(kind, channel, float(t[0]), float(t[-1]), 0, message))

    gyro = gyro_of(columns, period, known)
    if gyro is not None:
        scale, lag = _beyond(gyro, nominal)
        if scale != 1.0:
            log = replace(log, theta_dot=log.theta_dot / scale)
            fault("scale", "theta_dot", f"theta_dot is {gyro.scale:.4g} times the slope of theta (+- "
                  f"{gyro.scale_std:.1g}): taken for the gyro's scale, and corrected; if it is the attitude's, k1 is "
                  "off by as much")
        if lag > 0.0:
            is_delay = is_delayed(columns, period, known, lag)
            log = replace(log, theta_dot=_mended(log, data, "theta_dot", lag, is_delay))
            fault("lag", "theta_dot", f"theta_dot is {1e3 * lag:.2g} ms behind theta (+- {1e3 * gyro.lag_std:.1g}): "
                  f"the gyro's {'delay' if is_delay else 'lag'} is taken off")
        elif lag < 0.0:
            log = replace(log, theta=log.theta - lag * _filled(log, data, "theta_dot"))
            fault("lag", "theta", f"theta is {-1e3 * lag:.2g} ms behind theta_dot (+- {1e3 * gyro.lag_std:.1g}): "
                  "the attitude's lag is taken off")
    if nominal is not None:
        own, std = nozzle_gain(columns, period, nominal)
        relative = own / packed(nominal).actuator_gain
        if std < SURE_GAIN and abs(relative - 1.0) > max(SCALE_SIGMAS * std, LEAST_GAIN) \
                and 1.0 / MOST_SCALE < relative < MOST_SCALE:
            gain = relative
            log = replace(log, beta=log.beta / gain)
            fault("scale", "beta", f"beta is {own:.4g} times what the servo makes of beta_cmd (+- {std:.1g}): by its "
                  "sensor or by the servo: k1 is taken between the two, and is as much less certain; declare "
                  "actuator_gain if it is the servo's")
    coarse = "" if nominal is None else systematic_step(nominal, log)
    if coarse:
        fault("step", "theta", coarse)
    mended = {name: getattr(log, name) for name in STEPPED if getattr(log, name) is not getattr(logged, name)}
    return Sensed(mended, tuple(found), gain, coarse)


def _beyond(gyro: Gyro, nominal: Nominal | None) -> tuple[float, float]:
    """Return (scale, lag [s]) of a gyro beyond what the nominal declares; 1 and 0 where that is not sure."""
    own = None if nominal is None else packed(nominal)
    scale = gyro.scale / (1.0 if own is None else own.gyro_scale)
    lag = gyro.lag - (0.0 if own is None else own.gyro_delay - own.attitude_delay)
    is_scaled = abs(scale - 1.0) > max(SCALE_SIGMAS * gyro.scale_std, LEAST_SCALE) \
        and 1.0 / MOST_SCALE < scale < MOST_SCALE
    is_late = max(LAG_SIGMAS * gyro.lag_std, LEAST_LAG) < abs(lag) < MOST_LAG
    return scale if is_scaled else 1.0, lag if is_late else 0.0


def _filled(log: Log, data: DataCheck, name: str) -> np.ndarray:
    """Return a column (n,) with lines over what was not measured."""
    x, good = getattr(log, name), data.masks[name] & data.usable
    return filled(x, log.t, good, np.nan_to_num(log.t))


def _mended(log: Log, data: DataCheck, name: str, lag: float, is_delay: bool) -> np.ndarray:
    """Return a column (n,) less its lag or delay [s], NaN where it was not measured."""
    x = getattr(log, name)
    rows = np.flatnonzero(data.usable)
    out = x.copy()
    mended = without_lag(log.t[rows], _filled(log, data, name)[rows], lag, is_delay)
    out[rows] = np.where(np.isfinite(x[rows]), mended, x[rows])
    return np.asarray(out)


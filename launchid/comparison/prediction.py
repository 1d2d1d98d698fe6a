"""Predict a log a little ahead with a nominal, and measure how well that is done.

At each start the state is as the nominal's own filter, at its declared noise, knows it from all rows before; from there
the nominal runs free on the logged commands (k-step prediction: Ljung, System Identification, 2nd ed., ch. 3.2 and
16.5).  Vehicle, effects, wind and missing rows are those of the diagnosis (`diagnosis.model`).  Offsets that the
nominal declares are fitted to the whole log, within what it declares.

Predictions are given the logged command.  The command itself is predicted if the nominal's controller can be run: what
it would have commanded at the predicted attitude, with the log's reference.

How well a series meets a measured one: H. Theil, Applied Economic Forecasting, North-Holland, 1966, ch. 2 (the
inequality coefficient, and the three shares of the mean squared error); R. V. Jategaonkar, Flight Vehicle System
Identification, AIAA, 2006, ch. 11 (their use on flight data; a coefficient below 0.25 to 0.3 is commonly accepted
there); L. Ljung, System Identification Toolbox, `compare` (the fit).
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.flight import excitation
from sim.nominal import Nominal
from sim.plant import packed

from ..controller.command import record
from ..controller.issued import with_commands
from ..diagnosis.adapter import follow
from ..diagnosis.model import Model
from ..diagnosis.track import track_of
from ..diagnosis.used import shortened, sparser, used
from ..likelihood.estimate import gauss_newton
from ..likelihood.likelihood import LEVELS, Run, predict, run
from ..log.detect import DataCheck
from ..log.log import Log
from ..log.record import CHANNELS, Record
from ..series import filled

HORIZONS = (0.1, 0.5, 1.0)   # s
SPACING = 0.1    # s from one start to the next
FILTER_SETTLED = 1.0  # s after which the filter has forgotten that it knew nothing
NO_MOMENT = -27.6   # logarithm of a level [rad/s^2] that is none
HORIZON_TOLERANCE = 0.05  # of a horizon by which whole rows may miss it


class Predicted(NamedTuple):
    """Predictions of one channel over one horizon; arrays (s,) in the channel's unit.

    t         [s] the times predicted for, on the log's clock
    measured, predicted   NaN where the log has no value, or the prediction has diverged
    noise     rms error that the declared noise alone makes, if the nominal is right; NaN: not known
    """

    t: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    noise: float


Predictions = dict[str, dict[float, Predicted]]   # of channels and horizons [s]


def predictions(log: Log, nominal: Nominal, data: DataCheck) -> Predictions:
    """Return channel -> horizon [s] -> predictions, of every measured channel; a horizon of HORIZONS that is no whole
    number of rows is left out.

    log, nominal  as read;  data: the data check of the log with this nominal
    """
    r = _record(log, nominal, data)
    filtered = _filtered(r)
    spacing = max(1, round(SPACING / r.period))
    rows = {h: round(h / r.period) for h in HORIZONS
            if abs(round(h / r.period) * r.period / h - 1.0) <= HORIZON_TOLERANCE}
    if not rows:
        return {}
    most = max(rows.values())
    start = np.arange(0, r.rows - 1, spacing)
    errors, variances = predict(filtered, start, np.arange(1, most + 1))
    ahead = start[:, None] + np.arange(1, most + 1)
    inside = (ahead < r.rows) & (start[:, None] * r.period >= FILTER_SETTLED)
    ahead = np.minimum(ahead, r.rows - 1)
    predicted = r.z[ahead] - errors
    made: Predictions = {}
    commands = _commands(r, start, predicted[:, :, 0])
    for name, measured, series in [*((name, r.z[:, c], predicted[:, :, c]) for c, name in enumerate(CHANNELS)),
                                   *([] if commands is None else [("beta_cmd", _logged(r), commands)])]:
        if not np.isfinite(measured).any():
            continue
        made[name] = {}
        for h, k in rows.items():
            kept = inside[:, k - 1]
            at = ahead[kept, k - 1]
            counted = np.isfinite(measured[at])
            left = float(np.sqrt(np.mean(variances[kept, k - 1][counted, CHANNELS.index(name)]))) \
                if name in CHANNELS and counted.any() else float("nan")
            made[name][h] = Predicted(r.t[at] + r.shift, measured[at], series[kept, k - 1], left)
    return made


def _record(log: Log, nominal: Nominal, data: DataCheck) -> Record:
    """Return the log on its grid with its commands; of a long or fast log the rows that a diagnosis uses."""
    draft = shortened(record(log, nominal, sparser(data, log.t, nominal)))
    return used(with_commands(draft, follow)[0], log.t[data.usable])[0]


def _filtered(r: Record) -> Run:
    """Return the nominal's run over the log, with covariances, at declared noise, no slow moment."""
    m = Model.of(track_of(r), "declared")
    if not m.air.is_windy:
        m = replace(m, air=m.air._replace(start=0.0),
                    levels=np.where(np.arange(len(LEVELS)) == LEVELS.index("walk"), NO_MOMENT, m.levels))
    offsets = r.nominal.offsets
    unknown = [] if offsets is None else [name for name, sigma in (
        ("misalignment", offsets.thrust_misalignment + offsets.moment + offsets.attitude_bias),
        ("wind", offsets.attitude_bias), ("gyro_bias", offsets.gyro_bias), ("nozzle_bias", offsets.nozzle_sensor_bias))
        if sigma > 0.0]
    free = tuple(sorted(m.table.index(name) for name in unknown if name in m.table))
    p = gauss_newton(m, m.table.null, free, frozenset(free)).p if free else m.table.null
    return run(m.parameters(p), covariances=True)


def _logged(r: Record) -> np.ndarray:
    """Return the command (n,) [rad] of every row, NaN where the log lacks it."""
    issued = r.commands[:r.rows]
    return issued if r.logged is None else np.where(r.logged, issued, np.nan)


def _commands(r: Record, start: np.ndarray, theta: np.ndarray) -> np.ndarray | None:
    """Return the commands (s, rows ahead) [rad] of the nominal's attitude law at predicted theta (s, rows ahead) [rad]
    after rows `start` (s,); None for another law, without a reference, or if rows are not the controller's periods."""
    law, actuator = r.nominal.controller, r.nominal.actuator
    known = np.isfinite(r.reference) & np.isfinite(r.z[:, 0])
    if law is None or actuator is None or law.law != "attitude" or law.filters or r.input != "beta_cmd" \
            or not known.any() or r.every != r.tick or r.held > 1 \
            or abs(r.period / law.period - 1.0) > HORIZON_TOLERANCE:
        return None
    changes, tau = packed(r.nominal), law.derivative_time_constant
    kp, kd, lag = changes.kp_scale * law.kp, changes.kd_scale * law.kd, changes.computing_time / law.period
    reference = filled(r.reference)
    error = filled(r.z[:, 0] - reference, known=known)
    begin = round(r.first_step / r.tick)
    test = excitation(r.nominal, begin + r.rows + theta.shape[1] + 1, law.period)[begin:]
    derivative = np.zeros(r.rows)   # of the attitude as measured, until the start
    for k in range(1, r.rows):
        derivative[k] = (tau * derivative[k - 1] + error[k] - error[k - 1]) / (tau + law.period)
    d, before = derivative[start], error[start]
    issued = [kp * before + kd * d + test[start]]
    for j in range(theta.shape[1]):
        at = start + j + 1
        now = theta[:, j] - reference[np.minimum(at, r.rows - 1)]
        d, before = (tau * d + now - before) / (tau + law.period), now
        issued.append(kp * now + kd * d + test[at])
    commands = np.clip(np.stack(issued, axis=1), -actuator.deflection_limit, actuator.deflection_limit)
    whole, part = int(lag), lag - int(lag)   # a late command is the mean over its period, as the effect's
    late = np.full_like(commands, np.nan)
    late[:, whole:] = commands[:, :commands.shape[1] - whole] * (1.0 - part)
    if part > 0.0:
        late[:, whole + 1:] += commands[:, :commands.shape[1] - whole - 1] * part
        late[:, whole] = np.nan
    return late[:, 1:]


MIN_VALUES = 2  # values that have a mean and a spread


class Statistics(NamedTuple):
    """How well a simulated series y meets a measured one z; NaN where there is none.

    fit         [%] 100 (1 - |z - y| / |z - mean z|): 100 is exact, 0 no better than the mean
    rms         of z - y, in the channel's unit
    largest     of |z - y|, in the channel's unit
    tic         Theil's inequality coefficient, rms(z - y) / (rms z + rms y): 0 exact, 1 no relation
    bias        share of the mean square of z - y that is of the means: (mean z - mean y)^2
    variance    share that is of the spreads: (std z - std y)^2
    covariance  the other share, 2 (1 - correlation) std z std y: no shift or scale of y removes it
    """

    fit: float
    rms: float
    largest: float
    tic: float
    bias: float
    variance: float
    covariance: float


NO_STATISTICS = Statistics(*[math.nan] * len(Statistics._fields))


def statistics(measured: np.ndarray, simulated: np.ndarray) -> Statistics:
    """Return the statistics of two series (n,), of the rows where both are finite; NaN of fewer than MIN_VALUES.

    Examples
    --------
    >>> statistics(np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0])).bias
    1.0
    """
    both = np.isfinite(measured) & np.isfinite(simulated)
    z, y = measured[both], simulated[both]
    if len(z) < MIN_VALUES:
        return NO_STATISTICS
    error = z - y
    square, spread = float(np.mean(error**2)), float(np.std(z))
    size = math.sqrt(float(np.mean(z**2))) + math.sqrt(float(np.mean(y**2)))
    bias, variance = float(np.mean(error))**2, (spread - float(np.std(y)))**2
    shares = [x / square if square > 0.0 else math.nan for x in (bias, variance, max(0.0, square - bias - variance))]
    return Statistics(100.0 * (1.0 - math.sqrt(square) / spread) if spread > 0.0 else math.nan, math.sqrt(square),
                      float(np.max(np.abs(error))), math.sqrt(square) / size if size > 0.0 else math.nan, *shares)

"""One flight of a campaign: drawn by its seed, flown whole inside compiled code, measured for the requirements.

Everything is drawn by the seed alone, each source from its own random stream, so that a flight is the same whoever
flies it: noise, wind and offsets as `launchid simulate` draws them, the vehicle by `drawn_delta`, and slosh and bending
by `drawn_modes`.  The estimator that filters follow believes the nominal.

Peaks are of the truth, at every integration step, until the flight ends or the vehicle is lost.  `lost` is the
simulator's: the attitude left what the plant is valid for (`sim.flight.LOST_ANGLE`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sim.disturbance_draws import drawn_modes, drawn_offsets
from sim.flight import prepare, steering
from sim.kernels import apart
from sim.nominal import Nominal
from sim.plant import dispersion
from sim.vehicle.record import LOG_ROW, Vehicle
from sim.vehicle.step import advance

from ..campaign import drawn_delta
from ..journal import Row

# what a flight is judged by, in the order of the table's columns; units rad, rad/s
METRICS = {
    "max_theta_error": "rad", "max_theta_dot": "rad/s", "max_alpha": "rad", "max_beta": "rad", "max_beta_rate": "rad/s"}
JUDGED_COLUMNS = ("lost", "end", *METRICS)
OFFSET_PREFIX = "offset_"  # begins the names of what was drawn
ROWS_AT_A_TIME = 500  # rows at a time: 64 kB, which stay near the processor


class FlightJob(NamedTuple):
    """One flight: its seed, and the vehicle's deviation a6 = a6_0 (1 + sigma delta_a6), k1 alike."""

    seed: int
    delta_a6: float
    delta_k1: float


def flight_jobs(nominal: Nominal, first: int, flights: int) -> list[FlightJob]:
    """Return `flights` jobs, one a seed from `first` on; without [uncertainty] every vehicle is the nominal one."""
    return [flight_job(nominal, seed) for seed in range(first, first + flights)]


def flight_job(nominal: Nominal, seed: int) -> FlightJob:
    """Return the job of this seed, its delta drawn by the seed; 0 without [uncertainty]."""
    return FlightJob(seed, 0.0, 0.0) if nominal.uncertainty is None else FlightJob(seed, *drawn_delta(seed))


def flown_row(row: Mapping[str, Any]) -> Row:
    """Return the columns that a flight is judged by, as numbers, from a row of `Flyer` or its text; ValueError for any
    other row."""
    if any(name not in JUDGED_COLUMNS and not name.startswith(OFFSET_PREFIX) for name in row):
        raise ValueError("another column")
    try:
        values = {name: float(row[name]) for name in JUDGED_COLUMNS}
    except (KeyError, TypeError, OverflowError) as error:
        raise ValueError(str(error)) from None
    if values["lost"] not in (0.0, 1.0) or any(x < 0.0 for x in values.values()):
        raise ValueError("lost is 0 or 1, times and magnitudes are not below 0")
    return {**values, "lost": int(values["lost"])}


@dataclass(frozen=True, eq=False)
class Flyer:
    """The work of a campaign on this nominal: a callable job -> row that can be pickled to worker processes."""

    nominal: Nominal

    def __call__(self, job: FlightJob) -> Row:
        """Fly the job; return lost (0, 1), end of the flight [s], peaks (METRICS) and the offsets drawn."""
        nominal = self.nominal
        nominal.require("simulation")
        simulation = nominal.simulation
        assert simulation is not None
        factors = (1.0, 1.0) if nominal.uncertainty is None else dispersion(nominal, job.delta_a6, job.delta_k1)
        vehicle, steps = prepare(drawn_modes(nominal, job.seed), job.seed, "flight", simulation.step, *factors)
        peaks, rows, fly_on = np.zeros(len(METRICS)), np.zeros(ROWS_AT_A_TIME, LOG_ROW), steering(nominal, vehicle)
        if fly_on is advance:
            fly_for_peaks(vehicle, steps, rows, peaks)
        else:
            follow_for_peaks(vehicle, fly_on, steps, rows, peaks)
        offsets = {f"{OFFSET_PREFIX}{name}": value for name, value in drawn_offsets(nominal.offsets, job.seed).items()}
        state = vehicle.flight[0]
        return {"lost": int(state.lost), "end": int(state.at) * simulation.step,
                **dict(zip(METRICS, peaks.tolist(), strict=True)), **offsets}


@apart
def fly_for_peaks(vehicle, steps, rows, peaks):
    """Fly `steps` steps, each a row of the log, and record the largest magnitudes of the true motion.

    vehicle      inout    logs every step
    steps        in       how many, all that the flight has
    rows (r,)    scratch  some of the log at a time
    peaks (5,)   inout    [rad, rad/s, rad, rad, rad/s] as METRICS, 0 at first
    """
    state = vehicle.flight[0]
    for start in range(0, steps, len(rows)):
        state.rows = 0
        advance(vehicle, min(len(rows), steps - start), rows)
        take_peaks(rows, state.rows, peaks)
        if state.lost != 0:
            return


@apart
def take_peaks(rows, count, peaks):
    """Record the largest magnitudes of the true motion in the first `count` rows, LOG_ROW; peaks as `fly_for_peaks`."""
    for k in range(count):
        row = rows[k]
        peaks[0] = max(peaks[0], abs(row.true_theta - row.theta_ref))
        peaks[1] = max(peaks[1], abs(row.true_theta_dot))
        peaks[2] = max(peaks[2], abs(row.true_theta - row.true_gamma + row.wind))
        peaks[3] = max(peaks[3], abs(row.true_beta))
        peaks[4] = max(peaks[4], abs(row.true_beta_dot))


def follow_for_peaks(vehicle: Vehicle, fly_on: Callable[[Vehicle, int, np.ndarray], None], steps: int,
                     rows: np.ndarray, peaks: np.ndarray) -> None:
    """Fly as `fly_for_peaks`, by `fly_on`, which has an estimator in the loop."""
    state = vehicle.flight[0]
    for start in range(0, steps, len(rows)):
        state.rows = 0
        fly_on(vehicle, min(len(rows), steps - start), rows)
        take_peaks(rows, int(state.rows), peaks)
        if state.lost:
            return

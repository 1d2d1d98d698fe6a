"""The estimator in the loop: filters of the controller that follow a frequency which it tracks.

The estimator takes the sensors' samples as a host on board would: the sample of a period moves the filters from the
next one on.  A filter that is moved keeps what it remembers.

A frequency is valid where the estimator gives one: from its first window on, but not while its model is contradicted.
Then the last valid one is held for HOLD, since a mode's frequency moves in minutes and a contradiction need not be the
mode's; after that the filter stands at its declared frequency.
"""

import math
from collections.abc import Iterable

import numpy as np

from launchid_core import Config, Estimator, Sample, Status

from .nominal import Nominal
from .onboard import onboard_model
from .plant import CLOCK_DIGITS
from .vehicle.record import LOG_ROW, Vehicle
from .vehicle.step import advance

READING_PERIOD = 0.2  # s: how often a tracked frequency is read; a mode's moves in minutes
MIN_SAMPLES = 5       # samples in it
HOLD = 10.0           # s, of a frequency that was valid
SAME_TIME = 1e-9      # s


class Tracker:
    """The estimator of a nominal, and the frequencies [rad/s] that it tracks of the modes which filters follow; NaN
    where none is valid."""

    def __init__(self, nominal: Nominal, period: float) -> None:
        assert nominal.controller is not None
        self.estimator = Estimator(Config(window=max(READING_PERIOD, MIN_SAMPLES * period), sample_period=period,
                                          formulation="filtered", model=onboard_model(nominal, period)))
        self.frequencies = dict.fromkeys(nominal.controller.followed, math.nan)
        self.valid_at = dict.fromkeys(self.frequencies, -math.inf)   # s, when each was last valid

    def take(self, samples: Iterable[Sample]) -> bool:
        """Take samples; return whether the frequencies were read anew."""
        is_new = False
        for sample in samples:
            is_new |= self.estimator.update(sample) == Status.WINDOW_COMPLETE
        if is_new:
            estimate = self.estimator.estimate()
            assert estimate is not None
            for mode in estimate.modes:
                if mode.name not in self.frequencies:
                    continue
                if math.isfinite(mode.frequency):
                    self.frequencies[mode.name], self.valid_at[mode.name] = mode.frequency, estimate.t_end
                elif estimate.t_end - self.valid_at[mode.name] > HOLD:
                    self.frequencies[mode.name] = math.nan
        return is_new


class Following:
    """Flies a vehicle on, as `advance` does, its filters at the frequencies that the estimator of `nominal` tracks."""

    def __init__(self, nominal: Nominal, vehicle: Vehicle) -> None:
        assert nominal.controller is not None
        state, self.controller = vehicle.flight[0], nominal.controller
        self.tracker = Tracker(nominal, nominal.sensors.period)
        self.log_every = int(state.log_every)
        self.every = round(nominal.sensors.period / float(state.step))   # steps from sample to sample

    def __call__(self, vehicle: Vehicle, steps: int, rows: np.ndarray) -> None:
        state = vehicle.flight[0]
        end, filled = int(state.at) + steps, int(state.rows)
        state.log_every = math.gcd(self.every, self.log_every)
        made = np.empty(self.every // int(state.log_every), LOG_ROW)
        while state.at < end and not state.lost:
            start, fine = int(state.at), int(state.log_every)
            state.rows = 0
            advance(vehicle, min(start - start % self.every + self.every, end) - start, made)
            new = made[-start % self.log_every // fine:int(state.rows):self.log_every // fine]
            rows[filled:filled + len(new)] = new
            filled += len(new)
            if start % self.every == 0 and state.rows > 0 and self.tracker.take([sample_of(made[0])]):
                tune(vehicle, self.controller.following(self.tracker.frequencies).filters)
        state.log_every, state.rows = self.log_every, filled


class Followed:
    """The filters of a nominal's controller over a log, as the estimator on board made them follow: of its samples, a
    `period` [s] apart."""

    def __init__(self, nominal: Nominal, samples: Iterable[Sample], period: float) -> None:
        assert nominal.controller is not None
        tracker, self.t, self.filters = Tracker(nominal, period), [-math.inf], [nominal.controller.filters]
        for sample in samples:
            if tracker.take([sample]):
                self.t.append(sample.t)
                self.filters.append(nominal.controller.following(tracker.frequencies).filters)

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return b0, b1, b2, a1, a2 (n, s, 5) of the s filters at the controller's times t (n,) [s]."""
        table = np.array([[(*each.b, *each.a[1:]) for each in filters] for filters in self.filters])
        return table[np.searchsorted(self.t, t - SAME_TIME) - 1]


def tune(vehicle: Vehicle, filters: Iterable) -> None:
    """Give a vehicle's filters other coefficients; what they remember stays."""
    for own, section in zip(vehicle.filters, filters, strict=True):
        own.b0, own.b1, own.b2 = section.b
        own.a1, own.a2 = section.a[1:]


def sample_of(row: np.record) -> Sample:
    """Return a log row as the estimator's sample: what the sensors read, and the logged command."""
    return Sample(round(float(row.t), CLOCK_DIGITS), float(row.theta), float(row.theta_dot), float(row.beta), math.nan,
                  float(row.beta_cmd))

"""The confidence range: dispersed vehicles flown through the on-board estimator under flight sensors.

Navarro-Tapia et al., section 2.3, first aim: an offline model perturbed at random
and at its extremes gives the band that identified parameters fall into over
flight time (Figs. 4 and 8), and what identification gains: margins and mu of the
closed loop over the full box before it, over the identified sub-box after it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from launchid_core import Config
from sim.flight import fly_whole
from sim.nominal import Nominal, built_in, load_nominal
from sim.plant import dispersion, parameters

from ..identification.windows import run
from ..robustness.level import ranged_model
from ..robustness.margins import Margins, margins_over_time
from ..robustness.mu import mu_over_time

VEHICLES = ("constant", "vega_like")
VERTICES = ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 0.0))
RANDOM_SEED = 2024
INTERVAL = 1.96
MARGIN_TIMES = 12
DRAWN_DELTA = (0.4, -0.3)  # delta of the flight whose margins are drawn

# columns of a flight's table
(BAND_T, BAND_A6, BAND_K1, BAND_A6_STD, BAND_K1_STD, BAND_TRUE_A6, BAND_TRUE_K1, DELTA_A6, DELTA_K1, DELTA_A6_STD,
 DELTA_K1_STD, IN_RANGE) = range(12)


class BandJob(NamedTuple):
    """One dispersed flight to fly: built-in nominal `name`, delta of (a6, k1), seed of the noise."""

    name: str
    delta: tuple[float, float]
    seed: int


@dataclass(frozen=True, eq=False)
class Band:
    """One dispersed flight: its true delta of (a6, k1), and a table (windows, 12) of columns BAND_T to IN_RANGE."""

    delta: tuple[float, float]
    lost: bool
    table: np.ndarray   # (windows, 12)


@dataclass(frozen=True, eq=False)
class Bought:
    """What identification gains: worst margins and upper bounds of mu (n,) at times t (n,) [s], over the full range
    before it and over the identified part of the range after it."""

    t: np.ndarray
    before: Margins
    after: Margins
    mu_before: np.ndarray
    mu_after: np.ndarray


def deltas(count: int) -> list[tuple[float, float]]:
    """Return `count` pairs (delta_a6, delta_k1), at least five: the box's vertices, its centre, then random ones."""
    rng = np.random.default_rng(RANDOM_SEED)
    random = rng.uniform(-1.0, 1.0, (max(count - len(VERTICES), 0), 2))
    return [*VERTICES, *((float(a), float(k)) for a, k in random)]


def fly_band(job: BandJob) -> Band:
    """Fly one dispersed vehicle through the on-board estimator; return truth and estimate at each window's end."""
    name, delta, seed = job
    nominal = load_nominal(built_in(name))
    factors = dispersion(nominal, *delta)
    flight = fly_whole(nominal, seed, a6_factor=factors[0], k1_factor=factors[1])
    config = Config(sample_period=flight.period, formulation="filtered", model=ranged_model(nominal))
    estimates, _ = run(config, flight.rows())
    end = np.array([e.t_end for e in estimates])
    true_a6, true_k1 = parameters(nominal, end, *factors)
    rows = []
    for e in estimates:
        assert e.tracked is not None and e.uncertainty is not None
        level_a6, level_k1 = e.uncertainty.a6, e.uncertainty.k1
        rows.append([e.t_end, e.tracked.a6, e.tracked.k1, e.tracked.a6_std, e.tracked.k1_std, 0.0, 0.0, level_a6.delta,
                     level_k1.delta, level_a6.delta_std, level_k1.delta_std, level_a6.in_range and level_k1.in_range])
    table = np.array(rows)
    table[:, BAND_TRUE_A6], table[:, BAND_TRUE_K1] = true_a6, true_k1
    return Band(delta, flight.lost, table)


def band_jobs(name: str, count: int) -> list[BandJob]:
    """Return jobs of `count` flights (at least five) of nominal `name`: vertices, centre, then random delta."""
    return [BandJob(name, delta, seed) for seed, delta in enumerate(deltas(count))]


def bought(nominal: Nominal, flight: Band) -> Bought:
    """Compute worst margins and mu over time, for the full box and the 95 % box of a flight's estimated delta."""
    rows = flight.table[np.linspace(len(flight.table) * 0.15, len(flight.table) - 1, MARGIN_TIMES).astype(int)]
    t = rows[:, BAND_T]
    centre = np.clip(rows[:, [DELTA_A6, DELTA_K1]], -1.0, 1.0)
    radius = np.minimum(INTERVAL * rows[:, [DELTA_A6_STD, DELTA_K1_STD]], 1.0)
    return Bought(t, margins_over_time(nominal, t), margins_over_time(nominal, t, centre, radius),
                  np.array([m.upper for m in mu_over_time(nominal, t)]),
                  np.array([m.upper for m in mu_over_time(nominal, t, centre, radius)]))


def summary(name: str, bands: list[Band]) -> dict[str, float | str]:
    """Return figures of a vehicle's flights: coverage of the tracked 95 % intervals and median relative half-width,
    both after 30 s; number of flights with alarm, and lost."""
    table = np.concatenate([band.table for band in bands])
    late = table[(table[:, BAND_T] > 30.0) & np.isfinite(table[:, BAND_A6_STD])]
    z = np.abs(np.column_stack([(late[:, BAND_A6] - late[:, BAND_TRUE_A6]) / late[:, BAND_A6_STD],
                                (late[:, BAND_K1] - late[:, BAND_TRUE_K1]) / late[:, BAND_K1_STD]]))
    return {"vehicle": name, "flights": len(bands), "coverage": float(np.mean(z < INTERVAL)),
            "half_width_a6": float(np.median(INTERVAL * late[:, BAND_A6_STD] / late[:, BAND_TRUE_A6])),
            "half_width_k1": float(np.median(INTERVAL * late[:, BAND_K1_STD] / np.abs(late[:, BAND_TRUE_K1]))),
            "alarms": float(sum(not band.table[:, IN_RANGE].all() for band in bands)),
            "lost": float(sum(band.lost for band in bands))}

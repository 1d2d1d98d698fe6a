"""The confidence range: dispersed vehicles flown through the on-board estimator under flight sensors.

Navarro-Tapia et al., section 2.3, first aim: an offline model perturbed at random
and at its extremes gives the band that identified parameters fall into over
flight time (Figs. 4 and 8), and what identification buys: margins and mu of the
closed loop over the full box before it, over the identified sub-box after it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from launchid_core import Config
from sim.flight import dispersion, fly_whole, parameters
from sim.nominal import Nominal, built_in, load_nominal

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
    """One dispersed flight."""

    name: str
    delta: tuple[float, float]
    seed: int


@dataclass(frozen=True, eq=False)
class Band:
    """One dispersed flight: window ends by column; `delta` is its truth."""

    delta: tuple[float, float]
    lost: bool
    table: np.ndarray   # (windows, 12)


@dataclass(frozen=True, eq=False)
class Bought:
    """Margins and mu over flight time, before and after identification."""

    t: np.ndarray
    before: Margins
    after: Margins
    mu_before: np.ndarray
    mu_after: np.ndarray


def deltas(count: int) -> list[tuple[float, float]]:
    """The vertices and the centre, then random ones, `count` in all (at least the five)."""
    rng = np.random.default_rng(RANDOM_SEED)
    random = rng.uniform(-1.0, 1.0, (max(count - len(VERTICES), 0), 2))
    return [*VERTICES, *((float(a), float(k)) for a, k in random)]


def fly_band(job: BandJob) -> Band:
    """Fly one dispersed vehicle through the estimator."""
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
    """Vertices and random vehicles of a nominal, `count` flights."""
    return [BandJob(name, delta, seed) for seed, delta in enumerate(deltas(count))]


def bought(nominal: Nominal, flight: Band) -> Bought:
    """Worst margins and mu over the full box, and over the 95 % box of one flight's identified delta."""
    rows = flight.table[np.linspace(len(flight.table) * 0.15, len(flight.table) - 1, MARGIN_TIMES).astype(int)]
    t = rows[:, BAND_T]
    centre = np.clip(rows[:, [DELTA_A6, DELTA_K1]], -1.0, 1.0)
    radius = np.minimum(INTERVAL * rows[:, [DELTA_A6_STD, DELTA_K1_STD]], 1.0)
    return Bought(t, margins_over_time(nominal, t), margins_over_time(nominal, t, centre, radius),
                  np.array([m.upper for m in mu_over_time(nominal, t)]),
                  np.array([m.upper for m in mu_over_time(nominal, t, centre, radius)]))


def summary(name: str, bands: list[Band]) -> dict[str, float | str]:
    """Figures of one vehicle: coverage of the tracked intervals where they are valid, the median band after 30 s,
    alarms, lost flights."""
    table = np.concatenate([band.table for band in bands])
    late = table[(table[:, BAND_T] > 30.0) & np.isfinite(table[:, BAND_A6_STD])]
    z = np.abs(np.column_stack([(late[:, BAND_A6] - late[:, BAND_TRUE_A6]) / late[:, BAND_A6_STD],
                                (late[:, BAND_K1] - late[:, BAND_TRUE_K1]) / late[:, BAND_K1_STD]]))
    return {"vehicle": name, "flights": len(bands), "coverage": float(np.mean(z < INTERVAL)),
            "half_width_a6": float(np.median(INTERVAL * late[:, BAND_A6_STD] / late[:, BAND_TRUE_A6])),
            "half_width_k1": float(np.median(INTERVAL * late[:, BAND_K1_STD] / np.abs(late[:, BAND_TRUE_K1]))),
            "alarms": float(sum(not band.table[:, IN_RANGE].all() for band in bands)),
            "lost": float(sum(band.lost for band in bands))}

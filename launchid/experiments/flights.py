"""The flights of a case, through its estimator variants, one job a flight."""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from launchid_core import Config
from sim.flight import Flight, dispersion, fly_whole, parameters
from sim.nominal import Nominal, Profile, built_in, load_nominal

from ..identification.windows import identified, onboard_model, run
from ..log.check import checked
from ..log.log import flown_log
from .cases import CASES, Case, Variant

# columns of a variant's window table
(START, END, VALID, A6, K1, A6_STD, K1_STD, TRUE_A6, TRUE_K1, EXACT, NODE) = range(11)
N_COLUMNS = 11


class CaseJob(NamedTuple):
    """One flight of a case."""

    name: str
    delta: int
    seed: int


@dataclass(frozen=True, eq=False)
class Result:
    """One flight through all variants of its case."""

    delta: int
    seed: int
    lost: bool
    tables: tuple[np.ndarray, ...]  # per variant (windows, N_COLUMNS)
    xi: np.ndarray                  # (q, 3) of the first variant's last window


def proposed_sigma() -> Profile:
    """A dispersion over flight time for the VEGA-like vehicle: an estimate, for the paper's Fig. 7 is not public.

    Source: project research note on dispersions (course and VS-50 practice): sigma_a6 0.30 in the transonic
    (20..35 s), 0.20 at maximum dynamic pressure, 0.30 after 70 s; sigma_k1 0.10 rising to 0.30 in tail-off.
    """
    t = np.array([0.0, 20.0, 35.0, 53.0, 70.0, 90.0, 95.0])
    a6 = np.array([0.30, 0.30, 0.30, 0.20, 0.30, 0.30, 0.30])
    k1 = np.array([0.10, 0.10, 0.10, 0.10, 0.10, 0.10, 0.30])
    return Profile(t, a6, k1)


def case_nominal(case: Case) -> Nominal:
    """The nominal that a case flies."""
    nominal = load_nominal(built_in(case.nominal))
    return dataclasses.replace(nominal, uncertainty=proposed_sigma()) if case.proposed_sigma else nominal


def fly_variant(nominal: Nominal, variant: Variant, delta: int, seed: int) -> Flight:
    """The flight that a variant sees."""
    if variant.command_noise is not None:
        assert nominal.actuator is not None
        nominal = dataclasses.replace(
            nominal, actuator=dataclasses.replace(nominal.actuator, command_noise_std=variant.command_noise))
    a6_factor, k1_factor = dispersion(nominal, delta, delta)
    return fly_whole(nominal, seed, variant.suite, a6_factor=a6_factor, k1_factor=k1_factor)


def identify_flight(nominal: Nominal, case: Case, variant: Variant, flight: Flight, delta: int,
                    seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Window table and the last Xi of one variant on one flight.

    The paper's variant, the first of its case, goes the way of `identify`: a window that its log contradicts is not
    valid.  Its companions show what the formulations do by themselves.
    """
    config = Config(window=variant.window, sample_period=flight.period, compression=variant.compression, seed=seed,
                    library=variant.library, formulation=variant.formulation, solver=variant.solver,
                    threshold=variant.threshold,
                    model=onboard_model(nominal) if variant.formulation == "filtered" else None)
    is_papers = variant == case.variants[0]
    estimates = identified(config, checked(flown_log(flight))).judged.estimates if is_papers else \
        run(config, flight.rows())[0]
    support = np.array([term in case.support for term in config.terms])
    nodes = nominal.vehicle.t
    table = np.full((len(estimates), N_COLUMNS), np.nan)
    for row, e in zip(table, estimates, strict=True):
        exact = bool(e.valid and (e.support[:, 1] == support).all())
        node = bool(np.any((nodes > e.t_start + 1e-9) & (nodes < e.t_end - 1e-9)))
        row[:] = (e.t_start, e.t_end, e.valid, e.a6, e.k1, e.a6_std, e.k1_std, np.nan, np.nan, exact, node)
    centre = 0.5 * (table[:, START] + table[:, END])
    a6_factor, k1_factor = dispersion(nominal, delta, delta)
    table[:, TRUE_A6], table[:, TRUE_K1] = parameters(nominal, centre, a6_factor, k1_factor)
    return table, estimates[-1].xi if estimates else np.full((len(config.terms), 3), np.nan)


def fly_job(job: CaseJob) -> Result:
    """One flight of a case through all its variants (the unit of work of a process)."""
    name, delta, seed = job
    case = CASES[name]
    nominal = case_nominal(case)
    flights: dict[tuple[str, float | None], Flight] = {}
    tables, first_xi = [], np.zeros((0, 3))
    for k, variant in enumerate(case.variants):
        key = (variant.suite, variant.command_noise)
        if key not in flights:
            flights[key] = fly_variant(nominal, variant, delta, seed)
        table, xi = identify_flight(nominal, case, variant, flights[key], delta, seed)
        tables.append(table)
        if k == 0:
            first_xi = xi
    lost = any(flight.lost for flight in flights.values())
    return Result(delta, seed, lost, tuple(tables), first_xi)


def case_jobs(names: list[str], seeds: int) -> list[CaseJob]:
    """The flights of these cases, by case, delta and seed."""
    return [CaseJob(name, delta, seed) for name in names for delta in sorted(CASES[name].deltas)
            for seed in range(seeds)]

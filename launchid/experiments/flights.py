"""Fly the experiments' vehicles and identify each flight with every variant; one job a flight."""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from launchid_core import Config
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal, Profile, built_in, load_nominal
from sim.onboard import onboard_model
from sim.plant import dispersion, parameters

from ..identification.windows import identified, run
from ..log.check import CheckedLog, checked
from ..log.log import flown_log
from .cases import CASES, Case, Variant

# columns of a variant's window table
(START, WINDOW_END, VALID, WINDOW_A6, WINDOW_K1, A6_STD, K1_STD, TRUE_A6, TRUE_K1, EXACT, NODE) = range(11)
N_FLIGHT_COLUMNS = 11


class VehicleJob(NamedTuple):
    """One flight of a vehicle (delta in sigma, seed of the noise) and the names of all cases that use it."""

    cases: tuple[str, ...]
    delta: int
    seed: int


@dataclass(frozen=True, eq=False)
class Result:
    """One flight of a case: a window table per variant, and the first variant's Xi (q, 3) of its last window."""

    delta: int
    seed: int
    lost: bool
    tables: tuple[np.ndarray, ...]  # per variant (windows, N_FLIGHT_COLUMNS)
    xi: np.ndarray                  # (q, 3) of the first variant's last window


def proposed_sigma() -> Profile:
    """Return sigma over flight time for the VEGA-like vehicle: an estimate, for the paper's Fig. 7 is not public.

    Source: project research note on dispersions (course and VS-50 practice): sigma_a6 0.30 in the transonic
    (20..35 s), 0.20 at maximum dynamic pressure, 0.30 after 70 s; sigma_k1 0.10 rising to 0.30 in tail-off.
    """
    t = np.array([0.0, 20.0, 35.0, 53.0, 70.0, 90.0, 95.0])
    a6 = np.array([0.30, 0.30, 0.30, 0.20, 0.30, 0.30, 0.30])
    k1 = np.array([0.10, 0.10, 0.10, 0.10, 0.10, 0.10, 0.30])
    return Profile(t, a6, k1)


def case_nominal(case: Case) -> Nominal:
    """Return the nominal that a case flies, with the proposed sigma over flight time if the case asks for it."""
    nominal = load_nominal(built_in(case.nominal))
    return dataclasses.replace(nominal, uncertainty=proposed_sigma()) if case.proposed_sigma else nominal


def fly_variant(nominal: Nominal, variant: Variant, delta: int, seed: int) -> Flight:
    """Fly the nominal dispersed by `delta` sigma, with the variant's sensor suite and command noise."""
    if variant.command_noise is not None:
        assert nominal.actuator is not None
        nominal = dataclasses.replace(
            nominal, actuator=dataclasses.replace(nominal.actuator, command_noise_std=variant.command_noise))
    a6_factor, k1_factor = dispersion(nominal, delta, delta)
    return fly_whole(nominal, seed, variant.suite, a6_factor=a6_factor, k1_factor=k1_factor)


def identify_flight(nominal: Nominal, variant: Variant, support: tuple[str, ...], flight: Flight,
                    seen: CheckedLog | None, delta: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the window table (windows, N_FLIGHT_COLUMNS) and the last window's Xi (q, 3) of one variant on one flight.

    seen   the flight as a checked log: identified as by `identify`, a window that the log contradicts is not valid;
           None: by the formulation alone"""
    config = Config(window=variant.window, sample_period=flight.period, compression=variant.compression, seed=seed,
                    library=variant.library, formulation=variant.formulation, solver=variant.solver,
                    threshold=variant.threshold,
                    model=onboard_model(nominal) if variant.formulation == "filtered" else None)
    estimates = identified(config, seen).judged.estimates if seen else run(config, flight.rows())[0]
    active = np.array([term in support for term in config.terms])
    nodes = nominal.vehicle.t
    table = np.full((len(estimates), N_FLIGHT_COLUMNS), np.nan)
    for row, e in zip(table, estimates, strict=True):
        exact = bool(e.valid and (e.support[:, 1] == active).all())
        node = bool(np.any((nodes > e.t_start + 1e-9) & (nodes < e.t_end - 1e-9)))
        row[:] = (e.t_start, e.t_end, e.valid, e.a6, e.k1, e.a6_std, e.k1_std, np.nan, np.nan, exact, node)
    centre = 0.5 * (table[:, START] + table[:, WINDOW_END])
    a6_factor, k1_factor = dispersion(nominal, delta, delta)
    table[:, TRUE_A6], table[:, TRUE_K1] = parameters(nominal, centre, a6_factor, k1_factor)
    return table, estimates[-1].xi if estimates else np.full((len(config.terms), 3), np.nan)


def fly_job(job: VehicleJob) -> dict[str, Result]:
    """Fly once, identify with all variants of the job's cases; return case name -> result (a process's unit of work).

    What cases share is flown and identified once.  The paper's variant, the first of its case, goes the way of
    `identify`; its companions, and all of `tuning`, which claims nothing, do not.
    """
    flights = dict[tuple[str, float | None], Flight]()
    logs = dict[tuple[str, float | None], CheckedLog]()
    tables = dict[tuple[Variant, bool], tuple[np.ndarray, np.ndarray]]()
    results = dict[str, Result]()
    for case in (CASES[name] for name in job.cases):
        nominal = case_nominal(case)
        for k, variant in enumerate(case.variants):
            key, is_papers = (variant.suite, variant.command_noise), k == 0 and case.has_claim
            if key not in flights:
                flights[key] = fly_variant(nominal, variant, job.delta, job.seed)
            if is_papers and key not in logs:
                logs[key] = checked(flown_log(flights[key]))
            if (variant, is_papers) not in tables:
                tables[variant, is_papers] = identify_flight(nominal, variant, case.support, flights[key],
                                                             logs[key] if is_papers else None, job.delta, job.seed)
        made = [tables[variant, k == 0 and case.has_claim] for k, variant in enumerate(case.variants)]
        lost = any(flights[variant.suite, variant.command_noise].lost for variant in case.variants)
        results[case.name] = Result(job.delta, job.seed, lost, tuple(table for table, _ in made), made[0][1])
    return results


def vehicle_jobs(names: list[str], seeds: int) -> list[VehicleJob]:
    """Return the flights of the named cases, `seeds` of each vehicle, in order; equal flights of cases are one job."""
    flown = dict[tuple[str, bool, int], list[str]]()
    for name in names:
        case = CASES[name]
        for delta in sorted(case.deltas, key=abs):
            flown.setdefault((case.nominal, case.proposed_sigma and delta != 0, delta), []).append(name)
    return [VehicleJob(tuple(cases), delta, seed) for (*_, delta), cases in flown.items() for seed in range(seeds)]

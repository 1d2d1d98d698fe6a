"""Flights of the Monte Carlo: scenarios inside and beyond the box, with legacy and with rescheduled gains.

Scenarios, each with the job's delta as a constant deviation a = a_0 (1 + sigma delta) on top:
    box      nothing else
    k1-loss  LOSS of k1 gone from the moment t_event on (a nozzle or an engine of a cluster lost)
    a6-up    a6 up by RISE from t_event on, to the end
    both     both at t_event
t_event is the maximum of the nominal's a6, which stands for maximum dynamic pressure (a6 = q S CNalpha arm/J); of a
constant nominal CONSTANT_EVENT.
"""

import functools
import math

import numpy as np

from launchid_core import Config
from sim.errors import UsageError
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model
from sim.plant import Factor, dispersion

from ..identification.windows import run
from ..monte_carlo.campaign import Job
from .reconfigure import Flown, fly_legacy, fly_reconfigured

SCENARIOS = ("box", "k1-loss", "a6-up", "both")
LOSS = 0.45            # of k1
RISE = 0.60            # of a6
CONSTANT_EVENT = 30.0  # s
FLIGHT_WINDOW = 1.0    # s, of an identified flight

_nominal = functools.cache(load_nominal)


def event_time(nominal: Nominal) -> float:
    """Return when [s] a scenario changes a6 or k1: at the largest a6; CONSTANT_EVENT for a constant nominal."""
    profile = nominal.vehicle
    return CONSTANT_EVENT if len(profile.t) == 1 else float(profile.t[np.argmax(profile.a6)])


def factors(nominal: Nominal, job: Job) -> tuple[Factor, Factor]:
    """Return the true a6 and k1 over the nominal's, as functions of t [s]; UsageError for an unknown scenario."""
    if job.scenario not in SCENARIOS:
        raise UsageError(f"scenario {job.scenario!r}: expected one of {', '.join(SCENARIOS)}")
    rise = RISE if job.scenario in ("a6-up", "both") else 0.0
    loss = LOSS if job.scenario in ("k1-loss", "both") else 0.0
    start = event_time(nominal)
    box_a6, box_k1 = dispersion(nominal, job.delta_a6, job.delta_k1)
    assert callable(box_a6) and callable(box_k1)
    return (lambda t: box_a6(t) * np.where(t >= start, 1.0 + rise, 1.0),
            lambda t: box_k1(t) * np.where(t >= start, 1.0 - loss, 1.0))


def compare_gains(job: Job, nominal: Nominal | None = None) -> dict[str, float | int | str]:
    """Fly one vehicle twice, with the same noise; return figures of the flight with legacy and with reconfigured gains.
    nominal: instead of the one the job names."""
    nominal = nominal or _nominal(job.nominal)
    a6_factor, k1_factor = factors(nominal, job)
    legacy = fly_legacy(nominal, job.seed, a6_factor, k1_factor)
    changed = fly_reconfigured(nominal, job.seed, a6_factor, k1_factor)
    return {**{f"legacy_{name}": value for name, value in figures(legacy).items()},
            **{f"reconfigured_{name}": value for name, value in figures(changed).items()},
            "changes": len(changed.changes), "kp_last": float(changed.gains[-1, 0]),
            "kd_last": float(changed.gains[-1, 1])}


def figures(flown: Flown) -> dict[str, float | int]:
    """Return lost (0, 1), end of the log [s], rms of true theta - theta_ref [rad], true beta [rad], its rate [rad/s]
    from row to row."""
    def rms(x: np.ndarray) -> float:
        return math.sqrt(float(np.mean(x**2)))

    beta = flown.column("exact_beta")
    return {"lost": int(flown.lost), "end": float(flown.column("t")[-1]),
            "error": rms(flown.column("exact_theta") - flown.column("theta_ref")), "nozzle": rms(beta),
            "nozzle_rate": rms(np.diff(beta) / flown.period)}


def identify(job: Job) -> dict[str, float | int | str]:
    """Fly with legacy gains, identify in windows of FLIGHT_WINDOW; return counts, true and last tracked a6, k1."""
    nominal = _nominal(job.nominal)
    a6_factor, k1_factor = factors(nominal, job)
    flight = fly_whole(nominal, job.seed, a6_factor=a6_factor, k1_factor=k1_factor)
    config = Config(window=FLIGHT_WINDOW, sample_period=flight.period, formulation="filtered",
                    model=onboard_model(nominal))
    estimates, estimator = run(config, flight.rows())
    last = estimates[-1].tracked if estimates else None
    fields = last._asdict() if last is not None else {}
    return {"lost": int(flight.lost), "windows": len(estimates), "valid": sum(e.valid for e in estimates),
            "changes": len(estimator.changes()), "true_a6": float(flight.a6[-1]), "true_k1": float(flight.k1[-1]),
            **{name: fields[name] for name in ("a6", "k1", "a6_std", "k1_std", "a6_k1_corr") if name in fields}}

"""The threshold of evidence, measured: what the best hypothesis scores on clean flights of the user's own nominal.

A parametric bootstrap (Efron and Tibshirani 1993, ch. 6.5): flights of the nominal with the log's reference, period,
length and columns, a6 and k1 drawn within the tolerance, noise levels drawn as wrong as they may be declared.  The
threshold is the 99 % quantile of the best score, never below LOWEST.  Flights cost as much as diagnoses, so results
are kept in the user's cache folder, under a name made of everything they depend on.
"""

import hashlib
import json
import math
import os
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim.errors import InputError
from sim.files import write_text
from sim.flight import Flight
from sim.nominal import Nominal, write_nominal

from ...log.detect import check
from ...log.log import OPTIONAL, REQUIRED, Log
from ..causes import SOUGHT
from ..controller.command import record
from ..data.record import Record
from ..model.noise import LEVELS, WRONG_NOISE
from ..search.profile import as_simulated
from ..search.selection import Say, ranking_of
from .closed_loop import as_flown, flown_along

LOWEST = 8.0           # nats
QUANTILE = 0.99
VERSION = 1            # of the score: raised when a change of the method changes it


def threshold(r: Record, flights: int, say: Say) -> float:
    """The threshold [nats] of this log's nominal and grid, from `flights` clean flights; InputError where the nominal
    cannot fly.

    Cached: the same question is answered from the file of its last answer.
    """
    flown = as_flown(r)
    if flown is None:
        raise InputError(f"{r.nominal.path}: --bootstrap flies the nominal along the log: expected [controller], "
                         "[actuator], [simulation], and a log with theta_ref that starts at 0 s")
    kept = cache_folder() / f"{question(flown, r, flights)}.json"
    try:
        return float(json.loads(kept.read_text(encoding="utf-8"))["threshold"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    scores = list(clean_scores(flown, r, flights, say))
    value = max(LOWEST, float(np.quantile(scores, QUANTILE)))
    try:
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_text(kept, [json.dumps({"threshold": value, "scores": scores}), "\n"])
    except (OSError, InputError):
        pass  # a cache that cannot be written costs time, nothing else
    return value


def cache_folder() -> Path:
    """The folder in which answers are kept: LAUNCHID_CACHE, or the user's cache folder."""
    own = os.environ.get("LAUNCHID_CACHE")
    return Path(own) if own else Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "launchid"


def question(flown: Nominal, r: Record, flights: int) -> str:
    """A name for everything a threshold depends on."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "nominal.toml"
        write_nominal(replace(flown, vehicle=replace(flown.vehicle, path="")), path)
        parts = [file.read_bytes() for file in sorted(Path(folder).iterdir())]
    parts.append(repr((VERSION, flights, r.period, r.rows, r.channels, r.input)).encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:32]


def clean_scores(flown: Nominal, r: Record, flights: int, say: Say) -> Iterator[float]:
    """Evidence [nats] of the best hypothesis on each clean flight; 0 where none promises any."""
    for seed in range(flights):
        say(f"bootstrap: clean flight {seed + 1} of {flights}")
        rng = np.random.default_rng((407, seed))
        factors = np.exp(rng.uniform(-math.log(WRONG_NOISE), math.log(WRONG_NOISE), len(LEVELS)))
        a6, k1 = 1.0 + flown.diagnosis.tolerance * rng.standard_normal(2)
        flight = flown_along(r, noisier(flown, factors), seed, (), float(a6), float(k1))
        log = log_of(flight, r)
        made = record(log, r.nominal, check(log, r.nominal))
        best = ranking_of(made, as_simulated(made), SOUGHT)
        yield max((each.evidence for each in best), default=0.0)


def noisier(nominal: Nominal, factors: np.ndarray) -> Nominal:
    """The nominal with its five noise levels (theta, theta_dot, beta, command, acceleration) times the factors (5,)."""
    theta, theta_dot, beta, command, acceleration = factors.tolist()
    assert nominal.actuator is not None and nominal.simulation is not None
    s = nominal.sensors
    return replace(
        nominal, sensors=replace(s, theta_std=theta * s.theta_std, theta_dot_std=theta_dot * s.theta_dot_std,
                                 beta_std=beta * s.beta_std),
        actuator=replace(nominal.actuator, command_noise_std=command * nominal.actuator.command_noise_std),
        simulation=replace(nominal.simulation,
                           acceleration_noise_std=acceleration * nominal.simulation.acceleration_noise_std))


def log_of(flight: Flight, r: Record) -> Log:
    """A flight as a log with the columns of the record's."""
    absent = np.full(len(flight.t), math.nan)
    shown = {"t", "theta", *r.channels, *(("beta_cmd",) if r.input == "beta_cmd" else ()), "theta_ref"}
    columns = {name: getattr(flight, name) if name in shown else absent for name in REQUIRED + OPTIONAL}
    return Log("clean flight", tuple(sorted(shown)), (), **columns)

"""Intervals while a6 and k1 leave the profile: windows, the tracked estimate, and losses of k1 meanwhile.

    python benchmarks/drift.py [--flights 30] [--seed 20000] [--nominal NAME]

`flight` suite, 100 Hz, noise levels estimated, 5 s windows, drifts not declared: the default, the whole range in the
flight. a6 and k1 begin up to 15 % off the nominal and drift up or down:
k1 5, k1 10, k1 20, a6 5, a6 20   % a minute of one of them;  both 10  of both, each up or down
ramp                              k1 changes by 30 % between 20 and 50 s
none                              neither drifts; `wider`: median width over that of a nominal without drift
loss                              30 % of k1 is lost while k1 drifts 10 % a minute: median delay of the alarm; alarms
                                  outside of a second before to four behind are false
Demanded: 95 % intervals of windows and of the tracked estimate cover 90 to 99 %; no alarm for a drift; delay 0.2 s.
"""

import dataclasses
import math
import sys
from typing import Any

import numpy as np
from flights import INTERVAL, Table, arguments, nominal, relative, run_jobs

from launchid_core import Config, Estimator
from sim.flight import fly_whole
from sim.onboard import onboard_model
from sim.plant import parameters

WINDOW = 5.0   # s
SPREAD = 0.15  # of a6 and k1 at first
MINUTE = 60.0  # s
RATES = {"none": (0.0, 0.0), "k1 5": (0.0, 0.05), "k1 10": (0.0, 0.1), "k1 20": (0.0, 0.2), "a6 5": (0.05, 0.0),
         "a6 20": (0.2, 0.0), "both 10": (0.1, 0.1), "ramp": (0.0, 0.0), "loss": (0.0, 0.1)}  # 1/min
RAMP, RAMP_FROM, RAMP_LASTS = 0.3, 20.0, 30.0  # , s, s
LOSS = 0.3
SOON, LATE = 1.0, 4.0  # s, about a loss
FAR = 4.0              # standard deviations
MOST_DELAY = 0.2       # s


def vehicle(seed: int, kind: str, seconds: float) -> tuple[dict[str, Any], float]:
    """Draw one flight's factors of a6 and k1, as arguments of `fly_whole`, and when k1 is lost [s] (inf: never)."""
    rng = np.random.default_rng((613, seed))
    first, signs = rng.uniform(-SPREAD, SPREAD, 2), rng.choice([-1.0, 1.0], 2)
    rates = signs * RATES[kind] / np.array(MINUTE)
    lost = float(rng.uniform(20.0, seconds - 10.0)) if kind == "loss" else math.inf

    def k1(t: Any) -> Any:
        ramp = signs[1] * RAMP * np.clip((t - RAMP_FROM) / RAMP_LASTS, 0.0, 1.0) if kind == "ramp" else 0.0
        return (1.0 + first[1] + rates[1] * t + ramp) * np.where(t >= lost, 1.0 - LOSS, 1.0)

    return {"a6_factor": lambda t: 1.0 + first[0] + rates[0] * t, "k1_factor": k1}, lost


def job(name: str, seed: int, kind: str) -> tuple[np.ndarray, np.ndarray, list[float], int, bool, np.ndarray]:
    """Fly once; return `relative` and valid (n, 5) of windows and of the tracked estimate, delay of the alarm
    [s], false alarms, whether the loss was missed, and widths (n,) of k1 over those of a nominal without drift."""
    believed = nominal(name)
    assert believed.simulation is not None
    seconds = believed.simulation.duration
    factors, lost = vehicle(seed, kind, seconds)
    flight = fly_whole(believed, seed, **factors)
    estimator = Estimator(Config(window=WINDOW, sample_period=flight.period, formulation="filtered",
                                 model=onboard_model(believed)))
    found = estimator.replay(flight.samples())
    end = np.array([each.t_end for each in found])
    tables = []
    for of, at in ((found, end - 0.5 * WINDOW), ([each.tracked for each in found], end)):
        valid = [each.valid and not (e.t_start < lost < e.t_end) for each, e in zip(of, found, strict=True)]
        tables.append(np.column_stack([relative(of, *parameters(believed, at, **factors)), valid]))
    alarms = [change.alarm - lost for change in estimator.changes() if -SOON < change.t - lost < LATE]
    false = sum(not -SOON < change.t - lost < LATE for change in estimator.changes())
    still = np.zeros(0)
    if kind == "none":
        without = dataclasses.replace(believed, a6_drift=0.0, k1_drift=0.0)
        model = Config(window=WINDOW, sample_period=flight.period, formulation="filtered", model=onboard_model(without))
        still = np.array([each.k1_std for each in Estimator(model).replay(flight.samples())])
        still = np.array([each.k1_std for each in found]) / still
    return tables[0], tables[1], alarms[:1], false, len(alarms) == 0 and math.isfinite(lost), still


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    args = arguments(__doc__, flights=30, seed=20000)
    table = Table("nominal 16", "drift 8", "valid 6.3f", "of 5d", "a6 covers 6.3f", "k1 covers 6.3f", "rms/std 6.2f",
                  "> 4 std 6.4f", "tracked a6 6.3f", "k1 6.3f", "rms/std 6.2f", "false 5d", "missed 5d",
                  "delay [s] 6.2f", "wider 6.3f")
    for name in args.nominal:
        for kind in RATES:
            flights = run_jobs(job, [(name, seed, kind) for seed in args.seeds])
            windows, tracked, alarms, false, missed, wider = zip(*flights, strict=True)
            rows, counts = [], []
            for parts in (windows, tracked):
                x = np.concatenate(parts)
                counts.append((float(np.mean(x[:, 4])), len(x)))
                x = x[x[:, 4] == 1.0]
                rows.append(x[:, :2] / x[:, 2:4])
            own, followed = rows
            covers = [float(np.mean(np.abs(z[:, p]) < INTERVAL)) for z in rows for p in (0, 1)]
            delays = [each for part in alarms for each in part]
            delay = float(np.median(delays)) if delays else math.nan
            good = all(0.9 <= each <= 0.995 for each in covers[:2]) and min(covers[2:]) >= 0.9
            good = good and not delay > MOST_DELAY
            table.row(name, kind, *counts[0], *covers[:2], float(np.sqrt(np.mean(own**2))),
                      float(np.mean(np.max(np.abs(own), axis=1) > FAR)), *covers[2:],
                      float(np.sqrt(np.mean(followed**2))), sum(false), sum(missed), delay,
                      float(np.nanmedian(np.concatenate(wider))) if kind == "none" else math.nan,
                      good=good and not (kind != "loss" and sum(false) > 0))
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main())

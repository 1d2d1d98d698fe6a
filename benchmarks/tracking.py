"""The tracked estimate: a constant deviation, a drifting one, and how far its intervals can be trusted.

    python benchmarks/tracking.py [--flights 100] [--seed 0]

`flight` suite, 100 Hz, noise levels estimated, 5 s windows; from 20 s to the end.  One setting for all:
constant: deviations of a6 and k1 uniform in +-20 %;
drifting: 10 % sin(2 pi t/60 s + phase), a phase for each;
common: the same phase for both, so that a6/k1 stays constant and the drift nearly invisible on a trimmed flight
(reported, no demand).
"""

import argparse
import math
import sys

import numpy as np
from flights import NOMINALS, nominal, run_jobs

from launchid_core import Config
from sim.flight import fly_whole, parameters
from sim.identify import onboard_model, run

START = 20.0         # s
WINDOW = 5.0         # s
SPREAD = 0.2
AMPLITUDE, PERIOD = 0.1, 60.0
INTERVAL = 1.96


def vehicle(seed: int, kind: str) -> dict[str, object]:
    """Factors of a6 and k1 of one flight."""
    rng = np.random.default_rng((411, seed))
    if kind == "constant":
        deviation = rng.uniform(-SPREAD, SPREAD, 2)
        return {"a6_factor": 1.0 + deviation[0], "k1_factor": 1.0 + deviation[1]}
    phases = rng.uniform(0.0, 2.0 * math.pi, 2)
    if kind == "common":
        phases[1] = phases[0]
    omega = 2.0 * math.pi / PERIOD
    return {"a6_factor": lambda t: 1.0 + AMPLITUDE * np.sin(omega * t + phases[0]),
            "k1_factor": lambda t: 1.0 + AMPLITUDE * np.sin(omega * t + phases[1])}


def job(name: str, seed: int, kind: str) -> np.ndarray:
    """Rows: t_end, relative errors and stds of tracked a6, k1, of the window's a6, k1, and of the window's validity."""
    believed = nominal(name)
    factors = vehicle(seed, kind)
    flight = fly_whole(believed, seed, **factors)
    config = Config(window=WINDOW, sample_period=flight.period, formulation="filtered", model=onboard_model(believed))
    estimates, _ = run(config, flight.samples())
    end = np.array([e.t_end for e in estimates])
    centre = end - 0.5 * WINDOW
    truth = np.column_stack([*parameters(believed, end, **factors), *parameters(believed, centre, **factors)])
    rows = [[e.tracked.a6, e.tracked.k1, e.a6, e.k1, e.tracked.a6_std, e.tracked.k1_std, e.a6_std, e.k1_std]
            for e in estimates if e.tracked is not None]
    table = np.array(rows)
    valid = np.array([e.valid for e in estimates])
    return np.column_stack([end, table[:, :4] / truth - 1.0, table[:, 4:] / np.abs(truth), valid])


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    print(f"flights {args.flights}, seeds from {args.seed}, 100 Hz, noise estimated, windows {WINDOW:g} s, "
          f"t > {START:g} s")
    print(f"{'nominal':16} {'deviation':9} {'':3} {'tracked RMS':>11} {'window RMS':>10} {'ratio':>6} {'coverage':>8} "
          f"{'window coverage':>15}")
    missed = 0
    for name in NOMINALS:
        for kind in ("constant", "drifting", "common"):
            table = np.concatenate(run_jobs(job, [(name, args.seed + k, kind) for k in range(args.flights)]))
            table = table[table[:, 0] > START]
            valid = table[:, 9] == 1
            for p, label in enumerate(("a6", "k1")):
                error, own = table[:, 1 + p], table[valid, 3 + p]
                rms, window_rms = math.sqrt(np.mean(error**2)), math.sqrt(np.mean(own**2))
                coverage = float(np.mean(np.abs(error / table[:, 5 + p]) < INTERVAL))
                own_coverage = float(np.mean(np.abs(own / table[valid, 7 + p]) < INTERVAL))
                good = {"constant": rms <= 0.5 * window_rms and coverage >= 0.93,
                        "drifting": rms <= 0.06 and coverage >= 0.8, "common": True}[kind]
                missed += not good
                print(f"{name:16} {kind:9} {label:3} {100 * rms:10.2f}% "
                      f"{100 * window_rms:9.2f}% {rms / window_rms:6.2f} {coverage:8.3f} {own_coverage:15.3f} "
                      f"{'' if good else 'MISSED'}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())

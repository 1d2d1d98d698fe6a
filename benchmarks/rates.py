"""The false alarms of the model's check at every rate: clean flights, at 25 to 400 Hz.

    python benchmarks/rates.py [--flights 100] [--seed 7000] [--window 5] [--nominal NAME] [--rate HZ] [--loop HZ]

Each nominal flies undispersed, controller and sensors at the rate, under its own noises, and is told the truth.
--loop: the controller's rate, where the log's is a lower one, which misses commands.
Counted: windows that are MODEL, flights with one, and what said so first in each of them.  Demanded: 1 % of windows.
Of the others, how often the 95 % intervals of a6 and k1 hold the truth, window by window and tracked.
"""

import argparse
import collections
import sys

import numpy as np
from flights import NOMINALS, at_rate, run_jobs

from launchid.identification.windows import onboard_model
from launchid_core import Config, Estimate, Estimator, Status, Tracked
from launchid_core.filter import whiteness as wh
from launchid_core.model import N_NOISES
from launchid_core.watch import undeclared as un
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

RATES = (25.0, 50.0, 100.0, 200.0, 400.0)  # Hz
DEMAND = 0.01


def cause(estimator: Estimator) -> str:
    """The part that contradicts the model now; empty: none."""
    state = estimator._parts.state
    check = state.check
    if check.flag[wh.WHITENESS_RAISED] == 0:
        return ""
    if check.number[wh.STATISTIC] > wh.CONTRADICTING_STATISTIC:
        return "blocks"
    if check.flag[wh.IS_RESTLESS] == 1:
        return "changes"
    if state.undeclared.flag[un.FOUND] == 1:
        return "undeclared"
    if check.flag[wh.RAISED_BY_WINDOW] != wh.PASSED:
        return "window"
    return "level" if max(state.filter.level[:N_NOISES]) > wh.HIGHEST_LEVEL else "other"


def held(nominal: Nominal, t: float, each: Estimate | Tracked) -> list[bool]:
    """Whether the 95 % intervals of an estimate's a6 and k1 hold the truth at t [s]."""
    a6, k1 = nominal.vehicle.at(np.array(t))
    return [bool(abs(each.a6 - a6) < 1.96 * each.a6_std), bool(abs(each.k1 - k1) < 1.96 * each.k1_std)]


def job(name: str, rate: float, seed: int, window: float, loop: float) -> tuple[int, int, str, list[bool], list[bool]]:
    """One flight: (windows, MODEL, what said so first, what intervals of windows and tracked hold)."""
    nominal = at_rate(load_nominal(name), loop)
    flight = fly_whole(nominal, seed, period=None if rate == loop else 1.0 / rate)
    estimator = Estimator(Config(window=window, sample_period=flight.period, formulation="filtered",
                                 model=onboard_model(nominal)))
    windows, model, first = 0, 0, ""
    inside: tuple[list[bool], list[bool]] = ([], [])
    for sample in flight.samples():
        if estimator.update(sample) == Status.WINDOW_COMPLETE:
            windows += 1
            estimate = estimator.estimate()
            assert estimate is not None
            model += estimate.status.name == "MODEL"
            if estimate.valid:
                inside[0].extend(held(nominal, 0.5 * (estimate.t_start + estimate.t_end), estimate))
            if estimate.tracked is not None and estimate.tracked.valid:
                inside[1].extend(held(nominal, estimate.t_end, estimate.tracked))
        if not first:
            first = cause(estimator)
    return windows, model, first, *inside


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7000, help="first seed")
    parser.add_argument("--window", type=float, default=5.0, help="s")
    parser.add_argument("--nominal", choices=NOMINALS, action="append")
    parser.add_argument("--rate", type=float, action="append", help="Hz")
    parser.add_argument("--loop", type=float, help="Hz; without: the log's")
    args = parser.parse_args()
    missed = False
    print(f"flights {args.flights}, seeds from {args.seed}, windows of {args.window:g} s, clean")
    print(f"{'nominal':16} {'Hz':>5} {'windows':>8} {'MODEL':>6} {'share':>7} {'flights':>8} {'cover':>6} "
          f"{'tracked':>7}  first said by")
    for name in args.nominal or NOMINALS:
        for rate in args.rate or RATES:
            seeds = range(args.seed, args.seed + args.flights)
            made = run_jobs(job, [(name, rate, seed, args.window, args.loop or rate) for seed in seeds])
            windows, model = sum(each[0] for each in made), sum(each[1] for each in made)
            said = collections.Counter(each[2] for each in made if each[2])
            bad = model > DEMAND * windows
            missed |= bad
            cover, tracked = (np.mean([x for each in made for x in each[k]]) for k in (3, 4))
            print(f"{name:16} {rate:5g} {windows:8} {model:6} {model / windows:7.4f} "
                  f"{sum(each[1] > 0 for each in made):8} {cover:6.3f} {tracked:7.3f}  "
                  f"{', '.join(f'{word} {n}' for word, n in said.items())}{'  MISSED' if bad else ''}", flush=True)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

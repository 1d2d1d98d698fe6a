"""launchid's filtered form beside what a user could take instead (`baselines.py`), on the same flights.

    python benchmarks/comparison.py [--flights 40] [--seed 0] [--pysindy-flights 4]

One table per nominal and window.  `flight` suite at 100 Hz with the nominals' sensor noise, which is declared exactly
where a method asks for it, true parameters within +-25 % of the nominal.  Errors are relative to the truth at the
window's centre (of the Kalman filter and of `tracked`: at its end) and are taken over the windows whose Cramer-Rao
bound is below 30 %.  RMS/bound: RMS error over RMS bound; |e|: median; bias: mean over standard deviation; any: share
of all windows with an estimate (0 after a threshold is one); us: microseconds per sample, median of the flights, host
loop included (launchid's is Python, one sample at a time; RLS and Kalman are numpy, one row at a time).
*: knows data from before the window or a prior, which the window's bound does not count: may lie below 1.
The nominal's profile is known to launchid filtered, tracked and `extended Kalman, profile`; all others fit constants.
"""

import functools
import importlib.util
import math
import sys
import time

import numpy as np
from baselines import METHODS, Log, Method
from flights import Table, arguments, draw, nominal, run_jobs

from launchid.bound.flights import flight_bound
from launchid.identification.windows import onboard_model
from sim.flight import Flight, fly_whole, parameters

WINDOWS = (1.0, 5.0, 10.0)
USEFUL = 0.3   # windows with a larger relative bound are left out
SPREAD = 0.25

Result = dict[tuple[float, str], tuple[np.ndarray, float]]  # (window, method): errors and bounds, us per sample


def log_of(flight: Flight) -> Log:
    """The log that a method gets."""
    return Log(flight.t, flight.theta, flight.theta_dot, flight.beta, flight.beta_cmd)


@functools.cache
def warm_up(name: str, pysindy: bool) -> None:
    """Run every method on one window, so that neither compilation nor imports are timed."""
    believed = nominal(name)
    log = log_of(fly_whole(believed, 0))
    for window in WINDOWS:
        part = Log(*(column[:round(window / log.period)] for column in log))
        for method in chosen(pysindy):
            method.run(part, window, onboard_model(believed))


def chosen(pysindy: bool) -> list[Method]:
    """The methods to run."""
    return [method for method in METHODS if pysindy or not method.pysindy]


def job(name: str, seed: int, pysindy: bool) -> Result:
    """One flight, all methods and windows: relative errors of a6 and k1, their bounds."""
    warm_up(name, pysindy)
    believed = nominal(name)
    model = onboard_model(believed)
    deviation, _ = draw(seed, SPREAD, noise_spread=False)
    vehicle = {"a6_factor": 1.0 + deviation[0], "k1_factor": 1.0 + deviation[1]}
    log = log_of(fly_whole(believed, seed, **vehicle))
    results = {}
    for window in WINDOWS:
        bound = flight_bound(believed, window, seed, **vehicle)
        for method in chosen(pysindy):
            start = time.perf_counter()
            estimate = method.run(log, window, model)
            spent = time.perf_counter() - start
            n = min(len(estimate), len(bound.a6))
            at = bound.t_start[:n] + window * (1.0 if method.at_end else 0.5)
            truth = np.column_stack(parameters(believed, at, **vehicle))
            error = (estimate[:n] - truth) / np.abs(truth)
            results[window, method.name] = (np.column_stack([error, bound.a6[:n], bound.k1[:n]]),
                                            1e6 * spent / len(log.t))
    return results


def figures(error: np.ndarray, bound: np.ndarray) -> tuple[float, float, float]:
    """RMS error over RMS bound, median |error|, bias over standard deviation of one parameter."""
    used = (bound < USEFUL) & np.isfinite(error)
    if used.sum() < 2:
        return math.nan, math.nan, math.nan
    e, b = error[used], bound[used]
    return np.sqrt(np.mean(e**2) / np.mean(b**2)), np.median(np.abs(e)), np.mean(e) / max(np.std(e), 1e-300)


def main() -> int:
    """Run and print."""
    args = arguments(__doc__, flights=40, seed=0, pysindy_flights=4)
    if importlib.util.find_spec("pysindy") is None:
        print("pysindy is not installed: its rows are left out")
        args.pysindy_flights = 0
    for name in args.nominal:
        results = run_jobs(job, [(name, seed, seed - args.seed < args.pysindy_flights) for seed in args.seeds])
        for window in WINDOWS:
            print(f"\n{name}, window {window:g} s, bound below {USEFUL:.0%}")
            table = Table("method 27", "flights 7d", "a6 RMS/bound 12.2f", "|e| 8.2%", "bias +6.2f",
                          "k1 RMS/bound 12.2f", "|e| 8.2%", "bias +6.2f", "any 5.0%", "us 8.2f")
            for method in chosen(args.pysindy_flights > 0):
                got = [result[window, method.name] for result in results if (window, method.name) in result]
                errors = np.concatenate([rows for rows, _ in got])
                table.row(method.name + ("*" if method.memory else ""), len(got),
                          *figures(errors[:, 0], errors[:, 2]), *figures(errors[:, 1], errors[:, 3]),
                          np.mean(np.isfinite(errors[:, :2]).all(axis=1)), np.median([spent for _, spent in got]))
    return 0


if __name__ == "__main__":
    sys.exit(main())

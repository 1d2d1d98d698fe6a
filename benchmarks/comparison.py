"""launchid's filtered form beside what a user could take instead (`baselines.py`), on the same flights.

    python benchmarks/comparison.py [--flights 40] [--seed 0] [--pysindy-flights 4] [--quick]

One table per nominal and window.  `flight` suite at 100 Hz with the nominals' sensor noise, true parameters within
+-25 % of the nominal.  Errors are relative to the truth at the window's centre (of recursive filters: at its end) and
are taken over the windows whose Cramer-Rao bound is below 30 %.
"""

import argparse
import functools
import importlib.util
import math
import sys
import time

import numpy as np
from baselines import DRIFT, HALF_WIDTH, MANY, METHODS, Log, Method, walk
from flights import NOMINALS, draw, nominal, run_jobs

from launchid.bound.flights import flight_bound
from launchid.identification.windows import onboard_model
from sim.flight import Flight, fly_whole, parameters

WINDOWS = (1.0, 5.0, 10.0)
USEFUL = 0.3   # windows with a larger relative bound are left out
SPREAD = 0.25
E_A6, E_K1, B_A6, B_K1 = range(4)  # columns of a result: relative errors and bounds

Result = dict[tuple[float, str], tuple[np.ndarray, float]]  # (window, method): table (windows, 4), us per sample


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
    """One flight, all methods and windows."""
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


def figures(table: np.ndarray, parameter: int) -> tuple[float, float, float]:
    """RMS error over RMS bound, median |error|, bias over standard deviation of one parameter (E_A6 or E_K1)."""
    error, bound = table[:, parameter], table[:, parameter + 2]
    used = (bound < USEFUL) & np.isfinite(error)
    if used.sum() < 2:
        return math.nan, math.nan, math.nan
    e, b = error[used], bound[used]
    return (float(np.sqrt(np.mean(e**2) / np.mean(b**2))), float(np.median(np.abs(e))),
            float(np.mean(e) / max(np.std(e), 1e-300)))


def header(args: argparse.Namespace, pysindy_flights: int) -> None:
    """Print what was run, and how to read it."""
    print(f"{args.flights} flights a nominal, seeds {args.seed}..{args.seed + args.flights - 1}, 100 Hz, dispersed "
          f"+-{SPREAD:.0%}, sensor noise of the nominals, declared exactly where a method asks for it.")
    print(f"pysindy on the first {pysindy_flights} of them (too slow for all).  RMS/bound: RMS relative error over RMS "
          f"Cramer-Rao bound of the window, where that is below {USEFUL:.0%}.")
    print("|e|: median relative error.  bias: mean over standard deviation of the error.  any: share of all windows "
          "with an estimate (0 after a threshold is one).")
    print("us: microseconds per sample, median of the flights, host loop included (launchid's is Python, one sample at "
          "a time; RLS, frequency domain and Kalman run compiled over the whole log; two processes at a time).")
    print("*: knows data from before the window or a prior, which the window's bound does not count: may lie below 1.  "
          "Kalman, tracked: truth at the window's end.")
    print("The nominal's profile is known to launchid filtered, tracked and `extended Kalman, profile`; all others fit "
          "constants.")
    walks = ", ".join(f"{DRIFT / w:.1%} over {w:g} s (variance {walk(0.01, w):.2g} a row)" for w in WINDOWS)
    print(f"random walk of the Kalman filter's parameters, relative std: {walks}.  RLS memory: one window.  "
          f"weak, tuned: {MANY} subdomains of {2 * HALF_WIDTH:g} s sqrt(window/s).")


def show(name: str, window: float, results: list[Result]) -> None:
    """Print one table."""
    reference = np.concatenate([result[window, METHODS[0].name][0] for result in results])
    shares = [np.mean(reference[:, column] < USEFUL) for column in (B_A6, B_K1)]
    print(f"\n{name}, window {window:g} s: {len(reference)} windows, bound below {USEFUL:.0%} in {shares[0]:.0%} (a6), "
          f"{shares[1]:.0%} (k1)")
    print(f"{'':27} {'flights':>7} | {'a6 RMS/bound':>12} {'|e|':>8} {'bias':>6} | {'k1 RMS/bound':>12} {'|e|':>8} "
          f"{'bias':>6} | {'any':>5} {'us':>8}")
    for method in METHODS:
        got = [result[window, method.name] for result in results if (window, method.name) in result]
        if not got:
            continue
        table = np.concatenate([rows for rows, _ in got])
        line = f"{method.name + ('*' if method.memory else ''):27} {len(got):7d}"
        both = [figures(table, parameter) for parameter in (E_A6, E_K1)]
        for ratio, median, bias in both:
            line += f" | {ratio:12.2f} {100 * median:7.2f}% {bias:+6.2f}"
        share = np.mean(np.isfinite(table[:, E_A6]) & np.isfinite(table[:, E_K1]))
        print(f"{line} | {share:5.0%} {np.median([spent for _, spent in got]):8.2f}", flush=True)


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--pysindy-flights", type=int, default=4)
    parser.add_argument("--quick", action="store_true", help="at most 4 flights, 1 for pysindy")
    args = parser.parse_args()
    if args.quick:
        args.flights, args.pysindy_flights = min(args.flights, 4), min(args.pysindy_flights, 1)
    pysindy_flights = min(args.pysindy_flights, args.flights)
    if importlib.util.find_spec("pysindy") is None:
        print("pysindy is not installed: its rows are left out")
        pysindy_flights = 0
    header(args, pysindy_flights)
    for name in NOMINALS:
        seeds = range(args.seed, args.seed + args.flights)
        results = run_jobs(job, [(name, seed, seed - args.seed < pysindy_flights) for seed in seeds])
        for window in WINDOWS:
            show(name, window, results)
    return 0


if __name__ == "__main__":
    sys.exit(main())

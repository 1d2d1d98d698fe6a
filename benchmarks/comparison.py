"""launchid's filtered form beside what a user could take instead (`baselines.py`), on the same flights.

    python benchmarks/comparison.py [--flights 40] [--seed 0] [--pysindy-flights 4] [--quick] [--plot bars.png]

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
from pathlib import Path

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
    print("The nominal's profile is known to launchid filtered, tracked and to the rows `integral, profile` and "
          "`extended Kalman, profile/slow/restart`; all others fit constants or follow a random walk of a6, k1.")
    walks = ", ".join(f"{DRIFT / w:.1%} over {w:g} s (variance {walk(0.01, w):.2g} a row)" for w in WINDOWS)
    print(f"random walk of the Kalman filters' parameters, relative std: {walks}.  RLS memory: one window.  "
          f"weak, tuned: {MANY} subdomains of {2 * HALF_WIDTH:g} s sqrt(window/s).")


def show(name: str, window: float, results: list[Result]) -> dict[str, tuple[float, float]]:
    """One table; returns RMS over bound of a6 and k1 by method."""
    ratios: dict[str, tuple[float, float]] = {}
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
        ratios[method.name] = (both[0][0], both[1][0])
    return ratios


def plot(path: Path, ratios: dict[tuple[str, float], dict[str, tuple[float, float]]]) -> None:
    """Grouped bars of RMS over bound: one panel per parameter and nominal, one bar a window."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    names = [method.name for method in METHODS if any(method.name in table for table in ratios.values())]
    labels = [name + ("*" if any(m.memory for m in METHODS if m.name == name) else "") for name in names]
    looks = (("0.9", ""), ("0.6", "///"), ("0.2", ""))
    figure, panels = plt.subplots(2, len(NOMINALS), figsize=(15, 12), sharex=True, sharey=True, layout="constrained")
    for row, parameter in enumerate(("a6", "k1")):
        for panel, name in zip(panels[row], NOMINALS, strict=True):
            for k, (window, (grey, hatch)) in enumerate(zip(WINDOWS, looks, strict=True)):
                values = [ratios[name, window].get(method, (math.nan, math.nan))[row] for method in names]
                panel.barh(np.arange(len(names)) + 0.27 * (k - 1), values, 0.25, color=grey, hatch=hatch,
                           edgecolor="black", linewidth=0.5, label=f"{window:g} s window")
            panel.axvline(1.0, color="black", linewidth=1.5, linestyle="--", label="Cramér-Rao bound")
            panel.set(xscale="log", xlim=(0.03, 1.0e5), title=f"{name}, {parameter}")
            panel.set_yticks(np.arange(len(names)), labels)
            panel.grid(axis="x", color="0.8", linewidth=0.5)
            panel.set_axisbelow(True)
    panels[0][0].invert_yaxis()
    for panel in panels[1]:
        panel.set_xlabel("RMS relative error / RMS bound [-]")
    panels[0][-1].legend(loc="lower right")
    figure.suptitle("Error over the window's Cramér-Rao bound (* knows more than the window's data)")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--pysindy-flights", type=int, default=4)
    parser.add_argument("--quick", action="store_true", help="at most 4 flights, 1 for pysindy")
    parser.add_argument("--plot", type=Path, help="PNG to write")
    args = parser.parse_args()
    if args.quick:
        args.flights, args.pysindy_flights = min(args.flights, 4), min(args.pysindy_flights, 1)
    pysindy_flights = min(args.pysindy_flights, args.flights)
    if importlib.util.find_spec("pysindy") is None:
        print("pysindy is not installed: its rows are left out")
        pysindy_flights = 0
    header(args, pysindy_flights)
    ratios = {}
    for name in NOMINALS:
        seeds = range(args.seed, args.seed + args.flights)
        results = run_jobs(job, [(name, seed, seed - args.seed < pysindy_flights) for seed in seeds])
        for window in WINDOWS:
            ratios[name, window] = show(name, window, results)
    if args.plot:
        plot(args.plot, ratios)
    return 0


if __name__ == "__main__":
    sys.exit(main())

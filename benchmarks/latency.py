"""Time of Estimator.update from a Python host loop, of a window close beside C, numpy and pysindy, of a flight.

    python benchmarks/latency.py [--repeats 5] [--long 10000000] [--regression]

Every call is timed alone by perf_counter_ns; the clock's own cost stands beside and is not subtracted.  The cyclic
garbage collector is off in the timed loops, as a flight host would have it.  Ratios are of medians in the same run.
--regression: without the formulation `filtered`, whose kernels take minutes to compile, and without the flight.
`mean` is over all calls; `best` the mean of the best repeat, which the demand is about: other processes only add.
The demands are set for an AMD EPYC of 2021 (Zen 3, AVX2); ratios to another tool change with the processor.
Exit status 1 if a demand is missed.
"""

import argparse
import gc
import importlib.util
import shutil
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from flights import in_air, nominal
from latency_c import above_empty, exported, long_run, plain_close

from launchid.identification.windows import onboard_model
from launchid_core import Config, Estimator, Sample, Status
from launchid_core.algebra.library import LIBRARIES
from sim.flight import fly_whole

PLAIN = "plain C, the regression alone"
EXPORTED = "exported C, bits of launchid"   # the same algorithm whole, with its intervals and limits
PYSINDY_RATIO = 150.0   # demand: a window close at least so much faster than pysindy.SINDy.fit on the same rows
FLIGHT_TIME = 0.1       # s, demand: 70 s of flight at 1 kHz
ABOVE_EMPTY = 0.5       # us, demand: `update` of the regression formulations above an empty compiled call
REPLAY_RATE = 2.0       # million samples a second, demand: `integral` with two terms in one call
STEADY = 1.1            # demand: the last million of a long run over the first
CALM = "filtered, rigid-body, estimated"
WINDY = "filtered, wind and two offsets"
WINDY_SHARE = 3.0
A6, K1 = 2.0, -7.0      # 1/s^2, of the noise-free rows
CLOSE_CLOCK = time.process_time_ns  # other processes only add to the wall's
ROWS, PERIOD, THRESHOLD = 100, 0.01, 0.5
TONES = ((0.05, 2.0, 0.3), (0.03, 4.5, 1.1), (0.02, 7.0, 2.0))  # amplitude [rad], frequency [rad/s], phase


def timed(call: Callable[[Any], Any], arguments: list[Any],
          clock: Callable[[], int] = time.perf_counter_ns) -> tuple[np.ndarray, list[Any]]:
    """Microseconds of every call, and what it returned; garbage collector off."""
    spent, answers = [0] * len(arguments), []
    gc.collect()
    gc.disable()
    try:
        for i, argument in enumerate(arguments):
            start = clock()
            answer = call(argument)
            spent[i] = clock() - start
            answers.append(answer)
    finally:
        gc.enable()
    return np.array(spent) / 1000.0, answers


def floor() -> np.ndarray:
    """Microseconds between two readings of the clock around an empty call."""
    return timed(lambda _: None, [None] * 200_000)[0]


def line(name: str, repeats: list[np.ndarray], first: float | None = None) -> float:
    """One row of percentiles; returns the mean of the best repeat."""
    spent = np.concatenate(repeats)
    p50, p99, p999 = np.percentile(spent, [50.0, 99.0, 99.9])
    best = min(float(np.mean(repeat)) for repeat in repeats)
    print(f"{name:44} {len(spent):8d} {p50:8.2f} {p99:8.2f} {p999:8.2f} {np.max(spent):9.2f} {np.mean(spent):8.2f} "
          f"{best:8.2f} {'' if first is None else f'{first:8.2f}'}", flush=True)
    return best


def update_times(name: str, config: Config, samples: list[Sample], repeats: int) -> float:
    """Rows of one configuration: all updates, and the closes alone.  Returns the mean per update of the best repeat."""
    estimator = Estimator(config)
    first = timed(estimator.update, samples[:1])[0][0]
    everything, closes = [], []
    for _ in range(repeats):
        estimator.reset()
        spent, status = timed(estimator.update, samples)
        everything.append(spent)
        closes.append(spent[np.array(status) == Status.WINDOW_COMPLETE])
    best = line(name, everything, first)
    line("  its window closes", closes)
    return best


def noise_free() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (n,), states (n, 3) and their exact derivatives (n, 3) of theta_ddot = A6 theta + K1 beta, a sum of sines."""
    t = np.arange(ROWS) * PERIOD
    derivative = [sum(a * w**k * np.sin(w * t + p + 0.5 * np.pi * k) for a, w, p in TONES) for k in range(4)]
    beta = (derivative[2] - A6 * derivative[0]) / K1
    beta_dot = (derivative[3] - A6 * derivative[1]) / K1
    return (t, np.column_stack([derivative[0], derivative[1], beta]),
            np.column_stack([derivative[1], derivative[2], beta_dot]))


def numpy_stls(states: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Sequentially thresholded least squares on the ten quadratic terms with np.linalg.lstsq; returns Xi (10, 3)."""
    theta, rate, beta = states.T
    library = np.column_stack([np.ones(len(theta)), theta, rate, beta, theta**2, theta * rate, theta * beta, rate**2,
                               rate * beta, beta**2])
    xi = np.linalg.lstsq(library, slopes, rcond=None)[0]
    active = np.abs(xi) >= THRESHOLD
    for _ in range(library.shape[1]):
        xi = np.zeros_like(xi)
        for equation in range(slopes.shape[1]):
            chosen = active[:, equation]
            if chosen.any():
                xi[chosen, equation] = np.linalg.lstsq(library[:, chosen], slopes[:, equation], rcond=None)[0]
        small = active & (np.abs(xi) < THRESHOLD)
        if not small.any():
            break
        active &= ~small
    return xi


def worst(a6: float, k1: float) -> float:
    """Larger of the two relative errors."""
    return max(abs(a6 / A6 - 1.0), abs(k1 / K1 - 1.0))


def close_times(repeats: int) -> dict[str, tuple[np.ndarray, float]]:
    """Microseconds and worst relative error of one window, 100 rows x ten terms, by each tool.

    Processor time, but of the exported C, whose clock is the wall's.  All get theta_ddot exactly; numpy, pysindy and
    plain C get the exact beta_dot too, which launchid differences.
    """
    t, states, slopes = noise_free()
    estimator = Estimator(Config(window=ROWS * PERIOD, sample_period=PERIOD, library="quadratic",
                                 formulation="measured", threshold=THRESHOLD))
    windows = [np.column_stack([t + k * ROWS * PERIOD, states, slopes[:, 1]]) for k in range(100 * repeats)]
    spent, status = timed(estimator.update, [Sample(*row) for row in np.concatenate(windows).tolist()], CLOSE_CLOCK)
    estimate = estimator.estimate()
    assert estimate is not None
    results = {"launchid": (spent[np.array(status) == Status.WINDOW_COMPLETE], worst(estimate.a6, estimate.k1))}
    theta, beta = (LIBRARIES["quadratic"].index(term) for term in ("theta", "beta"))
    if shutil.which("gcc") is not None:
        spent, a6, k1 = plain_close(states, slopes, 100 * repeats)
        results[PLAIN] = (spent, worst(a6, k1))
        missing = np.full((ROWS, 2), np.nan)
        rows = np.concatenate([np.column_stack([window, missing]) for window in windows])
        whole = exported(estimator.config, [Sample(*row) for row in rows.tolist()], 1) / 1000.0
        closes = whole[np.array(status) == Status.WINDOW_COMPLETE]
        results[EXPORTED] = (closes, worst(estimate.a6, estimate.k1))
    spent, answers = timed(lambda _: numpy_stls(states, slopes), [None] * 100 * repeats, CLOSE_CLOCK)
    results["numpy"] = (spent, worst(answers[-1][theta, 1], answers[-1][beta, 1]))
    if importlib.util.find_spec("pysindy") is not None:
        import pysindy

        def fit(_: None) -> Any:
            model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=THRESHOLD, alpha=0.0),
                                  feature_library=pysindy.PolynomialLibrary(degree=2))
            model.fit(states, t=t, x_dot=slopes)
            return model

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fit(None)
            spent, answers = timed(fit, [None] * 10 * repeats, CLOSE_CLOCK)
        coefficients = answers[-1].coefficients()[1]
        results["pysindy"] = (spent, worst(coefficients[theta], coefficients[beta]))
    return results


def flight_time(repeats: int) -> float:
    """Seconds to simulate 70 s at 1 kHz, median."""
    believed = nominal("constant")
    fly_whole(believed, 0, "ideal")
    spent, _ = timed(lambda seed: fly_whole(believed, seed, "ideal"), list(range(max(repeats, 5))))
    return float(np.median(spent)) / 1e6


def all_updates(repeats: int, regression: bool) -> dict[str, float]:
    """Rows of every formulation, or of the regressions; returns the best means of the filtered ones [us]."""
    print(f"{'[us]':44} {'calls':>8} {'p50':>8} {'p99':>8} {'p99.9':>8} {'max':>9} {'mean':>8} {'best':>8} "
          f"{'first':>8}")
    line("clock alone", [floor()])
    believed = nominal("constant")
    ideal = list(fly_whole(believed, 0, "ideal").samples())
    update_times("measured, ten terms, 1 kHz ideal, 1 s", Config(window=1.0, sample_period=0.001, library="quadratic",
                 formulation="measured"), ideal, repeats)
    noisy = list(fly_whole(believed, 0).samples())
    common: dict[str, Any] = {"window": 1.0, "sample_period": 0.01}
    update_times("difference, ten terms, 100 Hz, 1 s", Config(**common, library="quadratic", formulation="difference"),
                 noisy, repeats)
    update_times("integral, two terms, 100 Hz, 1 s", Config(**common, formulation="integral"), noisy, repeats)
    means: dict[str, float] = {}
    if regression:
        return means
    for library in ("rigid-body", "quadratic"):
        for noise in ("declared", "estimated"):
            config = Config(**common, formulation="filtered", library=library, noise=noise,
                            model=onboard_model(believed))
            name = f"filtered, {library}, {noise}"
            means[name] = update_times(f"{name}, 100 Hz, 1 s", config, noisy, repeats)
    rough = onboard_model(in_air(believed, "wind"))
    means[WINDY] = update_times(f"{WINDY}, 100 Hz, 1 s", Config(**common, formulation="filtered", model=rough), noisy,
                                repeats)
    return means


def replay_rates(repeats: int, regression: bool) -> dict[str, float]:
    """Rows of whole logs in one call, and of the same in C; million samples a second, medians of processor time."""
    believed = nominal("constant")
    samples = list(fly_whole(believed, 0).samples())
    table, rates = np.array(samples), {}
    print(f"\n{'whole log in one call, 7000 samples':44} {'million/s':>10} {'in C':>10}")
    kinds: dict[str, dict[str, Any]] = {"integral, two terms": {"formulation": "integral"}}
    if not regression:
        kinds[CALM] = {"formulation": "filtered", "model": onboard_model(believed)}
    for name, more in kinds.items():
        estimator = Estimator(Config(window=1.0, sample_period=0.01, **more))
        estimator.replay(table[:200])  # compiles
        spent = []
        for _ in range(max(repeats, 5)):
            estimator.reset()
            start = time.process_time_ns()
            estimator.replay(table)
            spent.append((time.process_time_ns() - start) / len(table))
        rates[name] = 1000.0 / float(np.median(spent))
        in_c = np.nan
        if shutil.which("gcc") is not None:
            in_c = 1000.0 / float(np.median(exported(estimator.config, samples, max(repeats, 5), "whole")))
        print(f"{name:44} {rates[name]:10.2f} {in_c:10.2f}")
    return rates


def calls(repeats: int) -> float:
    """Rows of an empty compiled call, the compiled step and `update`; the largest of `update` above empty [us]."""
    believed = nominal("constant")
    print(f"\n{'one call, median of 2000 in turn [us]':44} {'empty':>10} {'step':>10} {'update':>10}")
    above = []
    for formulation in ("integral", "difference"):
        samples = list(fly_whole(believed, 0).samples())
        empty, step, update = above_empty(Config(window=1.0, sample_period=0.01, formulation=formulation), samples,
                                          repeats)
        print(f"{formulation + ', two terms, closes included':44} {empty:10.2f} {step:10.2f} {update:10.2f}")
        above.append(update - empty)
    return max(above)


def further(repeats: int, samples: int, regression: bool) -> list[tuple[str, str, bool]]:
    """Rates, calls and a long run, with their demands."""
    rates, above = replay_rates(repeats, regression), calls(repeats)
    chunks = long_run(Config(window=1.0, sample_period=0.01, formulation="integral"), samples)
    drift = float(np.median(chunks[-3:]) / np.median(chunks[:3]))
    print(f"\nlong run, integral, {samples} samples, ns a sample of each million: first three {chunks[:3].round()}, "
          f"last three {chunks[-3:].round()}")
    two = rates["integral, two terms"]
    return [(f"replay of `integral` at {REPLAY_RATE:g} million samples a second", f"{two:.2f}", two >= REPLAY_RATE),
            (f"update at most {ABOVE_EMPTY:g} us above an empty call", f"{above:.2f} us", above <= ABOVE_EMPTY),
            (f"the end of a long run at most {STEADY:g} times its beginning", f"{drift:.2f}", drift <= STEADY)]


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--long", type=int, default=10_000_000, metavar="N", help="samples of the long run")
    parser.add_argument("--regression", action="store_true", help="without `filtered` and the flight")
    args = parser.parse_args()
    print(f"70 s flights of `constant`, seed 0, {args.repeats} repeats; Python host loop, garbage collector off while "
          "timing; clock included\n")
    filtered = all_updates(args.repeats, args.regression)
    print(f"\n{'window close, 100 rows x ten terms':44} {'median us':>10} {'over launchid':>14} {'max rel. error':>15}")
    closes = close_times(args.repeats)
    base = float(np.median(closes["launchid"][0]))
    for name, (spent, error) in closes.items():
        print(f"{name:44} {np.median(spent):10.2f} {np.median(spent) / base:14.1f} {error:15.1e}")
    more = further(args.repeats, args.long, args.regression)
    ratio = float(np.median(closes["pysindy"][0])) / base if "pysindy" in closes else float("nan")
    demands = [(f"close at least {PYSINDY_RATIO:g} times faster than pysindy.SINDy.fit", f"{ratio:.0f}",
                ratio >= PYSINDY_RATIO)]
    if not args.regression:
        flight = flight_time(args.repeats)
        print(f"\n70 s flight at 1 kHz: {1000 * flight:.1f} ms\n")
        demands.append((f"simulated flight below {FLIGHT_TIME:g} s", f"{flight:.3f} s", flight < FLIGHT_TIME))
        share = filtered[WINDY] / filtered[CALM]
        demands.append((f"{WINDY}: at most {WINDY_SHARE:g} times calm filtered", f"{share:.2f}", share <= WINDY_SHARE))
    demands += more
    if "pysindy" not in closes:
        print("pysindy is not installed: its demand is not checked")
        demands = demands[1:]
    for demand, value, met in demands:
        print(f"{'met   ' if met else 'MISSED'}  {demand}: {value}")
    return int(not all(met for _, _, met in demands))


if __name__ == "__main__":
    sys.exit(main())

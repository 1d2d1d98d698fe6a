"""Time of Estimator.update from a Python host loop, of a window close beside C, numpy and pysindy, of a long run.

    python benchmarks/latency.py [--repeats 5] [--long 10000000] [--regression]

Ratios are of medians in the same run.  The cyclic garbage collector is off in the timed loops, as a flight host would
have it.  --regression: without the formulation `filtered`, whose kernels take minutes to compile.
The demands are set for an AMD EPYC of 2021 (Zen 3, AVX2); ratios to another tool change with the processor.
Exit status 1 if a demand is missed.
"""

import dataclasses
import gc
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from flights import Table, arguments, in_air, nominal

from launchid.c_export.program import c_files
from launchid_core import Config, Estimator, Sample, Status
from launchid_core.algebra.library import LIBRARIES
from sim.flight import fly_whole
from sim.onboard import onboard_model
from sim.sections import Bending, Slosh, constant

HERE = Path(__file__).parent
CC, FAST = "gcc", ("-O3", "-march=native")
CHUNK = 1_000_000       # samples, of the long run
BATCH = 2000            # calls between two readings of the clock
CALM = "filtered, two terms"
WINDY = "filtered, wind and two offsets"
KNOWN_MODES = "filtered, slosh and bending"
UNSURE_MODES = "filtered, both unknown"
SLOSH = Slosh(constant(3.5), constant(0.05), constant(0.01))
BENDING = Bending(constant(20.0), constant(0.02), constant(0.01))
UNSURE = {"frequency_sigma": 0.1}
A6, K1 = 2.0, -7.0      # 1/s^2, of the noise-free rows
ROWS, PERIOD, THRESHOLD = 100, 0.01, 0.5
TONES = ((0.05, 2.0, 0.3), (0.03, 4.5, 1.1), (0.02, 7.0, 2.0))  # amplitude [rad], frequency [rad/s], phase


# ---- in C


def as_lines(rows: np.ndarray) -> str:
    """Return the rows as text, as the C programs read them."""
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def plain_close(states: np.ndarray, slopes: np.ndarray, repeats: int) -> tuple[np.ndarray, float, float]:
    """Compile and run close.c; return the processor time [us] of each close, and its a6 and k1."""
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder) / "close")
        subprocess.run([CC, "-std=c99", *FAST, str(HERE / "close.c"), "-lm", "-o", program], check=True)
        said = subprocess.run([program, str(repeats)], input=as_lines(np.column_stack([states, slopes])), text=True,
                              capture_output=True, check=True).stdout.split()
    return np.array(said[2:], float) / 1000.0, float(said[0]), float(said[1])


def exported(config: Config, samples: list[Sample], repeats: int, *how: str, flags: tuple[str, ...] = FAST
             ) -> tuple[np.ndarray, int, int]:
    """Compile and run an exported estimator; return the times [us] of port.c, bytes of its struct and of its code."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in c_files(config).items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        build = [CC, "-std=c99", "-ffp-contract=off", *flags]
        for what in (["-c", "launchid.c"], ["-I.", str(HERE / "port.c"), "launchid.o", "-lm", "-o", "bench"]):
            subprocess.run([*build, *what], cwd=folder, check=True)
        rows = as_lines(np.array(samples))
        sizes, times = (subprocess.run(words, cwd=folder, text=True, capture_output=True, check=True, input=rows).stdout
                        for words in (["size", "launchid.o"], ["./bench", str(repeats), *how]))
    struct, *spent = times.split()
    return np.array(spent, float) / 1000.0, int(struct), sum(map(int, sizes.splitlines()[1].split()[:2]))


# ---- a window's close


def timed(call: Callable[[Any], Any], given: list[Any], clock: Callable[[], int] = time.process_time_ns
          ) -> tuple[np.ndarray, list[Any]]:
    """Call with each argument of `given`, garbage collector off; return the time [us] of every call, and its answer."""
    spent, answers = [0] * len(given), []
    gc.collect()
    gc.disable()
    try:
        for i, argument in enumerate(given):
            start = clock()
            answer = call(argument)
            spent[i] = clock() - start
            answers.append(answer)
    finally:
        gc.enable()
    return np.array(spent) / 1000.0, answers


def noise_free() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t (n,), states (n, 3), exact derivatives (n, 3) of theta_ddot = A6 theta + K1 beta, a sum of sines."""
    t = np.arange(ROWS) * PERIOD
    derivative = [sum(a * w**k * np.sin(w * t + p + 0.5 * np.pi * k) for a, w, p in TONES) for k in range(4)]
    beta = (derivative[2] - A6 * derivative[0]) / K1
    beta_dot = (derivative[3] - A6 * derivative[1]) / K1
    return (t, np.column_stack([derivative[0], derivative[1], beta]),
            np.column_stack([derivative[1], derivative[2], beta_dot]))


def numpy_stls(states: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return Xi (10, 3) by sequentially thresholded least squares on the ten quadratic terms with np.linalg.lstsq."""
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
    """Return the larger of the relative errors of a6 and k1."""
    return max(abs(a6 / A6 - 1.0), abs(k1 / K1 - 1.0))


def close_times(repeats: int) -> dict[str, tuple[np.ndarray, float]]:
    """Return tool -> (times [us], worst relative error) of closing one window, 100 rows x ten terms: processor time,
    but of the exported C, whose clock is the wall's.  All get theta_ddot exactly; numpy, pysindy and plain C get the
    exact beta_dot too, which launchid differences."""
    t, states, slopes = noise_free()
    estimator = Estimator(Config(window=ROWS * PERIOD, sample_period=PERIOD, library="quadratic",
                                 formulation="measured", threshold=THRESHOLD))
    windows = [np.column_stack([t + k * ROWS * PERIOD, states, slopes[:, 1]]) for k in range(100 * repeats)]
    spent, status = timed(estimator.update, [Sample(*row) for row in np.concatenate(windows).tolist()])
    closes = np.array(status) == Status.WINDOW_COMPLETE
    estimate = estimator.estimate()
    results = {"launchid": (spent[closes], worst(estimate.a6, estimate.k1))}
    theta, beta = (LIBRARIES["quadratic"].index(term) for term in ("theta", "beta"))
    if shutil.which(CC) is not None:
        spent, a6, k1 = plain_close(states, slopes, 100 * repeats)
        results["plain C, the regression alone"] = (spent, worst(a6, k1))
        missing = np.full((ROWS, 2), np.nan)
        rows = np.concatenate([np.column_stack([window, missing]) for window in windows])
        whole, *_ = exported(estimator.config, [Sample(*row) for row in rows.tolist()], 1)
        results["exported C, bits of launchid"] = (whole[closes], worst(estimate.a6, estimate.k1))
    spent, answers = timed(lambda _: numpy_stls(states, slopes), [None] * 100 * repeats)
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
            spent, answers = timed(fit, [None] * 10 * repeats)
        coefficients = answers[-1].coefficients()[1]
        results["pysindy"] = (spent, worst(coefficients[theta], coefficients[beta]))
    return results


# ---- updates and whole logs


def update_times(samples: list[Sample], repeats: int) -> dict[str, float]:
    """Return the time [us] of an update of each kind of `filtered`: mean of the best repeat, as others only add."""
    calm, windy = onboard_model(nominal("constant")), onboard_model(in_air(nominal("constant"), "wind"))
    flexible = dataclasses.replace(nominal("constant"), slosh=(SLOSH,), bending=(BENDING,))
    unsure = dataclasses.replace(flexible, slosh=(dataclasses.replace(SLOSH, coupling_sigma=0.5, **UNSURE),),
                                 bending=(dataclasses.replace(BENDING, gain_sigma=0.5, **UNSURE),))
    moved = list(fly_whole(flexible, 0).samples())
    means = {}
    for name, library, model in ((CALM, "rigid-body", calm), ("filtered, ten terms", "quadratic", calm),
                                 (WINDY, "rigid-body", windy), (KNOWN_MODES, "rigid-body", onboard_model(flexible)),
                                 (UNSURE_MODES, "rigid-body", onboard_model(unsure))):
        given = moved if model.modes else samples
        estimator = Estimator(Config(sample_period=PERIOD, formulation="filtered", library=library, model=model))
        timed(estimator.update, given[:1])
        means[name] = np.inf
        for _ in range(repeats):
            estimator.reset()
            means[name] = min(means[name], np.mean(timed(estimator.update, given, time.perf_counter_ns)[0]))
    return means


def replay_rates(config: Config, samples: list[Sample], repeats: int) -> tuple[float, float]:
    """Return million samples a second of a whole log in one call, Python and C (NaN: no gcc): median processor time."""
    estimator, given = Estimator(config), np.array(samples)
    estimator.replay(given[:200])  # compiles
    spent = []
    for _ in range(repeats):
        estimator.reset()
        spent.append(timed(estimator.replay, [given])[0][0] / len(given))
    in_c = exported(config, samples, repeats, "whole")[0] if shutil.which(CC) is not None else np.nan
    return 1.0 / float(np.median(spent)), 1.0 / float(np.median(in_c))


@numba.njit
def _empty(block: Any, ring: Any, seals: Any, t: float, theta: float, theta_dot: float, beta: float, theta_ddot: float,
           beta_cmd: float, gamma: float) -> int:
    """A step that does nothing, for what a call costs."""
    return 0


def call_times(config: Config, samples: list[Sample], repeats: int) -> list[float]:
    """Return median processor times [us] of batches taken in turn: an empty call, the compiled step, `update`."""
    estimator = Estimator(config)
    memory, step = estimator._memory, estimator._step
    given = memory.block, memory.apart["ring"], memory.apart["seals"]
    calls = [lambda sample: _empty(*given, *sample), lambda sample: step(*sample), estimator.update]
    spent: list[list[float]] = [[], [], []]
    for call in calls:
        call(samples[0])
    for _ in range(repeats):
        for begin in range(0, len(samples) - BATCH + 1, BATCH):
            for call, times in zip(calls, spent, strict=True):
                estimator.reset()
                start = time.process_time_ns()
                for sample in samples[begin:begin + BATCH]:
                    call(sample)
                times.append((time.process_time_ns() - start) / BATCH / 1000.0)
    return [float(np.median(times)) for times in spent]


def long_run(config: Config, samples: int) -> np.ndarray:
    """Return the processor time [ns] a sample of each million of one run."""
    estimator, found = Estimator(config), []
    for begin in range(0, samples, CHUNK):
        t = (begin + np.arange(min(CHUNK, samples - begin))) * PERIOD
        slow, quick = np.sin(1.3 * t), np.sin(4.1 * t)
        missing = np.full(len(t), np.nan)
        given = np.column_stack([
            t, 0.02 * slow + 0.005 * quick, 0.026 * np.cos(1.3 * t) + 0.0205 * np.cos(4.1 * t),
            0.01 * slow - 0.004 * quick, -0.0338 * slow - 0.084 * quick, missing, missing])
        found.append(1000.0 * timed(estimator.replay, [given])[0][0] / len(t))
    return np.array(found)


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    args = arguments(__doc__, repeats=5, long=10_000_000, regression=False)
    samples = list(fly_whole(nominal("constant"), 0).samples())
    demands = []  # name, value, whether it is met
    if not args.regression:
        means = update_times(samples, args.repeats)
        table = Table("an update, 100 Hz, 1 s 30", "mean [us] 6.2f")
        for name, mean in means.items():
            table.row(name, mean)
        share = means[WINDY] / means[CALM]
        demands.append((f"{WINDY}: at most 3 times calm", share, share <= 3.0))
        share = means[UNSURE_MODES] / means[CALM]
        demands.append((f"{UNSURE_MODES}: at most 1.7 times calm", share, share <= 1.7))
    closes = close_times(args.repeats)
    base = float(np.median(closes["launchid"][0]))
    table = Table("close, 100 rows x ten terms 30", "median [us] 10.2f", "over launchid 10.1f", "max error 10.1e")
    for name, (spent, error) in closes.items():
        table.row(name, np.median(spent), np.median(spent) / base, error)
    if "pysindy" in closes:
        ratio = float(np.median(closes["pysindy"][0])) / base
        demands.append(("close at least 150 times faster than pysindy.SINDy.fit", ratio, ratio >= 150.0))
    integral = Config(sample_period=PERIOD, formulation="integral")
    table = Table("whole log in one call 30", "million/s 10.2f", "in C 10.2f")
    rates = {"integral": replay_rates(integral, samples, args.repeats)}
    if not args.regression:
        calm = Config(sample_period=PERIOD, formulation="filtered", model=onboard_model(nominal("constant")))
        rates[CALM] = replay_rates(calm, samples, args.repeats)
    for name, of in rates.items():
        table.row(name, *of)
    demands.append(("replay of `integral` at 2 million samples a second", rates["integral"][0],
                    rates["integral"][0] >= 2.0))
    table = Table(f"one call, median of {BATCH} in turn [us] 30", "empty 6.2f", "step 6.2f", "update 6.2f")
    for formulation in ("integral", "difference"):
        times = call_times(Config(sample_period=PERIOD, formulation=formulation), samples, args.repeats)
        table.row(f"{formulation}, two terms", *times)
        above = times[2] - times[0]
        demands.append((f"update of `{formulation}` at most 0.5 us above an empty call", above, above <= 0.5))
    chunks = long_run(integral, args.long)
    drift = float(np.median(chunks[-3:]) / np.median(chunks[:3]))
    demands.append((f"end of a run of {args.long} samples at most 1.1 times its beginning", drift, drift <= 1.1))
    table = Table("demand 64", "measured 8.2f")
    for demand in demands:
        table.row(*demand[:2], good=demand[2])
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main())

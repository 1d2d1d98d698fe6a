"""The comparisons of `latency.py`: with C compiled in the same run, with an empty call, and with itself in a long
run."""

import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np

from launchid.c_export.program import c_files
from launchid_core import Config, Estimator, Sample

HERE = Path(__file__).parent
CC = "gcc"
FAST = ["-O3", "-march=native"]   # the baseline's; -ffp-contract=off besides, where bits are those of Python
CHUNK = 1_000_000                 # samples, of the long run
BATCH = 2000                      # calls between two readings of the clock


def as_lines(rows: np.ndarray) -> str:
    """The rows as the C programs read them."""
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def plain_close(states: np.ndarray, slopes: np.ndarray, repeats: int) -> tuple[np.ndarray, float, float]:
    """Microseconds of processor time of each close of close.c, and its a6 and k1."""
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder) / "close")
        subprocess.run([CC, "-std=c99", *FAST, str(HERE / "close.c"), "-lm", "-o", program], check=True)
        said = subprocess.run([program, str(repeats)], input=as_lines(np.column_stack([states, slopes])), text=True,
                              capture_output=True, check=True).stdout.split()
    return np.array(said[2:], float) / 1000.0, float(said[0]), float(said[1])


def exported(config: Config, samples: list[Sample], repeats: int, *how: str) -> np.ndarray:
    """The times [ns] that port.c prints of an exported estimator, compiled for this machine."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in c_files(config).items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        subprocess.run([CC, "-std=c99", *FAST, "-ffp-contract=off", "-I.", str(HERE / "port.c"), "launchid.c", "-lm",
                        "-o", "bench"], cwd=folder, check=True)
        said = subprocess.run(["./bench", str(repeats), *how], cwd=folder, text=True, capture_output=True, check=True,
                              input=as_lines(np.array(samples))).stdout.split()
    return np.array(said[1:], float)


@numba.njit
def _empty(block: Any, ring: Any, seals: Any, t: float, theta: float, theta_dot: float, beta: float, theta_ddot: float,
           beta_cmd: float, gamma: float) -> int:
    """A step that does nothing, for what a call costs."""
    return 0


def above_empty(config: Config, samples: list[Sample], repeats: int) -> tuple[float, float, float]:
    """Microseconds of processor time, medians of batches taken in turn: an empty call, the compiled step, `update`."""
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
    empty, bare, whole = (float(np.median(times)) for times in spent)
    return empty, bare, whole


def long_run(config: Config, samples: int) -> np.ndarray:
    """Nanoseconds of processor time a sample, of each million of one run."""
    estimator, period, found = Estimator(config), config.sample_period, []
    for begin in range(0, samples, CHUNK):
        t = (begin + np.arange(min(CHUNK, samples - begin))) * period
        slow, quick = np.sin(1.3 * t), np.sin(4.1 * t)
        missing = np.full(len(t), np.nan)
        table = np.column_stack([
            t, 0.02 * slow + 0.005 * quick, 0.026 * np.cos(1.3 * t) + 0.0205 * np.cos(4.1 * t),
            0.01 * slow - 0.004 * quick, -0.0338 * slow - 0.084 * quick, missing, missing])
        start = time.process_time_ns()
        estimator.replay(table)
        found.append((time.process_time_ns() - start) / len(t))
    return np.array(found)

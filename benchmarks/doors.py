"""Measure processor and wall time of each first command with a cold kernel cache, here and in another checkout.

    python benchmarks/doors.py --beside ../older [--runs 3] [--door simulate|effects|estimator|identify|diagnose]

Each run of a door (first command) starts with an empty cache; the two checkouts take turns; medians are compared.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from flights import Table, arguments

HERE = Path(__file__).resolve().parents[1]
FAULT = "slosh:coupling=0.1,frequency=3"
ESTIMATOR = """
from launchid_core import Config, Estimator
from sim.nominal import load_nominal
try:
    from launchid import onboard_model
except ImportError:
    from sim.believed import onboard_model
Estimator(Config(window=5.0, sample_period=0.01, formulation="filtered", model=onboard_model(load_nominal("constant"))))
"""
DOORS = {"simulate": "simulate constant --out OUT", "effects": f"simulate constant --effect {FAULT} --out OUT",
         "estimator": "", "identify": "identify LOG --nominal constant --formulation filtered",
         "diagnose": "diagnose LOG --nominal constant"}


def spent(tree: Path, words: str, cache: Path, log: Path) -> tuple[float, float]:
    """Return processor and wall time [s] of a command (`words`) of a checkout; without words, of the code ESTIMATOR."""
    named = {"LOG": str(log), "OUT": str(cache / "out.csv")}
    command = ["-m", "sim", *(named.get(word, word) for word in words.split())] if words else ["-c", ESTIMATOR]
    environment = {**os.environ, "PYTHONPATH": str(tree), "LAUNCHID_CACHE": str(cache)}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run([sys.executable, *command], env=environment, cwd=cache, stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{tree}: {words or 'estimator'}: exit status {done.returncode}: {done.stderr.strip()[-300:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, time.monotonic() - begun


def main() -> None:
    """Time the doors (first commands) and print the table."""
    args = arguments(__doc__, beside="", runs=3, door=list(DOORS))
    other = Path(args.beside or HERE).resolve()
    table = Table("first 10", "processor [s] 6.1f", "wall [s] 6.1f", "over the other: processor 5.2f", "wall 5.2f")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = folder / "flight.csv"
        (folder / "first").mkdir()
        spent(HERE, f"simulate constant --seed 1 --out {log}", folder / "first", log)
        for door in args.door:
            times: dict[Path, list[tuple[float, float]]] = {HERE: [], other: []}
            for run in range(args.runs):
                for tree in list(times)[::1 if run % 2 == 0 else -1]:
                    cache = Path(tempfile.mkdtemp(dir=folder))
                    times[tree].append(spent(tree, DOORS[door], cache, log))
                    shutil.rmtree(cache)
            ours, others = (np.median(times[tree], axis=0) for tree in (HERE, other))
            table.row(door, *ours, *ours / others)


if __name__ == "__main__":
    main()

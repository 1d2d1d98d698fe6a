"""The C port beside the Python estimator on one flight: time of an update, memory, code.

    OPENBLAS_NUM_THREADS=1 python benchmarks/port.py [--repeats 20] [--flags -O2]

Every sample's least time over the repeats (the machine may be shared); the longest are those that close a block or a
window.  Python's include the call from the interpreter.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from launchid_core import Config, Estimator, Sample
from sim.export_c.program import c_files
from sim.flight import fly
from sim.identify import onboard_model
from sim.nominal import load_nominal

HERE = Path(__file__).parent
NOMINAL = "constant"
SEED = 1


def configs() -> dict[str, Config]:
    """What is timed."""
    model = onboard_model(load_nominal(NOMINAL))
    common = {"sample_period": 0.01, "window": 1.0}
    return {"filtered, rigid-body": Config(formulation="filtered", model=model, **common),
            "filtered, ten terms": Config(formulation="filtered", model=model, library="quadratic", **common),
            "integral, ten terms": Config(formulation="integral", library="quadratic", **common)}


def python_times(config: Config, samples: list[Sample], repeats: int) -> np.ndarray:
    """Least time [ns] of each update."""
    least = np.full(len(samples), np.inf)
    estimator = Estimator(config)
    for _ in range(repeats):
        estimator.reset()
        for k, sample in enumerate(samples):
            begin = time.perf_counter_ns()
            estimator.update(sample)
            least[k] = min(least[k], time.perf_counter_ns() - begin)
    return least


def port_times(config: Config, samples: list[Sample], repeats: int, flags: list[str]) -> tuple[np.ndarray, int, int]:
    """Least time [ns] of each update; bytes of the struct, and of the code and its constants."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in c_files(config).items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        build = ["cc", "-std=c99", "-ffp-contract=off", *flags]
        for what in (["-c", "launchid.c"], ["-I.", str(HERE / "port.c"), "launchid.o", "-lm", "-o", "bench"]):
            subprocess.run([*build, *what], cwd=folder, check=True)
        sizes = subprocess.run(["size", "launchid.o"], cwd=folder, capture_output=True, text=True, check=True)
        text = "".join(" ".join(repr(float(x)) for x in sample) + "\n" for sample in samples)
        done = subprocess.run(["./bench", str(repeats)], cwd=folder, input=text, capture_output=True, text=True,
                              check=True)
    first, *rest = done.stdout.split()
    return np.array([float(x) for x in rest]), int(first), sum(map(int, sizes.stdout.splitlines()[1].split()[:2]))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--flags", nargs="+", default=["-O2"])
    args = parser.parse_args()
    samples = list(fly(load_nominal(NOMINAL), seed=SEED))
    print(f"{NOMINAL}, seed {SEED}, {len(samples)} samples at 100 Hz, windows of 1 s, cc {' '.join(args.flags)}; "
          "us an update: mean, longest")
    print("| | C | Python | ratio of means | struct, bytes | code, bytes |\n|---|---|---|---|---|---|")
    for name, config in configs().items():
        ours = python_times(config, samples, args.repeats) / 1e3
        port, struct, code = port_times(config, samples, args.repeats, args.flags)
        port /= 1e3
        print(f"| {name} | {port.mean():.2f}, {port.max():.1f} | {ours.mean():.2f}, {ours.max():.1f} "
              f"| {ours.mean() / port.mean():.1f} | {struct} | {code} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())

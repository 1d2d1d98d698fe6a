"""The C port beside the Python estimator on one flight: time of an update, memory, code; and on emulated targets.

    OPENBLAS_NUM_THREADS=1 python benchmarks/port.py [--repeats 20] [--targets-only] [--operations]

Every sample's least time over the repeats (the machine may be shared); the longest are those that close a block or a
window.  Python's include the call from the interpreter.  The second table needs arm-none-eabi-gcc and qemu-system-arm:
instructions are counted by an emulator that knows no cache and no wait state, and are no bound on time.
"""

import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from flights import arguments, nominal
from latency import exported as in_c
from port_operations import COUNTED, operations
from port_stack import graph_of

from launchid.c_export.kit import exported
from launchid.c_export.vectors import flown
from launchid_core import Config, Estimator, Sample
from sim.flight import fly
from sim.onboard import onboard_model

NOMINAL = "constant"
SEED = 1
ARM = "arm-none-eabi-gcc"
TARGETS = {  # name -> compiler, flags, the exported Makefile's target
    "this machine": ("gcc", [], ""),
    "Cortex-M7, doubles in hardware": (ARM, ["-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"], "check-m7"),
    "Cortex-M4F, doubles in software": (ARM, ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"],
                                        "check-m4")}


def configs() -> dict[str, Config]:
    """Return the configurations to time, by name."""
    model = onboard_model(nominal(NOMINAL))
    common = {"sample_period": 0.01, "window": 1.0}
    return {"filtered, rigid-body": Config(formulation="filtered", model=model, **common),
            "filtered, ten terms": Config(formulation="filtered", model=model, library="quadratic", **common),
            "integral, ten terms": Config(formulation="integral", library="quadratic", **common)}


def python_times(config: Config, samples: list[Sample], repeats: int) -> np.ndarray:
    """Return the least time [ns] of each update (n,) over the repeats."""
    least = np.full(len(samples), np.inf)
    estimator = Estimator(config)
    for _ in range(repeats):
        estimator.reset()
        for k, sample in enumerate(samples):
            begin = time.perf_counter_ns()
            estimator.update(sample)
            least[k] = min(least[k], time.perf_counter_ns() - begin)
    return least


def main() -> None:
    """Print the tables."""
    args = arguments(__doc__, repeats=20, targets_only=False, operations=False)
    if args.operations:
        return print_operations()
    if not args.targets_only:
        print_times(args.repeats)
    return print_targets()


def print_operations() -> None:
    """Print how many operations an update takes: mean, most frequent, largest."""
    stated = [k for k, name in enumerate(COUNTED) if name != "stores"]
    names = " | ".join(COUNTED[k] for k in stated)
    samples = list(fly(nominal(NOMINAL), seed=SEED))
    print(f"| {NOMINAL}, seed {SEED}, windows of 1 s: an update | {names} |\n|---|---|---|---|---|---|")
    for name, config in configs().items():
        counts = operations(config, samples)[1][:, stated]
        for what, row in (("mean", counts.mean(axis=0)), ("most frequent", np.median(counts, axis=0)),
                          ("largest of each", counts.max(axis=0))):
            print(f"| {name}: {what} | {' | '.join(f'{x:.0f}' for x in row)} |")


def print_times(repeats: int) -> None:
    """Print the times of an update on this machine."""
    samples = list(fly(nominal(NOMINAL), seed=SEED))
    print(f"{NOMINAL}, seed {SEED}, {len(samples)} samples at 100 Hz, windows of 1 s, -O2; us an update: mean, longest")
    print("| | C | Python | ratio of means | struct, bytes | code, bytes |\n|---|---|---|---|---|---|")
    for name, config in configs().items():
        ours = python_times(config, samples, repeats) / 1e3
        port, struct, code = in_c(config, samples, repeats, flags=("-O2",))
        print(f"| {name} | {port.mean():.2f}, {port.max():.1f} | {ours.mean():.2f}, {ours.max():.1f} "
              f"| {ours.mean() / port.mean():.1f} | {struct} | {code} |")


def print_targets() -> None:
    """Print code, memory, stack and instructions on the targets, and whether the bits are Python's."""
    print("\n| target, -O2 | | bits against Python's | code and constants, state, scratch, bytes "
          "| stack of the deepest call: computed, seen | instructions an update: mean, longest |\n"
          "|---|---|---|---|---|---|")
    for target, (compiler, flags, check) in TARGETS.items():
        if shutil.which(compiler) is None or (check and shutil.which("qemu-system-arm") is None):
            print(f"| {target} | no {compiler} or no qemu-system-arm here | | | | |")
            continue
        for name, config in configs().items():
            with tempfile.TemporaryDirectory() as folder:
                for file, text in exported(config, flown(nominal(NOMINAL), config)).items():
                    (Path(folder) / file).write_text(text, encoding="utf-8")
                print(f"| {target} | {name} | {' | '.join(on_target(Path(folder), compiler, flags, check))} |")


def on_target(folder: Path, compiler: str, flags: list[str], check: str) -> list[str]:
    """Build and run an export in `folder`; return the cells of its row."""
    stack = graph_of(folder, compiler, ["-O2", *flags]).deepest()[0]
    tool = compiler.replace("gcc", "size")
    sizes = subprocess.run([tool, "stack.o"], cwd=folder, capture_output=True, text=True, check=True).stdout
    code = sum(map(int, sizes.splitlines()[1].split()[:2]))
    memory = re.search(r"(\d+) bytes persist, (\d+) are scratch", (folder / "README.md").read_text(encoding="utf-8"))
    said = subprocess.run(["make", "-s", check or "check"], cwd=folder, capture_output=True, text=True,
                          check=False).stdout
    seen = re.search(r"stack at most (\d+) bytes; (\d+) instructions, longest (\d+)", said)
    return [said.splitlines()[-1], f"{code}, {memory[1]}, {memory[2]}", f"{stack}, {seen[1] if seen else '-'}",
            f"{seen[2]}, {seen[3]}" if seen else "-"]


if __name__ == "__main__":
    main()

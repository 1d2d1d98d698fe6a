"""The C port beside the Python estimator on one flight: time of an update, memory, code; and on emulated targets.

    OPENBLAS_NUM_THREADS=1 python benchmarks/port.py [--repeats 20] [--targets-only] [--operations] [--config NAME]

Every sample's least time over the repeats (the machine may be shared); the longest are those that close a block or a
window.  Python's include the call from the interpreter.  With modes: one slosh (3.5 rad/s, 5 %) and one bending mode
(19 rad/s, 2 %), known, or frequency and size of each declared to 10 and 50 %; the flight has them.  The targets need
arm-none-eabi-gcc and qemu-system-arm: instructions are counted by an emulator that knows no cache and no wait state,
and are no bound on time.
"""

import dataclasses
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
from sim.nominal import Nominal
from sim.onboard import onboard_model
from sim.sections import Bending, Slosh, constant

NOMINAL = "constant"
NAMES = ["rigid-body", "ten terms", "modes known", "modes unknown", "integral, ten terms"]
SEED = 1
ARM = "arm-none-eabi-gcc"
TARGETS = {  # name -> compiler, flags, the exported Makefile's target
    "this machine": ("gcc", [], ""),
    "Cortex-M7, doubles in hardware": (ARM, ["-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"], "check-m7"),
    "Cortex-M4F, doubles in software": (ARM, ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"],
                                        "check-m4")}


def flexible(is_known: bool) -> Nominal:
    """Return the nominal with one slosh and one bending mode."""
    doubt = {} if is_known else {"frequency_sigma": 0.1}
    slosh = Slosh(constant(3.5), constant(0.05), constant(0.01), **doubt, coupling_sigma=0.0 if is_known else 0.5)
    bending = Bending(constant(19.0), constant(0.02), constant(0.01), **doubt, gain_sigma=0.0 if is_known else 0.5)
    return dataclasses.replace(nominal(NOMINAL), slosh=(slosh,), bending=(bending,))


def cases(names: list[str]) -> dict[str, tuple[Nominal, Config]]:
    """Return the nominals to fly and the configurations to time, by name."""
    common = {"sample_period": 0.01, "window": 1.0}
    made = {"rigid-body": (nominal(NOMINAL), {}), "ten terms": (nominal(NOMINAL), {"library": "quadratic"}),
            "modes known": (flexible(True), {}), "modes unknown": (flexible(False), {})}
    found = {name: (flies, Config(formulation="filtered", model=onboard_model(flies), **more, **common))
             for name, (flies, more) in made.items()}
    found["integral, ten terms"] = nominal(NOMINAL), Config(formulation="integral", library="quadratic", **common)
    return {name: found[name] for name in names}


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
    args = arguments(__doc__, repeats=20, targets_only=False, operations=False, config=NAMES)
    asked = cases(args.config)
    if args.operations:
        return print_operations(asked)
    if not args.targets_only:
        print_times(asked, args.repeats)
    return print_targets(asked)


def print_operations(asked: dict[str, tuple[Nominal, Config]]) -> None:
    """Print how many operations an update takes: mean, most frequent, largest."""
    stated = [k for k, name in enumerate(COUNTED) if name != "stores"]
    names = " | ".join(COUNTED[k] for k in stated)
    print(f"| {NOMINAL}, seed {SEED}, windows of 1 s: an update | {names} |\n|---|---|---|---|---|---|")
    for name, (flies, config) in asked.items():
        counts = operations(config, list(fly(flies, seed=SEED)))[1][:, stated]
        for what, row in (("mean", counts.mean(axis=0)), ("most frequent", np.median(counts, axis=0)),
                          ("largest of each", counts.max(axis=0))):
            print(f"| {name}: {what} | {' | '.join(f'{x:.0f}' for x in row)} |")


def print_times(asked: dict[str, tuple[Nominal, Config]], repeats: int) -> None:
    """Print the times of an update on this machine."""
    print(f"{NOMINAL}, seed {SEED}, 100 Hz, windows of 1 s, -O2; us an update: mean, longest")
    print("| | C | Python | ratio of means | struct, bytes | code, bytes |\n|---|---|---|---|---|---|")
    for name, (flies, config) in asked.items():
        samples = list(fly(flies, seed=SEED))
        ours = python_times(config, samples, repeats) / 1e3
        port, struct, code = in_c(config, samples, repeats, flags=("-O2",))
        print(f"| {name} | {port.mean():.2f}, {port.max():.1f} | {ours.mean():.2f}, {ours.max():.1f} "
              f"| {ours.mean() / port.mean():.1f} | {struct} | {code} |")


def print_targets(asked: dict[str, tuple[Nominal, Config]]) -> None:
    """Print code, memory, stack and instructions on the targets, and whether the bits are Python's."""
    print("\n| target, -O2 | | bits against Python's | code and constants, state, scratch, bytes "
          "| stack of the deepest call: computed, seen | instructions an update: mean, longest |\n"
          "|---|---|---|---|---|---|")
    for target, (compiler, flags, check) in TARGETS.items():
        if shutil.which(compiler) is None or (check and shutil.which("qemu-system-arm") is None):
            print(f"| {target} | no {compiler} or no qemu-system-arm here | | | | |")
            continue
        for name, (flies, config) in asked.items():
            with tempfile.TemporaryDirectory() as folder:
                for file, text in exported(config, flown(flies, config)).items():
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

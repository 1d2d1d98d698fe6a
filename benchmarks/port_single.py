"""Single precision beside double: the exported estimator in both, on the same flights.

    python benchmarks/port_single.py [--flights 3]

Per nominal, formulation, library and window: windows whose status differs, and the largest difference of a6 and k1, in
standard deviations of the double one (flight sensors; `measured`, whose logs are clean: relative).  Demanded: no status
that differs, at most ERROR.  What `launchid export-c --float32` refuses is measured too.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from launchid.c_export.program import c_files
from launchid.c_export.single import ERROR, converted
from launchid.identification.windows import onboard_model
from launchid_core import Config, EstimateStatus
from sim.flight import fly
from sim.nominal import load_nominal

NOMINALS = ("constant", "vega_like", "greensite_cr826")
STATUS, A6, K1, A6_STD = 1, 6, 7, 8   # of replay.c's line of a window


def built(files: dict[str, str], folder: Path) -> Path:
    """The replay program of an export."""
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    subprocess.run(["cc", "-std=c99", "-O2", "-ffp-contract=off", "replay.c", "launchid.c", "-lm", "-o", "replay"],
                   cwd=folder, check=True)
    return folder / "replay"


def windows(program: Path, samples: str) -> np.ndarray:
    """Status, a6, k1, a6_std, k1_std of each window (n, 5)."""
    said = subprocess.run([str(program)], input=samples, capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in said.splitlines() if line.startswith("window")]
    return np.array([[float(row[STATUS]), *(float.fromhex(x) for x in row[A6:A6 + 4])] for row in rows]).reshape(-1, 5)


def compared(config: Config, flights: list[str]) -> tuple[int, int, float]:
    """Windows, those whose status differs (or that are missing), and the largest error of those valid in both."""
    total, differ, largest = 0, 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        programs = [built(made, Path(folder) / name)
                    for name, made in (("double", c_files(config)), ("single", converted(config)))]
        for samples in flights:
            ours, theirs = (windows(program, samples) for program in programs)
            n = min(len(ours), len(theirs))
            total += len(ours)
            same = ours[:n, 0] == theirs[:n, 0]
            differ += len(ours) - int(same.sum())
            valid = same & (ours[:n, 0] == int(EstimateStatus.OK))
            scale = np.abs(ours[:n, 1:3]) if config.formulation == "measured" else ours[:n, 3:5]
            errors = np.abs(ours[:n, 1:3] - theirs[:n, 1:3])[valid] / scale[valid]
            largest = max(largest, float(errors.max(initial=0.0)))
    return total, differ, largest


def main() -> int:
    """Print the table; exit status 1 if what is allowed misses the demand."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=3)
    args = parser.parse_args()
    missed = 0
    print("| nominal | formulation, library | window, s | windows | other status | largest error |\n"
          "|---|---|---|---|---|---|")
    for name in NOMINALS:
        nominal = load_nominal(name)
        for formulation, library, sizes in (
                ("measured", "rigid-body", (1.0, 5.0, 10.0)), ("difference", "rigid-body", (1.0, 5.0, 10.0)),
                ("integral", "rigid-body", (1.0, 5.0, 10.0)), ("integral", "quadratic", (1.0,)),
                ("filtered", "rigid-body", (1.0,))):
            suite = "ideal" if formulation == "measured" else "flight"
            flights = ["".join(" ".join(repr(float(x)) for x in sample) + "\n"
                               for sample in fly(nominal, seed, suite, nominal.sensors.period))
                       for seed in range(args.flights)]
            for window in sizes:
                model = onboard_model(nominal) if formulation == "filtered" else None
                total, differ, largest = compared(Config(
                    window=window, sample_period=nominal.sensors.period, formulation=formulation, library=library,
                    model=model), flights)
                allowed = formulation != "filtered" and library == "rigid-body"
                missed += allowed and (differ > 0 or largest > ERROR)
                print(f"| {name} | {formulation}, {library} | {window:g} | {total} | {differ} | {largest:.1e} |",
                      flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())

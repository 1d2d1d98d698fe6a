"""Whether intervals hold while something is not as declared: sensors as they are, a nominal of another vehicle.

    python benchmarks/regimes.py [--flights 10] [--seed 0] [--window 5] [--row NAME] [--nominal NAME]

Each row flies the independent generator `tests/hidden` (100 Hz, the nominals' own noises, a6 and k1 off by 8 %, one
sigma) with one thing that the nominal does not declare, and identifies the log with the nominal. Printed of the valid
windows: their share, the share of true a6 and k1 within 1.96 standard deviations, the root mean square of error over
deviation, how many are off by more than 4; and the coverage of the tracked estimates at the windows' ends.
`clean` is flown in the same run. `integral` is identified without a nominal, by that formulation, in flights of steps
and ramps.
`stamp_early`: rows are stamped early or late by a quarter of the stamps' step (one sigma), and rounded down to it.
`swap` identifies clean flights of each nominal with each other one, and counts windows that are off by more than 4.
`faults` flies the catalogue's effects at the sizes that a diagnosis finds with the right nominal, and counts the logs
that are refused as those of another vehicle's nominal.
"""

import math
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from flights import INTERVAL, Table, arguments, nominal, run_jobs

import launchid

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))   # of the independent generator
from hidden import draw_spec
from hidden.build import Build
from hidden.catalogue import LISTED
from hidden.flight import COLUMNS
from hidden.listed import FITS
from hidden.motion import run
from hidden.spec import Spec

SPREAD = 0.08    # one sigma of a6 and k1 over the nominal's
FAR = 4.0        # standard deviations
RATE = 100.0     # Hz
OTHER_VEHICLE = "another vehicle"   # words of the warning

Columns = dict[str, np.ndarray]
Hook = Callable[[Build, float], None]
After = Callable[[Columns, float], Columns]


def gyro_lag(b: Build, size: float) -> None:
    b.set(gyro_lag=size)


def gyro_scale(b: Build, size: float) -> None:
    b.gyro_gain *= size


def gyro_delay(b: Build, size: float) -> None:
    b.gyro_late += size


def nothing(b: Build, size: float) -> None:
    pass


def nozzle_scale(columns: Columns, size: float) -> Columns:
    return columns | {"beta": size * columns["beta"]}


def attitude_step(columns: Columns, size: float) -> Columns:
    return columns | {"theta": size * np.round(columns["theta"] / size)}


def stamp_step(columns: Columns, size: float) -> Columns:
    return columns | {"t": size * np.floor(columns["t"] / size + 1e-9)}


def stamp_early(columns: Columns, size: float) -> Columns:
    rng = np.random.default_rng(len(columns["t"]))
    return columns | {"t": np.maximum.accumulate(size * np.floor((
        columns["t"] + 0.25 * size * rng.standard_normal(len(columns["t"]))) / size))}


def same(columns: Columns, size: float) -> Columns:
    return columns


# row -> (what it does to the vehicle, what it does to the log, its sizes)
ROWS: dict[str, tuple[Hook, After, tuple[float, ...]]] = {
    "clean": (nothing, same, (0.0,)),
    "gyro_lag": (gyro_lag, same, (0.005, 0.01, 0.02)),
    "gyro_delay": (gyro_delay, same, (0.01, 0.02)),
    "gyro_scale": (gyro_scale, same, (0.97, 1.05)),
    "nozzle_scale": (nothing, nozzle_scale, (0.98, 1.05, 0.9)),
    "attitude_step": (nothing, attitude_step, (5e-4, 1e-3, 2e-3)),
    "stamp_step": (nothing, stamp_step, (0.004, 0.008, 0.016)),
    "stamp_early": (nothing, stamp_early, (0.008,)),
    "integral": (nothing, same, (0.0,)),
}


def flown(name: str, seed: int, row: str, size: float, text: str = "") -> tuple[Columns, np.ndarray, np.ndarray]:
    """Return (the log's columns, a6 and k1 (n,) at half sub-steps) of a flight; text: a listed effect of the
    generator."""
    spread = SPREAD * np.clip(np.random.default_rng((71, seed)).standard_normal(2), -2.5, 2.5)
    if text:
        spec = draw_spec(seed, text, nominal=name, rate=RATE, dispersion=(float(spread[0]), float(spread[1])))
    else:
        spec = Spec(nominal=name, seed=seed, rate=RATE, dispersion=(float(spread[0]), float(spread[1])),
                    reference="rough" if row == "integral" else "nominal")
    b = Build(spec)
    for hidden in spec.effects:
        FITS[hidden.name](b, hidden)
    hook, after, _ = ROWS[row]
    hook(b, size)
    knobs, clock, course = b.parts()
    rows = np.zeros((-(-clock.steps // clock.log_every), len(COLUMNS)))
    written, _ = run(knobs, clock, course, rows)
    columns = {each: rows[:written, k].copy() for k, each in enumerate(COLUMNS)}
    columns["t"] = np.round(columns["t"], 9)
    return after(columns, size), b.a6, b.k1


def errors(name: str, believed: str, seed: int, row: str, size: float, window: float,
           text: str = "") -> dict[str, Any]:
    """Return of one flight: `windows`, how many; `off` (k, 2) errors over deviations of a6 and k1 in valid windows;
    `tracked` (k, 2) the same; `status`, a count of each; `warnings` of identify."""
    columns, a6, k1 = flown(name, seed, row, size, text)
    half = 2.0 / 2.5e-4
    choices = {"formulation": "integral"} if row == "integral" else {"nominal": nominal(believed), "tracked": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            made = launchid.identify(columns, window=window, **choices)
        except Exception as error:  # a log that is refused as a whole is an answer
            return {"windows": 1, "off": np.zeros((0, 2)), "tracked": np.zeros((0, 2)), "widths": np.zeros((0, 2)),
                    "status": {type(error).__name__: 1}, "warnings": (str(error),)}
    off, tracked, status, widths = [], [], dict[str, int](), []
    for e in made.estimates:
        status[e.status.name] = status.get(e.status.name, 0) + 1
        middle, last = (min(round(t * half), len(a6) - 1) for t in (0.5 * (e.t_start + e.t_end), e.t_end))
        if e.valid:
            off.append([(e.a6 - a6[middle]) / e.a6_std, (e.k1 - k1[middle]) / e.k1_std])
            widths.append([e.a6_std, e.k1_std])
        if e.tracked is not None and e.tracked.valid:
            tracked.append([(e.tracked.a6 - a6[last]) / e.tracked.a6_std, (e.tracked.k1 - k1[last]) / e.tracked.k1_std])
    return {"windows": len(made.estimates), "off": np.reshape(off, (-1, 2)), "tracked": np.reshape(tracked, (-1, 2)),
            "status": status, "warnings": made.warnings, "widths": np.reshape(widths, (-1, 2))}


def coverage(off: np.ndarray) -> np.ndarray:
    """Return the shares (2,) of errors off (k, 2) within INTERVAL deviations; NaN of none."""
    return np.mean(np.abs(off) < INTERVAL, axis=0) if len(off) else np.full(2, math.nan)


def whole(parts: list[dict[str, Any]], name: str) -> np.ndarray:
    return np.concatenate([part[name] for part in parts])


def statuses(parts: list[dict[str, Any]]) -> str:
    """Return the statuses of all windows in words, the most frequent first."""
    counts: dict[str, int] = {}
    for part in parts:
        for status, n in part["status"].items():
            counts[status] = counts.get(status, 0) + n
    return " ".join(f"{status} {n}" for status, n in sorted(counts.items(), key=lambda each: -each[1]))


def print_row(table: Table, head: tuple[Any, ...], parts: list[dict[str, Any]]) -> None:
    """Print a line of a cell's flights."""
    off, tracked = whole(parts, "off"), whole(parts, "tracked")
    windows = sum(part["windows"] for part in parts)
    rms = np.sqrt(np.mean(off**2, axis=0)) if len(off) else np.full(2, math.nan)
    beyond = float(np.mean(np.any(np.abs(off) > FAR, axis=1))) if len(off) else math.nan
    table.row(*head, len(off) / windows, *coverage(off), *rms, beyond, *coverage(tracked), statuses(parts))


def main() -> int:
    """Run and print."""
    args = arguments(__doc__, flights=10, seed=0, window=5.0, row=[*ROWS, "swap", "faults"], words=False)
    table = Table("row 14", "size 7g", "nominal 16", "OK 5.2f", "a6 5.2f", "k1 5.2f", "rms a6 6.2f", "rms k1 6.2f",
                  ">4 6.3f", "tracked a6 5.2f", "k1 5.2f", "windows 20")
    for row in (each for each in args.row if each in ROWS):
        cells = [(name, size) for size in ROWS[row][2] for name in args.nominal]
        results = iter(run_jobs(errors, [(name, name, seed, row, size, args.window) for name, size in cells
                                         for seed in args.seeds]))
        for name, size in cells:
            parts = [next(results) for _ in args.seeds]
            print_row(table, (row, size, name), parts)
            if args.words:
                print(*{line for part in parts for line in part["warnings"]}, sep="\n")
    if "swap" in args.row:
        pairs = [(flies, believed) for flies in args.nominal for believed in args.nominal if flies != believed]
        results = iter(run_jobs(errors, [(*pair, seed, "clean", 0.0, args.window) for pair in pairs
                                         for seed in args.seeds]))
        for flies, believed in pairs:
            parts = [next(results) for _ in args.seeds]
            print_row(table, (f"of {flies}", 0.0, believed), parts)
            if args.words:
                print(*sorted({line for part in parts for line in part["warnings"]}), sep="\n")
    if "faults" in args.row:
        kinds = [(name, text) for text in ("", *LISTED) for name in args.nominal]
        results = iter(run_jobs(errors, [(name, name, seed, "clean", 0.0, args.window, text) for name, text in kinds
                                         for seed in args.seeds]))
        refused = total = 0
        for name, text in kinds:
            parts = [next(results) for _ in args.seeds]
            said = [line for part in parts for line in part["warnings"] if OTHER_VEHICLE in line]
            refused, total = refused + len(said), total + len(parts)
            if said:
                print(f"{text or 'nothing'} {name}: {len(said)} of {len(parts)} refused: {said[0]}")
        print(f"right nominals: {refused} of {total} logs refused")
    return 0


if __name__ == "__main__":
    sys.exit(main())

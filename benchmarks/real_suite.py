"""The answers of `identify` over measured logs, without a nominal, beside a plain regression that knows nothing of it.

    python benchmarks/real_suite.py FOLDER [--raw RAW] [--only NAME...] [--judge] [--placebo]

FOLDER   NAME.csv of logs that may not be passed on (`diagnosis_set.py --folder`), beside those of the labelled set and
         of the tests; RAW: files of SOURCES, fetched by hand, converted into FOLDER before; nothing is filtered
Where no window is OK, the library that the answer advises is taken, as its reader does. A line a log: the windows that
are OK, of the whole log and of 5 s; how far the furthest is from what is known; the R2 with which a regression on an
even grid (zero-phase low pass, the input delayed) predicts the last 40 % of the rows from the first 60 %. Known is
what the set says, else what the regression finds at its low passes where its R2 is 0.9 or more, with the square of the
input if the answer has it: k1 is then the slope where the input is zero. Asked: none more than
4 of its deviations and 5 % off; an OK window in half of the logs of such an R2.
--placebo: only the logs with their input shifted; k1 must be refused.  --judge: also those on which nothing is chosen.
"""

import argparse
import dataclasses
import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from diagnosis_labels import read_set
from diagnosis_sources import PUBLIC, public_flights, shifted
from scipy.signal import butter, filtfilt

from launchid.commands.identify import identify
from launchid.log.log import MEASURED_LOGS, Log, log_of_values, read_log
from sim.errors import InputError, UsageError
from sim.files import write_text

Columns = dict[str, np.ndarray]
WINDOWS = ("all", 5.0)
PREDICTS = 0.9               # R2 of left-out rows from which on the regression is believed
FAR, SHARE = 4.0, 0.05       # deviations, and share of the number, at which a window is a lie
LOW_PASSES = (1.5, 2.5, 4.0, 6.0, 10.0)  # Hz
DELAYS = np.arange(0.0, 0.16, 0.01)      # s
LARGE = 0.5                  # rad of theta, from which on its sine is meant
REBUILT = {"ship": (0.0, -0.0172), "tail_wags_dog": (23.6, 10.1), "rate_loop": (0.0, 88.0), "spinning": (0.0, 4000.0)}
BURN = (0.5, 2.8)        # s, of the hobby rocket's log: from lift-off to where it tumbles
COAST = (4547.0, 4561.0)  # s, of the sounding rocket's: from burn-out to where its fins reach their stops
GYRO_ZERO = 29400.0      # counts, before lift-off
GYRO_SCALE = 3.7e-4      # rad/s a count: two roll manoeuvres of 90 degrees are 4418 and 4132 counts s
FIN_ZERO, FIN_THROW = 24900.0, 8192.0  # counts: where roll rests at the highest speed, and to either stop


def mcar(path: Path) -> Columns:
    """Read a wheeled balancing robot's log: time, rate [deg/s], angle [deg], controller output, ...."""
    t, rate, angle, command = np.loadtxt(path, usecols=(0, 1, 2, 3), unpack=True)
    return {"t": t, "theta": np.radians(angle), "theta_dot": np.radians(rate), "beta_cmd": command}


def tail_sitter(path: Path) -> Columns:
    """Read the roll of a hovering tail-sitter: attitude by motion capture, actuator control without unit."""
    from scipy.io import loadmat
    flight = loadmat(path)
    return {"t": flight["time"].ravel(), "theta": flight["local_attitude"][:, 0],
            "beta_cmd": flight["actuator_controls"][:, 0]}


def hobby_rocket(path: Path) -> Columns:
    """Read a thrust-vectored rocket: gyro's axes 45 degrees from the nozzle's (our reading), commands in degrees."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    t = 1e-3 * (table[:, 0] - table[0, 0])
    burns = (t >= BURN[0]) & (t <= BURN[1])
    rate = np.radians(table[:, 8] + table[:, 9]) / np.sqrt(2.0)
    return {"t": t[burns] - BURN[0], "theta_dot": rate[burns], "beta_cmd": np.radians(table[:, 2])[burns]}


def aeropendulum(path: Path) -> Columns:
    """Read an aeropendulum's log tempo_ms, angulo_deg, u_pct: 0 is hanging down."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    return {"t": 1e-3 * table[:, 0], "theta": np.radians(table[:, 1]), "beta_cmd": table[:, 2] / 100.0}


def sounding_rocket(path: Path) -> Columns:
    """Read a sounding rocket's roll: time, accelerometer, roll gyro, fin servo's command [counts]."""
    t, gyro, fin = np.loadtxt(path, delimiter=",", usecols=(0, 2, 3), unpack=True)
    coasts = (t >= COAST[0]) & (t <= COAST[1])
    return {"t": t[coasts] - COAST[0], "theta_dot": GYRO_SCALE * (gyro[coasts] - GYRO_ZERO),
            "beta_cmd": (fin[coasts] - FIN_ZERO) / FIN_THROW}


SOURCES: dict[str, tuple[str, str, Callable[[Path], Columns]]] = {  # log: repository and folder, file in RAW, reader
    "mcar_8_3_1": ("dongdaming1966/mcar_simulate data", "8_3_1.dat", mcar),
    "tailsitter_stabilized_1": ("RockyJBL/Tailsitter-hovering-dataset dataset", "manual_stabilized_1.mat", tail_sitter),
    "tailsitter_step_size3_1": ("RockyJBL/Tailsitter-hovering-dataset dataset", "step_size3_1.mat", tail_sitter),
    "ubc_tvc": ("UBC-Rocket/Thrust-Vectoring-II Simulation/flight-data-based-simulation",
                "flight_data-08-06-2025.csv", hobby_rocket),
    "psas_roll": ("psas/flight_data-2010.10.17 roll/raw", "output_trim.csv", sounding_rocket),
    "aeropendulum_aprbs_1": ("FelipeEduardoMarcondes/SYSTEM-IDENTIFICATION-AERO experimentos",
                             "aprbs-1_0819_18-48.csv", aeropendulum),
}


def convert(raw: Path, out: Path) -> None:
    """Write the logs whose raw files are there as CSV; print where to get the others."""
    for name, (source, file, reader) in SOURCES.items():
        if not (raw / file).is_file():
            print(f"{name}: {file} is not there; fetch it from {source}")
            continue
        columns = reader(raw / file)
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        write_text(out / f"{name}.csv", [",".join(columns) + "\n", *(",".join(map(repr, row)) + "\n" for row in rows)])


def regression(log: Log, angle: str, is_squared: bool = False) -> tuple[float, dict[str, list[float]]]:
    """Return the R2 of left-out rows at the best low pass and delay, and {a6, k1: [low, high]} over the low passes that
    predict; it uses nothing of the project but the columns."""
    t, step = log.t, float(np.median(np.diff(log.t)))
    good = np.isfinite(t) & np.isfinite(log.beta) & np.isfinite(log.theta)
    if np.count_nonzero(good) < 100:
        return np.nan, {}
    t, theta, beta = (column[good] for column in (t, log.theta, log.beta))
    grid = np.arange(t[0], t[-1], step)
    theta, beta = np.interp(grid, t, theta), beta[np.searchsorted(t, grid, side="right") - 1]
    sine, n, found = (np.sin if angle == "sin(theta)" else np.array), round(0.6 * len(grid)), []
    for low_pass in LOW_PASSES:
        if low_pass * step >= 0.2 or len(grid) * step * low_pass < 10.0:
            continue
        poles = butter(2, 2.0 * low_pass * step)

        def smooth(column: np.ndarray, poles: Any = poles) -> np.ndarray:
            return filtfilt(*poles, column)
        rate = np.gradient(smooth(theta), grid)
        end = max(round(1.0 / low_pass / step), 1)
        y, inner = np.gradient(rate, grid), slice(end, -end)
        here = []
        for delay in DELAYS:
            late = beta[np.clip(np.arange(len(grid)) - round(delay / step), 0, None)]
            x = np.column_stack([smooth(sine(theta)), smooth(late), np.ones_like(grid), rate, smooth(np.sign(rate)),
                                 *([smooth(late**2)] if is_squared else [])])
            xi = np.linalg.lstsq(x[end:n], y[end:n], rcond=None)[0]
            left_out = slice(n, -end)
            r2 = 1.0 - np.var(y[left_out] - x[left_out] @ xi) / np.var(y[left_out])
            here.append((float(r2), np.linalg.lstsq(x[inner], y[inner], rcond=None)[0]))
        found.append(max(here, key=lambda one: one[0]))
    if not found:
        return np.nan, {}
    sizes = np.array([xi[:2] for r2, xi in found if r2 >= PREDICTS])
    ranges = {name: [np.min(each), np.max(each)] for name, each in zip(("a6", "k1"), sizes.T, strict=False)}
    return max(r2 for r2, _ in found), ranges if len(sizes) else {}


def windows(log: Log, library: str | None, window: float | str) -> list[dict[str, Any]]:
    """Return windows of `identify` without a nominal, by the library it advises if none is OK; one if it refuses."""
    try:
        said = identify(log, window=window, library=library).report
        advised = re.search(r"--library (\S+?);?(\s|$)", said.get("next", ""))
        if advised is not None and not any(each["status"] == "OK" for each in said["windows"]):
            said = identify(log, window=window, library=advised[1]).report
    except (InputError, UsageError):
        return [{"status": "refused"}]
    return said["windows"] or [{"status": "NO WINDOW"}]


def distances(window: dict[str, Any], terms: dict[str, str],
              known: dict[str, list[float]]) -> Iterator[tuple[float, float]]:
    """Yield how far each number of a window is from the known range: (standard deviations, share of the known size)."""
    for name, (low, high) in known.items():
        size, std = window["terms"].get(terms[name]), window["terms_std"].get(terms[name])
        if size is not None and std:
            off = max(low - size, size - high, 0.0)
            yield off / std, off / max(abs(low), abs(high), 1e-12)


def with_input(log: Log) -> Log:
    """Return the log, its command as beta if no nozzle is measured."""
    if np.isfinite(log.beta).any():
        return log
    columns = tuple("beta" if name == "beta_cmd" else name for name in log.columns)
    return dataclasses.replace(log, columns=columns, beta=log.beta_cmd, beta_cmd=log.beta)


def logs(folder: Path, judge: bool) -> Iterator[tuple[str, Log, dict[str, Any], float | None]]:
    """Yield name, log, what the set knows of it, and its placebo's shift (None), of the set's logs and the folder's."""
    cases = read_set()[0]
    of_set = {case.source[1]: case for case in cases if case.kind == "measured" and case.source[0] == "log"}
    shifts = {case.source[1]: case.options["shift"] for case in cases if case.kind == "placebo"}
    places = {path.stem: path for where in (MEASURED_LOGS, PUBLIC, folder) for path in sorted(where.glob("*.csv"))}
    for name, path in places.items():
        if judge or name not in of_set or of_set[name].part != "judge":
            log = read_log(path, ("t",))
            yield name, with_input(log), of_set[name].identify if name in of_set else {}, shifts.get(name)
    for name, known in REBUILT.items():
        log = log_of_values(name, getattr(public_flights, name)())
        yield name, with_input(log), {key: [each, each] for key, each in zip(("a6", "k1"), known, strict=True)}, None


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="NAME.csv of measured logs that are not shipped; SOURCES tell some")
    parser.add_argument("--raw", type=Path, help="files of SOURCES to be converted into FOLDER first")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--judge", action="store_true", help="also the logs on which nothing may be chosen")
    parser.add_argument("--placebo", action="store_true")
    args = parser.parse_args()
    if args.raw is not None:
        args.folder.mkdir(parents=True, exist_ok=True)
        convert(args.raw, args.folder)
    count = lies = kept = predicted = answered = 0
    print("log, OK of the windows, furthest of these (deviations, %), R2 of left-out rows, status of the rest")
    for name, log, asked, shift in logs(args.folder, args.judge):
        if (args.only and name not in args.only) or (args.placebo and shift is None):
            continue
        moves = shifted(log, shift) if args.placebo and shift else log
        angle = "sin(theta)" if np.nanmax(np.abs(log.theta), initial=0.0) > LARGE else "theta"
        library = None if angle == "theta" else "sin(theta),beta,theta_dot,1"
        told = [window for each in WINDOWS for window in windows(moves, library, each)]
        fine = [window for window in told if window["status"] == "OK"]
        kept += args.placebo and any(window["terms"].get("beta") for window in fine)
        r2, ranges = regression(moves, angle)
        if any("beta^2" in window["terms"] for window in fine):
            ranges = regression(moves, angle, is_squared=True)[1]
        known = ranges | {key: asked[key] for key in ("a6", "k1") if key in asked}
        off = [max(distances(window, {"a6": angle, "k1": "beta"}, known), default=(0.0, 0.0)) for window in fine]
        far = max(off, default=(0.0, 0.0))
        count += 1
        lies += sum(std > FAR and share > SHARE for std, share in off)
        predicted += r2 >= PREDICTS
        answered += r2 >= PREDICTS and bool(fine)
        rest = Counter(window["status"] for window in told if window["status"] != "OK")
        shown = f"{far[0]:.1f} std, {100.0 * far[1]:.0f} %" if fine and known else "-"
        print(f"{name}: {len(fine)}/{len(told)}, {shown}, {r2:.3f},", *(f"{n} {word}" for word, n in rest.items()),
              flush=True)
    print(f"{count} logs: {lies} OK windows more than {FAR:g} deviations and {100.0 * SHARE:g} % off (0); {answered} "
          f"of the {predicted} that a regression predicts have an OK window (half); {kept} placebos with a k1 (0)")


if __name__ == "__main__":
    main()

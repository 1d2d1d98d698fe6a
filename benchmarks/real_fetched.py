"""Measured logs that may not be passed on (no licence found), from files fetched by hand into the log's columns.

    python benchmarks/real_fetched.py RAW OUT

RAW holds, of these public repositories, the files of SOURCES that are wanted; OUT gets a log (CSV) for each, for
`diagnosis_set.py --folder OUT`.  Nothing is filtered or resampled; what was not measured is left out.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim.files import write_text

Columns = dict[str, np.ndarray]
BURN = (0.5, 2.8)        # s, of the hobby rocket's log: from lift-off to where it tumbles
COAST = (4547.0, 4561.0)  # s, of the sounding rocket's: from burn-out to where its fins reach their stops
GYRO_ZERO = 29400.0      # counts, before lift-off
GYRO_SCALE = 3.7e-4      # rad/s a count: two roll manoeuvres of 90 degrees are 4418 and 4132 counts s
FIN_ZERO, FIN_THROW = 24900.0, 8192.0  # counts: where roll rests at the highest speed, and to either stop


def mcar(path: Path) -> Columns:
    """time, rate [deg/s], angle [deg], controller output, ...: a wheeled balancing robot."""
    t, rate, angle, command = np.loadtxt(path, usecols=(0, 1, 2, 3), unpack=True)
    return {"t": t, "theta": np.radians(angle), "theta_dot": np.radians(rate), "beta_cmd": command}


def tail_sitter(path: Path) -> Columns:
    """Roll of a hovering tail-sitter: attitude by motion capture, actuator control without unit."""
    from scipy.io import loadmat
    flight = loadmat(path)
    return {"t": flight["time"].ravel(), "theta": flight["local_attitude"][:, 0],
            "beta_cmd": flight["actuator_controls"][:, 0]}


def hobby_rocket(path: Path) -> Columns:
    """Thrust-vectored rocket: the gyro's axes lie 45 degrees from the nozzle's (our reading), commands in degrees."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    t = 1e-3 * (table[:, 0] - table[0, 0])
    burns = (t >= BURN[0]) & (t <= BURN[1])
    rate = np.radians(table[:, 8] + table[:, 9]) / np.sqrt(2.0)
    return {"t": t[burns] - BURN[0], "theta_dot": rate[burns], "beta_cmd": np.radians(table[:, 2])[burns]}


def aeropendulum(path: Path) -> Columns:
    """tempo_ms, angulo_deg, u_pct: 0 is hanging down."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    return {"t": 1e-3 * table[:, 0], "theta": np.radians(table[:, 1]), "beta_cmd": table[:, 2] / 100.0}


def sounding_rocket(path: Path) -> Columns:
    """time, accelerometer, roll gyro, fin servo's command [counts]."""
    t, gyro, fin = np.loadtxt(path, delimiter=",", usecols=(0, 2, 3), unpack=True)
    coasts = (t >= COAST[0]) & (t <= COAST[1])
    return {"t": t[coasts] - COAST[0], "theta_dot": GYRO_SCALE * (gyro[coasts] - GYRO_ZERO),
            "beta_cmd": (fin[coasts] - FIN_ZERO) / FIN_THROW}


SOURCES: dict[str, tuple[str, str, Callable[[Path], Columns]]] = {  # log: repository and path, file name in RAW, reader
    "mcar_8_3_1": ("dongdaming1966/mcar_simulate data/8_3_1.dat", "8_3_1.dat", mcar),
    "tailsitter_stabilized_1": ("RockyJBL/Tailsitter-hovering-dataset dataset/manual_stabilized_1.mat",
                                "manual_stabilized_1.mat", tail_sitter),
    "tailsitter_step_size3_1": ("RockyJBL/Tailsitter-hovering-dataset dataset/step_size3_1.mat", "step_size3_1.mat",
                                tail_sitter),
    "ubc_tvc": ("UBC-Rocket/Thrust-Vectoring-II Simulation/flight-data-based-simulation/flight_data-08-06-2025.csv",
                "flight_data-08-06-2025.csv", hobby_rocket),
    "psas_roll": ("psas/flight_data-2010.10.17 roll/raw/output_trim.csv", "output_trim.csv", sounding_rocket),
    "aeropendulum_aprbs_1": ("FelipeEduardoMarcondes/SYSTEM-IDENTIFICATION-AERO experimentos/aprbs-1_0819_18-48.csv",
                             "aprbs-1_0819_18-48.csv", aeropendulum),
}


def write(path: Path, columns: Columns) -> None:
    """A log's CSV."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    write_text(path, [",".join(columns) + "\n", *(",".join(map(repr, row)) + "\n" for row in rows)])


def main() -> None:
    """Convert what is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raw", type=Path)
    parser.add_argument("out", type=Path)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name, (source, file, reader) in SOURCES.items():
        if not (args.raw / file).is_file():
            print(f"{name}: {file} is not there; fetch it from {source}")
            continue
        columns = reader(args.raw / file)
        write(args.out / f"{name}.csv", columns)
        print(f"{name}: {len(columns['t'])} rows, {', '.join(columns)}")


if __name__ == "__main__":
    main()

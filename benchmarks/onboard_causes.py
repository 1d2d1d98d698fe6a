"""Fly each cause of the catalogue with the cause in the nominal, and count what the estimator makes of it on board.

    python benchmarks/onboard_causes.py [--flights 6] [--seed 7300] [--nominal constant vega_like] [--cause NAME ...]

For each cause: the share of 5 s windows OK over the clean share of the same seeds, the share of the OK windows whose
95 % intervals hold a6 and k1, the largest error in standard deviations.  Flights of `simulate`: a6 and k1 off by up to
25 % each (uniform), the nominal's noise, rate and duration; seeds SEED, SEED + 1, ...: nothing was chosen on them.
"""

import argparse
import dataclasses

import numpy as np

from launchid.identification.windows import run
from launchid.judge.refusal import withdrawn
from launchid_core import Config, Estimate
from sim.effects import from_text
from sim.errors import InputError
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model

WINDOW = 5.0    # s
SPREAD = 0.25   # of a6 and k1, uniform
CAUSES = (
    "control_effectiveness:scale=0.85", "control_loss:fraction=0.3,time=31.3", "aero_instability:scale=1.2",
    "aero_damping:coefficient=0.2", "aero_cubic:coefficient=15", "friction:coefficient=0.02",
    "thrust_misalignment:angle=0.005", "slosh:coupling=0.05,frequency=3.5,damping_ratio=0.01",
    "bending:gain=0.02,frequency=20,damping_ratio=0.01", "missing_term:term=theta^2,coefficient=8",
    "moment_step:acceleration=0.05,time=33.3", "nozzle_inertia:coefficient=-0.02", "control_slope:slope=0.004",
    "lateral_drift:z_alpha=0.05,z_beta=-0.1", "gust:angle=0.03,time=30,duration=4", "steady_wind:angle=0.02",
    "periodic_disturbance:amplitude=0.04,frequency=3,phase=0.4", "turbulence:level=0.01,time_constant=1.5",
    "wind_walk:level=0.005", "actuator_delay:delay=0.03", "actuator_bandwidth:scale=0.6",
    "actuator_bandwidth:scale=0.6,lag=1", "actuator_gain:scale=0.9", "actuator_rate_limit:rate=0.08",
    "actuator_backlash:half_width=0.002", "actuator_bias:angle=0.01", "input_washout:time_constant=20",
    "attitude_bias:angle=0.01", "attitude_delay:delay=0.03", "gyro_bias:rate=0.01", "gyro_scale:scale=1.1",
    "gyro_delay:delay=0.03", "nozzle_sensor_bias:angle=0.01", "controller_mismatch:kp_scale=1.2,delay=0.02")


def estimates_of(flown: Nominal, declared: Nominal, seed: int) -> tuple[Flight, list[Estimate]]:
    """Return a flight with a6 and k1 off, and what the estimator says of it."""
    draw = np.random.default_rng((5, seed)).uniform(-SPREAD, SPREAD, 2)
    flight = fly_whole(flown, seed, a6_factor=1.0 + draw[0], k1_factor=1.0 + draw[1])
    config = Config(window=WINDOW, sample_period=flight.period, formulation="filtered",
                    model=onboard_model(declared, flight.period))
    return flight, withdrawn(run(config, flight.rows())[0])


def windows_of(nominal: Nominal, seeds: range) -> np.ndarray:
    """Return (windows, 3): 1 if OK, errors of a6 and k1 in standard deviations; of all flights."""
    return np.concatenate([judged(*estimates_of(nominal, nominal, seed)) for seed in seeds])


def judged(flight: Flight, found: list[Estimate]) -> np.ndarray:
    rows = []
    for e in found:
        k = int(np.argmin(np.abs(flight.t - 0.5 * (e.t_start + e.t_end))))
        rows.append((float(e.valid), (e.a6 - flight.a6[k]) / e.a6_std, (e.k1 - flight.k1[k]) / e.k1_std))
    return np.array(rows)


def line(name: str, rows: np.ndarray, clean: float) -> str:
    """Return a row of the table."""
    ok = rows[rows[:, 0] == 1.0, 1:3]
    if not len(ok):
        return f"| {name} | 0 of {len(rows)} | - | - | - |"
    held = np.mean(np.abs(ok) < 1.96, axis=0)
    return (f"| {name} | {len(ok)} of {len(rows)}, {rows[:, 0].mean() / clean:.2f} | {held[0]:.2f} | {held[1]:.2f} | "
            f"{np.abs(ok).max():.1f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cause", nargs="*", default=[])
    parser.add_argument("--flights", type=int, default=6)
    parser.add_argument("--seed", type=int, default=7300)
    parser.add_argument("--nominal", nargs="+", default=["constant", "vega_like"])
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.flights)
    chosen = [text for text in CAUSES if not given.cause or text.split(":")[0] in given.cause]
    for name in given.nominal:
        nominal = load_nominal(name)
        clean = windows_of(nominal, seeds)
        print(f"{name}\n| cause | windows OK, over clean | hold a6 | hold k1 | largest |\n|---|---|---|---|---|")
        print(line("none", clean, clean[:, 0].mean()))
        for text in chosen:
            try:
                rows = windows_of(dataclasses.replace(nominal, effects=(from_text(text),)), seeds)
            except InputError as error:
                print(f"| `{text}` | refused: {str(error).split('; ')[-1]} | | | |")
                continue
            print(line(f"`{text}`", rows, clean[:, 0].mean()), flush=True)


if __name__ == "__main__":
    main()

"""Fly each cause of the catalogue with the cause in the nominal, and count what the estimator makes of it on board.

    python benchmarks/onboard_causes.py [--flights 6] [--seed 7300] [--nominal constant vega_like] [--cause NAME ...]
    python benchmarks/onboard_causes.py --modes [--flights 6] [--seed 7300] [--nominal constant vega_like]

For each cause: the share of 5 s windows OK over the clean share of the same seeds, the share of the OK windows whose
95 % intervals hold a6 and k1, the largest error in standard deviations.  Flights of `simulate`: a6 and k1 off by up to
25 % each (uniform), the nominal's noise, rate and duration; seeds SEED, SEED + 1, ...: nothing was chosen on them.

--modes: slosh and bending whose frequency is declared to 10 %, size to 50 % (one sigma each, drawn, cut at 2); the
width over the clean one; of the modes that are proven (a reported frequency that is not the declared one) the median
standard deviation of frequency and size, and the share of 95 % intervals that hold them, from 20 s on.
"""

import argparse
import dataclasses
from typing import Any

import numpy as np

from launchid.identification.windows import run
from launchid.judge.refusal import withdrawn
from launchid_core import Config, Estimate
from sim.effects import from_text
from sim.errors import InputError
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model
from sim.sections import Bending, Slosh, constant

WINDOW = 5.0    # s
SPREAD = 0.25   # of a6 and k1, uniform
SIGMA = (0.1, 0.5)  # of a mode's frequency and size
DAMPING = 0.01
SETTLED = 20.0  # s
Pairs = tuple[tuple[float, float], ...]  # of a mode: frequency [rad/s], coupling or gain
MODES: tuple[tuple[Pairs, Pairs], ...] = (
    (((3.46, 0.02),), ()), (((3.46, 0.05),), ()), (((3.46, 0.1),), ()), ((), ((18.85, 0.005),)), ((), ((18.85, 0.02),)),
    ((), ((37.7, 0.002),)), ((), ((37.7, 0.01),)), (((3.46, 0.05),), ((18.85, 0.02),)),
    (((3.46, 0.05), (6.0, 0.03)), ((18.85, 0.02),)))
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
    """Return (windows, 4): 1 if OK, errors of a6 and k1 in standard deviations, width of a6; of all flights."""
    return np.concatenate([judged(*estimates_of(nominal, nominal, seed)) for seed in seeds])


def judged(flight: Flight, found: list[Estimate]) -> np.ndarray:
    rows = []
    for e in found:
        k = int(np.argmin(np.abs(flight.t - 0.5 * (e.t_start + e.t_end))))
        rows.append((float(e.valid), (e.a6 - flight.a6[k]) / e.a6_std, (e.k1 - flight.k1[k]) / e.k1_std, e.a6_std))
    return np.array(rows)


def drawn(kind: type, frequency: float, size: float, rng: np.random.Generator) -> tuple[Any, Any]:
    """Return a mode as flown and as declared."""
    name = "coupling" if kind is Slosh else "gain"
    off = 1.0 + np.array(SIGMA) * np.clip(rng.standard_normal(2), -2.0, 2.0)
    return (kind(frequency=constant(frequency * off[0]), damping_ratio=constant(DAMPING),
                 **{name: constant(size * off[1])}),
            kind(frequency=constant(frequency), damping_ratio=constant(DAMPING), frequency_sigma=SIGMA[0],
                 **{name: constant(size), f"{name}_sigma": SIGMA[1]}))


def modes_line(nominal: Nominal, slosh: Pairs, bending: Pairs, seeds: range, clean: np.ndarray) -> str:
    """Return a row of the table of modes."""
    rows, told = [], []
    for seed in seeds:
        rng = np.random.default_rng((6, seed))
        modes = {"slosh": [drawn(Slosh, *each, rng) for each in slosh],
                 "bending": [drawn(Bending, *each, rng) for each in bending]}
        flown, declared = (dataclasses.replace(nominal, **{kind: tuple(pair[k] for pair in each)
                                                           for kind, each in modes.items()}) for k in range(2))
        flight, found = estimates_of(flown, declared, seed)
        rows.append(judged(flight, found))
        for e in found:
            for mode, (true, known) in zip(e.modes, modes["slosh"] + modes["bending"], strict=True):
                size = true.coupling if isinstance(true, Slosh) else true.gain
                w, z = true.frequency.value[0], size.value[0]
                if e.t_end > SETTLED and mode.frequency_std > 0.0 and mode.frequency != known.frequency.value[0]:
                    told.append(((mode.frequency - w) / mode.frequency_std, (mode.size - z) / mode.size_std,
                                 mode.frequency_std / w, mode.size_std / abs(z)))
    name = "; ".join(f"{kind} {', '.join(f'{w:g} rad/s {size:g}' for w, size in each)}"
                     for kind, each in (("slosh", slosh), ("bending", bending)) if each)
    all_rows = np.concatenate(rows)
    ok = all_rows[all_rows[:, 0] == 1.0]
    held = np.mean(np.abs(ok[:, 1:3]) < 1.96, axis=0)
    wide = np.median(ok[:, 3]) / np.median(clean[clean[:, 0] == 1.0, 3])
    largest = np.abs(ok[:, 1:3]).max()
    said = (f"| {name} | {len(ok)} of {len(all_rows)} | {held[0]:.2f} | {held[1]:.2f} | {largest:.1f} | "
            f"{wide:.2f} |")
    if not told:
        return f"{said} - | - | - | - |"
    off = np.array(told)
    frequency, size = np.mean(np.abs(off[:, :2]) < 1.96, axis=0)
    return f"{said} {np.median(off[:, 2]):.4f} | {frequency:.2f} | {np.median(off[:, 3]):.3f} | {size:.2f} |"


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
    parser.add_argument("--modes", action="store_true")
    parser.add_argument("--flights", type=int, default=6)
    parser.add_argument("--seed", type=int, default=7300)
    parser.add_argument("--nominal", nargs="+", default=["constant", "vega_like"])
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.flights)
    chosen = [text for text in CAUSES if not given.cause or text.split(":")[0] in given.cause]
    for name in given.nominal:
        nominal = load_nominal(name)
        clean = windows_of(nominal, seeds)
        if given.modes:
            print(f"{name}\n| modes | OK | hold a6 | hold k1 | largest | width | frequency std | hold | size std "
                  "| hold |\n|---|---|---|---|---|---|---|---|---|---|")
            print(line("none", clean, clean[:, 0].mean()))
            for slosh, bending in MODES:
                print(modes_line(nominal, slosh, bending, seeds, clean), flush=True)
            continue
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

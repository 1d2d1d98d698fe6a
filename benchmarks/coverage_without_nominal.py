"""Coverage of the 95 % intervals of windows that know no nominal, over noises of the gyro and disturbances.

    python benchmarks/coverage_without_nominal.py [--flights 60] [--seed 0]

Flights of the built-in nominal `constant` (60 s, its other noises as they are) with 3 gyros and 3 levels of unmodelled
moments, in windows of 2, 5 and 10 s. Per line: the share of windows that are OK, the share of their intervals (+- 1.96
standard deviations) of a6 and k1 that hold the truth, the rms of the errors over the standard deviations, the median
standard deviation over the value.
"""

import argparse
import dataclasses

import numpy as np

from launchid.commands.identify import identify
from launchid.log.log import flown_log
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

GYROS = (1e-4, 5e-4, 2e-3)           # rad/s
DISTURBANCES = (2e-4, 2e-3, 2e-2)    # rad/s^2, one draw per controller period
WINDOWS = (2.0, 5.0, 10.0)           # s
SECONDS = 60.0
INTERVAL = 1.96


def noisy(gyro: float, disturbance: float) -> Nominal:
    """Return the nominal with these levels."""
    nominal = load_nominal("constant")
    assert nominal.simulation is not None
    return dataclasses.replace(
        nominal, sensors=dataclasses.replace(nominal.sensors, theta_dot_std=gyro),
        simulation=dataclasses.replace(nominal.simulation, duration=SECONDS, acceleration_noise_std=disturbance))


def main() -> None:
    """Print the table."""
    words = argparse.ArgumentParser(description="coverage of windows without a nominal")
    words.add_argument("--flights", type=int, default=60)
    words.add_argument("--seed", type=int, default=0)
    args = words.parse_args()
    for gyro in GYROS:
        for disturbance in DISTURBANCES:
            nominal = noisy(gyro, disturbance)
            logs = [flown_log(fly_whole(nominal, args.seed + k)) for k in range(args.flights)]
            for window in WINDOWS:
                told = [w for log in logs for w in identify(log, window=window).report["windows"]]
                ok = [w for w in told if w["valid"]]
                off = np.array([[(w["a6"] - nominal.vehicle.a6[0]) / w["a6_std"],
                                 (w["k1"] - nominal.vehicle.k1[0]) / w["k1_std"]] for w in ok]).reshape(-1, 2)
                std = np.array([[w["a6_std"] / abs(w["a6"]), w["k1_std"] / abs(w["k1"])] for w in ok]).reshape(-1, 2)
                held, rms = np.mean(np.abs(off) < INTERVAL, axis=0), np.sqrt(np.mean(off**2, axis=0))
                worst, usual = np.max(np.abs(off), axis=0), np.median(std, axis=0)
                print(f"gyro {gyro:<6g} disturbance {disturbance:<6g} {window:>4g} s  OK {len(ok) / len(told):>6.1%}  "
                      f"covers a6 {held[0]:.3f} k1 {held[1]:.3f}  rms {rms[0]:.2f} {rms[1]:.2f}  worst {worst[0]:.1f} "
                      f"{worst[1]:.1f}  std {usual[0]:.3f} {usual[1]:.3f}", flush=True)


if __name__ == "__main__":
    main()

"""Coverage of the 95 % intervals of windows that know no nominal, over noises of the gyro and disturbances.

    python benchmarks/coverage_without_nominal.py [--flights 60] [--seed 0] [--command]

Flights of the built-in nominal `constant` (60 s, its other noises as they are) with 3 gyros and 3 levels of unmodelled
moments, in windows of 2, 5 and 10 s. Per line: the share of windows that are OK, the share of their intervals (+- 1.96
standard deviations) of a6 and k1 that hold the truth, the rms of the errors over the standard deviations, the median
standard deviation over the truth. --command: of logs without a nozzle, whose beta is the command.
"""

import dataclasses

import numpy as np
from flights import INTERVAL, Table, arguments, relative, run_jobs

from launchid.commands.identify import identify
from launchid.log.log import flown_log, log_of
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

GYROS = (1e-4, 5e-4, 2e-3)           # rad/s
DISTURBANCES = (2e-4, 2e-3, 2e-2)    # rad/s^2, one draw per controller period
WINDOWS = (2.0, 5.0, 10.0)           # s
SECONDS = 60.0


def noisy(gyro: float, disturbance: float) -> Nominal:
    """Return the nominal `constant` with these noises: gyro [rad/s], unmodelled acceleration [rad/s^2]."""
    nominal = load_nominal("constant")
    return dataclasses.replace(
        nominal, sensors=dataclasses.replace(nominal.sensors, theta_dot_std=gyro),
        simulation=dataclasses.replace(nominal.simulation, duration=SECONDS, acceleration_noise_std=disturbance))


def job(gyro: float, disturbance: float, seed: int, is_command: bool) -> list[tuple[int, np.ndarray]]:
    """Fly once; return, for each window length, the number of windows, and `relative` (n, 4) of the OK ones."""
    nominal = noisy(gyro, disturbance)
    log, a6, k1 = flown_log(fly_whole(nominal, seed)), nominal.vehicle.a6[0], nominal.vehicle.k1[0]
    if is_command:
        log = log_of({"t": log.t, "theta": log.theta, "theta_dot": log.theta_dot, "beta": log.beta_cmd})
    made = []
    for window in WINDOWS:
        estimates = identify(log, window=window).estimates
        ok = [each for each in estimates if each.valid]
        made.append((len(estimates), relative(ok, np.full(len(ok), a6), np.full(len(ok), k1))))
    return made


def main() -> None:
    """Print the table."""
    args = arguments(__doc__, flights=60, seed=0, command=False)
    table = Table("gyro 6g", "disturbance 6g", "window 5g", "OK 6.1%", "a6 covers 5.3f", "k1 5.3f", "rms a6 5.2f",
                  "k1 5.2f", "worst a6 5.1f", "k1 5.1f", "std a6 5.3f", "k1 5.3f")
    for gyro in GYROS:
        for disturbance in DISTURBANCES:
            flights = run_jobs(job, [(gyro, disturbance, seed, args.command) for seed in args.seeds])
            for window, of_window in zip(WINDOWS, zip(*flights, strict=True), strict=True):
                rows = np.concatenate([each for _, each in of_window])
                if not len(rows):   # none is OK
                    continue
                off, std = np.abs(rows[:, :2] / rows[:, 2:]), rows[:, 2:]
                table.row(gyro, disturbance, window, len(rows) / sum(count for count, _ in of_window),
                          *np.mean(off < INTERVAL, axis=0), *np.sqrt(np.mean(off**2, axis=0)), *np.max(off, axis=0),
                          *np.median(std, axis=0))


if __name__ == "__main__":
    main()

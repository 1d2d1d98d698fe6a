"""The false alarms of the model's check at every rate: clean flights, at 25 to 400 Hz.

    python benchmarks/rates.py [--flights 100] [--seed 7000] [--window 5] [--nominal NAME] [--rate HZ] [--loop HZ]

Each nominal flies undispersed, controller and sensors at the rate, under its own noises, and is told the truth.
--loop: the controller's rate, where the log's is a lower one, which misses commands.
Counted: windows that are MODEL, and flights with one.  Demanded: 1 % of windows.
Of the others, how often the 95 % intervals of a6 and k1 hold the truth, window by window and tracked.
"""

import sys

import numpy as np
from flights import INTERVAL, Table, arguments, at_rate, estimates_of, nominal, relative, run_jobs

from launchid_core import EstimateStatus
from sim.flight import fly_whole
from sim.plant import parameters

RATES = [25.0, 50.0, 100.0, 200.0, 400.0]  # Hz
DEMAND = 0.01


def job(name: str, rate: float, seed: int, window: float, loop: float) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Fly once; return the number of windows, of those MODEL, errors over std (n, 2) of valid windows, of tracked."""
    believed = at_rate(nominal(name), loop or rate)
    flight = fly_whole(believed, seed, period=1.0 / rate if loop else None)
    estimates = estimates_of(flight, believed, window)
    windows = [(0.5 * (e.t_start + e.t_end), e) for e in estimates if e.valid]
    tracked = [(e.t_end, e.tracked) for e in estimates if e.tracked is not None and e.tracked.valid]
    scaled = []
    for of in (windows, tracked):
        table = relative([each for _, each in of], *parameters(believed, np.array([t for t, _ in of])))
        scaled.append(table[:, :2] / table[:, 2:])
    return len(estimates), sum(e.status == EstimateStatus.MODEL for e in estimates), *scaled


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    args = arguments(__doc__, flights=100, seed=7000, window=5.0, rate=RATES, loop=0.0)
    table = Table("nominal 16", "Hz 5g", "windows 8d", "MODEL 6d", "share 7.4f", "flights 8d", "cover 6.3f",
                  "tracked 7.3f")
    for name in args.nominal:
        for rate in args.rate:
            made = run_jobs(job, [(name, rate, seed, args.window, args.loop) for seed in args.seeds])
            windows, model = sum(each[0] for each in made), sum(each[1] for each in made)
            cover = [np.mean(np.abs(np.concatenate([each[k] for each in made])) < INTERVAL) for k in (2, 3)]
            table.row(name, rate, windows, model, model / windows, sum(each[1] > 0 for each in made), *cover,
                      good=model <= DEMAND * windows)
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main())

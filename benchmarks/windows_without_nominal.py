"""Coverage of the 95 % intervals of windows that know no nominal, on clean flights of the built-in nominals.

    python benchmarks/windows_without_nominal.py [--flights 10] [--seed 0] [--formulation integral]

Per nominal and window: the share of windows that are valid, the share refused by each reason, and of the valid ones the
share of intervals (+- 1.96 standard deviations) of a6 and k1 that hold the truth at the window's centre, the median
relative standard deviation and the median absolute relative error.  `flight` suite, 100 Hz, library `rigid-body`.
"""

import argparse
from collections import Counter

import numpy as np

from launchid.identification.windows import run
from launchid_core import Config
from sim.flight import fly_whole, parameters
from sim.nominal import load_nominal

NOMINALS = ("constant", "vega_like", "greensite_cr826")
WINDOWS = (1.0, 5.0, 10.0)
INTERVAL = 1.96


def rows(name: str, window: float, formulation: str, seeds: range) -> tuple[np.ndarray, Counter[str]]:
    """(n, 4) errors and standard deviations of a6 and k1 over the truth, of valid windows; all windows' statuses."""
    nominal, table, status = load_nominal(name), [], Counter[str]()
    for seed in seeds:
        flight = fly_whole(nominal, seed)
        config = Config(window=window, sample_period=flight.period, formulation=formulation)
        estimates, _ = run(config, flight.rows())
        truth = parameters(nominal, np.array([0.5 * (e.t_start + e.t_end) for e in estimates]))
        for e, a6, k1 in zip(estimates, *truth, strict=True):
            status[e.status.name] += 1
            if e.valid:
                table.append((e.a6 / a6 - 1.0, e.k1 / k1 - 1.0, e.a6_std / abs(a6), e.k1_std / abs(k1)))
    return np.array(table).reshape(len(table), 4), status


def main() -> None:
    """Print the table."""
    words = argparse.ArgumentParser(description="coverage of windows without a nominal")
    words.add_argument("--flights", type=int, default=10)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--formulation", default="integral", choices=["difference", "integral"])
    args = words.parse_args()
    for name in NOMINALS:
        for window in WINDOWS:
            table, status = rows(name, window, args.formulation, range(args.seed, args.seed + args.flights))
            total = sum(status.values())
            held = np.mean(np.abs(table[:, :2]) < INTERVAL * table[:, 2:], axis=0)
            std, error = np.median(table[:, 2:], axis=0), np.median(np.abs(table[:, :2]), axis=0)
            said = ", ".join(f"{reason} {n / total:.1%}" for reason, n in status.most_common())
            print(f"{name:<16} {window:>4g} s  covers a6 {held[0]:.3f} k1 {held[1]:.3f}  "
                  f"std {std[0]:.3f} {std[1]:.3f}  error {error[0]:.3f} {error[1]:.3f}  {total} windows: {said}")


if __name__ == "__main__":
    main()

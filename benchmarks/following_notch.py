"""Flights lost with a notch that is fixed and with one that follows the tracked bending frequency.

    python benchmarks/following_notch.py [--flights 200] [--seed 40000] [--figure FILE.png]

The launcher of `cr826_max_q` (first bending mode, two slosh masses; sources in sim/data/profiles/SOURCES.md), 60 s at
100 Hz, `flight` suite, wind and offsets drawn. Drawn uniformly: the bending frequency, up to 25 % off the declared
one; a6 and k1, up to the nominal's 10 % off. Bending gain, slosh and damping are drawn with the sigmas that the nominal
declares. The estimator on board believes the nominal.

fixed    the nominal's notch, at the declared frequency
follows  the nominal's: where the estimator on board tracks the mode, at most 30 % off
knows    fixed at the true frequency: no estimator does better

Demanded of the notch that follows: at most 1 % of the flights are lost that `knows` keeps.
Tracked: median and largest error of the centre, relative, over the flights' second halves.
"""

import dataclasses
import itertools
import math
import sys
from typing import Any
from unittest import mock

import numpy as np
from flights import Table, arguments, nominal, run_jobs

from sim import following
from sim.disturbance_draws import drawn_modes
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal
from sim.plant import dispersion
from sim.sections import constant

LAUNCHER = "cr826_max_q"
MOST_OFF = 0.25     # of the bending frequency
MOST_LOST = 0.01
EDGES = np.array([-0.25, -0.15, -0.05, 0.05, 0.15, 0.25])
SHOWN_OFF = 0.15    # of the flight in the figure
NOTCHES = ("fixed", "follows", "knows")


def fixed(believed: Nominal) -> Nominal:
    """Return the nominal with notches that stand at their declared frequencies."""
    controller = believed.controller
    return dataclasses.replace(believed, controller=dataclasses.replace(
        controller, filters=tuple(dataclasses.replace(each, follow=None) for each in controller.filters)))


def vehicle(believed: Nominal, seed: int, off: float) -> Nominal:
    """Return a nominal whose modes are drawn, the bending frequency `off` the declared one."""
    drawn = drawn_modes(believed, seed)
    own = dataclasses.replace(drawn.bending[0],
                              frequency=constant((1.0 + off) * believed.bending[0].frequency.value[0]))
    return dataclasses.replace(drawn, bending=(own,))


def fly(believed: Nominal, notch: str, seed: int, off: float) -> tuple[Flight, np.ndarray]:
    """Fly once with a notch of NOTCHES; return the flight and (n, 2) times [s] and centres [rad/s] of the one that
    follows."""
    true = vehicle(believed, seed, off)
    if notch != "follows":
        true = fixed(true)
    if notch == "knows":
        own = believed.controller.following({"bending1": true.bending[0].frequency.value[0]})
        true = dataclasses.replace(true, controller=fixed(dataclasses.replace(believed, controller=own)).controller)
    delta = np.random.default_rng((931, seed)).uniform(-1.0, 1.0, 2).tolist()
    centres: list[tuple[float, float]] = []
    tune = following.tune

    def noted(moved: Any, filters: Any) -> None:
        state = moved.flight[0]
        centres.append((float(state.at) * float(state.step), centre_of(filters[0], believed.controller.period)))
        tune(moved, filters)

    with mock.patch.object(following, "tune", noted):
        flight = fly_whole(true, seed, a6_factor=dispersion(believed, *delta)[0],
                           k1_factor=dispersion(believed, *delta)[1], believed=believed)
    return flight, np.array(centres).reshape(-1, 2)


def centre_of(section: Any, period: float) -> float:
    """Return the centre [rad/s] of a notch by Tustin's rule, prewarped: cos(w T) of b1/(b0 + b2) = -cos(w T)."""
    return math.acos(-section.b[1] / (section.b[0] + section.b[2])) / period


def job(seed: int) -> tuple[float, list[bool], np.ndarray]:
    """Return how far the bending frequency is off, whether each of NOTCHES loses the flight, and errors of the
    centre."""
    believed = nominal(LAUNCHER)
    off = float(np.random.default_rng((930, seed)).uniform(-MOST_OFF, MOST_OFF))
    lost, errors = [], np.zeros(0)
    for notch in NOTCHES:
        flight, centres = fly(believed, notch, seed, off)
        lost.append(flight.lost)
        if notch == "follows" and not flight.lost:
            late = centres[centres[:, 0] > 0.5 * believed.simulation.duration, 1]
            errors = late / ((1.0 + off) * believed.bending[0].frequency.value[0]) - 1.0
    return off, lost, errors


def draw(path: str, off: np.ndarray, lost: np.ndarray, seed: int) -> None:
    """Draw the lost flights by offset, and one flight with the notch fixed and following."""
    import matplotlib.pyplot as plt
    believed = nominal(LAUNCHER)
    declared = believed.bending[0].frequency.value[0]
    figure, (left, right, below) = plt.subplots(1, 3, figsize=(12.0, 3.6), layout="constrained")
    figure.get_layout_engine().set(wspace=0.05)
    share = [[100.0 * lost[(low <= off) & (off < high), k].mean() for low, high in itertools.pairwise(EDGES)]
             for k in range(2)]
    middle, width = 50.0 * (EDGES[1:] + EDGES[:-1]), 4.0
    colours = ("tab:red", "tab:blue")
    for k, name in enumerate(("fixed notch", "notch that follows")):
        bars = left.bar(middle + (k - 0.5) * width, share[k], 0.9 * width, color=colours[k], label=name)
        left.bar_label(bars, fmt="%.0f", fontsize=8)
    left.set(title=f"Flights lost, of {len(off)} [%]", xlabel="bending frequency off the declared one [%]",
             ylim=(0.0, 110.0), xticks=100.0 * EDGES)
    left.legend(loc="upper left", frameon=False)
    for notch, colour in (("fixed", colours[0]), ("follows", colours[1])):
        flight, centres = fly(believed, notch, seed, SHOWN_OFF)
        below.plot(flight.t, np.degrees(flight.beta), color=colour, lw=0.7,
                   label="fixed: lost" if flight.lost else "follows")
        t, at = (centres.T if notch == "follows" else (np.array([0.0, believed.simulation.duration]),
                                                       np.full(2, declared)))
        right.step(np.append(0.0, t), np.append(declared, at), where="post", color=colour, label=notch)
    right.axhline((1.0 + SHOWN_OFF) * declared, color="k", ls=":", lw=1.0, label="the mode's")
    right.set(title=f"Notch's centre [rad/s], mode {100.0 * SHOWN_OFF:g} % off", xlabel="t [s]",
              ylim=(declared - 2.0, (1.0 + SHOWN_OFF) * declared + 2.0))
    right.legend(frameon=False, loc="center right")
    below.set(title="Nozzle angle of the same flights [deg]", xlabel="t [s]")
    below.legend(frameon=False, loc="upper right")
    figure.savefig(path, dpi=110)


def main() -> int:
    """Fly, print the table, draw."""
    args = arguments(__doc__, flights=200, seed=40000, figure="")
    made = run_jobs(job, [(seed,) for seed in args.seeds])
    off, lost = np.array([each[0] for each in made]), np.array([each[1] for each in made])
    print(f"{LAUNCHER}, {len(made)} flights, seeds {args.seed} to {args.seed + args.flights - 1}")
    table = Table("bending off [%] 16", "flights 7d", *(f"{name} 7d" for name in NOTCHES))
    for low, high in itertools.pairwise(EDGES):
        inside = (low <= off) & (off < high)
        table.row(f"{100 * low:g} to {100 * high:g}", int(inside.sum()), *lost[inside].sum(axis=0).tolist())
    more = int((lost[:, 1] & ~lost[:, 2]).sum())
    table.row("all", len(made), *lost.sum(axis=0).tolist(), good=more <= MOST_LOST * len(made))
    errors = np.abs(np.concatenate([each[2] for each in made]))
    print(f"tracked: median error of the centre {100 * np.median(errors):.2f} %, largest {100 * errors.max():.2f} %, "
          f"within 3 % {100 * np.mean(errors < 0.03):.2f} % of the time")
    if args.figure:
        draw(args.figure, off, lost, args.seed)
    return table.missed > 0


if __name__ == "__main__":
    sys.exit(main())

"""Slosh and bending that no nominal declares: are their logs refused, and what is answered, does it hold?

    python benchmarks/undeclared_modes.py [--flights 8] [--seed 91000] [--nominal NAME] [--cell NAME]

Flights of `simulate` with a mode, identified by the nominal without it, in 5 s windows, 100 Hz; the nominal's noises
and duration, a6 and k1 up to 25 % off (uniform), the mode's frequency up to 20 % off what the cell says (uniform),
damping ratio 0.01.  Bending is as large as it shows: its gain puts this share of the rigid body's rms rate into the
gyro.  Seeds SEED, SEED + 1, ..., on which nothing was chosen.  Printed: the share of windows OK, of these the share of
95 % intervals that hold a6 and k1, and the largest error in standard deviations; the same of the tracked estimates.

Asked: of bending at most 1 % of windows OK, of slosh in calm air that the OK ones hold at least 0.90.
"""

import dataclasses
import functools
import math
import warnings

import numpy as np
from flights import INTERVAL, Table, arguments, in_air, nominal, run_jobs

import launchid
from sim.effects import effect
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal

WINDOW = 5.0      # s
SPREAD = 0.25     # of a6 and k1, uniform
OFF = 0.2         # of a mode's frequency, uniform
DAMPING = 0.01
LOGGED = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot")
MOST_OK, HELD_LEAST = 0.01, 0.90
# cell -> (air, kind, frequency [rad/s], share of the rigid rate or coupling)
CELLS = {"none": ("calm", "slosh", 3.5, 0.0),
         **{f"bending {hz:g} Hz {100 * share:g} % {air}": (air, "bending", 2.0 * math.pi * hz, share)
            for air in ("calm", "wind") for hz in (3.0, 6.0) for share in (0.05, 0.1, 0.3)},
         **{f"slosh {100 * coupling:g} %": ("calm", "slosh", 3.5, coupling) for coupling in (0.02, 0.05, 0.1)}}


@functools.cache
def gain_of(name: str, frequency: float, share: float) -> float:
    """Return the gain at which bending shows `share` of the rms rate of a nominal's flight without it, in calm air."""
    flight = fly_whole(nominal(name), 0)
    n = 2 * len(flight.t)   # what rings on after the flight does not come back at its beginning
    omega = 2.0 * math.pi * np.fft.rfftfreq(n, flight.period)
    response = 1j * omega / (1.0 - (omega / frequency) ** 2 + 2j * DAMPING * omega / frequency)
    rate = np.fft.irfft(response * np.fft.rfft(flight.beta, n), n)[:len(flight.t)]
    return share * float(np.std(flight.theta_dot) / np.std(rate))


def with_mode(name: str, believed: Nominal, cell: str, seed: int) -> Nominal:
    """Return the nominal with the cell's mode."""
    _, kind, frequency, size = CELLS[cell]
    if size == 0.0:
        return believed
    frequency *= 1.0 + float(np.random.default_rng((941, seed)).uniform(-OFF, OFF))
    given = {"coupling": size} if kind == "slosh" else {"gain": gain_of(name, frequency, size)}
    return dataclasses.replace(believed, effects=(*believed.effects, effect(
        kind, frequency=frequency, damping_ratio=DAMPING, **given)))


def errors(name: str, cell: str, seed: int) -> dict[str, np.ndarray] | None:
    """Return of one flight `windows` (k, 3): 1 if OK, errors of a6 and k1 over their deviations; `tracked` (k, 2)
    errors; None if it is lost."""
    believed = in_air(nominal(name), CELLS[cell][0])
    draw = np.random.default_rng((942, seed)).uniform(-SPREAD, SPREAD, 2)
    flight = fly_whole(with_mode(name, believed, cell, seed), seed, a6_factor=1.0 + draw[0], k1_factor=1.0 + draw[1])
    if flight.lost:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = launchid.identify({each: getattr(flight, each) for each in LOGGED}, nominal=believed, window=WINDOW,
                                 tracked=True)
    return {"windows": np.reshape([(float(e.valid), *off(flight, e, 0.5 * (e.t_start + e.t_end)))
                                   for e in made.estimates], (-1, 3)),
            "tracked": np.reshape([off(flight, e.tracked, e.t_end) for e in made.estimates
                                   if e.tracked is not None and e.tracked.valid], (-1, 2))}


def off(flight: Flight, e, t: float) -> tuple[float, float]:
    k = int(np.argmin(np.abs(flight.t - t)))
    return (e.a6 - flight.a6[k]) / e.a6_std, (e.k1 - flight.k1[k]) / e.k1_std


def main() -> None:
    args = arguments(__doc__, flights=8, seed=91000, cell=list(CELLS))
    table = Table("cell 26", "nominal 16", "flights 7d", "windows 7d", "OK 6.3f", "a6 5.2f", "k1 5.2f", "largest 7.1f",
                  "tracked 7d", "a6 5.2f", "k1 5.2f")
    for cell in args.cell:
        for name in args.nominal:
            made = [each for each in run_jobs(errors, [(name, cell, seed) for seed in args.seeds]) if each]
            windows, tracked = (np.concatenate([each[key] for each in made]) for key in ("windows", "tracked"))
            ok = windows[windows[:, 0] == 1.0, 1:]
            held = np.mean(np.abs(ok) < INTERVAL, axis=0) if len(ok) else np.full(2, math.nan)
            good = len(ok) <= MOST_OK * len(windows) if cell.startswith("bending") else not np.any(held < HELD_LEAST)
            table.row(cell, name, len(made), len(windows), len(ok) / len(windows), *held,
                      np.abs(ok).max() if len(ok) else math.nan, len(tracked),
                      *(np.mean(np.abs(tracked) < INTERVAL, axis=0) if len(tracked) else (math.nan, math.nan)),
                      good=bool(good))


if __name__ == "__main__":
    main()

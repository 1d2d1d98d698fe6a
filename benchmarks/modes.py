"""Fly slosh and bending that are declared with a doubt, and count what the estimator makes of them on board.

    python benchmarks/modes.py [--flights 16] [--seed 80000] [--rate 100] [--air calm] [--cell NAME] [--seconds 40]
                               [--off FACTOR]

Flights of `simulate` of `constant`, 40 s long, in 5 s windows; the nominal's noises, controller and sensors at the
rate; seeds SEED, SEED + 1, ..., on which nothing was chosen.  Drawn within what is declared: a6 and k1 up to 25 % off
(uniform), of each mode the frequency with a sigma of 10 % and the size with one of 50 % (both cut at 2 sigma); the
damping ratio of 0.01 is known.  In air `wind` the wind and offsets of `flights.py` blow and are declared.
Bending is as large as it shows: the gain is that which puts this share of the rigid body's rms rate into the gyro, the
nozzle moving as it does without bending.  In the cells `absent` the declared modes are not flown.
With --off every mode's frequency is FACTOR times the declared one, its size as declared.

Of a row: the share of windows OK; of the OK windows, and of the tracked estimates at their ends, the share of 95 %
intervals that hold a6 and k1; the root mean square and the largest of the windows' errors in standard deviations; the
median standard deviation of a6 over that of `none`; from 20 s on, of the modes that are proven (whose frequency is
reported with a doubt of its own), how many, the share of 95 % intervals that hold frequency and size, and their median
standard deviations, relative.  Of `absent` every report counts as one of a size of 0, and `proven` is a false size.
"""

import dataclasses
import functools
import math
import sys
from typing import Any

import numpy as np
from flights import AIRS, INTERVAL, Table, arguments, at_rate, in_air, nominal, run_jobs
from onboard_causes import estimates_of

from sim.flight import Flight, fly_whole
from sim.nominal import Nominal
from sim.sections import Bending, Slosh, constant

WINDOW = 5.0        # s, of `onboard_causes`
SETTLED = 20.0      # s
DAMPING = 0.01
SIGMA = (0.1, 0.5)  # of a mode's frequency and size
CUT = 2.0           # sigmas of a draw
RATES = [100.0, 50.0, 200.0]  # Hz
SLOW, FAST = 3.5, 6.0         # rad/s, of slosh
HZ = 2.0 * math.pi

# cell -> (slosh: frequency [rad/s], coupling), (bending: frequency [rad/s], share of the rigid rate)
Pairs = tuple[tuple[float, float], ...]
CELLS: dict[str, tuple[Pairs, Pairs]] = {
    "none": ((), ()),
    "slosh 2 %": (((SLOW, 0.02),), ()),
    "slosh 5 %": (((SLOW, 0.05),), ()),
    "slosh 10 %": (((SLOW, 0.1),), ()),
    "bending 3 Hz 5 %": ((), ((3.0 * HZ, 0.05),)),
    "bending 3 Hz 30 %": ((), ((3.0 * HZ, 0.3),)),
    "bending 6 Hz 5 %": ((), ((6.0 * HZ, 0.05),)),
    "bending 6 Hz 30 %": ((), ((6.0 * HZ, 0.3),)),
    "two slosh, bending": (((SLOW, 0.05), (FAST, 0.03)), ((3.0 * HZ, 0.15),)),
    "absent slosh": (((SLOW, 0.05),), ()),
    "absent bending": ((), ((3.0 * HZ, 0.15),)),
}


def base(rate: float, air: str, seconds: float) -> Nominal:
    made = at_rate(in_air(nominal("constant"), air), rate)
    return dataclasses.replace(made, simulation=dataclasses.replace(made.simulation, duration=seconds))


@functools.cache
def gain_of(frequency: float, share: float, seconds: float) -> float:
    """Return the gain at which bending shows `share` of the rms rate of a flight without it, in calm air at 100 Hz."""
    flight = fly_whole(base(100.0, "calm", seconds), 0)
    n = 2 * len(flight.t)  # what rings on after the flight does not come back at its beginning
    omega = 2.0 * math.pi * np.fft.rfftfreq(n, flight.period)
    response = 1j * omega / (1.0 - (omega / frequency) ** 2 + 2j * DAMPING * omega / frequency)
    rate = np.fft.irfft(response * np.fft.rfft(flight.beta, n), n)[:len(flight.t)]
    return share * float(np.std(flight.theta_dot) / np.std(rate))


def drawn(kind: type, frequency: float, size: float, rng: np.random.Generator,
          factor: float = 0.0) -> tuple[Any, Any]:
    """Return a mode as flown and as declared; factor: of the frequency, 0: frequency and size are drawn."""
    name = "coupling" if kind is Slosh else "gain"
    off = 1.0 + np.array(SIGMA) * np.clip(rng.standard_normal(2), -CUT, CUT)
    if factor:
        off[:] = factor, 1.0
    return (kind(frequency=constant(frequency * off[0]), damping_ratio=constant(DAMPING),
                 **{name: constant(size * off[1])}),
            kind(frequency=constant(frequency), damping_ratio=constant(DAMPING), frequency_sigma=SIGMA[0],
                 **{name: constant(size), f"{name}_sigma": SIGMA[1]}))


def errors(cell: str, rate: float, air: str, seconds: float, factor: float, seed: int) -> dict[str, np.ndarray]:
    """Return of one flight `windows` (k, 4): 1 if OK, errors of a6 and k1 over their deviations, deviation of a6;
    `tracked` (k, 2) errors over deviations; `told` (k, 5) of the modes from SETTLED on: 1 if proven, errors of
    frequency and size over their deviations, both deviations relative."""
    slosh, bending = CELLS[cell]
    rng = np.random.default_rng((6, seed))
    modes = ([drawn(Slosh, *each, rng, factor) for each in slosh]
             + [drawn(Bending, w, gain_of(w, share, seconds), rng, factor) for w, share in bending])
    absent = cell.startswith("absent")
    clean = base(rate, air, seconds)
    declared = dataclasses.replace(clean, slosh=tuple(known for _, known in modes if isinstance(known, Slosh)),
                                   bending=tuple(known for _, known in modes if isinstance(known, Bending)))
    flown = clean if absent else dataclasses.replace(
        clean, slosh=tuple(true for true, _ in modes if isinstance(true, Slosh)),
        bending=tuple(true for true, _ in modes if isinstance(true, Bending)))
    flight, found = estimates_of(flown, declared, seed)
    told = [told_of(mode, true, known, absent) for e in found if e.t_end > SETTLED
            for mode, (true, known) in zip(e.modes, modes, strict=True) if mode.size_std > 0.0]
    return {"windows": np.reshape([off_by(flight, e, 0.5 * (e.t_start + e.t_end)) for e in found], (-1, 4)),
            "tracked": np.reshape([off_by(flight, e.tracked, e.t_end)[1:3] for e in found
                                   if e.tracked is not None and e.tracked.valid], (-1, 2)),
            "told": np.reshape(told, (-1, 5))}


def off_by(flight: Flight, e: Any, t: float) -> tuple[float, float, float, float]:
    k = int(np.argmin(np.abs(flight.t - t)))
    return (float(e.valid), (e.a6 - flight.a6[k]) / e.a6_std, (e.k1 - flight.k1[k]) / e.k1_std, e.a6_std)


def told_of(mode: Any, true: Any, known: Any, absent: bool) -> tuple[float, ...]:
    size = "coupling" if isinstance(true, Slosh) else "gain"
    w = true.frequency.value[0]
    z, z_0 = (getattr(each, size).value[0] for each in (true, known))
    return (float(mode.frequency != known.frequency.value[0]), (mode.frequency - w) / mode.frequency_std,
            (mode.size - (0.0 if absent else z)) / mode.size_std, mode.frequency_std / w, mode.size_std / abs(z_0))


def held(off: np.ndarray) -> np.ndarray:
    return np.mean(np.abs(off) < INTERVAL, axis=0) if len(off) else np.full(off.shape[1], math.nan)


def print_row(table: Table, head: tuple[Any, ...], parts: list[dict[str, np.ndarray]], clean: float) -> float:
    """Print a line of a cell; return the median standard deviation of a6."""
    windows, tracked, told = (np.concatenate([part[name] for part in parts]) for name in ("windows", "tracked", "told"))
    ok = windows[windows[:, 0] == 1.0]
    width = float(np.median(ok[:, 3])) if len(ok) else math.nan
    off = ok[:, 1:3] if len(ok) else np.full((1, 2), math.nan)
    proven = told[told[:, 0] == 1.0]
    counted = told if head[-1].startswith("absent") else proven
    std = np.median(counted[:, 3:], axis=0) if len(counted) else np.full(2, math.nan)
    table.row(*head, len(windows), len(ok) / len(windows), *held(ok[:, 1:3]), *held(tracked),
              *np.sqrt(np.mean(off**2, axis=0)), np.abs(off).max(), width / (clean or width),
              f"{len(proven)}/{len(told)}", *held(counted[:, 1:3]), *std)
    return width


def main() -> int:
    """Run and print."""
    args = arguments(__doc__, flights=16, seed=80000, seconds=40.0, off=0.0, rate=RATES, air=list(AIRS[::2]),
                     cell=[*CELLS])
    table = Table("air 5", "rate 4g", "cell 18", "windows 4", "OK 5.2f", "a6 5.2f", "k1 5.2f", "tracked a6 5.2f",
                  "k1 5.2f", "rms a6 5.2f", "k1 5.2f", "worst 5.1f", "width 5.2f", "proven 8", "frequency 5.2f",
                  "size 5.2f", "std 6.4f", "std 6.4f")
    cells = [(air, rate, cell) for air in args.air for rate in args.rate
             for cell in dict.fromkeys(("none", *args.cell))]
    results = iter(run_jobs(errors, [(cell, rate, air, args.seconds, args.off, seed) for air, rate, cell in cells
                                     for seed in args.seeds]))
    clean = 0.0
    for air, rate, cell in cells:
        width = print_row(table, (air, rate, cell), [next(results) for _ in args.seeds],
                          0.0 if cell == "none" else clean)
        clean = width if cell == "none" else clean
    return 0


if __name__ == "__main__":
    sys.exit(main())

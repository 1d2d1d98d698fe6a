"""The share of valid estimates that are far from the truth, while something acts that the nominal does not know of.

    python benchmarks/confident_lies.py [--flights 20] [--seed 0] [--window 5] [--nominal NAME] [--rate 100] [--large]

Rows: the disturbances of a table of large ones, and every effect of the catalogue at twice the size that `diagnose`
would find on a clean flight (its printed limit).  Each is flown and not told to the nominal, once with a nominal that
declares nothing and once with one that declares wind (walk 0.005 rad/sqrt(s), turbulence 0.005 rad) and offsets
(misalignment 0.004 rad, attitude bias 0.005 rad).  Counted: valid windows, and valid tracked estimates at their ends,
of which a6 or k1 is more than 3 of its own standard deviations off; the truth has the effect's own change of a6 and k1;
and the sudden changes that stand at a flight's end (a loss of control is one, the others are none).  On board, and
pooled as `launchid identify` gives them, which has the whole log and refuses what a contradiction follows within 20 s.
Effects whose signature is parallel to a6's or k1's (|cosine| > 0.9 on the clean flight) are listed apart.
Demanded, pooled: 2 % with wind and offsets declared, 5 % without; 1 % of clean windows called MODEL.
`flight` suite, controller and sensors at the rate, the nominals' own noises, estimated.
"""

import argparse
import dataclasses
import functools
import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from flights import NOMINALS, at_rate, run_jobs

from launchid.diagnosis.answer import report
from launchid.diagnosis.estimate import information
from launchid.diagnosis.verdict import diagnose
from launchid.identification.windows import onboard_model, run
from launchid.log.log import read_log, write_flight
from launchid.weakform.windows import withdrawn
from launchid_core import Config, EstimateStatus
from sim.effects import Effect, from_text
from sim.flight import fly_whole, parameters
from sim.nominal import Nominal, load_nominal
from sim.sections import Offsets, Wind

LARGE = ("steady_wind:angle=0.03", "thrust_misalignment:angle=0.004", "attitude_bias:angle=0.005",
         "slosh:coupling=0.05,frequency=3.5", "periodic_disturbance:amplitude=0.01,frequency=5",
         "gust:angle=0.05,time=30,duration=6", "bending:gain=0.1,frequency=15", "actuator_delay:delay=0.03",
         "attitude_delay:delay=0.03")
DECLARED = {"wind": Wind(walk=0.005, turbulence=0.005), "offsets": Offsets(thrust_misalignment=0.004,
                                                                          attitude_bias=0.005)}
FAR = 3.0          # standard deviations
PARALLEL = 0.9
TWICE = 2.0
REFERENCE_SEED = 900   # of the clean flight that gives the limits
DEMAND = {"nothing": 0.05, "wind, offsets": 0.02}
CLEAN_MODEL = 0.01


@functools.cache
def limits(name: str, rate: float) -> tuple[tuple[str, bool], ...]:
    """(effect as text, parallel to a6 or k1) of every cause at twice its limit on a clean flight of a nominal."""
    nominal = flown(name, rate)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clean.csv"
        write_flight(path, fly_whole(nominal, REFERENCE_SEED))
        made = diagnose(read_log(path), nominal)
    m, full = made.model, made.elimination.full
    inverse = np.linalg.inv(information(m, full))
    own = [m.index(each) for each in ("a6", "k1") if each in m.names]
    found = []
    for j, number in enumerate(m.numbers):
        limit = report(made)["limits"].get(number.cause)
        if limit is None or limit["parameter"] != number.parameter or limit["size"] is None:
            continue
        value = limit["neutral"] + TWICE * limit["size"]
        parallel = any(abs(inverse[j, k]) > PARALLEL * math.sqrt(inverse[j, j] * inverse[k, k]) for k in own)
        found.append((f"{number.cause}:{number.parameter}={value!r}", parallel))
    return tuple(found)


@functools.cache
def flown(name: str, rate: float) -> Nominal:
    """The nominal at a rate [Hz]; as it is at 100 Hz."""
    return at_rate(load_nominal(name), rate)


def believed(name: str, rate: float, declared: str) -> Nominal:
    """The nominal with or without wind and offsets."""
    nominal = flown(name, rate)
    return nominal if declared == "nothing" else dataclasses.replace(nominal, **DECLARED)


def job(name: str, rate: float, text: str, seed: int, declared: str, window: float) -> np.ndarray:
    """One flight: (windows, MODEL, valid, lies, tracked valid, tracked lies, alarms whose changes stand), and valid,
    lies, tracked valid, tracked lies of `identify`."""
    effects: list[Effect] = [from_text(text)] if text else []
    nominal = flown(name, rate)
    flight = fly_whole(nominal, seed, effects=effects)
    config = Config(window=window, sample_period=flight.period, formulation="filtered",
                    model=onboard_model(believed(name, rate, declared)))
    estimates, estimator = run(config, flight.rows())
    count = np.zeros(11, np.int64)
    for each, whole in zip(estimates, withdrawn(estimates), strict=True):
        (a6, a6_end), (k1, k1_end) = parameters(nominal, np.array([0.5 * (each.t_start + each.t_end), each.t_end]),
                                                effects=effects)
        count[0] += 1
        count[1] += each.status == EstimateStatus.MODEL
        for e, at in ((each, 2), (whole, 7)):
            if e.valid:
                count[at] += 1
                count[at + 1] += far(e.a6, e.a6_std, a6) or far(e.k1, e.k1_std, k1)
            if e.tracked is not None and e.tracked.valid:
                count[at + 2] += 1
                count[at + 3] += far(e.tracked.a6, e.tracked.a6_std, a6_end) or far(e.tracked.k1, e.tracked.k1_std,
                                                                                   k1_end)
    count[6] = len({change.alarm for change in estimator.changes()})
    return count


def far(value: float, std: float, true: float) -> bool:
    """Whether a value is more than FAR of its own standard deviations off."""
    return abs(value - true) > FAR * std


def share(part: int, whole: int) -> str:
    return f"{part / whole:6.3f}" if whole else "     -"


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--window", type=float, default=5.0, help="s")
    parser.add_argument("--rate", type=float, default=100.0, help="Hz")
    parser.add_argument("--nominal", choices=NOMINALS, action="append")
    parser.add_argument("--large", action="store_true", help="only the table of large ones")
    args = parser.parse_args()
    missed = False
    pooled = {declared: np.zeros(11, np.int64) for declared in DEMAND}
    print(f"flights {args.flights}, seeds from {args.seed}, windows of {args.window:g} s, {args.rate:g} Hz; "
          f"shares of valid answers more than {FAR:g} std off")
    print(f"{'nominal':16} {'effect':62} {'declared':14} {'MODEL':>6} {'valid':>6} {'lies':>6} {'tracked':>7} "
          f"{'lies':>6} changes")
    for name in args.nominal or NOMINALS:
        rows = [("", False), *((text, False) for text in LARGE), *(() if args.large else limits(name, args.rate))]
        jobs = [(name, args.rate, text, seed, declared, args.window) for text, _ in rows for declared in DEMAND
                for seed in range(args.seed, args.seed + args.flights)]
        results = iter(run_jobs(job, jobs))
        for text, parallel in rows:
            for declared in DEMAND:
                count = np.sum([next(results) for _ in range(args.flights)], axis=0)
                windows, model, valid, lies, tracked, tracked_lies, changes = count[:7].tolist()
                if not parallel:
                    pooled[declared] += count
                bad = not text and model > CLEAN_MODEL * windows
                missed |= bad
                print(f"{name:16} {text or 'nothing':62.62} {declared:14} {share(model, windows)} "
                      f"{share(valid, windows)} {share(lies, valid)} {share(tracked, windows):>7} "
                      f"{share(tracked_lies, tracked)} {changes:7}{'  parallel' if parallel else ''}"
                      f"{'  MISSED' if bad else ''}", flush=True)
    for declared, count in pooled.items():
        _, _, valid, lies, tracked, tracked_lies, changes, *whole = count.tolist()
        bad = lies > DEMAND[declared] * valid or tracked_lies > DEMAND[declared] * tracked
        missed |= bad
        print(f"pooled, {declared} declared: windows {share(lies, valid)}, tracked {share(tracked_lies, tracked)} "
              f"(demanded {DEMAND[declared]:g}){'  MISSED' if bad else ''}; sudden changes {changes}; identify: "
              f"windows {share(whole[1], whole[0])}, tracked {share(whole[3], whole[2])}, "
              f"of {share(whole[0], valid)} as many")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

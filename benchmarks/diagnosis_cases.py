"""Hidden flights for the benchmark of the diagnosis: which are flown, and what came of each.

A campaign's job is a `Case`; `calibrated` flies it clean and says what the diagnosis says it could have found,
`diagnosed` flies it with the effects of the case and compares the verdict with the truth.  Both return one row of
plain values; a number that there is none of is NaN.

The generator (`tests/hidden`) is independent of the project; sizes are drawn from the printed limits of the clean
flight of the same seed, reference, rate, noise and columns.
"""

import argparse
import dataclasses
import json
import math
import sys
import time
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # the generator is no installed package

from hidden import LISTED, OTHER, PLAIN, UNLISTED, Hidden, Label, Weather, draw_spec, fly, hide  # noqa: E402
from hidden.build import SUBSTEP  # noqa: E402
from hidden.catalogue import CAUSES  # noqa: E402

from launchid.diagnosis.data.record import Record  # noqa: E402
from launchid.diagnosis.judge.gain import held_out, long_folds  # noqa: E402
from launchid.diagnosis.model.nuisance import Problem  # noqa: E402
from launchid.diagnosis.report.answer import report  # noqa: E402
from launchid.diagnosis.search.fit import fit  # noqa: E402
from launchid.diagnosis.search.foresight import LONGEST, SPACING  # noqa: E402
from launchid.diagnosis.verdict import Diagnosis, diagnose  # noqa: E402
from launchid.log.log import OPTIONAL, REQUIRED, Log  # noqa: E402
from sim.nominal import Nominal, Wind, built_in, load_nominal  # noqa: E402

NOMINALS = ("constant", "vega_like")
CALM, WINDY = AIRS = ("calm", "windy")
# of the windy column: as the nominal declares it, and as it blows
DECLARED = Wind(turbulence=0.005, walk=0.002)
WEATHER = Weather(DECLARED.turbulence, DECLARED.walk, DECLARED.turbulence_time, DECLARED.initial)
# seeds a nominal (of each effect where there are effects): quick, full
SEEDS = {"clean": (10, 50), "twice": (2, 5), "half": (2, 2), "dropped": (2, 2), "pairs": (4, 20), "unlisted": (2, 3),
         "odds": (2, 2)}
HALVED = ("twice", "unlisted", "odds")  # quick: a seed is flown on one of the nominals; always in SHARED
SHARED = ("half", "dropped")
GROUPS = tuple(SEEDS)
TWICE, HALF, PAIR = 2.0, 0.5, 3.0   # sizes over the printed limit
ODDS = (0.5, 0.7, 1.0, 1.4, 2.0)
ODDS_CAUSES = ("aero_damping", "actuator_delay", "gyro_scale", "thrust_misalignment", "slosh", "gust")
DROPS = ("theta_dot", "beta")
VISIBLE = (1.0, 2.0)                 # the generator's size factors of unlisted effects
# constant moments and null offsets: any two of them are equal to another two
OFFSETS = frozenset({"steady_wind", "attitude_bias", "thrust_misalignment", "actuator_bias", "nozzle_sensor_bias"})
# how fast the nozzle moves: the generator has one knob for some of them, the log one trace of all
SERVO = frozenset({"actuator_delay", "actuator_bandwidth", "actuator_rate_limit", "actuator_backlash"})

NAN = math.nan
CONTROLLER = "controller_mismatch"
CHANCE = ("turbulence", "wind_walk")   # not flown in wind: there the nominal declares them
NO_LIMIT = (CONTROLLER,)     # found by exact comparison, so no limit is printed; flown at the generator's factor
IN_PARTS = ("bending",)      # its other form has two modes
NAMED = ("explained", "dominant")
LARGEST_SET = 3              # causes an answer may leave open
HORIZON = 1.0                # s of the prediction error in the gain
NORMAL_95 = 1.96
LARGEST_SHARE = 0.9          # of a scale's or a fraction's deviation downwards: the vehicle keeps a tenth
ONSETS = {"control_loss": "time", "moment_step": "time", "gust": "time"}

# How far the other parameters are from those for which the limit is printed: off the search's grid, but so near that
# the printed limit still is that of the flown shape (slosh's goes with the frequency squared).
FREQUENCY_SPREAD = 0.05      # relative
DURATION_SPREAD = 0.2        # relative, and of damping ratios
TIME_SPREAD = 2.0            # s

Parameters = dict[str, float]
Flight = dict[str, Any]    # a row of the table as read: numbers are floats, text is text


class Case(NamedTuple):
    """One flight.  `causes` joined by "+" ("" is clean), each at `factor` times its printed limit.

    sizes  JSON: {cause: [limit, neutral, parameter, {other parameter: value}]} of the clean flight; "" for unlisted
    rate   Hz of the log; 0: drawn
    drop   the column left out, "" none
    air    calm, or windy as the nominal declares
    """

    group: str
    nominal: str
    causes: str
    factor: float
    variant: str
    seed: int
    rate: float
    reference: str
    drop: str
    air: str = CALM
    sizes: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.causes.split("+")) if self.causes else ()


def twin(flight: Mapping[str, Any]) -> tuple[Any, ...]:
    """The key that two flights share if they are the same but for their effects."""
    return tuple(flight[name] for name in ("nominal", "seed", "rate", "reference", "drop", "air"))


# ---- which flights


def seeds_of(args: argparse.Namespace, group: str, index: int) -> list[int]:
    """Seeds that a group flies on the nominal of this index; [] if it is not asked for.

    Quick: every other one, so that the two nominals share them and each meets both references and both forms.
    """
    count = SEEDS[group][0 if args.quick else 1]
    if args.seeds is not None:
        count = max(1, round(count * args.seeds / SEEDS["twice"][0 if args.quick else 1]))
    if group not in args.groups and group != "clean":
        return []
    shared = (group in SHARED or (args.quick and group in HALVED)) and len(args.nominals) > 1
    return [args.first + seed for seed in range(count) if not shared or (seed + seed // 2 + index) % 2 == 0]


def case(group: str, nominal: str, causes: str, factor: float, seed: int, rate: float, drop: str, air: str) -> Case:
    """Reference and form go with the seed, so that four seeds fly all four."""
    rough = seed % 2 == 1 and group != "unlisted"
    other = seed // 2 % 2 == 1 and causes and group != "unlisted"
    return Case(group, nominal, causes, factor, OTHER if other else PLAIN, seed, rate, "rough" if rough else "nominal",
                drop, air)


def wanted(args: argparse.Namespace) -> list[Case]:
    """Every flight with an effect, without its sizes."""
    return [each for air in args.air for index, nominal in enumerate(args.nominals)
            for each in _wanted(args, air, nominal, index)]


def _wanted(args: argparse.Namespace, air: str, nominal: str, index: int) -> list[Case]:
    """The cases of one nominal in this air."""
    cases: list[Case] = []
    causes = [name for name in CAUSES if name in args.causes and not (air == WINDY and name in CHANCE)]

    def add(group: str, name: str, factors: tuple[float, ...], shift: int = 0, drops: tuple[str, ...] = ("",)) -> None:
        for seed in seeds_of(args, group, (index + shift) % 2):
            turn = seed + shift // 2  # not with the seed alone: few seeds must not tie it to their rates
            factor = factors[(seed // 2 + shift // 2 + index) % len(factors)]
            cases.append(case(group, nominal, name, factor, seed, args.rate, drops[turn % len(drops)], air))

    for number, name in enumerate(causes):
        add("twice", name, (1.0 if name in NO_LIMIT else TWICE,))
        if name not in NO_LIMIT:
            add("half", name, (HALF,), number)
            add("dropped", name, (TWICE,), number, DROPS)
    seeds = seeds_of(args, "pairs", index)
    for seed, pair in zip(seeds, pairs(causes, len(seeds), (index, args.first)), strict=True):
        cases.append(case("pairs", nominal, pair, PAIR, seed, args.rate, "", air))
    for number, name in enumerate(UNLISTED):
        add("unlisted", name, VISIBLE, number)
    for number, name in enumerate(ODDS_CAUSES if air == CALM else ()):
        for factor in ODDS if name in causes else ():
            add("odds", name, (factor,), number)
    return cases


def pairs(causes: Iterable[str], count: int, stream: tuple[int, int]) -> list[str]:
    """Random pairs of different places that are not exact equivalents of other pairs."""
    free = [name for name in causes if name not in NO_LIMIT]
    possible = [f"{a}+{b}" for a, b in combinations(free, 2) if CAUSES[a].place != CAUSES[b].place
                and not {a, b} <= OFFSETS and not {a, b} <= SERVO]
    if not possible:
        return []
    chosen = np.random.default_rng((2, *stream)).choice(len(possible), count, replace=count > len(possible))
    return [possible[k] for k in chosen]


def clean(args: argparse.Namespace, cases: list[Case]) -> list[Case]:
    """The clean flights: those that give the limits of `cases`, and the rest of the group."""
    flights = {case("clean", nominal, "", 0.0, seed, args.rate, "", air) for air in args.air
               for index, nominal in enumerate(args.nominals) for seed in seeds_of(args, "clean", index)}
    flights |= {each._replace(group="clean", causes="", factor=0.0, variant=PLAIN) for each in cases
                if each.group != "unlisted"}
    return sorted(flights)


def sized(cases: list[Case], rows: list[Flight]) -> list[Case]:
    """The flights with the limits of their clean twin; without those whose limit this log does not have."""
    limits = {twin(row): json.loads(row["limits"]) for row in rows if row["limits"]}
    found = []
    for each in cases:
        if each.group == "unlisted":
            found.append(each)
            continue
        of = limits.get(twin(each._asdict()), {})
        if all(name in of for name in each.names if name not in NO_LIMIT):
            found.append(each._replace(sizes=json.dumps({name: of[name] for name in each.names if name in of})))
    return found


# ---- the flight


def log_of(columns: dict[str, np.ndarray]) -> Log:
    """The generator's columns as a log."""
    n = len(columns["t"])
    names = (*REQUIRED, *OPTIONAL)
    values = {name: columns.get(name, np.full(n, NAN)) for name in names}
    return Log("hidden", tuple(name for name in names if name in columns), (), **values)


@cache
def nominal_of(name: str, air: str) -> Nominal:
    """The nominal of the vehicle, with the wind of the windy column."""
    nominal = load_nominal(built_in(name))
    return dataclasses.replace(nominal, wind=DECLARED) if air == WINDY else nominal


def flown(case: Case, effects: tuple[Hidden, ...]) -> tuple[Log, Label]:
    """The case's flight with these effects; noise, rate and dispersion are drawn from its seed."""
    unlisted = case.causes if case.group == "unlisted" else None
    given: dict[str, Any] = {"reference": case.reference, "drop": (case.drop,) if case.drop else ()}
    if case.air == WINDY:
        given["wind"] = dataclasses.replace(WEATHER, variant=OTHER if case.seed // 4 % 2 else PLAIN)
    if case.rate:
        given["rate"] = case.rate
    if unlisted is None:
        given["effects"] = effects
    columns, label = fly(draw_spec(case.seed, unlisted, case.nominal, case.factor, **given))
    return log_of(columns), label


def effects_of(case: Case) -> tuple[Hidden, ...]:
    """The generator's effects of a case with listed causes."""
    if case.group == "unlisted":
        return ()
    sizes = json.loads(case.sizes) if case.sizes else {}
    return tuple(_effect(case, name, sizes.get(name)) for name in case.names)


def _effect(case: Case, name: str, size: list[Any] | None) -> Hidden:
    rng = np.random.default_rng((case.seed, len(case.nominal), *name.encode()))
    if size is None:
        return LISTED[name](case.factor, rng, case.nominal, case.variant)
    limit, neutral, parameter, shape = size
    slower = name == "actuator_bandwidth" and case.variant == OTHER
    sign = 1.0 if CAUSES[name].one_sided else -1.0 if slower else float(rng.choice((-1.0, 1.0)))
    value = _value(name, parameter, limit, neutral, case.factor, sign)
    parameters = {v.contract: v.neutral for v in CAUSES[name].values} | _near(shape, rng) | {parameter: value}
    return hide(name, parameters, PLAIN if slower and value > 1.0 else case.variant)


def _value(name: str, parameter: str, limit: float, neutral: float, factor: float, sign: float) -> float:
    """The size's value; a deviation that would leave nothing of its quantity goes upwards instead."""
    if name == "actuator_rate_limit":
        return limit / factor
    deviation = limit * factor
    if parameter == "delay":
        return max(round(deviation / SUBSTEP), 1) * SUBSTEP
    if parameter == "scale" and sign < 0.0 and deviation > LARGEST_SHARE:
        sign = 1.0
    if parameter == "fraction":
        deviation = min(deviation, LARGEST_SHARE)
    return neutral + sign * deviation


def _near(shape: Parameters, rng: np.random.Generator) -> Parameters:
    """Parameters near those for which the limit holds."""
    near: Parameters = {}
    for name, value in shape.items():
        draw = float(rng.uniform(-1.0, 1.0))
        if name == "time":
            near[name] = round(value + TIME_SPREAD * draw, 2)
        elif name == "phase":
            near[name] = 3.0 * draw
        else:
            near[name] = value * (1.0 + (FREQUENCY_SPREAD if name == "frequency" else DURATION_SPREAD) * draw)
    return near


# ---- the clean flight: false alarms, limits, floor


def calibrated(case: Case) -> dict[str, Any]:
    """The clean flight's row: verdict, limits (JSON), and the RMS error over 1 s that is left with nothing wrong."""
    log, label = flown(case, ())
    made, seconds = timed(log, nominal_of(case.nominal, case.air))
    floor = NAN
    if made.record is not None and made.selection is not None:
        gain = held_out(made.selection.nominal, made.selection.nominal)
        floor = gain.nrmse.get(HORIZON, {}).get("theta", (NAN, NAN))[1] * change_rms(made.record)
    sizes = {each.cause: [each.size, each.neutral if each.neutral is not None else NAN, each.parameter, dict(each.at)]
             for each in made.limits if each.size is not None}
    return {**_verdict(made), "floor": floor, "limits": json.dumps(sizes), "seconds": seconds,
            "flown_rate": label.spec.rate, "spec": repr(label.spec)}


def timed(log: Log, nominal: Nominal) -> tuple[Diagnosis, float]:
    """The diagnosis and its seconds of processor time (the machine may be shared)."""
    start = time.process_time()
    made = diagnose(log, nominal)
    return made, time.process_time() - start


def change_rms(record: Record) -> float:
    """RMS change [rad] of the attitude over the horizon, in the blocks that `gain.held_out` leaves out."""
    ahead = max(1, round(HORIZON / record.period))
    spacing = max(1, round(SPACING / record.period))
    theta = record.z[:, 0]
    starts = spacing * np.arange(math.ceil((record.rows - max(1, round(LONGEST / record.period))) / spacing))
    starts = starts[starts + ahead < record.rows]
    changes = []
    for mask in long_folds(record):
        total = np.concatenate([[0], np.cumsum(~mask)])
        whole = total[starts + ahead + 1] - total[starts] == ahead + 1
        changes.append(theta[starts[whole] + ahead] - theta[starts[whole]])
    change = np.concatenate(changes)
    change = change[np.isfinite(change)]
    return float(np.sqrt(np.mean(change**2))) if len(change) else NAN


def _verdict(made: Diagnosis) -> dict[str, Any]:
    """The verdict as a row.  `named`: causes with the sets they stand for, a/b for a set, joined by "+"."""
    return {"verdict": made.verdict, "where": made.where or "",
            "named": "+".join("/".join((cause.cause, *cause.rivals)) for cause in made.causes),
            "nearest": "+".join(cause.cause for cause in made.nearest),
            "evidence": round(max((cause.evidence for cause in (*made.causes, *made.nearest)), default=NAN), 1),
            "doubts": " | ".join(made.doubts)}


# ---- the flight with something hidden


def diagnosed(case: Case) -> dict[str, Any]:
    """The row of a flight with effects: what was said, and whether it is so."""
    log, label = flown(case, effects_of(case))
    made, seconds = timed(log, nominal_of(case.nominal, case.air))
    told = report(made)
    places = frozenset().union(*label.places)
    truth = {str(cause["cause"]): cause["parameters"] for cause in label.causes}
    said = [(cause.cause, *cause.rivals) for cause in made.causes]
    return {**_verdict(made), **judged(made.verdict, said, tuple(truth), case.variant),
            "place_right": made.where in places, "places": "/".join(sorted(places)), "as_noise": label.as_noise,
            "noise_said": any(level["significant"] for level in told["noise"].values()),
            **_sizes(made, truth), **_gain(made), "achieved": _achieved(case, truth), "lost": label.lost,
            "t_end": label.t_end, "flown_rate": label.spec.rate, "seconds": seconds,
            "truth": json.dumps(truth), "estimates": json.dumps(told["causes"]), "spec": repr(label.spec)}


def judged(verdict: str, said: list[tuple[str, ...]], truth: tuple[str, ...], variant: str) -> dict[str, Any]:
    """right: every true cause is named, alone or in a set of at most LARGEST_SET, and nothing else is.
    wrong: a cause is named that is not true (`missing_term` is, of what is in no list).
    said: of each answer the cause and what it cannot be told from.  A cause IN_PARTS in its other form may be
    named as often as it has parts."""
    left, wrong, extra = list(truth), False, False
    parts = [name for name in truth if name in IN_PARTS and variant == OTHER]
    for answer in said:
        true = next((name for name in (*left, *parts) if name in answer), None)
        if true is not None and len(answer) <= LARGEST_SET:
            left = [name for name in left if name != true]
            continue
        extra = True
        wrong |= true is None and (bool(truth) or answer[0] != "missing_term")
    found = verdict in NAMED and not left and not extra
    return {"right": found, "wrong": wrong, "found": len(truth) - len(left)}


def _sizes(made: Diagnosis, truth: dict[str, Parameters]) -> dict[str, Any]:
    """Errors of size and onset of the first true cause that was named by its own name, and the bound of its size."""
    row = dict.fromkeys(("size_error", "value_error", "covered", "onset_error", "over_bound"), NAN)
    for cause in made.causes:
        if cause.cause in truth:
            true = truth[cause.cause]
            name = _size_name(cause.cause, true)
            neutral = next(v.neutral for v in CAUSES[cause.cause].values if v.contract == name)
            error, std = float(cause.values[name]) - true[name], cause.std.get(name, NAN)
            deviation = true[name] - neutral
            onset = ONSETS.get(cause.cause)
            return {"size_error": abs(error / deviation) if deviation else NAN,
                    "value_error": abs(error / true[name]) if true[name] else NAN,
                    "covered": float(abs(error) <= NORMAL_95 * std) if math.isfinite(std) else NAN,
                    "onset_error": abs(float(cause.values[onset]) - true[onset]) if onset else NAN,
                    "over_bound": abs(error) / _bound(made, cause.cause, true, name)}
    return row


def _bound(made: Diagnosis, name: str, true: Parameters, size: str) -> float:
    """The Cramer-Rao bound of a cause's size in this log: from the innovations' information at its true values, every
    number that was free beside it free.  NaN where the model has no such number, or gives it another shape."""
    if made.selection is None:
        return NAN
    found = made.selection.model.fit
    for k, cause in enumerate(found.causes):
        free = [each.name for each in cause.hypothesis.free]
        if cause.hypothesis.cause != name or size not in free or not set(free) <= set(true):
            continue
        shift = {"time": found.record.shift}
        values = tuple(true[each] - shift.get(each, 0.0) for each in free)
        causes = (*found.causes[:k], dataclasses.replace(cause, values=values), *found.causes[k + 1:])
        there = fit(Problem(found.record, found.filter), causes, found.delta, iterations=0)
        return there.std(k)[free.index(size)]
    return NAN


def _size_name(cause: str, true: Parameters) -> str:
    """The parameter that is a cause's size: the first, of a controller the first that is off."""
    values = CAUSES[cause].values
    return next((v.contract for v in values if true[v.contract] != v.neutral), values[0].contract)


def _achieved(case: Case, truth: dict[str, Parameters]) -> float:
    """Size over limit as flown: delays are on a grid, a fraction has an end."""
    sizes = json.loads(case.sizes) if case.sizes else {}
    for cause, true in truth.items():
        if cause in sizes:
            limit, neutral, parameter, _ = sizes[cause]
            if cause == "actuator_rate_limit":
                return float(limit / true[parameter])
            return float(abs(true[parameter] - neutral) / limit)
    return case.factor


def _gain(made: Diagnosis) -> dict[str, float]:
    """RMS errors [rad] of the attitude over the horizon on held-out data, nominal and extended."""
    if made.gain is None or made.record is None:
        return {"before": NAN, "after": NAN, "held_out_nats": NAN}
    before, after = made.gain.nrmse.get(HORIZON, {}).get("theta", (NAN, NAN))
    change = change_rms(made.record)
    return {"before": before * change, "after": after * change, "held_out_nats": made.gain.nats}

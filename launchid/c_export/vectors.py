"""Replay vectors of an export: flights, and what the Python estimator answers to them, as the bits of C arrays.

Together the flights reach what the estimator has: a plain one; one of faults, a row of FAULTS each; one in pieces; two
that change their regime; sensors that stand still; rest; and one that begins again and again from a checkpoint of which
words are others, a row of WORDS each: what takes minutes, or an upset memory, to come about.
"""

import itertools
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from launchid_core import BANDS, PLACES, Config, Estimate, Estimator, Sample, Status, port_of
from sim.effects import from_text
from sim.errors import InputError, UsageError
from sim.flight import fly
from sim.nominal import Nominal

SEED = 1
FEWEST_SAMPLES = 300   # of a flight
NO_NUMBER = 0x7FF8000000000000  # every NaN
OFFSETS = ("thrust_misalignment", "moment", "attitude_bias", "gyro_bias", "nozzle_sensor_bias")
NAN, INF, HUGE = math.nan, math.inf, 1e300


Word = tuple[str, int | str, float]   # array of the memory, place in it (its name: `PLACES`), what stands there


class Flight(NamedTuple):
    """Samples after a reset.

    words  number of a sample -> words of the saved state that are others when the estimator goes on from a checkpoint
           before this sample; none: a checkpoint as it is
    """

    samples: list[Sample]
    words: dict[int, list[Word]]


def flown(nominal: Nominal, config: Config) -> list[Flight]:
    """The flights of a configuration."""
    rows = config.rows
    plain = _base(nominal, config, max(2 * rows + 2, FEWEST_SAMPLES))
    half = min(rows // 2, FEWEST_SAMPLES // 2)
    first = [*plain[:half], plain[half]._replace(theta=NAN), plain[half], plain[half], *plain[half + 3:]]
    first = first[:max(rows + 2, FEWEST_SAMPLES)]
    pieces = rows if config.formulation != "filtered" else min(rows, 60)   # the filter takes one sample like the other
    return [Flight(first, {half: []}), _faulty(plain), _in_pieces(plain, rows, pieces),
            _changing(nominal, config, "control_loss:fraction=0.5,time=3"),
            _changing(nominal, config, "control_loss:fraction=0.5,time=2.5", "steady_wind:angle=0.02"),
            _standing(plain, rows), _still(plain, rows), _begun_again(plain, config)]


def _base(nominal: Nominal, config: Config, count: int, *effects: str) -> list[Sample]:
    """A short flight of the nominal; of one that cannot be flown (no actuator, another period) sines."""
    suite = "ideal" if config.formulation == "measured" else "flight"
    try:
        return list(itertools.islice(
            fly(nominal, SEED, suite, config.sample_period, effects=[from_text(text) for text in effects]), count))
    except (InputError, UsageError):
        return [_swinging(config.sample_period * k) for k in range(count)]


def _swinging(t: float) -> Sample:
    """A sample of a vehicle that two sines drive."""
    slow, quick = math.sin(1.3 * t), math.sin(4.1 * t)
    return Sample(t, 0.02 * slow + 0.005 * quick, 0.026 * math.cos(1.3 * t) + 0.0205 * math.cos(4.1 * t),
                  0.01 * slow - 0.004 * quick, -0.0338 * slow - 0.084 * quick, 0.01 * slow - 0.004 * quick)


# ---- faults of single samples

FAULTS: tuple[tuple[int, Callable[[Sample], list[Sample]]], ...] = (  # number of a sample -> what comes in its place
    (3, lambda s: [s._replace(t=NAN), s._replace(t=INF), s._replace(theta=NAN), s._replace(beta=-INF), s]),
    (4, lambda s: [s._replace(theta_dot=INF), s._replace(theta_ddot=-INF), s._replace(beta_cmd=INF), s]),
    (5, lambda s: [s._replace(gamma=INF), s._replace(t=HUGE), s._replace(theta=-HUGE), s._replace(beta=HUGE), s]),
    (6, lambda s: [s._replace(theta_dot=HUGE), s._replace(theta_ddot=HUGE), s._replace(beta_cmd=-HUGE), s]),
    (7, lambda s: [s._replace(gamma=HUGE), s, s, *(s._replace(t=s.t - back) for back in (1.0, 0.5, 0.7))]),
    (12, lambda s: [s._replace(theta_dot=NAN)]),
    (13, lambda s: [s._replace(beta_cmd=NAN)]),
    (14, lambda s: [s._replace(theta_dot=NAN, beta_cmd=NAN, gamma=NAN)]),
    (20, lambda s: [s._replace(gamma=NAN)]),
    (21, lambda s: [s._replace(gamma=0.01)]),
    (24, lambda s: [s._replace(gamma=0.02)]),
    (25, lambda s: [s._replace(gamma=NAN)]),
    (40, lambda s: [s._replace(theta=s.theta + 0.3)]),
    *((k, lambda s: [s._replace(theta=s.theta + 0.3, theta_dot=s.theta_dot + 1.0)]) for k in range(55, 62)),
    *((k, lambda s: []) for k in range(70, 73)),
    *((k, lambda s: []) for k in range(90, 130)),
    (130, lambda s: [s._replace(theta_dot=NAN, gamma=0.01)]),
    (140, lambda s: [s._replace(theta=3.1)]),
    (141, lambda s: [s._replace(theta=-3.1)]),
    (142, lambda s: [s._replace(theta=3.1)]),
    *((k, lambda s: [s._replace(theta_dot=NAN)]) for k in range(150, 165)),
)
LOST = 60              # sample of the faults before which the filter has lost the sensors often


def _faulty(plain: list[Sample]) -> Flight:
    """Faults in the gate, outliers, gaps, a jump across half a turn; the clock is set back."""
    faults = dict(FAULTS)
    samples = [each for k, sample in enumerate(plain[:180]) for each in faults.get(k, lambda s: [s])(sample)]
    return Flight([*samples, *(s._replace(t=s.t - 3.0) for s in plain[180:240])],
                  {LOST: [("state.check.number", "LOSSES", 9.0)]})


def _in_pieces(plain: list[Sample], rows: int, count: int) -> Flight:
    """Windows that have too few samples, one that comes late, none, single ones, and pieces without a rate."""
    single = [3 * rows + 2 * k for k in range(count // 2)]
    pieces, at, length = list[int](), 4 * rows, 0
    while len(pieces) < 0.7 * count and at < 5 * rows:
        length = length % 12 + 1
        pieces += range(at, at + length)
        at += length + 1
    places = [*range(20), rows - 1, rows - 0.4, *single, *pieces, 6 * rows]
    period = plain[1].t - plain[0].t
    return Flight([s._replace(t=period * k, theta_dot=NAN if k >= 4 * rows else s.theta_dot)
                   for k, s in zip(places, itertools.cycle(plain), strict=False)], {})


def _changing(nominal: Nominal, config: Config, *effects: str) -> Flight:
    """A regime that changes; on the way alarms are raised that were not, and what is known is surer than it is."""
    samples, rows = _base(nominal, config, 700, *effects), config.rows
    t = samples[min(280, len(samples) - 1)].t
    sure: list[Word] = [("state.bank.covariance", place, 1e-12) for place in (0, 5, 16, 21)]
    sure += [("state.bank.covariance", place, 0.0) for place in (1, 4, 17, 20)]
    words: dict[int, list[Word]] = {
        150: [("state.gauge.flag", 0, 1), ("state.gauge.flag", 2, 1)], 220: [("state.gauge.flag", 1, 1)],
        rows - 15: sure,
        rows - 3: [("state.check.flag", "HAS_FAILED", 1), ("state.check.number", "LAST_FAILED", 0.0)]}
    if len(effects) > 1:
        words[280] = [("state.check.flag", "CHANGED", 1), ("state.check.number", "LAST_CHANGE", t - 5.0),
                      ("state.undeclared.flag", "AGE", 1)]
    return Flight(samples, words)


def _standing(plain: list[Sample], rows: int) -> Flight:
    """A window that knows of one term alone; one in which a sensor after the other stands still."""
    samples = plain[:rows]
    for k, s in enumerate(plain[rows:2 * rows + 2]):
        still, which = plain[rows + k - k % 30], k // 30 % 4
        samples.append(s._replace(**({"theta": still.theta} if which == 1 else {"theta_dot": still.theta_dot}
                                     if which == 2 else {"beta": still.beta} if which == 3 else {})))
    return Flight(samples, {rows - 3: [("state.active", 0, 0)], rows: [("state.active", 0, 1)]})


def _still(plain: list[Sample], rows: int) -> Flight:
    """At rest, so that nothing can be known; then motion too small for its squares, and a window that is no number."""
    half, period = rows // 2 + 2, plain[1].t - plain[0].t
    samples = [Sample(s.t, 0.0, 0.0, 0.0, 0.0, 0.0) for s in plain[:half]]
    samples += [s._replace(t=s.t + rows * period, theta=1e-170 * s.theta, theta_dot=1e-170 * s.theta_dot,
                           beta=1e-170 * s.beta, beta_cmd=1e-170 * s.beta_cmd) for s in plain[:half]]
    return Flight([*samples, plain[0]._replace(t=2 * rows * period)], {
        half - 2: [("state.check.number", "STATISTIC", 1e9)],
        2 * half - 2: [("state.acc.window", 0, NAN), ("state.check.number", "STATISTIC", NAN)]})


# ---- words of a checkpoint

def place_of(array: str, place: int | str) -> int:
    """The place of a word in its array."""
    return PLACES[f"{array}.{place}"] if isinstance(place, str) else place


WORDS: tuple[tuple[Word, ...], ...] = (
    (("seals", 24, 1),), (("state.guard", 0, 1),), (("state.guard", 0, 1),), (("state.guard", 1, 1),),
    *(((name, place, value),) for name, place, values in (
        ("state.counts", "HEAD", (-1, 9999)), ("state.counts", "ROWS", (-1, 9999)),
        ("state.counts", "CLOSED_ROWS", (-1, 9999)), ("state.counts", "CLOSED_BACK", (-1, 2)),
        ("state.counts", "WAITING", (-1, 9999)), ("state.acc.counts", 0, (-1, 9999)),
        ("state.watch.counts", "NEXT", (-1, 99)), ("state.watch.counts", "KEPT", (-1, 99)),
        ("state.watch.counts", "EVENTS", (-1,)), ("state.check.flag", "OLDEST", (-1, 99)),
        ("state.check.flag", "WAITING", (-1, 99)), ("state.undeclared.flag", "NEWER", (-1, 2)),
        ("state.undeclared.flag", "AGE", (-1,)), ("state.bank.total", 0, (NAN,)), ("state.bank.total", 2, (-1.0,)),
        ("state.bank.total", 3, (-1.0,)),
        ("state.filter.x", 0, (NAN,)), ("state.filter.p", 0, (NAN,)), ("state.filter.level", 0, (13.0, 5.0)),
        ("state.undeclared.flag", "DOUBT", (1, 2)),
        ("state.bank.mean", 0, (NAN,)), ("state.acc.level_information", 0, (NAN, INF)),
        ("state.undeclared.covariance", 28, (NAN,)),
        ("state.check.flag", "BEYOND_CHANCE", (1,)),
        ("state.check.number", "STATISTIC", (NAN,))) for value in values),
    (("state.check.number", "STATISTIC", 6000.0), ("state.check.flag", "WAITING", 24)),
    (("state.check.sums", 0, 1e9), ("state.check.flag", "WAITING", 24)),
    (("state.filter.level", 5, -2.0), ("state.filter.level", 6, -2.0), ("state.gust.number", 0, 0.9999)),
)
AFTER = 14             # samples from one to the next: a block, and a window's end
BEFORE = 25            # the first


def _begun_again(plain: list[Sample], config: Config) -> Flight:
    """From checkpoints whose seals fit what stands in them, but for some words; then a window ends."""
    there = dict(port_of(config).memory.state_arrays())
    sets = [words for words in WORDS if all(name in there and place_of(name, place) < there[name].size
                                            for name, place, _ in words)]
    at = {BEFORE + AFTER * k: list(words) for k, words in enumerate(sets)}
    period, samples, t = config.sample_period, list[Sample](), plain[0].t
    for k in range(BEFORE + AFTER * len(sets)):
        t += period * (config.rows if k >= BEFORE and (k - BEFORE) % AFTER == AFTER - 3 else 1)
        samples.append(plain[k % len(plain)]._replace(t=t))
    samples[BEFORE + AFTER] = samples[BEFORE + AFTER]._replace(theta=NAN)
    return Flight(samples, at)


# ---- bits


def word(x: float) -> int:
    """The bits of a number, a count's in two's complement."""
    if not isinstance(x, float):
        return int(x) % 2**64
    return NO_NUMBER if math.isnan(x) else struct.unpack("<Q", struct.pack("<d", x))[0]  # type: ignore[no-any-return]


def of_window(e: Estimate) -> list[Any]:
    """What leaves with a window, in the order of check.c."""
    tracked = e.tracked or (False, *(NAN,) * 5)
    offsets = [x for name in OFFSETS for x in e.offsets.get(name, (NAN, NAN))]
    servo = [x for each, shared in zip(e.actuator.values(), e.actuator_corr, strict=True) for x in (*each, shared)] \
        if e.actuator else [NAN] * 9
    return [int(e.status), e.rows, e.gaps, e.t_start, e.t_end, e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr, e.a6_dot,
            e.k1_dot, e.a6_bound, e.k1_bound, e.condition, *e.xi.ravel().tolist(), *e.support.ravel().tolist(),
            *tracked, e.wind, e.wind_std, *offsets, *servo, *_of_levels(e)]


def _of_levels(e: Estimate) -> Iterator[Any]:
    there = e.uncertainty is not None and e.uncertainty.valid
    yield there
    for name in ("a6", "k1"):
        if there:
            level = getattr(e.uncertainty, name)
            yield from (BANDS.index(level.band) if level.band in BANDS else -1, level.in_range, level.delta,
                        level.delta_std, *level.probability, level.out_since)
        else:
            yield from (0,) * 9


def of_end(estimator: Estimator) -> list[Any]:
    """What is known at a flight's end: changes, interventions, answers."""
    changes = estimator.changes()
    counts = estimator.counts
    return [len(changes), *(x for c in changes for x in (ord(c.parameter[0]), c.t, c.t_std, c.before, c.after,
                                                         c.size, c.size_std, c.alarm, c.final)),
            *(counts.get(name, 0) for name in ("OUTLIER", "RESTART", "LEVEL_CLAMP", "CHANGE_WITHDRAWN")),
            *(counts[status.name] for status in Status)]


class _Answers:
    """The words of the Python estimator's answers to flights, and where it goes on from checkpoints."""

    def __init__(self, config: Config) -> None:
        self.estimator, self.words, self.events = Estimator(config), list[int](), list[list[int]]()
        arrays = port_of(config).memory.state_arrays()
        sizes = [array.size for _, array in arrays]
        self.begin = len(self.estimator.save()) - 4 - 8 * sum(sizes)
        self.place = dict(zip((name for name, _ in arrays), itertools.accumulate([0, *sizes]), strict=False))

    def answer(self, values: Iterable[Any]) -> None:
        self.words += map(word, values)

    def restart(self, number: int, words: list[Word]) -> None:
        """Save, change words that are there, restore: what `restart` of check.c does for each."""
        for name, place, value in [word for word in words if word[0] in self.place] or [("", 0, 0)]:
            saved = bytearray(self.estimator.save())
            self.answer([zlib.crc32(saved[:-4])])
            at = self.begin + 8 * (self.place[name] + place_of(name, place)) if name else 0
            if at:
                saved[at:at + 8] = word(value).to_bytes(8, "little")
                saved[-4:] = zlib.crc32(saved[:-4]).to_bytes(4, "little")
            self.events.append([number, at, word(value)])
            self.estimator.reset()
            self.estimator.restore(bytes(saved))

    def fly(self, flight: Flight, begin: int) -> None:
        self.estimator.reset()
        for number, sample in enumerate(flight.samples):
            if number in flight.words:
                self.restart(begin + number, flight.words[number])
            status = self.estimator.update(sample)
            self.answer([int(status)])
            estimate = self.estimator.estimate() if status == Status.WINDOW_COMPLETE else None
            if estimate is not None:
                self.answer(of_window(estimate))
        self.answer(of_end(self.estimator))


def header(config: Config, flights: list[Flight]) -> str:
    """The text of vectors.h."""
    answers, ends = _Answers(config), list(itertools.accumulate(len(flight.samples) for flight in flights))
    with np.errstate(all="ignore"):  # in plain Python numpy would warn of what a status says
        for flight, end in zip(flights, ends, strict=True):
            answers.fly(flight, end - len(flight.samples))
    samples = [[word(float(x)) for x in sample] for flight in flights for sample in flight.samples]
    return "\n".join([
        "/* Samples and what the Python estimator answers to them: bits of doubles, every NaN 7FF8000000000000. */\n",
        "#ifndef LAUNCHID_VECTORS_H\n#define LAUNCHID_VECTORS_H\n\n#include <stdint.h>\n",
        f"#define VECTOR_SAMPLES {ends[-1]}\n#define VECTOR_FIRST {ends[0]}     /* samples of the first flight */",
        f"#define VECTOR_FLIGHTS {len(flights)}\n#define VECTOR_RESTARTS {len(answers.events)}",
        f"#define VECTOR_ANSWERS {len(answers.words)}\n",
        "/* samples until each flight's end */",
        f"static const int vector_end[] = {{{', '.join(map(str, ends))}}};\n",
        "/* before a sample: byte of the saved state, 0: none, and the word that stands there after the restart */",
        _array("vector_restart", answers.events, 3),
        _array("vector_sample", samples, 7), _array("vector_answer", [answers.words], 0), "#endif\n"])


def _array(name: str, rows: list[list[int]], width: int) -> str:
    """The C array of a table; without a width, of its one row."""
    listed = [", ".join(f"UINT64_C(0x{value:X})" for value in row) for row in rows]
    if width:
        body = ",\n".join(f"    {{{text}}}" for text in listed)
        return f"static const uint64_t {name}[{len(rows)}][{width}] = {{\n{body}}};\n"
    return f"static const uint64_t {name}[{len(rows[0])}] = {{\n    {listed[0]}}};\n"

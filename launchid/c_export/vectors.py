"""Replay vectors of the C export: flights and the Python estimator's answers to them, as bits in C arrays.

The flights together reach every branch that a short flight can: a plain one; faults of samples (FAULTS); gaps; two
changes of regime; sensors that stand still; rest.  What takes minutes or an upset memory is listed in `upsets.txt`:
words of a checkpoint that are changed for some samples, found by a search for branches that were not reached.
"""

import functools
import itertools
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from launchid_core import BANDS, Config, Estimate, Estimator, Sample, Status, port_of
from sim.effects import from_text
from sim.errors import InputError, UsageError
from sim.flight import fly
from sim.nominal import Nominal

from .program import core_module

VECTORS_SEED = 1
FEWEST_SAMPLES = 300   # of a flight
NO_NUMBER = 0x7FF8000000000000  # every NaN
OFFSETS = ("thrust_misalignment", "moment", "attitude_bias", "gyro_bias", "nozzle_sensor_bias")
NOT_MEASURED = math.nan
INF = math.inf
HUGE = 1e300           # its square overflows
PRIME = 0x100000001B3  # FNV-1a's
UPSETS = Path(__file__).parent / "upsets.txt"

Flight = list[Sample]  # after a reset


class Upset(NamedTuple):
    """Words of a checkpoint that are changed while some samples are flown; then the checkpoint is restored.

    flight         index of the flight
    window, place  the change comes `place` samples before that window's end; of window 0, after the flight's begin
    flown          samples flown with the change
    words          (array of the memory, index in it, new value); of array `sample`, index of a field of a sample
    """

    flight: int
    window: int
    place: int
    flown: int
    words: list[tuple[str, int, float]]

    def before(self, rows: int) -> int:
        """Return the index in the flight of the sample before which the change comes; rows: samples of a window."""
        return self.window * rows - self.place if self.window > 0 else self.place


def upsets() -> list[Upset]:
    """Return the upsets of upsets.txt: a line is flight, window, place, flown, then array, index, value for each."""
    found = []
    for line in UPSETS.read_text(encoding="utf-8").splitlines():
        flight, window, place, count, *words = line.split()
        found.append(Upset(int(flight), int(window), int(place), int(count), [
            (words[k], int(words[k + 1]), float(words[k + 2])) for k in range(0, len(words), 3)]))
    return found


def flown(nominal: Nominal, config: Config) -> list[Flight]:
    """Return the seven flights (lists of samples) that check the C estimator with this configuration."""
    rows = config.rows
    plain = _base(nominal, config, max(2 * rows + 2, FEWEST_SAMPLES))
    half = min(rows // 2, FEWEST_SAMPLES // 2)
    first = [*plain[:half], plain[half]._replace(theta=NOT_MEASURED), plain[half], plain[half], *plain[half + 3:]]
    pieces = rows if config.formulation != "filtered" else min(rows, 60)   # the filter takes one sample like the other
    return [first[:max(rows + 2, FEWEST_SAMPLES)], _faulty(plain), _in_pieces(plain, rows, pieces),
            _base(nominal, config, 700, "control_loss:fraction=0.5,time=3"),
            _base(nominal, config, 700, "control_loss:fraction=0.5,time=2.5", "steady_wind:angle=0.02"),
            _standing(plain, rows), _still(plain, rows)]


def _base(nominal: Nominal, config: Config, count: int, *effects: str) -> list[Sample]:
    """Return `count` samples of a flight of the nominal; of two sines if it cannot be flown (no actuator)."""
    suite = "ideal" if config.formulation == "measured" else "flight"
    try:
        return list(itertools.islice(
            fly(nominal, VECTORS_SEED, suite, config.sample_period, effects=[from_text(text) for text in effects]),
            count))
    except (InputError, UsageError):
        return [_swinging(config.sample_period * k) for k in range(count)]


def _swinging(t: float) -> Sample:
    """Return the sample at t [s] of a vehicle that two sines drive."""
    slow, quick = math.sin(1.3 * t), math.sin(4.1 * t)
    return Sample(t, 0.02 * slow + 0.005 * quick, 0.026 * math.cos(1.3 * t) + 0.0205 * math.cos(4.1 * t),
                  0.01 * slow - 0.004 * quick, -0.0338 * slow - 0.084 * quick, 0.01 * slow - 0.004 * quick)


# ---- faults of single samples

FAULTS: tuple[tuple[int, Callable[[Sample], list[Sample]]], ...] = (  # number of a sample -> what comes in its place
    (3, lambda s: [s._replace(t=NOT_MEASURED), s._replace(t=INF), s._replace(theta=NOT_MEASURED),
                   s._replace(beta=-INF), s]),
    (4, lambda s: [s._replace(theta_dot=INF), s._replace(theta_ddot=-INF), s._replace(beta_cmd=INF), s]),
    (5, lambda s: [s._replace(gamma=INF), s._replace(t=HUGE), s._replace(theta=-HUGE), s._replace(beta=HUGE), s]),
    (6, lambda s: [s._replace(theta_dot=HUGE), s._replace(theta_ddot=HUGE), s._replace(beta_cmd=-HUGE), s]),
    (7, lambda s: [s._replace(gamma=HUGE), s, s, *(s._replace(t=s.t - back) for back in (1.0, 0.5, 0.7))]),
    (12, lambda s: [s._replace(theta_dot=NOT_MEASURED)]),
    (13, lambda s: [s._replace(beta_cmd=NOT_MEASURED)]),
    (14, lambda s: [s._replace(theta_dot=NOT_MEASURED, beta_cmd=NOT_MEASURED, gamma=NOT_MEASURED)]),
    (20, lambda s: [s._replace(gamma=NOT_MEASURED)]),
    (21, lambda s: [s._replace(gamma=0.01)]),
    (24, lambda s: [s._replace(gamma=0.02)]),
    (25, lambda s: [s._replace(gamma=NOT_MEASURED)]),
    (40, lambda s: [s._replace(theta=s.theta + 0.3)]),
    *((k, lambda s: [s._replace(theta=s.theta + 0.3, theta_dot=s.theta_dot + 1.0)]) for k in range(55, 62)),
    *((k, lambda s: []) for k in range(70, 73)),
    *((k, lambda s: []) for k in range(90, 130)),
    (130, lambda s: [s._replace(theta_dot=NOT_MEASURED, gamma=0.01)]),
    (140, lambda s: [s._replace(theta=3.1)]),
    (141, lambda s: [s._replace(theta=-3.1)]),
    (142, lambda s: [s._replace(theta=3.1)]),
    *((k, lambda s: [s._replace(theta_dot=NOT_MEASURED)]) for k in range(150, 165)),
)


def _faulty(plain: list[Sample]) -> Flight:
    """Return a flight with faults that the gate meets, outliers, gaps, a jump of half a turn, a clock set back."""
    faults = dict(FAULTS)
    samples = [each for k, sample in enumerate(plain[:180]) for each in faults.get(k, lambda s: [s])(sample)]
    return [*samples, *(s._replace(t=s.t - 3.0) for s in plain[180:240])]


def _in_pieces(plain: list[Sample], rows: int, count: int) -> Flight:
    """Return a flight of windows with too few samples, a late one, none, single ones, and pieces without a rate."""
    single = [3 * rows + 2 * k for k in range(count // 2)]
    pieces, at, length = list[int](), 4 * rows, 0
    while len(pieces) < 0.7 * count and at < 5 * rows:
        length = length % 12 + 1
        pieces += range(at, at + length)
        at += length + 1
    places = [*range(20), rows - 1, rows - 0.4, *single, *pieces, 6 * rows]
    period = plain[1].t - plain[0].t
    return [s._replace(t=period * k, theta_dot=NOT_MEASURED if k >= 4 * rows else s.theta_dot)
            for k, s in zip(places, itertools.cycle(plain), strict=False)]


def _standing(plain: list[Sample], rows: int) -> Flight:
    """Return a flight of a plain window, and one in which one sensor after the other stands still."""
    samples = plain[:rows]
    for k, s in enumerate(plain[rows:2 * rows + 2]):
        still, which = plain[rows + k - k % 30], k // 30 % 4
        samples.append(s._replace(**({"theta": still.theta} if which == 1 else {"theta_dot": still.theta_dot}
                                     if which == 2 else {"beta": still.beta} if which == 3 else {})))
    return samples


def _still(plain: list[Sample], rows: int) -> Flight:
    """Return a flight at rest, where nothing can be estimated; then motion so small that its squares vanish."""
    half, period = rows // 2 + 2, plain[1].t - plain[0].t
    samples = [Sample(s.t, 0.0, 0.0, 0.0, 0.0, 0.0) for s in plain[:half]]
    samples += [s._replace(t=s.t + rows * period, theta=1e-170 * s.theta, theta_dot=1e-170 * s.theta_dot,
                           beta=1e-170 * s.beta, beta_cmd=1e-170 * s.beta_cmd) for s in plain[:half]]
    return [*samples, plain[0]._replace(t=2 * rows * period)]


# ---- bits


def word(x: float) -> int:
    """Return the 64 bits of a float, or of an integer in two's complement, as an integer; NO_NUMBER for any NaN."""
    if not isinstance(x, float):
        return int(x) % 2**64
    return NO_NUMBER if math.isnan(x) else struct.unpack("<Q", struct.pack("<d", x))[0]  # type: ignore[no-any-return]


def folded(words: Iterable[int]) -> int:
    """Return one 64-bit hash of 64-bit words (FNV-1a from 0)."""
    return functools.reduce(lambda all_, each: (all_ ^ each) * PRIME % 2**64, words, 0)


def of_window(e: Estimate) -> list[Any]:
    """Return the numbers of an estimate in the order of check.c; NaN or 0 for an optional part that is missing."""
    tracked = e.tracked or (False, *(NOT_MEASURED,) * 5)
    offsets = [x for name in OFFSETS for x in e.offsets.get(name, (NOT_MEASURED, NOT_MEASURED))]
    servo = [x for each, shared in zip(e.actuator.values(), e.actuator_corr, strict=True) for x in (*each, shared)] \
        if e.actuator else [NOT_MEASURED] * 9
    return [int(e.status), e.rows, e.gaps, e.t_start, e.t_end, e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr, e.a6_dot,
            e.k1_dot, e.a6_bound, e.k1_bound, e.condition, *e.xi.ravel().tolist(), *e.support.ravel().tolist(),
            *tracked, e.wind, e.wind_std, *offsets, *servo, *(x for mode in e.modes for x in mode[1:]), *_of_levels(e)]


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
    """Return the numbers that check.c compares at a flight's end: changes, counts of interventions and statuses."""
    changes = estimator.changes()
    counts = estimator.counts
    return [len(changes), *(x for c in changes for x in (ord(c.parameter[0]), c.t, c.t_std, c.before, c.after,
                                                         c.size, c.size_std, c.alarm, c.final)),
            *(counts.get(name, 0) for name in ("OUTLIER", "RESTART", "LEVEL_CLAMP", "CHANGE_WITHDRAWN")),
            *(counts[status.name] for status in Status)]


class _Answers:
    """`words`: the Python estimator's answers to flights; `rows`: upsets as (sample, byte of the saved state, or behind
    it field of the sample, new word, samples flown, or 0 if another word follows)."""

    def __init__(self, config: Config) -> None:
        self.estimator, self.words, self.rows = Estimator(config), list[int](), list[list[int]]()
        arrays = port_of(config).memory.state_arrays()
        ends = list(itertools.accumulate((array.size for _, array in arrays), initial=0))
        self.window, self.size = config.rows, len(self.estimator.save())
        self.begin = self.size - 4 - 8 * ends[-1]
        self.arrays = {name: (at, array) for (name, array), at in zip(arrays, ends, strict=False)}

    def has(self, upset: Upset) -> bool:
        """Whether the memory of this configuration has all words that an upset changes."""
        return all(name == "sample" or (name in self.arrays and place < self.arrays[name][1].size)
                   for name, place, _ in upset.words)

    def answer(self, values: Iterable[Any]) -> None:
        self.words += map(word, values)

    def take(self, samples: Iterable[Sample]) -> None:
        for sample in samples:
            status = self.estimator.update(sample)
            self.answer([int(status)])
            estimate = self.estimator.estimate() if status == Status.WINDOW_COMPLETE else None
            if estimate is not None:
                self.answer(of_window(estimate))

    def fly(self, flight: Flight, begin: int, there: list[Upset]) -> None:
        self.estimator.reset()
        for number, sample in enumerate(flight):
            here = [upset for upset in there if number == upset.before(self.window)]
            if here:
                kept = self.estimator.save()
                self.answer([self.state_of(kept)])
                for upset in here:
                    self.fly_upset(upset, kept, flight[number:number + upset.flown], begin + number)
                self.estimator.restore(kept)
            self.take([sample])
        self.answer(of_end(self.estimator))

    def put(self, saved: bytearray, name: str, place: int, bits: int) -> tuple[int, int]:
        """Write a word in place into a saved state, at index `place` of array `name`; return its byte and the word."""
        at = self.begin + 8 * (self.arrays[name][0] + place)
        saved[at:at + 8] = bits.to_bytes(8, "little")
        return at, bits

    def seals(self, saved: bytearray, upset: Upset) -> Iterator[tuple[str, int, int]]:
        """Yield (array, index, seal) of clock, counts and rows of the ring that fit an upset's words."""
        ring, changed = core_module("ring"), {name for name, _, _ in upset.words}
        control = [name for name in self.arrays if name.startswith(("state.clock.", "state.counts."))
                   and name != "state.counts.answers"]  # one word each, one after the other
        if changed & set(control):
            yield "state.guard.control", 0, self.seal(saved, control[0], 0, len(control))
        for row in sorted({place // ring.N_COLUMNS for name, place, _ in upset.words if name == "ring"}):
            yield "seals", row, self.seal(saved, "ring", row * ring.N_COLUMNS, ring.N_COLUMNS)

    def seal(self, saved: bytearray, name: str, place: int, count: int) -> int:
        """Return the checksum that `guard.fold` gives of `count` words from index `place` of array `name`."""
        begin, seal = self.begin + 8 * (self.arrays[name][0] + place), 0
        for k in range(count):
            bits = int.from_bytes(saved[begin + 8 * k:begin + 8 * k + 8], "little")
            seal ^= (bits << k | bits >> 64 - k) % 2**64
        return seal

    def fly_upset(self, upset: Upset, kept: bytes, samples: Flight, number: int) -> None:
        """Fly samples from the checkpoint `kept` with an upset's words; the answers become one word, as in check.c."""
        saved, fields, outer = bytearray(kept), [float(x) for x in samples[0]], self.words
        rows = list[list[int]]()
        for name, place, value in upset.words:
            if name == "sample":
                fields[place] = value
                rows.append([number, self.size + place, word(value), 0])
            else:
                is_real = self.arrays[name][1].dtype.kind == "f"
                rows.append([number, *self.put(saved, name, place, word(value if is_real else int(value))), 0])
        for name, place, bits in self.seals(saved, upset):
            rows.append([number, *self.put(saved, name, place, bits), 0])
        self.rows += [*rows[:-1], [*(rows or [[number, 0, 0]])[-1][:3], len(samples)]]
        saved[-4:] = zlib.crc32(saved[:-4]).to_bytes(4, "little")
        self.estimator.restore(bytes(saved))
        self.words = []
        self.take([Sample(*fields), *samples[1:]])
        self.answer([*of_end(self.estimator), self.state_of(self.estimator.save())])
        self.words = [*outer, folded(self.words)]

    def state_of(self, saved: bytes) -> int:
        """Return a hash of a saved state's words, with one bit pattern for all NaN (the sign is the machine's)."""
        words = np.frombuffer(saved[self.begin:-4], "<u8")
        return folded(np.where(words << np.uint64(1) <= np.uint64(0xFFE0000000000000), words, NO_NUMBER).tolist())


def header(config: Config, flights: list[Flight]) -> str:
    """Return the text of vectors.h: samples of the flights, upsets, and the Python estimator's answers to them."""
    answers, ends = _Answers(config), list(itertools.accumulate(map(len, flights)))
    with np.errstate(all="ignore"):  # in plain Python numpy would warn of what a status says
        for k, (flight, end) in enumerate(zip(flights, ends, strict=True)):
            answers.fly(flight, end - len(flight), [upset for upset in upsets() if upset.flight == k
                                                    and answers.has(upset)])
    samples = [[word(float(x)) for x in sample] for flight in flights for sample in flight]
    return "\n".join([
        "/* Samples and what the Python estimator answers to them: bits of doubles, every NaN 7FF8000000000000. */\n",
        "#ifndef LAUNCHID_VECTORS_H\n#define LAUNCHID_VECTORS_H\n\n#include <stdint.h>\n",
        f"#define VECTOR_SAMPLES {ends[-1]}\n#define VECTOR_FIRST {ends[0]}     /* samples of the first flight */",
        f"#define VECTOR_FLIGHTS {len(flights)}\n#define VECTOR_UPSETS {len(answers.rows)}",
        f"#define VECTOR_ANSWERS {len(answers.words)}",
        f"#define VECTOR_STATE {answers.begin}      /* byte at which the words of a saved state begin */\n",
        "/* samples until each flight's end */",
        f"static const int vector_end[] = {{{', '.join(map(str, ends))}}};\n",
        "/* before a sample: byte of the saved state (0: none), or behind it field of the sample; the word there;",
        "   how many samples are flown so (0: the next row's word too) */",
        _array("vector_upset", answers.rows, 4),
        _array("vector_sample", samples, 7), _array("vector_answer", [answers.words], 0), "#endif\n"])


def _array(name: str, rows: list[list[int]], width: int) -> str:
    """Return the C array of a table with rows of `width` numbers; width 0: of its single row, one-dimensional."""
    listed = [", ".join(f"UINT64_C(0x{value:X})" for value in row) for row in rows]
    if width:
        body = ",\n".join(f"    {{{text}}}" for text in listed)
        return f"static const uint64_t {name}[{len(rows)}][{width}] = {{\n{body}}};\n"
    return f"static const uint64_t {name}[{len(rows[0])}] = {{\n    {listed[0]}}};\n"

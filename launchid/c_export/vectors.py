"""Replay vectors of an export: samples, and what the Python estimator answers to them, as the bits of C arrays."""

import itertools
import math
import struct
import zlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from launchid_core import BANDS, Change, Config, Estimate, Estimator, Sample, Status
from sim.errors import InputError, UsageError
from sim.flight import fly
from sim.nominal import Nominal

WINDOWS = 3            # of a vector
MOST_SAMPLES = 1500    # of a vector: 84 kB as words, that a target's flash takes
FEWEST_SAMPLES = 300
SEED = 1
ABSENT = 2             # share of the way through a vector, at which a value is missing: one half
NO_NUMBER = 0x7FF8000000000000  # every NaN
OFFSETS = ("thrust_misalignment", "moment", "attitude_bias", "gyro_bias", "nozzle_sensor_bias")


def flown(nominal: Nominal, config: Config) -> list[Sample]:
    """A short flight of the nominal with a sample refused, one repeated and a gap; of one that cannot be flown (no
    actuator, another period) sines."""
    count = min(max(WINDOWS * config.rows + 2, FEWEST_SAMPLES), MOST_SAMPLES)
    suite = "ideal" if config.formulation == "measured" else "flight"
    try:
        samples = list(itertools.islice(fly(nominal, SEED, suite, config.sample_period), count))
    except (InputError, UsageError):
        samples = [_swinging(config.sample_period * k) for k in range(count)]
    half = len(samples) // ABSENT
    refused = samples[half]._replace(theta=math.nan)
    return [*samples[:half], refused, samples[half], samples[half], *samples[half + 3:]]


def _swinging(t: float) -> Sample:
    """A sample of a vehicle that two sines drive."""
    slow, quick = math.sin(1.3 * t), math.sin(4.1 * t)
    return Sample(t, 0.02 * slow + 0.005 * quick, 0.026 * math.cos(1.3 * t) + 0.0205 * math.cos(4.1 * t),
                  0.01 * slow - 0.004 * quick, -0.0338 * slow - 0.084 * quick, 0.01 * slow - 0.004 * quick)


def word(x: float) -> int:
    """The bits of a number."""
    return NO_NUMBER if math.isnan(x) else struct.unpack("<Q", struct.pack("<d", x))[0]  # type: ignore[no-any-return]


def _words(values: Iterable[Any]) -> list[int]:
    """Numbers as their bits, counts in two's complement."""
    return [word(value) if isinstance(value, float) else int(value) % 2**64 for value in values]


def of_window(e: Estimate) -> list[int]:
    """The words that leave with a window, in the order of check.c."""
    tracked = e.tracked or (False, *(math.nan,) * 5)
    offsets = [x for name in OFFSETS for x in e.offsets.get(name, (math.nan, math.nan))]
    servo = [x for each, shared in zip(e.actuator.values(), e.actuator_corr, strict=True) for x in (*each, shared)] \
        if e.actuator else [math.nan] * 9
    return _words([
        int(e.status), e.rows, e.gaps, e.t_start, e.t_end, e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr, e.a6_dot,
        e.k1_dot, e.a6_bound, e.k1_bound, e.condition, *e.xi.ravel().tolist(), *e.support.ravel().tolist(),
        *tracked, e.wind, e.wind_std, *offsets, *servo, *_of_levels(e)])


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


def _of_change(c: Change) -> list[int]:
    return _words([ord(c.parameter[0]), c.t, c.t_std, c.before, c.after, c.size, c.size_std, c.alarm, c.final])


def header(config: Config, samples: list[Sample]) -> str:
    """The text of vectors.h."""
    estimator = Estimator(config)
    statuses: list[int] = []
    windows: list[list[int]] = []
    saved = b""
    with np.errstate(all="ignore"):  # in plain Python numpy would warn of what a status says
        for number, sample in enumerate(samples):
            if number == len(samples) // ABSENT:
                saved = estimator.save()
            statuses.append(int(estimator.update(sample)))
            if statuses[-1] == Status.WINDOW_COMPLETE:
                windows.append(of_window(estimator.estimate()))  # type: ignore[arg-type]
    changes = [_of_change(change) for change in estimator.changes()]
    notes = [estimator.counts.get(name, 0) for name in ("OUTLIER", "RESTART", "LEVEL_CLAMP", "CHANGE_WITHDRAWN")]
    width = len(windows[0]) if windows else 1
    return "\n".join([
        "/* Samples and what the Python estimator answers to them: bits of doubles, every NaN 7FF8000000000000. */\n",
        "#ifndef LAUNCHID_VECTORS_H\n#define LAUNCHID_VECTORS_H\n\n#include <stdint.h>\n",
        f"#define VECTOR_SAMPLES {len(samples)}\n#define VECTOR_WINDOWS {len(windows)}\n#define VECTOR_WORDS {width}",
        f"#define VECTOR_CHANGES {len(changes)}\n#define VECTOR_SAVED_AT {len(samples) // ABSENT}",
        f"#define VECTOR_SAVED_CHECKSUM UINT32_C({zlib.crc32(saved[:-4])})\n",
        _array("uint64_t", "vector_sample", [_words(sample) for sample in samples], "7"),
        _array("int8_t", "vector_status", [statuses], ""),
        _array("uint64_t", "vector_window", windows or [[0]], str(width)),
        _array("uint64_t", "vector_change", [*changes, [0] * 9], "9"),
        _array("uint64_t", "vector_notes", [notes], ""),
        "#endif\n"])


def _array(c: str, name: str, rows: list[list[int]], width: str) -> str:
    """The C array of a table; without a width, of its one row."""
    number = "UINT64_C(0x{:X})" if c == "uint64_t" else "{}"
    listed = [", ".join(number.format(value) for value in row) for row in rows]
    if width:
        body = ",\n".join(f"    {{{text}}}" for text in listed)
        return f"static const {c} {name}[{len(rows)}][{width}] = {{\n{body}}};\n"
    return f"static const {c} {name}[{len(rows[0])}] = {{\n    {listed[0]}}};\n"

"""An export in single precision: the same source with floats, and the constants that stand for a number's last digits.

Not the bits of Python, which has no such estimator: how far it is off is measured (`benchmarks/port_single.py`).
Stamps are floats too: counted from the flight's begin, below LONGEST periods.
"""

import math
import re

import numpy as np

from launchid_core import Config
from sim.errors import InputError

from .program import c_files, template

EPS = float(np.finfo(np.float32).eps)
LONGEST = 100_000      # periods: a stamp is then known to 1/250 of one
FORMULATIONS = ("measured", "difference", "integral")  # `filtered`: not yet measured over flights
TERMS = ("theta", "beta")
WINDOWS = (1.0, 10.0)  # s, as measured
ERROR = 0.1            # standard deviations: the demand, which the measured errors are far below
MEASURED = "benchmarks/port_single.py"
LN2_HIGH = 0.693145751953125          # ln 2 to 16 bits: a whole number below 2^8 times it is exact
QUARTER_HIGH = 1.5703125              # pi/2 to 8 bits, and the next 8, 8: a whole number below 2^16 times each is exact
QUARTER_NEXT = 0.00048351287841796875
QUARTER_LAST = 3.1383709e-07
CONSTANTS = {  # by their name in C
    "RING_SAME_INSTANT": 1.0e-2, "PREDICTOR_SAME_STEP": 4.0e-3, "EQUATIONS_RANK_TOLERANCE": 64.0 * EPS,
    "ROWS_STILL": 64.0 * EPS, "SPARSE_ACTIVE_TOLERANCE": 8.0 * EPS, "FILTERED_RANK_TOLERANCE": 64.0 * EPS,
    "ELEMENTARY_LN2_HIGH": LN2_HIGH, "ELEMENTARY_LN2_LOW": math.log(2.0) - LN2_HIGH,
    "ELEMENTARY_LARGEST": 88.7228, "ELEMENTARY_SMALLEST": -103.97, "ELEMENTARY_NARROW": 4097.0,
    "ELEMENTARY_FAR": 1.0e4}
FUNCTIONS = ("sqrt", "fabs", "floor", "fmod", "copysign", "frexp", "ldexp")
NUMBER = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")
LARGEST, SMALLEST = float(np.finfo(np.float32).max), float(np.finfo(np.float32).smallest_subnormal)


def refuse(config: Config) -> None:
    """InputError for what fails in single precision, or has not been measured."""
    why = ""
    if config.formulation not in FORMULATIONS:
        why = (f"formulation {config.formulation}: what it carries over a flight is not measured; expected one of "
               f"{', '.join(FORMULATIONS)}")
    elif config.terms != TERMS:
        why = f"library {', '.join(config.terms)}: windows are lost with 24 bits; expected {','.join(TERMS)}"
    elif not WINDOWS[0] <= config.window <= WINDOWS[1]:
        why = f"window {config.window:g} s: measured for {WINDOWS[0]:g} to {WINDOWS[1]:g} s only"
    if why:
        raise InputError(f"--float32: {why} ({MEASURED} measures it)")


def single_files(config: Config) -> dict[str, str]:
    """File name -> text of an estimator in single precision; InputError where that fails."""
    refuse(config)
    return converted(config)


def converted(config: Config) -> dict[str, str]:
    """The same, whether it fails or not."""
    files = c_files(config)
    made = {name: single(files[name]) for name in ("launchid.h", "launchid.c")}
    preface = re.search(r"preface\[\] = \{([^}]*)\}", made["launchid.c"])
    assert preface is not None
    *before, last = preface[1].rsplit(" ", 1)
    own = f"{' '.join(before)} {int(last) ^ 0xFF}"  # no saved state of the double one fits
    made["launchid.c"] = made["launchid.c"].replace(preface[1], own)
    made["replay.c"] = files["replay.c"].replace("%lf", "%f")
    called = re.search(r"only libm \(([^:]*):", files["README.md"])
    words = re.search(r"(\d+) bytes persist", files["README.md"])
    assert called is not None and words is not None
    made["README.md"] = template("README_single.md", {
        "formulation": config.formulation, "library": ", ".join(config.terms), "window": config.window,
        "period": config.sample_period, "error": ERROR, "measured": MEASURED,
        "longest": f"{LONGEST * config.sample_period:g}", "state_words": int(words[1]) // 8,
        "functions": ", ".join(f"{name.strip()}f" for name in called[1].split(","))})
    return made


def _rounded(match: re.Match[str]) -> str:
    """A number as a float's; what is too large is infinite, what is too small 0."""
    value = float(match[1])
    if value > LARGEST:
        return "INFINITY"
    return f"{0.0 if 0.0 < value < SMALLEST else value!r}F"


def single(source: str) -> str:
    """A C file in single precision."""
    code = source
    for name, value in CONSTANTS.items():
        code = re.sub(rf"(#define {name} ).*", lambda m, value=value: f"{m[1]}({value!r})", code)  # type: ignore[misc]
    rest = math.pi / 2.0 - QUARTER_HIGH - QUARTER_NEXT - QUARTER_LAST
    parts = ", ".join(map(repr, (QUARTER_HIGH, QUARTER_NEXT, QUARTER_LAST, rest)))
    code = re.sub(r"(ELEMENTARY_QUARTER_numbers\[\] = )\{.*\}", lambda m: f"{m[1]}{{{parts}}}", code)
    code = code.replace("union { double number; int64_t word; }", "union { float number; int32_t word; }")
    code = re.sub(r"\bdouble\b", "float", code)
    for name in FUNCTIONS:
        code = re.sub(rf"\b{name}\(", f"{name}f(", code)
    code = code.replace("end = put_words(saved, end, &bits.word, 1U);",
                        "end = put_word(saved, end, (uint64_t)(int64_t)bits.word);")
    code = code.replace(".word = (int64_t)take_word(", ".word = (int32_t)(uint32_t)take_word(")
    code = code.replace("expected plain double precision", "expected plain single precision")
    return re.sub(r'(/\*.*?\*/|"[^"\n]*")|' + NUMBER.pattern, lambda m: m[1] or _rounded_at(m), code, flags=re.S)


def _rounded_at(match: re.Match[str]) -> str:
    found = NUMBER.match(match[0])
    assert found is not None
    return _rounded(found)

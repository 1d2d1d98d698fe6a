"""Check the keys and values of a parsed TOML file one by one; an InputError names the place of each."""

import math
from dataclasses import MISSING, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, did_you_mean
from ..sections import ANYWHERE, AT_REST, LAWS, InTime, constant
from .profiles import read_columns

LARGEST_QUANTITY = 1e300  # a number beyond it is no physical quantity
KEY_CHOICES = {"law": LAWS, "alpha_source": ("inertial", "air"),
               "begins": (ANYWHERE, AT_REST)}  # keys that are no numbers
POSITIVE = {"natural_frequency", "deflection_limit", "period", "step", "duration", "time_constant", "turbulence_time",
            "time_limit", "effort"}
SIGNED = {"kp", "kd", "ki"}


class Table:
    """The parsed content of one TOML file; its methods check keys and values, and raise InputError naming the place."""

    def __init__(self, path: Path, table: dict[str, Any]) -> None:
        self.path = path
        self.table = table

    def fail(self, place: str, value: object, expected: str) -> InputError:
        shown = repr(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer of many digits"
        return InputError(f"{self.path}: {place} = {shown}: expected {expected}")

    def keys(self, section: str, allowed: set[str], required: set[str]) -> dict[str, Any]:
        table = self.table[section]
        if not isinstance(table, dict):
            raise self.fail(section, table, "a section")
        for key in table:
            if key not in allowed:
                otherwise = f"expected one of {', '.join(sorted(allowed))}"
                raise InputError(f"{self.path}: unknown key '{section}.{key}'; "
                                 + did_you_mean(key, sorted(allowed), otherwise))
        for key in sorted(required - set(table)):
            raise InputError(f"{self.path}: key '{section}.{key}' is missing")
        return table

    def number(self, place: str, value: object, above: float | None = None, least: float | None = None) -> float:
        expected = "a number" + (f" above {above:g}" if above is not None else "") + \
            (f" of at least {least:g}" if least is not None else "")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not -math.inf < value < math.inf:
            raise self.fail(place, value, expected)
        if not -LARGEST_QUANTITY < value < LARGEST_QUANTITY:
            raise self.fail(place, value, expected if isinstance(value, int)
                            else f"{expected}, below {LARGEST_QUANTITY:g}")
        if (above is not None and not value > above) or (least is not None and not value >= least):
            raise self.fail(place, value, expected)
        return float(value)

    def section(self, section: str, kind: type) -> Any:
        """Return a section as dataclass `kind` of numbers and words, keys checked by its fields; None without it."""
        if section not in self.table:
            return None
        names = {f.name for f in fields(kind)}
        required = {f.name for f in fields(kind) if f.default is MISSING}
        return kind(**self.values(section, self.keys(section, names, required)))

    def values(self, section: str, table: dict[str, Any]) -> dict[str, Any]:
        """Return a section's numbers and words, key -> value, each checked by its key; InputError if one is wrong."""
        return {key: self.value(f"{section}.{key}", key, value) for key, value in table.items()}

    def value(self, place: str, key: str, value: object) -> float | str:
        if key in KEY_CHOICES:
            if not isinstance(value, str) or value not in KEY_CHOICES[key]:
                raise self.fail(place, value, " or ".join(f'"{word}"' for word in KEY_CHOICES[key]))
            return value
        if key in POSITIVE:
            return self.number(place, value, above=0.0)
        return self.number(place, value, least=None if key in SIGNED else 0.0)

    def csv(self, place: str, value: object, header: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
        """Return name -> column of the CSV file that `value` names, relative to the nominal, and the file's path."""
        if not isinstance(value, str):
            raise self.fail(place, value, f"the path of a CSV file {','.join(header)}")
        path = self.path.parent / value
        return read_columns(path, header), str(path)

    def numbers(self, place: str, value: object, above: float | None = None,
                least: float | None = None) -> tuple[float, ...]:
        """Return a list of at least one number as tuple, each checked against the limits; InputError else."""
        if not isinstance(value, list) or not value:
            raise self.fail(place, value, "a list of numbers")
        return tuple(self.number(f"{place}[{i}]", x, above, least) for i, x in enumerate(value))

    def in_time(self, place: str, value: object) -> InTime:
        """Return a number, or one over time {t = [...], value = [...]} with increasing times; InputError else."""
        if not isinstance(value, dict):
            return constant(self.number(place, value))
        if set(value) != {"t", "value"}:
            raise self.fail(place, value, "a number, or {t = [...], value = [...]}")
        t, x = (self.numbers(f"{place}.{key}", value[key]) for key in ("t", "value"))
        if len(t) != len(x) or any(b <= a for a, b in pairwise(t)):
            raise self.fail(place, value, "increasing times t [s] and as many values")
        return InTime(t, x)

    def same_length(self, section: str, columns: dict[str, tuple[float, ...]]) -> None:
        (first, head), *others = columns.items()
        for key, column in others:
            if len(column) != len(head):
                raise InputError(f"{self.path}: {section}.{first} has {len(head)} numbers and {section}.{key} "
                                 f"{len(column)}; expected as many")

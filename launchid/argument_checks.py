"""Parameters as Python hands them over, held to what the command's words would be: UsageError in one line, never a
TypeError out of the depths."""

import math
import operator
from collections.abc import Iterable, Sequence
from typing import Any

from sim.errors import UsageError

# s, of every command that is not told another: a few of a loop's own periods, short beside a profile
DEFAULT_WINDOW = 5.0


def integer(name: str, value: Any, least: int) -> int:
    """A whole number of at least `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least:
        raise UsageError(f"{name} {_said(value)}: expected an integer of at least {least}")
    return number


def real(name: str, value: Any, expected: str = "a number") -> float:
    """A finite number; what range it must be of is the asker's."""
    try:
        number = math.nan if isinstance(value, (str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"{name} {_said(value)}: expected {expected}")
    return number


def word(name: str, value: Any, words: Sequence[str]) -> str:
    """One of these words."""
    for each in words:
        if isinstance(value, str) and value == each:
            return each
    raise UsageError(f"{name} {_said(value)}: expected one of {', '.join(words)}")


def several(name: str, value: Any, expected: str) -> list[Any]:
    """A list of things, not one of them: a text or a mapping would fall into its letters or names."""
    if isinstance(value, (str, bytes, dict)) or hasattr(value, "columns") or not isinstance(value, Iterable):
        raise UsageError(f"{name} {_said(value)}: expected {expected}")
    return list(value)


def _said(value: Any) -> str:
    """A number or a text as it is, of anything else what it is."""
    return repr(value) if value is None or isinstance(value, (bool, int, float, str)) else type(value).__name__

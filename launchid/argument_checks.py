"""Check arguments of functions called from Python as the command line checks its words: UsageError in one line, never a
TypeError out of the depths."""

import math
import operator
from collections.abc import Iterable, Sequence
from typing import Any

from sim.errors import UsageError


class Default(float):
    """A default that a user did not choose, so that a command may choose a fitter one."""


# s, of every command that is not told another: a few of a loop's own periods, short beside a profile
DEFAULT_WINDOW = Default(5.0)
LEAST_WINDOWS = 3    # of a log, of the default length: a shorter log has shorter ones


def window_for(window: Any, log: Any) -> Any:
    """Return a window's length [s] as it was asked for; the default one is at most a third of the log."""
    if not isinstance(window, Default):
        return window
    t, period = log.t[abs(log.t) < math.inf], log.check_clock()
    if period is None:
        return float(window)
    rows = round((float(t.max() - t.min()) + period) / period) // LEAST_WINDOWS
    return min(float(window), max(rows, 1) * period)


def window_seconds(window: Any, log: Any) -> float:
    """Return a window's length [s]: as asked for, the whole log for "all", the default one as `window_for`."""
    if window == "all":
        t = log.t[abs(log.t) < math.inf]
        return float(t.max() - t.min() + log.period)
    if isinstance(window, str):
        try:
            window = float(window)
        except ValueError:
            window = math.nan
    length = window_for(window, log)
    return real("--window", length, "seconds or 'all'")


def integer(name: str, value: Any, least: int) -> int:
    """Return `value` as an int; UsageError, which names it `name`, unless it is an integer of at least `least`."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least:
        raise UsageError(f"{name} {_said(value)}: expected an integer of at least {least}")
    return number


def real(name: str, value: Any, expected: str = "a number") -> float:
    """Return `value` as a finite float, of any range; else UsageError, which says `name` and what was expected."""
    try:
        number = math.nan if isinstance(value, (str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"{name} {_said(value)}: expected {expected}")
    return number


def word(name: str, value: Any, words: Sequence[str]) -> str:
    """Return `value` if it is one of the words; else UsageError, which names it `name`."""
    for each in words:
        if isinstance(value, str) and value == each:
            return each
    raise UsageError(f"{name} {_said(value)}: expected one of {', '.join(words)}")


def several(name: str, value: Any, expected: str) -> list[Any]:
    """Return an iterable as a list; UsageError for a text, mapping or data frame, which would fall into its parts."""
    if isinstance(value, (str, bytes, dict)) or hasattr(value, "columns") or not isinstance(value, Iterable):
        raise UsageError(f"{name} {_said(value)}: expected {expected}")
    return list(value)


def _said(value: Any) -> str:
    """Return a number or text as Python writes it, for anything else the name of its type."""
    return repr(value) if value is None or isinstance(value, (bool, int, float, str)) else type(value).__name__

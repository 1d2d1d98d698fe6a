"""Cut a log in time: the rows from one stamp to another, as `--from`, `--to`, a map's [cut] and `read_log` ask for."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.errors import InputError, UsageError

from .log import Log

START, END = "start", "end"   # words for the first and the last row
Bound = float | str | None    # s of the log's own time, START or END; None: nobody asked


@dataclass(frozen=True)
class Cut:
    """Rows of a log from stamp `first` to stamp `last` [s], both included; `is_asked`: a user chose them."""

    first: float = -math.inf
    last: float = math.inf
    is_asked: bool = False

    def of(self, log: Log) -> Log:
        """Return the log's rows within the cut, which may be none; a row without a stamp goes with those around it."""
        if not self.is_asked:
            return log
        with np.errstate(invalid="ignore"):
            outside = (log.t < self.first) | (log.t > self.last)
        inside = np.flatnonzero(~outside & np.isfinite(log.t))
        rows = slice(inside[0], inside[-1] + 1) if len(inside) else slice(0, 0)
        keep = ~outside[rows]
        arrays: dict[str, Any] = {name: x[rows][keep] for name, x in vars(log).items() if isinstance(x, np.ndarray)}
        return replace(log, **arrays, is_chosen=True)

    def of_whole(self, log: Log) -> Log:
        """Return the log's rows within the cut; InputError if there are none."""
        made = self.of(log)
        if not len(made.t):
            t = log.t[np.isfinite(log.t)]
            raise InputError(f"{log.path}: no row lies {self.words}; t runs from {np.min(t):g} to {np.max(t):g} s")
        return made

    @property
    def words(self) -> str:
        """Return the cut in words, as `between 3 and 7.5 s`."""
        if math.isfinite(self.first) and math.isfinite(self.last):
            return f"between {self.first:g} and {self.last:g} s"
        return f"from {self.first:g} s on" if math.isfinite(self.first) else f"up to {self.last:g} s"

    def but(self, from_: Bound, to: Bound, names: tuple[str, str] = ("--from", "--to")) -> "Cut":
        """Return the cut with those of its ends replaced that are given; UsageError for what is no time."""
        first = self.first if from_ is None else _time(names[0], from_, START, -math.inf)
        last = self.last if to is None else _time(names[1], to, END, math.inf)
        if not first < last:
            raise UsageError(f"{names[0]} {first:g} {names[1]} {last:g}: expected a first time before the last")
        return Cut(first, last, self.is_asked or from_ is not None or to is not None)


WHOLE = Cut()   # all rows, and nobody asked


def _time(name: str, value: float | str, word: str, of_word: float) -> float:
    """Return a bound [s], `of_word` for its word; UsageError, which names it `name`, for anything else."""
    if value == word:
        return of_word
    try:
        time = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        time = math.nan
    if not math.isfinite(time):
        raise UsageError(f"{name} {value!r}: expected a time in s, or {word}")
    return time


def cut_log(log: Log, from_: Bound = None, to: Bound = None, names: tuple[str, str] = ("--from", "--to")) -> Log:
    """Return the rows of a log from one time to another, both included; the whole log if neither is given.

    Parameters
    ----------
    log : Log
    from_ : float, "start" or None
        First time [s of the log's own time]; "start": the first row, chosen by the user.
    to : float, "end" or None
        Last time [s].
    names : tuple of str
        What messages call the two.

    Raises
    ------
    UsageError
        For what is no time, or a first time that is not before the last.
    InputError
        If no row lies between.
    """
    return WHOLE.but(from_, to, names).of_whole(log)

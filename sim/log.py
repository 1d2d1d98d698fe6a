"""Flight logs: CSV in and out; a file, a FIFO (a shell's `<(...)`), or `-` for standard input.

Required columns t, theta, beta; optional theta_dot, theta_ddot, beta_cmd,
theta_ref, rate_ref, and gamma or alpha; others are ignored with one line of notice.  SI units.  An empty cell
or `nan` is "not measured".  What cannot be read is an InputError naming file,
line and column; bad time stamps and values are data, and pass.

The logs of `data/logs`, which others measured (SOURCES.md there), are read by their names.
"""

import contextlib
import csv
import math
import os
import re
import stat
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from launchid_core import Sample

from .errors import InputError
from .files import is_read, reads, write_text
from .result import Result

if TYPE_CHECKING:
    from .flight import Flight
    from .result import Columns as Table
    from .result import Figure

MEASURED = Path(__file__).parent / "data" / "logs"  # that come with the package
REQUIRED = ("t", "theta", "beta")
STANDARD_INPUT = "-"
OPTIONAL = ("theta_dot", "theta_ddot", "beta_cmd", "theta_ref", "gamma", "alpha", "rate_ref")

# float() alone takes 1_000, Arabic-Indic digits and more; a log's cell is a plain ASCII number
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,4})?\Z|[+-]?inf\Z", re.ASCII)


@dataclass(frozen=True, eq=False)
class Log(Result):
    """A log as arrays of equal length; NaN where not measured, whole columns of NaN where the file has none."""

    path: str
    columns: tuple[str, ...]   # the known ones that the file has
    ignored: tuple[str, ...]   # the unknown ones
    t: np.ndarray
    theta: np.ndarray
    theta_dot: np.ndarray
    beta: np.ndarray
    theta_ddot: np.ndarray
    beta_cmd: np.ndarray
    theta_ref: np.ndarray
    gamma: np.ndarray = None     # type: ignore[assignment]  # left out: not measured, as the next two
    alpha: np.ndarray = None     # type: ignore[assignment]
    rate_ref: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name in ("gamma", "alpha", "rate_ref"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full(len(self.t), math.nan))

    def measured(self) -> dict[str, np.ndarray]:
        """The known columns that there are."""
        return {name: getattr(self, name) for name in self.columns}

    def table(self) -> "Table":
        return {name: x.tolist() for name, x in self.measured().items()}

    def summary(self, of: str | None = None) -> str:
        """Its rows, its time, and the share of them in which each column is measured."""
        shares = ", ".join(f"{name} {100.0 * np.isfinite(x).mean():.4g} %"
                           for name, x in self.measured().items() if name != "t")
        t = self.t[np.isfinite(self.t)]
        steps = np.diff(t)
        rows = f"{len(self.t)} rows over {np.ptp(t) if len(t) else 0.0:.6g} s"
        if (steps > 0).any():
            rows += f", {np.median(steps[steps > 0]):.6g} s apart"
        return f"{self.path if of is None else of}: {rows}; measured: {shares or 'nothing'}"

    def _figure(self) -> "Figure":
        from .answers.figures import log_figure
        return log_figure(self)

    @property
    def flight_path(self) -> np.ndarray:
        """gamma [rad] as the log has it, or theta - alpha; NaN where neither is measured."""
        return self.theta - self.alpha if "alpha" in self.columns else self.gamma

    @property
    def period(self) -> float:
        """Median step between finite stamps that go forward [s]; InputError if there is none."""
        t = self.t[np.isfinite(self.t)]
        steps = np.diff(t)
        steps = steps[steps > 0]
        if len(steps) == 0:
            raise InputError(f"{self.path}: column t: no two increasing time stamps, so there is no sample period")
        return float(np.median(steps))

    def samples(self) -> Iterator[Sample]:
        """The rows as the estimator's samples."""
        columns = (self.t, self.theta, self.theta_dot, self.beta, self.theta_ddot, self.beta_cmd,
                   self.flight_path)
        return starmap(Sample, zip(*(column.tolist() for column in columns), strict=True))


def _shown(cell: str) -> str:
    """A cell for a message: escaped and cut."""
    return ascii(cell if len(cell) <= 40 else cell[:40] + "...")


def _header(path: str, header: list[str], required: tuple[str, ...], where: str = "line 1: ") -> dict[str, int]:
    names = [name.strip() for name in header]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: {where}column {_shown(name)} stands {names.count(name)} times; expected once")
    if "gamma" in names and "alpha" in names:
        raise InputError(f"{path}: {where}columns gamma and alpha; expected one of them, the other follows from theta")
    for name in required:
        if name not in names:
            raise InputError(f"{path}: {where}column '{name}' is missing (found {_shown(','.join(names))}); "
                             f"expected a header with {', '.join(required)}")
    return {name: k for k, name in enumerate(names)}


def _cell(path: str, line: int, name: str, text: str) -> float:
    text = text.strip()
    if text == "" or text.lower() == "nan":
        return math.nan
    if not _NUMBER.match(text):
        raise InputError(f"{path}: line {line}, column {name}: {_shown(text)} is no number; "
                         "expected one such as -0.0123, or an empty cell")
    return float(text)


class Columns:
    """Which column of a CSV log is which: its header, read once, and its rows, as many at a time as there are.

    known, ignored   name -> place of the columns that are used; names of the others
    InputError for a header that cannot be a log's.
    """

    def __init__(self, path: str, header: list[str], required: tuple[str, ...] = REQUIRED,
                 where: str = "line 1: ") -> None:
        names = _header(path, header, required, where)
        self.path, self.width = path, len(header)
        self.known = {name: names[name] for name in REQUIRED + OPTIONAL if name in names}
        self.ignored = tuple(name for name in names if name not in self.known)

    def numbers(self, line: int, cells: list[str]) -> list[float]:
        """One row's known cells; InputError naming line and column."""
        if len(cells) != self.width:
            raise InputError(f"{self.path}: line {line}: {len(cells)} cells, expected {self.width} as in the header")
        return [_cell(self.path, line, name, cells[k]) for name, k in self.known.items()]

    def values(self, rows: list[list[float]]) -> dict[str, np.ndarray]:
        """The known columns of rows that `numbers` made."""
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(self.known))
        return {name: table[:, k].copy() for k, name in enumerate(self.known)}

    def log(self, rows: list[list[float]]) -> Log:
        """These rows as a log, even if none of them can be used."""
        return log_of_any(self.path, self.values(rows), self.ignored)


def measured_logs() -> tuple[str, ...]:
    """Names of the logs that come with the package."""
    return tuple(sorted(path.stem for path in MEASURED.glob("*.csv")))


def locate_log(text: str) -> Path:
    """A log by path, or by the name of one that comes with the package when no such file exists."""
    path = Path(text)
    return MEASURED / f"{text}.csv" if text in measured_logs() and not path.is_file() else path


@contextlib.contextmanager
def _opened(path: str) -> Iterator[TextIO]:
    """A log's text: of standard input for `-`, of a regular file, of the package's, of a FIFO (which can be read
    once)."""
    located = locate_log(path)
    if path == STANDARD_INPUT:
        if sys.stdin is None:
            raise InputError("-: standard input is closed; expected a CSV log there")
        number = sys.stdin.fileno()
        reads(number)
        with open(number, encoding="utf-8-sig", newline="", closefd=False) as file:
            yield file
        return
    if os.path.exists(path) and stat.S_ISFIFO(os.stat(path).st_mode):
        if is_read(path):
            raise InputError(f"{path}: named twice, and a pipe can be read once; expected another log")
    elif not os.path.isfile(path) and not located.is_file():
        what = "neither a file nor a pipe" if os.path.exists(path) else "no such file"
        raise InputError(f"{path}: {what}; expected a CSV log with the columns t, theta, beta, or one of "
                         + ", ".join(measured_logs()))
    reads(located)
    with open(located, encoding="utf-8-sig", newline="") as file:
        yield file


def read_log(path: str | Path, required: tuple[str, ...] = REQUIRED) -> Log:
    """Read a log; InputError in one line if it cannot be used.

    path      of a file, `-`: standard input, or the name of a log that comes with the package
    required  columns without which it cannot be; a row is usable where all of them are finite
    """
    path = str(path)
    rows: list[list[float]] = []
    try:
        with _opened(path) as file:
            reader = csv.reader(file, strict=True)
            header = next(reader, None)
            if header is None:
                raise InputError(f"{path}: empty file; expected a header with t, theta, beta")
            columns = Columns(path, header, required)
            rows = [columns.numbers(reader.line_num, cells) for cells in reader if cells]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; expected a UTF-8 CSV log") from None
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: {error}; expected comma-separated cells") from None
    return _made(path, columns.values(rows), required, columns.ignored)


def _made(path: str, values: dict[str, np.ndarray], required: tuple[str, ...], ignored: tuple[str, ...]) -> Log:
    """A log of these columns; InputError if no row can be used."""
    rows = len(values["t"])
    if rows == 0 or not np.isfinite(np.stack([values[name] for name in required])).all(axis=0).any():
        raise InputError(f"{path}: no usable row; expected rows with finite {', '.join(required)}")
    return log_of_any(path, values, ignored)


def log_of_any(path: str, values: dict[str, np.ndarray], ignored: tuple[str, ...] = ()) -> Log:
    """A log of these columns, even if no row of it can be used."""
    missing = {name: np.full(len(values["t"]), math.nan) for name in REQUIRED + OPTIONAL if name not in values}
    return Log(path=path, columns=tuple(values), ignored=ignored, **values, **missing)


def log_of(columns: Any, path: str = "log", required: tuple[str, ...] = REQUIRED) -> Log:
    """A log of columns in memory: a mapping, or a data frame of any library (names in `columns`, taken by them).

    path  what messages call it;  None and NA are not measured
    """
    given = list(columns.columns) if hasattr(columns, "columns") else list(columns)
    names = _header(path, [str(name) for name in given], required, "")
    known = [name for name in REQUIRED + OPTIONAL if name in names]
    values = {name: _column(path, name, columns[given[names[name]]]) for name in known}
    lengths = {name: len(x) for name, x in values.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{path}: columns of unequal length ({', '.join(f'{k} {n}' for k, n in lengths.items())})")
    return _made(path, values, required, tuple(name for name in names if name not in known))


def _column(path: str, name: str, column: Any) -> np.ndarray:
    try:
        values = np.array(column, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array([_in_memory(path, name, k, x) for k, x in enumerate(column)])
    if values.ndim != 1:
        raise InputError(f"{path}: column {name}: {values.ndim} dimensions; expected one")
    return values


def _in_memory(path: str, name: str, row: int, x: Any) -> float:
    """A cell of what is no plain array: None and a frame's NA are not measured."""
    if x is None or repr(x) == "<NA>":
        return math.nan
    try:
        return float(x)
    except (TypeError, ValueError):
        raise InputError(f"{path}: row {row}, column {name}: {_shown(str(x))} is no number") from None


def flown_columns(flight: "Flight") -> dict[str, np.ndarray]:
    """The columns of a flown log: t, theta_ref, beta_cmd, beta, theta, theta_dot (theta_ddot, gamma, rate_ref if it has
    them)."""
    names = ["t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot"]
    names += [name for name in ("theta_ddot", "gamma", "rate_ref") if not np.isnan(getattr(flight, name)).all()]
    return {name: getattr(flight, name) for name in names}


def flown_log(flight: "Flight", path: str = "flight") -> Log:
    """As it would be read."""
    return _made(path, flown_columns(flight), REQUIRED, ())


def write_flight(path: str | Path, flight: "Flight") -> None:
    """Write a flown log, in the shortest numbers that read back to the same bits."""
    write_columns(path, flown_columns(flight))


def write_columns(path: str | Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns of equal length as CSV."""
    def lines() -> Iterator[str]:
        yield ",".join(columns) + "\n"
        for row in zip(*(x.tolist() for x in columns.values()), strict=True):
            yield ",".join(map(repr, row)) + "\n"

    write_text(path, lines())

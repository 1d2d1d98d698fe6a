"""Flight logs: CSV in and out; a file, a FIFO (a shell's `<(...)`), or `-` for standard input.

Required columns t, theta, beta; optional theta_dot, theta_ddot, beta_cmd,
theta_ref, rate_ref, and gamma or alpha; others are ignored with one line of notice.  SI units.  An empty cell
or `nan` is "not measured".  What cannot be read is an InputError naming file,
line and column; bad time stamps and values are data, and pass.

The logs of `data/logs`, which others measured (SOURCES.md there), are read by their names.
"""

import contextlib
import difflib
import math
import os
import stat
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

import sim
from launchid_core import Sample
from sim.csv_text import AS_TEXT, rows, shown
from sim.errors import InputError, did_you_mean
from sim.files import is_read, reads, write_text
from sim.result import Result

from .table import DRIVEN, EITHER, OPTIONAL, REQUIRED, UNITS, Columns, first_of, places

if TYPE_CHECKING:
    from sim.flight import Flight
    from sim.result import Columns as Table
    from sim.result import Figure

MEASURED_LOGS = Path(sim.__file__).parent / "data" / "logs"  # that come with the package
STANDARD_INPUT = "-"
SHORTEST_STEP = 1.0e-6  # s between samples, the estimator's least: stamps that are nearer are no times
NEIGHBOUR = 1.5  # sample periods: a stamp this close to the next or the last one belongs to the log's clock
FED = 4096         # rows that are samples at a time
MOVING_COLUMNS = ("theta", "theta_dot", "beta")  # where anything moves


@dataclass(frozen=True, eq=False)
class Log(Result):
    """Flight log as columns (n,) [s, rad, rad/s, rad/s^2], NaN where not measured; columns, ignored: names."""

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
    beta_noise: float = 0.0    # rad, of a beta that is predicted and not measured, as the estimator gets it
    options: str = ""          # with which a command reads it (` --map MAP.toml`), for the next command
    is_chosen: bool = False    # a user chose its rows (`log.cut`), so that no phase of it is chosen for him

    def __post_init__(self) -> None:
        for name in ("gamma", "alpha", "rate_ref"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full(len(self.t), math.nan))

    def measured(self) -> dict[str, np.ndarray]:
        """Return name -> column (n,) of the known columns that the log has."""
        return {name: getattr(self, name) for name in self.columns}

    def in_range(self, name: str) -> np.ndarray:
        """Return (n,) bool: where column `name` is a number that the estimator does not reject as out of range."""
        from launchid_core import Config
        return np.abs(getattr(self, name)) <= getattr(Config, f"{name}_limit")

    def is_same(self, other: "Log") -> bool:
        """Whether the other log has the same columns with equal values (NaN equals NaN)."""
        return self.columns == other.columns and all(
            np.array_equal(x, getattr(other, name), equal_nan=True) for name, x in self.measured().items())

    def too_short(self, window: float) -> str:
        """Return a sentence that says why no window of `window` [s] in the log is complete."""
        t = self.t[np.isfinite(self.t)]
        if reason := self.unusable():
            return f"no window of {window:g} s is complete: {reason}"
        return (f"no window of {window:g} s is complete: the log has {len(t)} rows over {np.ptp(t):.4g} s; "
                "expected a longer log, or a smaller window")

    def unusable(self) -> str:
        """Return in words which columns an estimator cannot use, and why (beyond its limit, in how many rows, or never
        changing); "" if none."""
        from launchid_core import Config
        beyond, still = [], []
        for name, x in self.measured().items():
            limit = getattr(Config, f"{name}_limit", math.inf)
            if rows := int(np.count_nonzero(np.abs(x) > limit)):
                beyond.append(f"{name} is beyond {limit:g} {UNITS[name]} in {rows} of {len(x)} rows")
            if name in MOVING_COLUMNS and np.nanmax(x, initial=-math.inf) == np.nanmin(x, initial=math.inf):
                still.append(name)
        said = [f"{'; '.join(beyond)}, which rejects them: expected SI units"] if beyond else []
        if still:
            said.append(f"{', '.join(still)} never change{'s' * (len(still) == 1)} in {len(self.t)} rows")
        return "; ".join(said)

    def table(self) -> "Table":
        return {name: x.tolist() for name, x in self.measured().items()}

    def summary(self, of: str | None = None) -> str:
        """Return one line: path (or `of`), rows, duration, period, and the share of rows each column is measured in."""
        shares = ", ".join(f"{name} {100.0 * np.isfinite(x).mean():.4g} %"
                           for name, x in self.measured().items() if name != "t")
        t = self.t[np.isfinite(self.t)]
        steps = np.diff(t)
        rows = f"{len(self.t)} rows over {np.ptp(t) if len(t) else 0.0:.6g} s"
        if (steps > 0).any():
            rows += f", {np.median(steps[steps > 0]):.6g} s apart"
        return f"{self.path if of is None else of}: {rows}; measured: {shares or 'nothing'}"

    def _figure(self) -> "Figure":
        from .figure import columns_figure
        return columns_figure([self])

    @property
    def flight_path(self) -> np.ndarray:
        """Flight-path angle gamma (n,) [rad] as logged, or theta - alpha; NaN where neither is measured."""
        return self.theta - self.alpha if "alpha" in self.columns else self.gamma

    @property
    def period(self) -> float:
        """Median of the positive steps between finite stamps [s]; InputError if there is none or it is below 1 us."""
        period = self.check_clock()
        if period is None:
            steps = np.diff(self.t[np.isfinite(self.t)])
            remedy = "t runs backward: sort the rows by t" if (steps < 0).any() and len(steps) else \
                "no two increasing time stamps, so there is no sample period"
            raise InputError(f"{self.path}: column t: {remedy}")
        return period

    def span(self) -> tuple[float, float]:
        """Return the first and last time [s]; a stamp without neighbour within NEIGHBOUR sample periods is a bad one,
        not the log's end."""
        t = self.t[np.isfinite(self.t)]
        step = np.diff(t)
        near = (step > 0.0) & (step <= NEIGHBOUR * self.period)
        kept = t[np.append(near, False) | np.insert(near, 0, False)]
        return float(np.min(kept)), float(np.max(kept))

    @np.errstate(over="ignore")
    def check_clock(self) -> float | None:
        """Return the median of the positive steps between finite stamps [s], None if none; InputError if below 1 us."""
        steps = np.diff(self.t[np.isfinite(self.t)])
        steps = steps[steps > 0]
        period = float(np.median(steps)) if len(steps) > 0 else None
        if period is not None and not period >= SHORTEST_STEP:
            raise InputError(f"{self.path}: column t: its median step is {period:g} s; expected at least "
                             f"{SHORTEST_STEP:g} s")
        return period

    def samples(self) -> Iterator[Sample]:
        """Yield the rows as samples for the estimator."""
        columns = (self.t, self.theta, self.theta_dot, self._nozzle(), self.theta_ddot, self.beta_cmd,
                   self.flight_path)
        for first in range(0, len(self.t), FED):  # as Python's floats a log takes four times its arrays
            part = [column[first:first + FED].tolist() for column in columns]
            yield from starmap(Sample, zip(*part, strict=True))

    def rows(self) -> np.ndarray:
        """Return an array (n, 7) for `Estimator.replay`: t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma."""
        return np.column_stack([self.t, self.theta, self.theta_dot, self._nozzle(), self.theta_ddot, self.beta_cmd,
                                self.flight_path])

    def _nozzle(self) -> np.ndarray:
        """Return beta (n,) [rad] for the estimator: where it is predicted, with the white noise that says so."""
        if not self.beta_noise > 0.0:
            return self.beta
        return np.asarray(self.beta + self.beta_noise * np.random.default_rng(0).standard_normal(len(self.t)))


def measured_logs() -> tuple[str, ...]:
    """Return the names of the measured logs that come with the package."""
    return tuple(sorted(path.stem for path in MEASURED_LOGS.glob("*.csv")))


def near_files(path: str) -> list[str]:
    """Return the file beside a missing one whose name is nearest, as a user would name it; [] if none is near."""
    folder = os.path.dirname(path)
    try:
        names = sorted(os.listdir(folder or "."))
    except OSError:
        return []
    found = [name for name in names if not name.startswith(".") and os.path.isfile(os.path.join(folder, name))]
    return [os.path.join(folder, name) for name in difflib.get_close_matches(os.path.basename(path), found, 1)]


def locate_log(text: str) -> Path:
    """Return the path `text`, or if it is no file, that of the log of this name that comes with the package."""
    path = Path(text)
    return MEASURED_LOGS / f"{text}.csv" if text in measured_logs() and not path.is_file() else path


@contextlib.contextmanager
def _opened(path: str) -> Iterator[TextIO]:
    """Open as text standard input for `-`, a file, a FIFO (which can be read once) or a log of the package; InputError
    if there is none, or if it is a nominal."""
    located = locate_log(path)
    if path == STANDARD_INPUT:
        if sys.stdin is None:
            raise InputError("-: standard input is closed; expected a CSV log there")
        number = sys.stdin.fileno()
        reads(number)
        with open(number, closefd=False, **AS_TEXT) as file:
            yield file
        return
    from sim.nominal import NAMES
    if path.endswith(".toml") or (path in NAMES and not os.path.exists(path)):
        raise InputError(f"{path}: a nominal; the log comes first: COMMAND LOG NOMINAL")
    if os.path.exists(path) and stat.S_ISFIFO(os.stat(path).st_mode):
        if is_read(path):
            raise InputError(f"{path}: named twice, and a pipe can be read once; expected another log")
    elif not os.path.isfile(path) and not located.is_file():
        what = "neither a file nor a pipe" if os.path.exists(path) else "no such file"
        raise InputError(f"{path}: {what}; " + did_you_mean(
            path, near_files(path) or (*measured_logs(), *NAMES),
            f"expected a CSV log with the columns t, theta, beta, or one of {', '.join(measured_logs())}"))
    reads(located)
    with open(located, **AS_TEXT) as file:
        yield file


def read_log(path: str | Path, required: tuple[str, ...] = DRIVEN) -> Log:
    """Read a CSV log; InputError in one line if it cannot be read or no row has all required columns finite.

    path      of a file, `-`: standard input, or the name of a log that comes with the package
    required  columns that must be there; "a or b": one of the two
    """
    path = str(path)
    try:
        with _opened(path) as file:
            read = rows(path, file)
            header = next(read, None)
            if header is None:
                raise InputError(f"{path}: empty file; expected a header with {first_of(required)}")
            columns = Columns(path, header[1], required, f"line {header[0]}: ")
            values = columns.read(read)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    return _made(path, values, required, columns.ignored)


def _made(path: str, values: dict[str, np.ndarray], required: tuple[str, ...], ignored: tuple[str, ...]) -> Log:
    """Return the log of these columns; InputError if no row has all required ones finite."""
    there = [[np.isfinite(values[each]) for each in name.split(EITHER) if each in values] for name in required]
    if not np.logical_and.reduce([np.logical_or.reduce(each) for each in there]).any():
        raise InputError(f"{path}: no usable row; expected rows with finite {first_of(required)}")
    return log_of_values(path, values, ignored)


def log_of_values(path: str, values: dict[str, np.ndarray], ignored: tuple[str, ...] = ()) -> Log:
    """Return a log of columns name -> (n,), even if no row of it can be used; absent ones are NaN."""
    nothing = np.full(len(values["t"]), math.nan)
    arrays: dict[str, Any] = values | {name: nothing for name in REQUIRED + OPTIONAL if name not in values}
    return Log(path=path, columns=tuple(values), ignored=ignored, **arrays)


def log_of(columns: Any, path: str = "log", required: tuple[str, ...] = DRIVEN) -> Log:
    """Return the log of a mapping or data frame, name -> column of numbers; None, NA and masked values become NaN.

    path  what messages call it;  InputError for a missing column, unequal lengths, no numbers, or no usable row
    """
    given = _names(path, columns)
    names = places(path, [str(name) for name in given], required, "")
    known = [name for name in REQUIRED + OPTIONAL if name in names]
    values = {name: _column(path, name, columns[given[names[name]]]) for name in known}
    lengths = {name: len(x) for name, x in values.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{path}: columns of unequal length ({', '.join(f'{k} {n}' for k, n in lengths.items())})")
    return _made(path, values, required, tuple(name for name in names if name not in known))


def _names(path: str, columns: Any) -> list[Any]:
    """Return the column names of a frame, mapping or structured array; InputError for anything else."""
    if hasattr(columns, "collect"):
        raise InputError(f"{path}: expected a frame that holds its data, .collect(); found {type(columns).__name__}")
    named = columns.columns if hasattr(columns, "columns") else getattr(getattr(columns, "dtype", None), "names", None)
    if named is None and isinstance(columns, Mapping):
        named = columns
    if named is None or isinstance(columns, type):
        raise InputError(f"{path}: expected a path, a data frame, or a mapping of the columns t, theta, beta; found "
                         f"{type(columns).__name__}")
    return list(named)


def _column(path: str, name: str, column: Any) -> np.ndarray:
    hidden = np.ma.getmaskarray(column) if isinstance(column, np.ma.MaskedArray) else None
    raw = np.asarray(column) if hasattr(column, "dtype") else column
    if isinstance(raw, np.ndarray) and raw.dtype.kind in "mM":  # durations and dates
        raise InputError(f"{path}: column {name}: it holds dates; expected numbers"
                         + (", seconds from the first row on" if name == "t" else ""))
    if isinstance(raw, np.ndarray) and raw.dtype.kind == "c":
        raise InputError(f"{path}: column {name}: its numbers are complex; expected real ones")
    try:
        values = np.array(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.array([_in_memory(path, name, k, x) for k, x in enumerate(column)])
    if values.ndim != 1:
        raise InputError(f"{path}: column {name}: {values.ndim} dimensions; expected one")
    return values if hidden is None else np.where(hidden, math.nan, values)


def _in_memory(path: str, name: str, row: int, x: Any) -> float:
    """Return one cell as a float, None and a frame's NA as NaN; InputError if it is no number."""
    if x is None or repr(x) == "<NA>":
        return math.nan
    try:
        return float(x)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: row {row}, column {name}: {shown(str(x))} is no number") from None


def flown_columns(flight: "Flight") -> dict[str, np.ndarray]:
    """Return name -> column (n,) that a simulated flight logs: t, theta_ref, beta_cmd, beta, theta, theta_dot, and
    theta_ddot, gamma, rate_ref where it has them."""
    names = ["t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot"]
    names += [name for name in ("theta_ddot", "gamma", "rate_ref") if not np.isnan(getattr(flight, name)).all()]
    return {name: getattr(flight, name) for name in names}


def flown_log(flight: "Flight", path: str = "flight") -> Log:
    """Return the log of a simulated flight, as if it were written and read; messages call it `path`."""
    return _made(path, flown_columns(flight), REQUIRED, ())


def write_flight(path: str | Path, flight: "Flight") -> None:
    """Write the log of a simulated flight as CSV, numbers as the shortest text that reads back to the same bits."""
    write_columns(path, flown_columns(flight))


def write_columns(path: str | Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns (n,) of equal length as CSV under their names, whole or not at all."""
    def lines() -> Iterator[str]:
        yield ",".join(columns) + "\n"
        for row in zip(*(x.tolist() for x in columns.values()), strict=True):
            yield ",".join(map(repr, row)) + "\n"

    write_text(path, lines())

"""Read profiles over flight time from CSV files beside a nominal."""

import math
from pathlib import Path

import numpy as np

from ..csv_text import AS_TEXT, number, rows, shown
from ..errors import InputError
from ..files import reads
from ..sections import Profile

VEHICLE, DRIFT_COLUMNS, FORECAST = ("t", "a6", "k1"), ("t", "z_alpha", "z_beta"), ("t", "wind")  # headers


def constant_profile(a6: float, k1: float) -> Profile:
    """Return a profile of the same a6 and k1 [1/s^2] at all times: one node."""
    return Profile(np.zeros(1), np.array([a6]), np.array([k1]))


def read_columns(path: Path, header: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return name -> column (n,) of a CSV with this header, t first, increasing; InputError naming line and column."""
    reads(path)
    names = ",".join(header)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: no regular file; expected a CSV file {names}")
    columns: list[list[float]] = [[] for _ in header]
    try:
        with open(path, **AS_TEXT) as file:
            read = rows(str(path), file)
            if [cell.strip() for cell in next(read, (1, []))[1]] != list(header):
                raise InputError(f"{path}: line 1: expected the header {names}")
            for line, cells in read:
                _take(path, line, cells, header, columns)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a CSV file {names}") from None
    except ValueError as error:  # a NUL in the path
        raise InputError(f"{path}: cannot be read ({error}); expected a CSV file {names}") from None
    if not columns[0]:
        raise InputError(f"{path}: no rows; expected {names} over the flight")
    return {name: np.array(column) for name, column in zip(header, columns, strict=True)}


def _take(path: Path, line: int, cells: list[str], header: tuple[str, ...], columns: list[list[float]]) -> None:
    """Append one row's numbers to the columns; InputError naming line and column."""
    if len(cells) != len(header):
        raise InputError(f"{path}: line {line}: {len(cells)} cells, expected {len(header)} as in the header")
    for name, column, cell in zip(header, columns, cells, strict=True):
        value = number(cell)
        if value is None or not math.isfinite(value):
            raise InputError(f"{path}: line {line}, column {name}: {shown(cell.strip())} is no number; expected one "
                             "such as -0.0123")
        if name == "t" and column and value <= column[-1]:
            raise InputError(f"{path}: line {line}, column t: {value} is not after {column[-1]}; expected increasing "
                             "times")
        column.append(value)

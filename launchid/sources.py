"""Make logs and nominals from what a caller in Python gives for them, and pass warnings on to that caller."""

from __future__ import annotations

import dataclasses
import functools
import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol, TypeVar, Union, runtime_checkable

import numpy.typing as npt

from launchid.argument_checks import several
from launchid.log.cut import Bound, cut_log
from launchid.log.log import Log, log_of
from launchid.log.log import read_log as read_file
from launchid.log.table import DRIVEN
from sim import nominal as nominals
from sim.errors import InputError, UsageError
from sim.files import as_path
from sim.sections import Nominal

if TYPE_CHECKING:
    from launchid.report.answer import Answer


class DataWarning(UserWarning):
    """Warning that a command prints on stderr: about units, signs and stamps, or a nominal that ends early."""


@runtime_checkable
class Frame(Protocol):
    """Protocol of a data frame of any library: `columns`, and a column by its name."""

    @property
    def columns(self) -> Any: ...

    def __getitem__(self, name: Any, /) -> Any: ...


@runtime_checkable
class WithLog(Protocol):
    """Protocol of a result that has a log as `log`, such as a flight."""

    @property
    def log(self) -> Log: ...


LogSource = Union[str, "os.PathLike[str]", Mapping[str, npt.ArrayLike], Frame, Log, WithLog]
LogSources = LogSource | Sequence[LogSource]
NominalSource = Union[str, "os.PathLike[str]", Nominal]
Made = TypeVar("Made", bound="Answer")
Asked = ParamSpec("Asked")
OPTION = re.compile(r"(?<!\S)--([a-z][a-z0-9-]*)")
RENAMED_OPTIONS = {"effect": "effects"}  # of options whose parameter has another name


def read_log(source: LogSource, required: tuple[str, ...] = DRIVEN, *,
             map: str | os.PathLike[str] | None = None, from_: Bound = None, to: Bound = None) -> Log:
    """Return a log from a path, data frame, mapping of arrays, log, or result that has one.

    required  columns that it must have, else InputError; "a or b": one of the two
    map       for a path to a ULog, MCAP, MAT, HDF5, Parquet or other CSV file: MAP.toml, or "px4", "ardupilot",
              "betaflight", "tvc"
    from_, to first and last time [s of the log's own time] of its rows; "start", "end": all of them, whatever its
              phases; None: the phase in which beta moves the vehicle, if the log has others
    """
    if map is not None:
        from launchid.convert.columns import converted
        from launchid.convert.mapping import map_for
        path = str(as_path(source))
        mapping = map_for(path, as_path(map))
        mapping = dataclasses.replace(mapping, cut=mapping.cut.but(from_, to, ("from_", "to")))
        return _noted(*converted(path, mapping, required))
    return cut_log(_read(source, required), from_, to, ("from_", "to"))


def _read(source: LogSource, required: tuple[str, ...]) -> Log:
    """Return the whole log of a source."""
    if isinstance(source, Log):
        return dataclasses.replace(log_of(source.measured(), source.path, required), is_chosen=source.is_chosen,
                                   options=source.options)
    if isinstance(source, (str, os.PathLike)):
        as_path(source)
        from launchid.convert.readers import map_by_itself, refuse_foreign
        if own := map_by_itself(os.fspath(source)):
            from launchid.convert.columns import converted
            from launchid.convert.mapping import map_for
            try:
                mapping = map_for(os.fspath(source), own, was_asked=False)
            except InputError:
                refuse_foreign(os.fspath(source))
                raise
            return _noted(*converted(os.fspath(source), mapping, required))
        refuse_foreign(os.fspath(source))
        return read_file(os.fspath(source), required)
    if isinstance(source, WithLog) and isinstance(source.log, Log):
        return source.log
    return log_of(source, required=required)


def is_several(source: Any) -> bool:
    """Whether a source is a list of logs, one a flight."""
    return isinstance(source, (list, tuple)) and bool(source) and all(
        isinstance(each, (str, os.PathLike, Mapping, Log)) or isinstance(each, Frame) or
        isinstance(getattr(each, "log", None), Log) for each in source)


def several_logs(source: Any, required: tuple[str, ...] = DRIVEN) -> list[Log]:
    """Return the logs of a list, each read once; InputError if one is given twice."""
    read = [read_log(log, required) for log in source]
    for k, log in enumerate(read):
        if again := next((one for one in read[:k] if log.is_same(one)), None):
            raise InputError(f"{log.path}: the same flight as {again.path}; expected each once")
    return read


def each_of(logs: Sequence[LogSource]) -> list[LogSource]:
    """Return a list of logs, one a flight; UsageError for one log alone, which would fall into letters or columns."""
    return several("logs", logs, "a list of logs, one a flight")


def load_nominal(source: NominalSource) -> Nominal:
    """Return a nominal from a path, a built-in name or a Nominal; else InputError.  DataWarning for wrong feedback."""
    if isinstance(source, Nominal):
        return source
    if not isinstance(source, (str, os.PathLike)):
        raise InputError("nominal: expected a path, a name such as 'constant', or what load_nominal returns; found "
                         f"{type(source).__name__}")
    nominal = nominals.load_nominal(as_path(source))
    if warning := nominals.wrong_feedback(nominal):
        warnings.warn(warning, DataWarning, stacklevel=3)
    return nominal


def _noted(log: Log, notes: Sequence[str]) -> Log:
    """Return a log that was converted, after issuing each of the notes on it as a DataWarning."""
    for line in notes:
        warnings.warn(line, DataWarning, stacklevel=3)
    return log


def warned(answer: Made) -> Made:
    """Return the result after issuing each of its warnings as a DataWarning to the caller of the public function."""
    for line in answer.warnings:
        warnings.warn(line, DataWarning, stacklevel=3)
    return answer


def from_python(function: Callable[Asked, Made]) -> Callable[Asked, Made]:
    """Return a command's function for callers from Python: its warnings become DataWarnings, and its UsageErrors name
    parameters in place of the command's options."""
    @functools.wraps(function)
    def asked(*given: Asked.args, **named: Asked.kwargs) -> Made:
        try:
            answer = function(*given, **named)
        except UsageError as error:
            raise UsageError(OPTION.sub(_parameter, str(error))) from None
        return warned(answer)

    return asked


def _parameter(option: re.Match[str]) -> str:
    return RENAMED_OPTIONS.get(option[1], option[1].replace("-", "_"))

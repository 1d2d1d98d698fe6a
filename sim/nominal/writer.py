"""A nominal as the lines of its file; shortest numbers that read back to the same bits."""

import json
import math
import os
from collections.abc import Iterator
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, UsageError
from ..files import write_text
from ..sections import Controller, Drift, Forecast, Nominal, Profile, Required
from .control import ONLY_ATTITUDE
from .profiles import DRIFT, FORECAST, VEHICLE, read_columns


def write_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write a nominal that reads back equal; shortest numbers that read back to the same bits."""
    write_text(path, (line + "\n" for line in nominal_lines(nominal, path)))


def nominal_lines(nominal: Nominal, path: str | Path) -> list[str]:
    """The lines of a nominal file at this path.

    A profile that came from a file and still equals it is named by its path from the new file's folder; any other
    is written beside the new file as NAME.SECTION.csv (vehicle, uncertainty, drift, wind).
    """
    path = Path(path)
    if nominal.terms and len(nominal.vehicle.t) > 1:
        raise UsageError(f"nominal {nominal.name!r} has a profile and terms; a nominal file holds one or the other")
    lines = [f"name = {_literal(nominal.name)}", *_vehicle_lines(nominal, path)]
    for section, header, part in (("uncertainty", VEHICLE, nominal.uncertainty), ("drift", DRIFT, nominal.drift)):
        if part is not None:
            lines += ["", f"[{section}]", *_profile_lines(part, path, section, header)]
    if nominal.wind is not None:
        lines += ["", "[wind]", *_number_lines(nominal.wind)]
        if nominal.wind.profile is not None:
            lines.append(_path_line(nominal.wind.profile, path, "wind", FORECAST))
    for section in ("offsets", "actuator", "controller", "guidance", "sensors", "simulation", "diagnosis", "margins",
                    "test_input"):
        plain = getattr(nominal, section)
        if plain is not None and plain != Required():
            lines += ["", f"[{section}]", *_number_lines(plain)]
        for each in plain.filters if isinstance(plain, Controller) else ():
            lines += ["", "[[controller.filters]]", f"b = {_literal(each.b)}", f"a = {_literal(each.a)}"]
    for of in nominal.effects:
        from ..effects import values
        lines += ["", "[[effects]]", f"name = {_literal(of.name)}"]
        lines += [f"{key} = {_literal(value)}" for key, value in values(of).items()]
    return lines


def _number_lines(part: Any) -> Iterator[str]:
    """The keys of a section that are not their defaults: numbers, lists of them, words."""
    foreign = ONLY_ATTITUDE if isinstance(part, Controller) and part.is_rate_law else ()
    for key in fields(part):
        value = getattr(part, key.name)
        if key.name not in ("filters", "profile", *foreign) and not _is_default(key, value):
            yield f"{key.name} = {_literal(value)}"


def _is_default(key: "Field[Any]", value: object) -> bool:
    return value == key.default or (isinstance(value, float) and math.isnan(value))


def _literal(value: float | str | tuple[float, ...]) -> str:
    """A TOML value."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_literal, value)) + "]"
    return repr(float(value))


def _vehicle_lines(nominal: Nominal, path: Path) -> Iterator[str]:
    if not nominal.terms:
        yield from ("", "[vehicle]", *_profile_lines(nominal.vehicle, path, "vehicle", VEHICLE))
        return
    yield from ("", "[vehicle.terms]")
    rigid = (("theta", float(nominal.vehicle.a6[0])), ("beta", float(nominal.vehicle.k1[0])))
    for term, coefficient in (*rigid, *nominal.terms):
        yield f"{_literal(term)} = {_literal(coefficient)}"


def _profile_lines(profile: Profile | Drift, path: Path, section: str, header: tuple[str, ...]) -> list[str]:
    """Two numbers if it is constant, else the path of its CSV file."""
    if len(profile.t) == 1:
        return [f"{key} = {_literal(getattr(profile, key)[0])}" for key in header[1:]]
    return [_path_line(profile, path, section, header)]


def _path_line(profile: Profile | Drift | Forecast, path: Path, section: str, header: tuple[str, ...]) -> str:
    """The path of its CSV file, which is written unless it is there."""
    if profile.path and _same(profile, profile.path, header):
        return f"profile = {_literal(Path(os.path.relpath(profile.path, path.parent)).as_posix())}"
    beside = path.with_name(f"{path.stem}.{section}.csv")
    table = zip(*(getattr(profile, key).tolist() for key in header), strict=True)
    write_text(beside, [",".join(header) + "\n", *(",".join(map(repr, row)) + "\n" for row in table)])
    return f"profile = {_literal(beside.name)}"


def _same(profile: Profile | Drift | Forecast, path: str, header: tuple[str, ...]) -> bool:
    """The file at `path` still holds this profile."""
    try:
        columns = read_columns(Path(path), header)
    except InputError:
        return False
    return all(np.array_equal(getattr(profile, key), column) for key, column in columns.items())

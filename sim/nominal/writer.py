"""Turn a nominal into the content and the lines of its file; shortest numbers that read back to the same bits."""

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
from ..sections import (
    DRIFT_RATES,
    Bending,
    Controller,
    Diagnosis,
    Drift,
    Forecast,
    InTime,
    Nominal,
    Profile,
    Required,
    Section,
    Slosh,
)
from .control import FOLLOW_RANGE, OF_LAW
from .profiles import DRIFT_COLUMNS, FORECAST, VEHICLE, read_columns

Content = dict[str, Any]   # keys: numbers, texts, lists of numbers, sections, lists of sections


def write_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write a nominal file that reads back equal, without the comments of the file that it came from."""
    write_text(path, (line + "\n" for line in nominal_lines(nominal, path)))


def nominal_lines(nominal: Nominal, path: str | Path) -> list[str]:
    """Return the lines of a nominal file at this path; writes profiles beside it, as `content_of`."""
    return list(lines_of(content_of(nominal, path)))


def content_of(nominal: Nominal, path: str | Path) -> Content:
    """Return the content of a nominal file at this path, defaults left out; UsageError for a profile with terms.

    A profile that came from a file and still equals it is named by its path from the new file's folder; any other
    is written beside the new file as NAME.SECTION.csv (vehicle, uncertainty, drift, wind).
    """
    path = Path(path)
    if nominal.terms and len(nominal.vehicle.t) > 1:
        raise UsageError(f"nominal {nominal.name!r} has a profile and terms; a nominal file holds one or the other")
    content: Content = {"name": nominal.name, "vehicle": _vehicle(nominal, path)}
    for section, header, part in (("uncertainty", VEHICLE, nominal.uncertainty),
                                  ("drift", DRIFT_COLUMNS, nominal.drift)):
        if part is not None:
            content[section] = _profile(part, path, section, header)
    rates = {key: getattr(nominal, key) for key in DRIFT_RATES if getattr(nominal, key) is not None}
    if rates:
        content["uncertainty"] = content.get("uncertainty", {}) | rates
    if nominal.wind is not None:
        content["wind"] = _numbers(nominal.wind)
        if nominal.wind.profile is not None:
            content["wind"]["profile"] = _path(nominal.wind.profile, path, "wind", FORECAST)
    for section in ("offsets", "actuator", "controller", "guidance", "sensors", "simulation", "diagnosis", "margins",
                    "test_input"):
        plain = getattr(nominal, section)
        if plain is not None and plain not in (Diagnosis(), Required()):
            content[section] = _numbers(plain)
        if isinstance(plain, Controller) and plain.filters:
            content[section]["filters"] = [_filter(each) for each in plain.filters]
    for section, modes in (("slosh", nominal.slosh), ("bending", nominal.bending)):
        if modes:
            content[section] = [_mode(mode) for mode in modes]
    if nominal.effects:
        from ..effects import values
        content["effects"] = [{"name": each.name, **values(each)} for each in nominal.effects]
    return content


def lines_of(content: Content, section: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the TOML lines of a section: its own keys, then the sections in it."""
    for key, value in content.items():
        if not is_section(value):
            yield f"{key_of((*section, key))} = {literal(value)}"
    for key, value in content.items():
        name = ".".join((*section, key))
        if isinstance(value, dict):
            if not value or not all(map(is_section, value.values())):
                yield from ("", f"[{name}]")
            yield from lines_of(value, (*section, key))
        elif is_section(value):
            for each in value:
                yield from ("", f"[[{name}]]", *lines_of(each, (*section, key)))


def key_of(place: tuple[str, ...]) -> str:
    """Return the last key of a place as it stands in its line; names of library terms are quoted."""
    return literal(place[-1]) if place[:-1] == ("vehicle", "terms") else place[-1]


def literal(value: float | str | list[float]) -> str:
    """Return a number, text or list as a TOML value."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return "[" + ", ".join(map(literal, value)) + "]"
    return repr(float(value))


def is_section(value: object) -> bool:
    """Whether a content's value is a section (dict) or a list of sections."""
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _numbers(part: Any) -> Content:
    """Return the keys of a section that are not their defaults: numbers, lists of numbers, words."""
    foreign = [key for keys in OF_LAW.values() for key in keys if key not in OF_LAW[part.law]] \
        if isinstance(part, Controller) else ()
    return {key.name: list(value) if isinstance(value, tuple) else value
            for key, value in ((key, getattr(part, key.name)) for key in fields(part))
            if key.name not in ("filters", "profile", *foreign) and not _is_default(key, value)}


def _filter(section: Section) -> Content:
    """Return the keys of a filter: its coefficients, or of a notch that follows a mode its numbers."""
    own = section.follow
    if own is None:
        return {"b": list(section.b), "a": list(section.a)}
    content: Content = {"kind": "notch", "frequency": own.frequency, "depth_damping": own.depth_damping,
                        "width_damping": own.width_damping, "follow": own.mode}
    return content if own.reach == FOLLOW_RANGE else content | {"follow_range": own.reach}


def _mode(mode: Slosh | Bending) -> Content:
    """Return the keys of a mode that are not their defaults: numbers, and numbers over time."""
    content: Content = {}
    for key in fields(mode):
        value = getattr(mode, key.name)
        if value == key.default:
            continue
        is_constant = isinstance(value, InTime) and len(value.t) == 1
        content[key.name] = value.value[0] if is_constant else \
            {"t": list(value.t), "value": list(value.value)} if isinstance(value, InTime) else value
    return content


def _is_default(key: "Field[Any]", value: object) -> bool:
    return value == key.default or (isinstance(value, float) and math.isnan(value))


def _vehicle(nominal: Nominal, path: Path) -> Content:
    if not nominal.terms:
        return _profile(nominal.vehicle, path, "vehicle", VEHICLE)
    rigid = {"theta": float(nominal.vehicle.a6[0]), "beta": float(nominal.vehicle.k1[0])}
    return {"terms": rigid | dict(nominal.terms)}


def _profile(profile: Profile | Drift, path: Path, section: str, header: tuple[str, ...]) -> Content:
    """Return two numbers if the profile is constant and of no file, else the path of its CSV file."""
    if len(profile.t) == 1 and not profile.path:
        return {key: float(getattr(profile, key)[0]) for key in header[1:]}
    return {"profile": _path(profile, path, section, header)}


def _path(profile: Profile | Drift | Forecast, path: Path, section: str, header: tuple[str, ...]) -> str:
    """Return the path of the profile's CSV file, which is written unless it is there."""
    if profile.path and _same(profile, profile.path, header):
        return Path(os.path.relpath(profile.path, path.parent)).as_posix()
    beside = path.with_name(f"{path.stem}.{section}.csv")
    table = zip(*(getattr(profile, key).tolist() for key in header), strict=True)
    write_text(beside, [",".join(header) + "\n", *(",".join(map(repr, row)) + "\n" for row in table)])
    return beside.name


def _same(profile: Profile | Drift | Forecast, path: str, header: tuple[str, ...]) -> bool:
    """Whether the file at `path` still holds this profile."""
    try:
        columns = read_columns(Path(path), header)
    except InputError:
        return False
    return all(np.array_equal(getattr(profile, key), column) for key, column in columns.items())

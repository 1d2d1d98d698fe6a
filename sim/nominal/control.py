"""Read the sections of a nominal that steer: [actuator], [controller] with its filters, [guidance], [test_input]."""

import math
from dataclasses import fields, replace
from typing import Any

from ..errors import InputError
from ..sections import Actuator, Controller, Follow, Guidance, Multisine, Section, lowpass, notch
from .table import Table

# keys of the controller's laws beside kp and period
OF_LAW = {"attitude": ("kd", "derivative_time_constant"), "rate": ("ki",), "gyro": ("kd",)}
OPTIONAL_OF_LAW = ("ki",)
# keys of a filter by its kind; "": by its coefficients
FILTER_KINDS = {"": ("b", "a"), "notch": ("frequency", "depth_damping", "width_damping"),
                "lowpass": ("frequency", "damping_ratio")}
FOLLOW_RANGE = 0.3  # share of its declared frequency by which a notch may follow a mode up or down


def actuator_of(file: Table) -> Actuator | None:
    """Return [actuator]: natural_frequency and damping_ratio, or time_constant; None without; InputError if wrong."""
    if "actuator" not in file.table:
        return None
    table = file.keys("actuator", {f.name for f in fields(Actuator)}, set())
    second = {"natural_frequency", "damping_ratio"}
    if "time_constant" in table and second & set(table):
        raise InputError(f"{file.path}: [actuator] has time_constant and {min(second & set(table))}; expected "
                         "natural_frequency and damping_ratio, or time_constant")
    for key in ("natural_frequency_sigma", "damping_ratio_sigma"):
        if "time_constant" in table and key in table:
            raise InputError(f"{file.path}: [actuator] has time_constant and {key}; expected natural_frequency and "
                             "damping_ratio, of which alone it can be asked")
    for key in sorted(second - set(table)) if "time_constant" not in table else ():
        raise InputError(f"{file.path}: key 'actuator.{key}' is missing; expected natural_frequency and "
                         "damping_ratio, or time_constant")
    return Actuator(**file.values("actuator", table))


def controller_of(file: Table) -> Controller | None:
    """Return [controller] of law attitude or rate with its filters, None without it; InputError if wrong."""
    if "controller" not in file.table:
        return None
    names = {f.name for f in fields(Controller)}
    table = dict(file.keys("controller", names, {"kp", "period"}))
    filters = table.pop("filters", [])
    given = file.values("controller", table)
    law = given.get("law", "attitude")
    for key in dict.fromkeys(key for keys in OF_LAW.values() for key in keys):
        if key in given and key not in OF_LAW[law]:
            raise InputError(f"{file.path}: key 'controller.{key}' is not of law \"{law}\"; expected it left out")
    file.keys("controller", names, {"kp", "period", *(key for key in OF_LAW[law] if key not in OPTIONAL_OF_LAW)})
    given = dict.fromkeys(OF_LAW["attitude"], 0.0) | given
    return Controller(filters=filters_of(file, filters, float(given["period"])), **given)


def filters_of(file: Table, tables: object, period: float) -> tuple[Section, ...]:
    """Return [[controller.filters]] as discrete sections at the controller's period [s]; InputError if wrong."""
    if not isinstance(tables, list):
        raise file.fail("controller.filters", tables, "[[controller.filters]] tables")
    return tuple(filter_of(file, f"controller.filters[{k}]", table, period) for k, table in enumerate(tables))


def filter_of(file: Table, place: str, table: object, period: float) -> Section:
    """Return a filter's discrete section, from coefficients b, a or its kind (notch, lowpass); InputError if wrong."""
    if not isinstance(table, dict):
        raise file.fail(place, table, "a table with b and a, or with kind")
    kind = table.get("kind", "")
    names = FILTER_KINDS.get(kind) if isinstance(kind, str) else None
    if names is None:
        raise file.fail(f"{place}.kind", kind, " or ".join(f'"{word}"' for word in FILTER_KINDS if word))
    known = (*names, *(("follow", "follow_range") if kind == "notch" else ()))
    for key in table:
        if key not in {*known, *(["kind"] if kind else [])}:
            raise InputError(f"{file.path}: unknown key '{place}.{key}'; expected one of {', '.join(known)}")
    for key in names:
        if key not in table:
            raise InputError(f"{file.path}: key '{place}.{key}' is missing")
    if not kind:
        return coefficients_of(file, place, table)
    numbers = [file.number(f"{place}.{key}", table[key], least=0.0) for key in names]
    if not 0.0 < numbers[0] * period < math.pi:
        raise file.fail(f"{place}.frequency", table["frequency"],
                        f"a number above 0 and below {math.pi / period:g} rad/s, half the controller's rate")
    if kind == "lowpass":
        return lowpass(period, *numbers)
    return replace(notch(period, *numbers), follow=follow_of(file, place, table, period, *numbers))


def follow_of(file: Table, place: str, table: dict[str, Any], period: float, frequency: float, depth_damping: float,
              width_damping: float) -> Follow | None:
    """Return which mode of the file a notch follows, and how far; None if none; InputError if wrong."""
    if "follow" not in table:
        if "follow_range" in table:
            raise InputError(f"{file.path}: key '{place}.follow_range' without follow; expected both, or neither")
        return None
    tables = {kind: file.table.get(kind) for kind in ("slosh", "bending")}
    modes = [f"{kind}{k + 1}" for kind, there in tables.items() if isinstance(there, list) for k in range(len(there))]
    if table["follow"] not in modes:
        raise file.fail(f"{place}.follow", table["follow"],
                        "a mode of this file: " + " or ".join(f'"{mode}"' for mode in modes) if modes else
                        "a [[slosh]] or [[bending]] in this file, which it names: \"bending1\" is the first")
    share = file.number(f"{place}.follow_range", table.get("follow_range", FOLLOW_RANGE), above=0.0)
    if share >= 1.0 or not (1.0 + share) * frequency * period < math.pi:
        raise file.fail(f"{place}.follow_range", share, "a share below 1 with which the notch stays below "
                        f"{math.pi / period:g} rad/s, half the controller's rate")
    return Follow(table["follow"], frequency, depth_damping, width_damping, share)


def coefficients_of(file: Table, place: str, table: dict[str, Any]) -> Section:
    b, a = (file.numbers(f"{place}.{key}", table[key]) for key in ("b", "a"))
    for key, values in (("b", b), ("a", a)):
        if len(values) != 3:
            raise file.fail(f"{place}.{key}", list(values), "three numbers")
    if a[0] != 1.0:
        raise file.fail(f"{place}.a", list(a), "1 as the first number")
    return Section((b[0], b[1], b[2]), (a[0], a[1], a[2]))


def guidance_of(file: Table, controller: Controller | None) -> Guidance | None:
    """Return [guidance]: theta_ref, for law `rate` also or instead rate_ref; None without it; InputError if wrong."""
    if "guidance" not in file.table:
        return None
    keys = ("t", "theta_ref", "rate_ref")
    table = file.keys("guidance", set(keys), {"t"})
    alone = "rate_ref" in table and controller is not None and controller.is_rate_law
    file.keys("guidance", set(keys), {"t"} if alone else {"t", "theta_ref"})
    columns = {key: file.numbers(f"guidance.{key}", table[key]) for key in keys if key in table}
    file.same_length("guidance", columns)
    if any(b <= a for a, b in zip(columns["t"], columns["t"][1:], strict=False)):
        raise file.fail("guidance.t", list(columns["t"]), "increasing times")
    return Guidance(**{"theta_ref": (0.0,) * len(columns["t"])} | columns)


def test_input_of(file: Table) -> Multisine | None:
    """Return [test_input], equally long lists of its sines, None without it; InputError if wrong."""
    if "test_input" not in file.table:
        return None
    names = {f.name for f in fields(Multisine)}
    table = file.keys("test_input", names, names)
    columns = {"frequency": file.numbers("test_input.frequency", table["frequency"], above=0.0),
               "amplitude": file.numbers("test_input.amplitude", table["amplitude"], least=0.0),
               "phase": file.numbers("test_input.phase", table["phase"])}
    file.same_length("test_input", columns)
    return Multisine(file.number("test_input.start", table["start"], least=0.0),
                     file.number("test_input.duration", table["duration"], above=0.0), **columns)

"""Read the sections of a nominal that steer: [actuator], [controller] with its filters, [guidance], [test_input]."""

import math
from dataclasses import fields
from typing import Any

from ..errors import InputError
from ..sections import Actuator, Controller, Guidance, Multisine, Section
from .table import Table

ONLY_ATTITUDE, ONLY_RATE = ("kd", "derivative_time_constant"), ("ki",)  # keys of the controller's laws
# keys of a filter by its kind; "": by its coefficients
FILTER_KINDS = {"": ("b", "a"), "notch": ("frequency", "depth_damping", "width_damping"),
                "lowpass": ("frequency", "damping_ratio")}


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
    for key in ONLY_RATE if law == "attitude" else ONLY_ATTITUDE:
        if key in given:
            raise InputError(f"{file.path}: key 'controller.{key}' is not of law \"{law}\"; expected it left out")
    if law == "attitude":
        file.keys("controller", names, {"kp", "period", *ONLY_ATTITUDE})
    elif law == "rate":
        given |= dict.fromkeys(ONLY_ATTITUDE, 0.0)
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
    for key in table:
        if key not in {*names, *(["kind"] if kind else [])}:
            raise InputError(f"{file.path}: unknown key '{place}.{key}'; expected one of {', '.join(names)}")
    for key in names:
        if key not in table:
            raise InputError(f"{file.path}: key '{place}.{key}' is missing")
    if not kind:
        return coefficients_of(file, place, table)
    numbers = [file.number(f"{place}.{key}", table[key], least=0.0) for key in names]
    if not 0.0 < numbers[0] * period < math.pi:
        raise file.fail(f"{place}.frequency", table["frequency"],
                        f"a number above 0 and below {math.pi / period:g} rad/s, half the controller's rate")
    return tustin(kind, period, *numbers)


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


def tustin(kind: str, period: float, frequency: float, *damping: float) -> Section:
    """Return a notch or lowpass as discrete section by Tustin's rule, prewarped at w = frequency [rad/s]: s = w/c (z -
    1)/(z + 1), c = tan(w period/2) (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., ch. 8.3).

    damping  notch: of the numerator, of the denominator; lowpass: of the denominator
    """
    c = math.tan(0.5 * frequency * period)

    def quadratic(zeta: float) -> tuple[float, float, float]:
        """c^2/w^2 (s^2 + 2 zeta w s + w^2) (z + 1)^2, powers of z falling."""
        return 1.0 + 2.0 * zeta * c + c * c, 2.0 * (c * c - 1.0), 1.0 - 2.0 * zeta * c + c * c

    numerator = quadratic(damping[0]) if kind == "notch" else (c * c, 2.0 * c * c, c * c)
    a0, a1, a2 = quadratic(damping[-1])
    b0, b1, b2 = numerator
    return Section((b0 / a0, b1 / a0, b2 / a0), (1.0, a1 / a0, a2 / a0))

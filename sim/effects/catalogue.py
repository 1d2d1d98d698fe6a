"""The catalogue of causes: find them by name, read them from text or TOML tables, pack them for the compiled step.

What may be left out: a parameter with a default takes it; one with a neutral value
takes that, provided at least one parameter of the effect is given; any other is
required.  An effect may stand several times (two gusts, two bending modes).
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from launchid_core import parse_term, term_name

from ..errors import UsageError, did_you_mean
from . import actuator, controller, environment, plant, sensor
from .table import CENTRE, Cause, Changes, Effect, Parameter

_PLACES: dict[str, Any] = {"plant": plant, "environment": environment, "actuator": actuator}  # of more than numbers
CATALOGUE: dict[str, Cause] = {cause.name: cause for cause in (
    *plant.PLANT_EFFECTS, *environment.ENVIRONMENT_EFFECTS, *actuator.ACTUATOR_EFFECTS, *sensor.SENSOR_EFFECTS,
    *controller.CONTROLLER_EFFECTS)}
_ORDER = {name: k for k, name in enumerate(CATALOGUE)}

RADIANS_PER_STEP = 0.5  # Runge-Kutta 4 loses 0.02 % of an oscillation's amplitude a radian at this frequency times step


def find(name: str) -> Cause:
    """Return the cause of this name; UsageError that lists the known ones."""
    if name not in CATALOGUE:
        otherwise = f"expected one of {', '.join(CATALOGUE)}"
        raise UsageError(f"unknown effect {name!r}; {did_you_mean(name, CATALOGUE, otherwise)}")
    return CATALOGUE[name]


def effect(name: str, /, **given: Any) -> Effect:
    """Return an effect with parameters `given`, checked; UsageError naming effect, parameter and what is allowed."""
    cause = find(name)
    known = ", ".join(parameter.name for parameter in cause.parameters)
    for key in given:
        if key not in {parameter.name for parameter in cause.parameters}:
            raise UsageError(f"effect {name}: unknown parameter {key!r}; expected {known}")
    if not given:
        raise UsageError(f"effect {name}: no parameter given; expected {known}")
    return Effect(name, tuple(_value(cause, parameter, given) for parameter in cause.parameters))


def _value(cause: Cause, parameter: Parameter, given: Mapping[str, Any]) -> float | str:
    """Return the parameter's value: given and checked, or the one it takes when left out."""
    if parameter.name not in given:
        if parameter.is_required:
            raise UsageError(f"effect {cause.name}: parameter {parameter.name!r} is missing; "
                             f"expected {parameter.expected}")
        left_out = parameter.default if parameter.neutral is None else parameter.neutral
        assert left_out is not None
        return left_out
    value = given[parameter.name]
    refusal = UsageError(f"effect {cause.name}: {parameter.name} = {value!r}: expected {parameter.expected}")
    if parameter.is_term:
        return _term(value, refusal)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise refusal
    try:
        number = float(value)
    except OverflowError:
        raise refusal from None
    if not parameter.allows(number):
        raise refusal
    return number


def _term(value: object, refusal: UsageError) -> str:
    """Return the canonical name of a library term of theta, theta_dot, beta (tau, a window's time, is refused)."""
    if not isinstance(value, str):
        raise refusal
    try:
        code = parse_term(value)
    except ValueError:
        raise refusal from None
    if code[3]:
        raise refusal
    return term_name(code)


def values(effect: Effect) -> dict[str, float | str]:
    """Return the effect's parameters, name -> value."""
    return dict(zip((parameter.name for parameter in CATALOGUE[effect.name].parameters), effect.values, strict=True))


def from_text(text: str) -> Effect:
    """Parse an effect from NAME:PARAMETER=VALUE[,PARAMETER=VALUE...]; UsageError in one line if it is none."""
    name, colon, rest = text.partition(":")
    cause = find(name.strip())
    given: dict[str, float | str] = {}
    for part in rest.split(",") if colon and rest.strip() else ():
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            raise UsageError(f"effect {text!r}: {part!r} is no PARAMETER=VALUE")
        if key in given:
            raise UsageError(f"effect {text!r}: parameter {key!r} stands twice")
        parameter = next((p for p in cause.parameters if p.name == key), None)
        given[key] = value if parameter is None or parameter.is_term else _number(cause, parameter, value)
    return effect(cause.name, **given)


def _number(cause: Cause, parameter: Parameter, text: str) -> float:
    try:
        if text.endswith("%") and not parameter.unit:
            return float(text[:-1]) / 100.0
        return float(text)
    except ValueError:
        raise UsageError(f"effect {cause.name}: {parameter.name} = {text!r}: expected {parameter.expected}") from None


def from_table(table: object) -> Effect:
    """Parse an effect from one `[[effects]]` table of a nominal: `name` and parameters; UsageError if it is none."""
    if not isinstance(table, dict):
        raise UsageError(f"{table!r}: expected a table with name and parameters")
    name = table.get("name")
    if not isinstance(name, str):
        raise UsageError(f"name = {name!r}: expected one of {', '.join(CATALOGUE)}")
    return effect(name, **{str(key): value for key, value in table.items() if key != "name"})


def pack(effects: Iterable[Effect], step: float, centre: float = math.nan) -> Changes:
    """Return the sum of what all effects change in a flight; their order does not matter.

    effects  any number of each
    step     [s] of integration; UsageError if it does not resolve an effect's frequency
    centre   [s] of the flight, or of the log: a `middle` that is not given; NaN if there is none
    """
    changes = Changes()
    for each in sorted(effects, key=lambda each: (_ORDER[each.name], tuple(map(repr, each.values)))):
        cause = CATALOGUE[each.name]
        given: dict[str, Any] = {parameter.name: centre if value == CENTRE and parameter.default == CENTRE else value
                                 for parameter, value in zip(cause.parameters, each.values, strict=True)}
        if "frequency" in given and not given["frequency"] * step <= RADIANS_PER_STEP:
            raise UsageError(f"effect {each.name}: frequency = {given['frequency']!r}: expected at most "
                             f"{RADIANS_PER_STEP / step:g} rad/s, what the simulation's step of {step:g} s resolves")
        for parameter in cause.parameters:
            if parameter.into:
                changes.join(parameter, given[parameter.name])
        if cause.where in _PLACES:
            _PLACES[cause.where].change(changes, each.name, given)
    return changes

"""The sections of a nominal that fly: [vehicle] and its range, [drift], [wind], [[effects]]."""

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, UsageError
from ..sections import Drift, Forecast, Profile, Wind
from .profiles import DRIFT_COLUMNS, FORECAST, VEHICLE, constant_profile
from .table import Table

if TYPE_CHECKING:
    from ..effects import Effect


def vehicle_of(file: Table) -> tuple[Profile, tuple[tuple[str, float], ...]]:
    """a6 and k1 over time, and the further terms: from two numbers, a CSV file, or terms with coefficients."""
    table = file.keys("vehicle", {"a6", "k1", "profile", "terms"}, set())
    for key, what in (("profile", "a profile"), ("terms", "terms")):
        if key in table and len(table) > 1:
            raise InputError(f"{file.path}: [vehicle] has {what} and other keys; expected one or the other")
    if "profile" in table:
        return profile_of(file, "vehicle.profile", table["profile"]), ()
    if "terms" in table:
        terms = terms_of(file, table["terms"])
        return (constant_profile(terms.pop("theta", 0.0), terms.pop("beta", 0.0)), tuple(terms.items()))
    file.keys("vehicle", {"a6", "k1"}, {"a6", "k1"})
    return constant_profile(file.number("vehicle.a6", table["a6"]), file.number("vehicle.k1", table["k1"])), ()


def profile_of(file: Table, place: str, value: object) -> Profile:
    columns, path = file.csv(place, value, VEHICLE)
    return Profile(path=path, **columns)


def terms_of(file: Table, table: object) -> dict[str, float]:
    """[vehicle.terms]: canonical name of a library term -> its coefficient."""
    if not isinstance(table, dict) or not table:
        raise file.fail("vehicle.terms", table, "library terms with their coefficients")
    from ..effects import effect
    terms: dict[str, float] = {}
    for key, value in table.items():
        coefficient = file.number(f"vehicle.terms.{key!r}", value)
        try:
            name = effect("missing_term", term=key, coefficient=coefficient).values[0]
        except UsageError:
            raise InputError(f"{file.path}: [vehicle.terms] {key!r}: expected a library term of theta, theta_dot, "
                             "beta such as theta^3 or sin(theta)") from None
        if name in terms:
            raise InputError(f"{file.path}: [vehicle.terms] {key!r}: the term {name!r} stands twice")
        terms[str(name)] = coefficient
    return terms


def uncertainty_of(file: Table) -> Profile | None:
    if "uncertainty" not in file.table:
        return None
    table = file.keys("uncertainty", {"a6", "k1", "profile"}, set())
    if "profile" in table:
        sigma = profile_of(file, "uncertainty.profile", table["profile"])
        if not (np.all(sigma.a6 > 0) and np.all(sigma.k1 > 0)):
            raise file.fail("uncertainty.profile", table["profile"], "every sigma above 0")
        return sigma
    file.keys("uncertainty", {"a6", "k1"}, {"a6", "k1"})
    return constant_profile(file.number("uncertainty.a6", table["a6"], above=0.0),
                            file.number("uncertainty.k1", table["k1"], above=0.0))


def drift_of(file: Table) -> Drift | None:
    """[drift]: two numbers, or a CSV file."""
    if "drift" not in file.table:
        return None
    table = file.keys("drift", {"z_alpha", "z_beta", "profile"}, set())
    if "profile" in table:
        if len(table) > 1:
            raise InputError(f"{file.path}: [drift] has a profile and other keys; expected one or the other")
        columns, path = file.csv("drift.profile", table["profile"], DRIFT_COLUMNS)
        return Drift(path=path, **columns)
    file.keys("drift", {"z_alpha", "z_beta", "profile"}, {"z_alpha", "z_beta"})
    z_alpha, z_beta = (np.array([file.number(f"drift.{key}", table[key])]) for key in DRIFT_COLUMNS[1:])
    return Drift(np.zeros(1), z_alpha, z_beta)


def wind_of(file: Table) -> Wind | None:
    """[wind]: levels, and a forecast from a CSV file."""
    if "wind" not in file.table:
        return None
    table = dict(file.keys("wind", {f.name for f in fields(Wind)}, set()))
    forecast = None
    if "profile" in table:
        columns, path = file.csv("wind.profile", table.pop("profile"), FORECAST)
        forecast = Forecast(path=path, **columns)
    return Wind(profile=forecast, **file.values("wind", table))


def effects_of(file: Table) -> tuple["Effect", ...]:
    """[[effects]], in the order of the file."""
    tables = file.table.get("effects", [])
    if not isinstance(tables, list):
        raise file.fail("effects", tables, "[[effects]] tables")
    if not tables:
        return ()
    from ..effects import from_table
    effects = []
    for k, table in enumerate(tables):
        try:
            effects.append(from_table(table))
        except UsageError as error:
            raise InputError(f"{file.path}: effects[{k}]: {error}") from None
    return tuple(effects)

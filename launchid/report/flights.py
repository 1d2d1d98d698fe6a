"""The result of `identify` for several flights of one vehicle: the joint a6 and k1, and each flight beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..flights.pooled import PARAMETERS, Joint, Told, pooled
from ..flights.told import is_relative, told_by
from ..formatting import saying_what_plus_minus_is, with_std
from ..log.commanded import is_of_commands
from .answer import Answer, flat
from .headline import closing, shown_path

if TYPE_CHECKING:
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..commands.identify import Identification

UNIT = "1/s^2"


@dataclass(frozen=True, eq=False)
class JointAnswer(Answer):
    """Joint answer of several flights.

    flights  the result of each;  told, joint  what each tells of a6 and k1, and all of them together, of those flights
    that tell both: as factors of the nominal's where `nominal` has them, else in 1/s^2
    """

    flights: Sequence[Answer]
    nominal: Nominal | None
    told: list[Told]
    joint: Joint | None
    report: dict[str, Any]
    is_relative: bool
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        parts = [each.summary() for each in self.flights]
        return "\n".join([*parts, *saying_what_plus_minus_is(self.joint_lines()), *closing(self.report)])

    def joint_lines(self) -> list[str]:
        """Return the joint answer as lines: each flight's numbers, then those of all, the scatter between flights."""
        scale, unit = words_of(self.nominal if self.is_relative else None)
        said = [f"{Path(each.log).name}: " + ", ".join(
            f"{name} {with_std(scale[j] * each.value[j], abs(scale[j]) * math.sqrt(each.covariance[j, j]))}{unit}"
            for j, name in enumerate(PARAMETERS)) for each in self.told]
        joint = self.report["joint"]
        if joint is None:
            return said
        for name in PARAMETERS:
            one = joint[name]
            of = "" if one["factor"] is None else \
                f" ({with_std(one['factor']['value'], one['factor']['std'])} of the nominal's)"
            value = "" if one["value"] is None else f" {with_std(one['value'], one['std'])} {UNIT}"
            between = self.report["scatter"][name]
            said.append(f"all: {name}{value}{of}; between flights {between['sigma']:.2g} ({between['low']:.2g} .. "
                        f"{between['high']:.2g}, 95 %){self._unit}")
        return said

    @property
    def _unit(self) -> str:
        return " of the nominal's" if self.is_relative else f" {UNIT}"

    def columns(self) -> Columns:
        rows = [{"flight": Path(each.log).name, **{
            key: value for j, name in enumerate(PARAMETERS)
            for key, value in ((name, float(each.value[j])), (f"{name}_std", math.sqrt(each.covariance[j, j])))}}
            for each in self.told]
        return flat(rows) or {name: [] for name in ("flight", "a6", "a6_std", "k1", "k1_std")}

    def _figure(self) -> Figure:
        from .flights_page import joint_figure
        return joint_figure(self)

    def write_report(self, folder: str | Path) -> None:
        """Write report.html, flights.json and the figure into a folder."""
        from .flights_page import write_joint
        write_joint(self, folder)


def words_of(relative: Nominal | None) -> tuple[tuple[float, float], str]:
    """Return (factors on a6 and k1, their unit) for words: in 1/s^2, but of a profile as factors of it."""
    if relative is None:
        return (1.0, 1.0), f" {UNIT}"
    if len(relative.vehicle.t) > 1:
        return (1.0, 1.0), " of the nominal's"
    return (float(relative.vehicle.a6[0]), float(relative.vehicle.k1[0])), f" {UNIT}"


def joint_report(told: Sequence[Told], joint: Joint | None, nominal: Nominal | None) -> dict[str, Any]:
    """Return the joint part of the JSON: `joint` numbers, `one_vehicle`, `scatter`.

    nominal  whose factors the numbers are; None: they are in 1/s^2
    """
    if joint is None:
        return {"joint": None, "one_vehicle": None, "scatter": None}
    numbers: dict[str, Any] = {}
    for j, name in enumerate(PARAMETERS):
        value, std = float(joint.value[j]), float(joint.std[j])
        constant = None if nominal is None or len(nominal.vehicle.t) > 1 else float(getattr(nominal.vehicle, name)[0])
        numbers[name] = {"value": value, "std": std, "factor": None} if nominal is None else {
            "value": None if constant is None else value * constant,
            "std": None if constant is None else std * abs(constant), "factor": {"value": value, "std": std}}
    correlation = joint.covariance[0, 1] / (joint.std[0] * joint.std[1])
    return {
        "joint": None if joint.is_of_two else {**numbers, "a6_k1_corr": float(correlation)},
        "one_vehicle": {"p": joint.p, "flights": [{"log": each.log, "p": p} for each, p in zip(told, joint.each,
                                                                                             strict=True)],
                        "differs": [{"log": told[k].log, "in": name} for k, name in joint.others.items()]},
        "scatter": {name: each._asdict() for name, each in zip(PARAMETERS, joint.scatter, strict=True)}}


def joined(found: Sequence[Identification], nominal: Nominal | None) -> JointAnswer:
    """Return the joint answer of flights that were identified one by one."""
    of = nominal if is_relative(nominal) else None
    told = [one for each in found if (one := told_by(each.log.path, each.estimates, of,
                                                     is_of_commands(each.log))) is not None]
    joint = pooled(told) if len(told) > 1 else None
    said = joint_report(told, joint, of)
    flights = [{"log": each.log.path, **each.report} for each in found]
    report = {**said, **joint_words(told, joint, of, [each.log.path for each in found],
                                    None if nominal is None else shown_path(nominal.path or nominal.name),
                            found[0].log.options), "flights": flights}
    return JointAnswer(found, nominal, told, joint, report, of is not None,
                       tuple(dict.fromkeys(line for each in found for line in each.warnings)))


def differing(told: Sequence[Told], joint: Joint | None) -> str:
    """Return in words which flights are of another vehicle than the rest, and in what; "" if they agree."""
    if joint is None:
        return ""
    if joint.is_of_two:
        return f"the two flights are not of one vehicle (p {joint.p:.1g})"
    return "; ".join(f"{Path(told[k].log).name} differs, in {name}" for k, name in joint.others.items())


def joint_words(told: Sequence[Told], joint: Joint | None, relative: Nominal | None, logs: Sequence[str],
                nominal: str | None, options: str) -> dict[str, str]:
    """Return the headline of several flights and the command to run next, which reads the logs with `options`."""
    names = " ".join(logs)
    if joint is None:
        return {"headline": f"of {len(logs)} flights {len(told)} tell a6 and k1: too few for a joint answer.",
                "next": f"launchid show {names}{options}"}
    scale, unit = words_of(relative)
    numbers = " and ".join(f"{name} {with_std(scale[j] * joint.value[j], abs(scale[j]) * joint.std[j])}"
                           for j, name in enumerate(PARAMETERS))
    rest = [each.log for k, each in enumerate(told) if k not in joint.others]
    if joint.others:
        off = differing(told, joint)
        head = f"{off} (p {joint.p:.1g} that all are of one vehicle); the other {len(rest)} agree: {numbers}{unit}."
    elif joint.is_of_two:
        head = f"The two flights are not of one vehicle (p {joint.p:.1g}): no a6 and k1 hold for both."
    else:
        head = f"{len(told)} flights of one vehicle (p {joint.p:.2g}): {numbers}{unit}."
    if nominal is None:
        follow = f"launchid nominal {' '.join(rest)} --out first.toml"
    elif len(rest) < 3:
        follow = f"launchid compare {rest[0]} {nominal}"
    else:
        follow = f"launchid fit-lft {' '.join(rest)} {nominal} --out range.toml"
    return {"headline": head, "next": follow + options}

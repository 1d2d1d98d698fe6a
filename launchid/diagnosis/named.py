"""What a diagnosis says: the result, and numbers that were kept as causes in the catalogue's words."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.effects import CATALOGUE
from sim.nominal import Nominal

from ..controller.check import ControllerCheck
from ..formatting import with_std
from ..likelihood.estimate import level_deviation
from .adapter import Reading
from .adequacy import LOUD_LEVEL
from .elimination import Elimination, Kept
from .gain import Fitted, Gain
from .model import Model
from .noise import WEATHER
from .numbers import FORM, TOLERANCE_SIGMAS
from .score import covariance

FORM_Z = 3.0           # standard deviations beyond which a lateness is no delay, or no lag, alone
EQUAL_CAUSES = {"misalignment": ("steady_wind", "attitude_bias"), "moment": ("steady_wind", "attitude_bias"),
                "wind": ("attitude_bias",)}


Values = dict[str, tuple[Any, float | None]]   # parameter -> value, standard deviation


@dataclass(frozen=True, eq=False)
class Result:
    """The diagnosis of a log: verdict, where it applies, named causes, reasons against, and the fits behind it."""

    reading: Reading
    nominal: Nominal
    model: Model | None
    elimination: Elimination | None
    verdict: str
    where: str | None
    named: tuple["Named", ...] = ()
    nearest: tuple["Named", ...] = ()
    doubts: tuple[str, ...] = ()
    remaining: tuple[str, ...] = ()
    remaining_where: str | None = None
    share: float | None = None
    gain: Gain | None = None
    notes: tuple[str, ...] = ()
    is_cut_short: bool = False
    false_alarms: dict[str, int] | None = None
    fitted: tuple[Fitted, ...] = ()   # nominal, with what is named, everything free


@dataclass(frozen=True, eq=False)
class Named:
    """A cause: parameters {name: (value, std)}, causes not told from it, nats and share of squares that it saves."""

    cause: str
    where: str
    parameters: dict[str, tuple[Any, float | None]]
    alike: tuple[str, ...]
    nats: float
    share: float

    @property
    def values(self) -> dict[str, Any]:
        return {name: value for name, (value, _) in self.parameters.items()}

    @property
    def std(self) -> dict[str, float | None]:
        return {name: std for name, (_, std) in self.parameters.items()}


def noted(m: Model, el: Elimination) -> list[str]:
    """Return notes on the columns, from numbers that are no causes (gyro bias, scale, delay) and are not nominal."""
    out = []
    for j in el.notes:
        value, std = float(el.final.p[j]), el.std_full.get(j, 0.0)
        if abs(value - m.table.null[j]) > max(3.0 * std, m.table.tol[j]):
            name = m.table.numbers[j].name
            if name in FORM:
                out.append(f"the input's lateness has a form: {name} {with_std(value, std)} (no cause)")
                continue
            out.append(f"columns: {name} {with_std(value, std)} (theta_dot against theta; no cause)")
    for ch, name in enumerate(("theta", "theta_dot")):
        loud = math.exp(m.levels[ch] - m.noise.declared[ch])
        if not m.log.is_flown and m.log.has[name] and loud > LOUD_LEVEL:
            out.append(f"columns: noise of {name} is {loud:.1f} times the declared (no cause)")
    return out


def named_beside(m: Model, el: Elimination, controller: ControllerCheck | None, is_weather: bool) -> list[Named]:
    """Return the causes found without a number of the fit: another controller, and weather if `is_weather`."""
    found = []
    if controller is not None and controller.is_named:
        found.append(Named("controller_mismatch", "controller", {
            "kp_scale": (controller.kp_scale, controller.std[0]), "kd_scale": (controller.kd_scale, controller.std[1]),
            "delay": (controller.delay, controller.std[2])}, (), controller.evidence, math.nan))
    if is_weather:
        k, std = WEATHER[m.air.weather], level_deviation(m, el.final.p, WEATHER[m.air.weather])
        level = math.exp(m.levels[k])
        given: dict[str, tuple[Any, float | None]] = {"level": (level, std)}
        if m.air.weather == "turbulence":   # of another spectrum the log shows the rms alone, to sqrt(time/2 span)
            time = m.air.turbulence_time
            given = {"level": (level, math.hypot(std, level * math.sqrt(0.5 * time / m.log.span))),
                     "time_constant": (time, None)}
        alike = tuple(WEATHER.keys() - {m.air.weather})
        found.append(Named(m.air.weather, "environment", given, alike, math.nan, math.nan))
    return found


def named_of(m: Model, el: Elimination, k: Kept, weather: tuple[str, ...] = ()) -> list[Named]:
    """Return a kept group as causes in the catalogue's words; a sine in the place of the angle is two terms; a servo
    that is both later and slower is one cause: a scale that is as late as both, not told from a delay.  weather: does
    as well."""
    cause, values = k.group.cause, parameters_of(m, el, k)
    alike = {*k.alike, *weather} - {""} | set(EQUAL_CAUSES.get(k.group.name, ()))
    if {"delay", "bandwidth"} <= {each.group.name for each in el.kept}:
        if k.group.name == "delay":
            return []          # it is said with the bandwidth
        if k.group.name == "bandwidth":
            (value, std), delay = values["scale"], m.table.index("delay")
            scale = m.log.servo.lag / (m.log.servo.lag / value + float(el.final.p[delay] - m.table.null[delay]))
            if abs(scale - 1.0) < max(m.table.tol[k.group.numbers[0]], 2.0 * (std or 0.0)):
                return []      # they undo one another
            values, alike = {"scale": (scale, std)}, alike | {"actuator_delay"}
    if k.group.name == "delay" and m.log.is_blind and m.log.is_commanded:
        cause, values = form_of(m, el, k, values)
        alike |= {"actuator_delay", "actuator_bandwidth"}
    if cause == "gyro_delay" and values["delay"][0] < 0.0 and not m.log.is_flown:
        cause, values = "attitude_delay", {"delay": (-values["delay"][0], values["delay"][1])}
    named = Named(cause, CATALOGUE[cause].where, values, tuple(sorted(alike - {cause})), 0.5 * k.gain, k.share)
    if k.group.name != "sine":
        return [named]
    size, std = values["coefficient"]
    return [named, replace(named, parameters={"term": ("theta", None), "coefficient": (-size, std)}, alike=())]


def form_of(m: Model, el: Elimination, k: Kept, values: Values) -> tuple[str, Values]:
    """Return the cause and its parameters of a lateness whose nozzle nothing shows, by the part of it that is a lag: a
    slower servo only where it may be all of it and not none."""
    lag, (late, std) = m.table.index("lag"), values["delay"]
    part = float(el.final.p[lag] - m.table.null[lag])
    error = FORM_Z * el.std_full.get(lag, math.inf)
    may_delay, may_lag = part < error, late - part < math.hypot(error, FORM_Z * (std or 0.0))
    scale = m.log.servo.lag / max(m.log.servo.lag + late, 1e-6)
    slower: Values = {"scale": (scale, None if std is None else scale**2 / m.log.servo.lag * std)}
    return ("actuator_bandwidth", slower) if may_lag and not may_delay else ("actuator_delay", values)


def parameters_of(m: Model, el: Elimination, k: Kept) -> Values:
    """Return the parameters of a kept group's cause in the catalogue's words."""
    cause, p = k.group.cause, el.final.p
    values: Values = {}
    for j in k.group.numbers:
        number, value, std = m.table.numbers[j], float(p[j]), k.std.get(j)
        is_scale, own = number.parameter == "scale", m.log.given.get(number.name)   # of the nominal's own effects
        extra = value if own is None else value / own if is_scale else value - own
        # that is nobody's fault
        part = number.tol / TOLERANCE_SIGMAS * (abs(value) if is_scale else 1.0)
        values[number.parameter] = (extra, None if std is None else math.hypot(std, part))
    if cause == "missing_term":
        return term_of(m, el, k)
    if cause == "periodic_disturbance":
        s, c = (float(p[j]) for j in k.group.numbers[:2])
        w = float(p[k.group.numbers[2]])
        return {"amplitude": (math.hypot(s, c), k.std.get(k.group.numbers[0])),
                "frequency": (w, k.std.get(k.group.numbers[2])),
                "phase": (math.remainder(math.atan2(c, s) - w * m.log.centre, 2.0 * math.pi), None)}
    if cause == "input_washout":
        v, std = values["time_constant"]
        return {"time_constant": (1.0 / v if v else math.inf, (std or 0.0) / v**2 if v else None)}
    if cause == "actuator_bandwidth" and "lag" in values:
        lag, std = values["lag"]
        scale = m.log.servo.lag / (m.log.servo.lag + lag)
        return {"scale": (scale, None if std is None else scale / (m.log.servo.lag + lag) * std)}
    if cause == "actuator_backlash":
        share, width = (float(p[j]) for j in k.group.numbers)
        at = [el.final.at(j) for j in k.group.numbers]
        C, slope = covariance(m, el.final, el.unit)[np.ix_(at, at)], np.array([width, share])
        return {"half_width": (share * width, math.sqrt(slope @ C @ slope))}
    values.pop("share", None)
    return values


def term_of(m: Model, el: Elimination, k: Kept) -> Values:
    """Return the parameters of a term, whose coefficient is what the nominal's, `believed`, lacks."""
    j = k.group.numbers[0]
    number = m.table.numbers[j]
    values: Values = {"term": (number.parameter, None),
                      "coefficient": (float(el.final.p[j]) - number.null, k.std.get(j))}
    if number.name == "term " + number.parameter and number.null != 0.0:
        values["believed"] = (number.null, None)
    return values

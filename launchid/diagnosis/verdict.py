"""Diagnose one log: estimate everything, take away what left-out rows do not need, and decide what that means."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.effects import CATALOGUE
from sim.flight import fly_whole
from sim.nominal import Nominal

from ..controller.check import ControllerCheck
from ..formatting import with_std
from ..likelihood.estimate import fit_levels, level_deviation
from ..log.log import Log, flown_log
from ..log.vehicle import plant_faults
from ..sums import square
from .adapter import FEWEST_ROWS, Reading, read
from .adequacy import LOUD_LEVEL, acts, adequacy, clear, is_rest, other_shape, strangers, untested
from .dissipation import within
from .elimination import MIN_SQUARES_SAVED, MOST, NAME_SHARE, Elimination, Kept, Search
from .gain import Gain, held_out
from .model import Model, Stopped
from .noise import WEATHER
from .numbers import FORM, KINEMATIC, TOLERANCE_SIGMAS
from .scan import with_rivals
from .score import covariance
from .start import everything, with_found

MOST_GROWTH = 16.0     # nats in a row: ten million times, beyond which the filter sets a motion back to the log
UNKNOWN_LEFT = 0.75    # of the removable error ahead: with more left beside something unknown no cause is named
FORM_Z = 3.0           # standard deviations beyond which a lateness is no delay, or no lag, alone
BETWEEN_THEM = 2.0     # of what everything saves, that names may save last in: more is numbers that undo one another
INPUT_NUMBERS = ("k1", "k1_slope", "delay", "lag", "washout", "bandwidth", "inertia", "term beta^2",   # of the input
                 "control_loss", "bending", "actuator_backlash", "actuator_rate_limit")


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


def diagnose(log: Log, nominal: Nominal, holdout: Log | None = None, bootstrap: int = 0,
             say: Callable[[str], None] = lambda text: None, noise: str = "bounded") -> Result:
    """Diagnose why measurement and simulation part.

    Parameters
    ----------
    log, nominal : what was measured, what is believed
    holdout : a second log, to judge the extension on
    bootstrap : clean flights of the nominal that are diagnosed too, to count false alarms
    noise : how far levels may be from the declared: "bounded", "declared" or "free"
    say : told what is being done
    """
    if bootstrap > 0:
        wrong = 0
        for seed in range(bootstrap):
            say(f"clean flight {seed + 1} of {bootstrap}")
            clean = flown_log(fly_whole(nominal, seed), f"clean flight {seed}")
            wrong += diagnose(clean, nominal, noise=noise).verdict != "consistent"
        result = diagnose(log, nominal, holdout, say=say, noise=noise)
        words = f"{wrong} of {bootstrap} clean flights of this nominal are not found consistent"
        return replace(result, notes=(*result.notes, words),
                       false_alarms={"flights": bootstrap, "not_consistent": wrong})
    say("data check")
    reading = read(log, nominal)
    if reading.track is None:
        few = f"fewer than {FEWEST_ROWS} rows can be used: log longer, or more often"
        return Result(reading, nominal, None, None, "bad-data", "data") if reading.is_bad else Result(
            reading, nominal, None, None, "unexplained", None, doubts=(few,))
    if runs_away(nominal, log.period):
        return Result(reading, nominal, None, None, "unexplained", None, doubts=(
            "the nominal's motion grows more than ten million times from row to row: correct sign and unit of its "
            "terms",))
    m = replace(Model.of(reading.track, noise), brake=time.monotonic() + nominal.diagnosis.time_limit)
    try:
        return examined(m, reading, nominal, holdout, say)
    except Stopped:
        return Result(reading, nominal, None, None, "unexplained", None, is_cut_short=True)


def runs_away(nominal: Nominal, period: float) -> bool:
    """Return whether the nominal's rigid body grows by more than MOST_GROWTH in a period [s]."""
    damping = dict(nominal.terms).get("theta_dot", 0.0)
    growth = 0.5 * damping + math.sqrt(0.25 * damping**2 + max(float(np.max(nominal.vehicle.a6)), 0.0))
    return growth * period > MOST_GROWTH


def examined(m: Model, reading: Reading, nominal: Nominal, holdout: Log | None, say: Callable[[str], None]) -> Result:
    """Diagnose a track: fit all numbers, eliminate, decide; judge the gain on `holdout` if given."""
    say("everything free")
    of = () if m.log.is_flown else (*KINEMATIC, *FORM) if m.log.is_blind else KINEMATIC
    notes = frozenset(m.table.index(x) for x in of if x in m.table)
    m, p = everything(m)
    say("taking away")
    el = Search(m, notes).run(p)
    if any(k.group.name == "gyro_delay" for k in el.kept):
        timed = m.retime(float(el.final.p[m.table.index("gyro_delay")]))
        if timed is not m:
            m = fit_levels(timed, el.full.p)
            el = Search(m, notes).run(el.full.p)
    m, p = with_found(m, el.final, el.full.p)   # shapes that show once the numbers that are not needed are gone
    if len(p) > len(el.full.p):
        el = Search(m, notes).run(p)
    wider, p = with_rivals(m, el)
    if len(p) > len(el.full.p):
        rival = Search(wider, notes).go_on(el, p)
        if square(rival.e_final) < square(el.e_final) + MIN_SQUARES_SAVED:   # else it found a worse minimum
            m, el = wider, rival
    say("held-out gain")
    result = decided(m, reading, nominal, el)
    if result.verdict == "unexplained":   # for the unit or the sign of a column, which no cause of the vehicle is
        whole = plant_faults(reading.log, nominal, reading.data.masks)
        result = replace(result, doubts=(*(fault.message for fault in whole), *result.doubts))
    if holdout is None:
        return result
    second = read(holdout, nominal)
    if second.track is None:
        return replace(result, notes=(*result.notes, "the second log cannot be used: the gain is of the first"))
    other = replace(Model.of(second.track, m.bounds).retime(m.log.retimed), table=m.table, shapes=m.shapes,
                    levels=m.levels, noise=m.noise, air=m.air, brake=m.brake)
    nats = 0.5 * (square(el.e_nominal) - square(el.e_final))
    return replace(result, gain=held_out(other, el.nominal, el.final, el.full, nats, is_another=True))


def decided(m: Model, reading: Reading, nominal: Nominal, el: Elimination) -> Result:
    """Decide the verdict from the elimination, its scores and the model's adequacy."""
    nats = 0.5 * (square(el.e_nominal) - square(el.e_final))
    gain = held_out(m, el.nominal, el.final, el.full, nats)
    inadequate, misfit = adequacy(m, el.final)
    controller = reading.controller
    others = {k.group.name: why for k in el.kept if (why := other_shape(m, el, k))}
    kept, note = within(m, el)
    listed = [k for k in kept if k.group.cause and k.group.name not in others]
    unlisted = [k for k in kept if k not in listed]
    notes = (*noted(m, el), *note)
    words = []
    for k in tuple(listed):
        if why := no_cause(m, el, k, controller):
            listed.remove(k)
            words.append(why)
    of_input = [k for k in listed if k.group.kind in INPUT_NUMBERS]
    resembled = tuple(listed)
    if not m.log.is_flown and of_input and not acts(m, el):
        listed, resembled = [], tuple(k for k in listed if k not in of_input)
        words.append("the input of another time explains as much as the log's own: nothing is said of it")
    elif not m.log.is_flown:
        listed, more = clear(m, el, listed, gain)
        words += more
    modes = [k.group.kind for k in listed if k.group.kind in MODES]
    if m.air.weather and modes:
        words.append(f"what a {modes[0]} leaves is like {m.air.weather}: it is neither")
    beside = named_beside(m, el, controller, bool(m.air.weather) and not modes)
    names = [*beside, *(each for k in listed for each in named_of(m, el, k))]
    nearest = [*beside, *(each for k in resembled for each in named_of(m, el, k))]
    doubts = [others.get(k.group.name) or f"{k.group.kind} explains {0.5 * k.gain:.0f} nats and is no known cause"
              for k in unlisted]
    where = unlisted[0].group.place if unlisted else None
    is_foreign = controller is not None and controller.is_foreign
    if controller is not None and is_foreign:
        doubts.insert(0, f"the command is not the nominal controller's: {controller.words}")
        where = "controller"
    against = [*doubts, *words, *inadequate]
    if not m.log.is_flown:
        against += strangers(m, el, gain)

    def result(verdict: str, where: str | None, **more: Any) -> Result:
        return Result(reading, nominal, m, el, verdict, where, notes=notes, gain=gain, **more)

    if not (names or against or kept):
        against = untested(m, el)
    if not (names or against or kept):
        return result("consistent", None)
    is_odd = sum(k.gain for k in unlisted) > (1.0 - UNKNOWN_LEFT) * sum(k.gain for k in listed)
    short = 2.0 * nats < MOST * el.removable
    noises = sum("noise of" in each for each in inadequate)
    loud = m.log.is_flown and (noises > 1 or (noises == 1 and gain.share > NAME_SHARE))
    is_poor = bool(listed) and bool(against) and (gain.share > (UNKNOWN_LEFT if m.log.is_flown else MOST)
                                                  or short or loud)
    is_known = bool(names) and not (is_foreign or is_odd or is_poor)
    if is_known and not against:
        return result("explained", names[0].where, named=tuple(names))
    sure = tuple(each for each in names if each.where == "controller" or each.share > MOST)
    if is_known and sure and sum(k.share for k in el.kept) <= BETWEEN_THEM:
        return result("dominant", sure[0].where, named=sure, remaining=tuple(against), share=gain.share,
                      remaining_where=where or misfit)
    return result("unexplained", where or misfit or (nearest[0].where if nearest else "plant"), nearest=tuple(nearest),
                  doubts=tuple(against))


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


MODES = ("slosh", "bending")   # of the vehicle: what their form leaves swings on
EQUAL_CAUSES = {"misalignment": ("steady_wind", "attitude_bias"), "moment": ("steady_wind", "attitude_bias"),
                "wind": ("attitude_bias",)}


def no_cause(m: Model, el: Elimination, k: Kept, controller: ControllerCheck | None) -> str:
    """Return why a kept number is no cause; "": it may be one.

    A scale of the other sign is a convention of the log or of the nominal; at the end of its range nothing is
    estimated; commands between rows that a found controller made tell nothing of the servo; the acceleration of a
    nozzle that no row measures is as wrong as a stranger's servo; and what another cause leaves by not being the same
    along the log is that cause's.
    """
    j, name = k.group.numbers[0], k.group.kind
    number, value = m.table.numbers[j], el.final.p[j]
    is_own = number.name == "term " + number.parameter and number.null != 0.0
    if (number.parameter == "scale" and not value > 0.0) or (is_own and not value / number.null > 0.0):
        return f"{name} has the opposite sign: a convention, or a wrong nominal"
    if number.name == k.group.name and (value <= m.table.low[j] + 1e-9 or value >= m.table.high[j] - 1e-9):
        return f"{name} would be {value:.3g}, the end of its range, or beyond: something else is wrong"
    if controller is not None and controller.is_named and m.log.unsure > 0.0 and k.group.place == "actuator":
        return f"{name}: the commands between the rows are another controller's, and tell nothing of the servo"
    largest = max(el.kept, key=lambda each: each.gain)
    if is_rest(m, el, k, largest):
        return f"{name} may be what {largest.group.kind} leaves by not being the same along the log"
    return ""


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


def named_of(m: Model, el: Elimination, k: Kept) -> list[Named]:
    """Return a kept group as causes in the catalogue's words; a sine in the place of the angle is two terms; a servo
    that is both later and slower is one cause: a scale that is as late as both, not told from a delay."""
    cause, values = k.group.cause, parameters_of(m, el, k)
    alike = {*k.alike} - {""} | set(EQUAL_CAUSES.get(k.group.name, ()))
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

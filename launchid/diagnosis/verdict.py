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
from ..log.log import Log, flown_log
from ..log.vehicle import plant_faults
from ..sums import along, square
from .adapter import FEWEST_ROWS, Reading, read
from .candidates import CANDIDATE_KINDS, TOLERANCE_SIGMAS, usual
from .elimination import ALIKE_Z, MIN_SQUARES_SAVED, MOST, NAME_SHARE, Elimination, Kept, Search
from .estimate import Fit, fit_levels, gauss_newton, gram, level_deviation, likelihood
from .gain import Gain, held_out
from .model import KINEMATIC, SCORE_BLOCKS, WEATHER, Model, Stopped
from .scan import RIVAL_SHARE, SQUARES_PROMISED, Found, scan, with_shape
from .score import compare, covariance, left_out

SERVO_DELAYS = (0.008, 0.015, 0.025, 0.04, 0.07, 0.12)  # s, delays of a servo that are tried
SLOW_SERVOS = (0.6, 0.35, 0.2, 0.12)   # of its bandwidth, of a servo that are tried
FAR_LESS = 0.7         # of the squares that the nominal leaves, for a limited servo to be the start
WEATHER_NATS = 20.0    # nats by which weather must be better than causes,
CALMER = (0.3, 0.1, 0.03, 0.01)  # and than the moment that always wanders, so many times as large
MOST_SHAPES = 3        # shapes that are taken into a model
GOES_Z, GOES = 4.5, 0.003   # block-robust z and share with which errors go with a signal: something is missing
LOUD_LEVEL = 2.9       # times the declared, from which a level hides what is not modelled
WHITE_SQUARES = 1.35   # mean square of whitened errors that a model at its noise may leave
UNKNOWN_LEFT = 0.75    # of the removable error ahead: with more left beside something unknown no cause is named
BETWEEN_THEM = 2.0     # of what everything saves, that names may save last in: more is numbers that undo one another
AHEAD, LEVEL = 0.85, 2.0     # of a stranger's log: share of the error ahead, noise level
TURNING_SHARES, PLACEBO = (0.2, 0.45, 0.7), 2.0   # of the log, turns of the input; times that its own must win
INPUT_NUMBERS = ("k1", "k1_slope", "delay", "lag", "washout", "bandwidth", "inertia", "term beta^2",   # of the input
                 "control_loss", "bending", "actuator_backlash", "actuator_rate_limit")


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


def adequacy(m: Model, fit: Fit) -> tuple[list[str], str | None]:
    """Return what speaks against a model by itself, in words, and where: whitened errors that go with a signal, are
    larger than their noise, or are no longer white."""
    e = m.white(fit.p)
    signals = {"the rate": m.motion[:, 1], "the rate's sign": np.sign(m.motion[:, 1]), "the attitude": m.motion[:, 0],
               "the attitude's square": (m.motion[:, 0] - m.motion[:, 0].mean())**2,
               "the input": m.mean_input, "the input's square": (m.mean_input - m.mean_input.mean())**2,
               "time": m.tau}
    words, place = [], None
    for ch, name in enumerate(("theta", "theta_dot", "beta")):
        mine = m.channel == ch
        if mine.sum() < 200:
            continue
        k, x = m.rows[mine], e[mine]
        size = math.sqrt(np.mean(x * x))
        for what, signal in signals.items():
            s = signal[np.maximum(k - 2, 0)]
            s = s - s.mean()
            s = s / (s.std() + 1e-300)
            y = np.bincount(m.block[mine], s * x, minlength=SCORE_BLOCKS)
            z, r = float(y.sum() / (math.sqrt(SCORE_BLOCKS) * y.std(ddof=1) + 1e-9)), float(np.mean(s * x))
            if abs(z) > GOES_Z and r * r > GOES * np.mean(x * x):
                words.append(f"errors of {name} go with {what} (z {z:.1f}, {100 * r * r / np.mean(x * x):.1f} %)")
                place = place or ("actuator" if ch == 2 else None)
        if m.is_flown:
            factor = math.exp(m.levels[ch] - m.levels0[ch])
            if factor * size > LOUD_LEVEL:
                words.append(f"noise of {name} is {factor * size:.1f} times the declared")
                place = place or ("actuator" if ch == 2 else "sensor")
            elif size * size > WHITE_SQUARES:
                words.append(f"errors of {name} are {size:.2f} times their noise")
                place = place or ("actuator" if ch == 2 else None)
    if m.is_flown and m.levels[3] - m.levels0[3] > math.log(LOUD_LEVEL):
        words.append(f"noise of the acceleration is {math.exp(m.levels[3] - m.levels0[3]):.1f} times the declared")
    return words, place


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
    m = Model(reading.track, noise)
    m.with_numbers(usual(m), [])
    m.brake = time.monotonic() + nominal.diagnosis.time_limit
    try:
        return examined(m, reading, nominal, holdout, say)
    except Stopped:
        return Result(reading, nominal, None, None, "unexplained", None, is_cut_short=True)
    finally:
        m.brake = math.inf


def examined(m: Model, reading: Reading, nominal: Nominal, holdout: Log | None, say: Callable[[str], None]) -> Result:
    """Diagnose a track: fit all numbers, eliminate, decide; judge the gain on `holdout` if given."""
    say("everything free")
    notes = frozenset() if m.is_flown else frozenset(m.index(x) for x in KINEMATIC if x in m.names)
    p = everything(m)
    say("taking away")
    el = Search(m, notes).run(p)
    if any(k.group.name == "gyro_delay" for k in el.kept) and m.retime(float(el.final.p[m.index("gyro_delay")])):
        fit_levels(m, el.full.p)
        el = Search(m, notes).run(el.full.p)
    p = with_found(m, el.final, el.full.p)   # shapes that show once the numbers that are not needed are gone
    if len(p) > len(el.full.p):
        el = Search(m, notes).run(p)
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
    other = Model(second.track, m.noise)
    other.weather, other.levels0, other.levels = m.weather, m.levels0, m.levels
    other.is_windy, other.tau_m, other.m0 = m.is_windy, m.tau_m, m.m0
    other.retime(m.retimed)
    other.with_numbers(m.numbers, m.shapes)
    nats = 0.5 * (square(el.e_nominal) - square(el.e_final))
    return replace(result, gain=held_out(other, el.nominal, el.final, el.full, nats, is_another=True))


def everything(m: Model) -> np.ndarray:
    """Fit every usual number, the shapes that the scan finds and the noise levels; return the numbers."""
    start = limited(m) if m.is_commanded and m.is_flown else best_delay(m)
    fit = gauss_newton(m, start, tuple(range(len(m.numbers))), frozenset(), 3)
    fit_levels(m, fit.p)
    fit = gauss_newton(m, fit.p, fit.free, frozenset(), 3)
    fit_levels(m, fit.p)
    for k in range(MOST_SHAPES):
        if k == 1 and weather(m, fit):
            m.with_numbers(usual(m), [])
            fit = gauss_newton(m, m.null, tuple(range(len(m.null))), frozenset(), 3)
            fit_levels(m, fit.p)
            fit = gauss_newton(m, fit.p, fit.free, frozenset(), 2)
        p = with_found(m, fit, fit.p, 2.0 * SQUARES_PROMISED)   # what promises less is sought later
        if len(p) == len(fit.p):
            break
        fit = gauss_newton(m, p, tuple(range(len(p))), frozenset(), 4)
        fit_levels(m, fit.p, 2)
    return without_weather(m, fit) if m.weather and m.shapes else fit.p


def without_weather(m: Model, fit: Fit) -> np.ndarray:
    """Return the numbers fitted in calm air, in which the model is left, unless the weather still explains WEATHER_NATS
    more beside the shapes that were found since; else those of `fit`."""
    name, levels, windy = m.weather, m.levels.copy(), likelihood(m, m.white(fit.p))
    m.in_weather("")
    calm = gauss_newton(m, fit.p, fit.free, frozenset(), 3)
    fit_levels(m, calm.p, 4)
    calm = gauss_newton(m, calm.p, fit.free, frozenset(), 3)
    if likelihood(m, m.white(calm.p)) + WEATHER_NATS > windy:
        return calm.p
    m.in_weather(name)
    m.levels = levels
    m.move_to(fit.p)
    return fit.p


def with_found(m: Model, fit: Fit, p: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Return the numbers p with the one or two shapes that promise most added to the model; p itself if none does."""
    there = {shape.kind.name for shape in m.shapes if not shape.kind.once}
    found = [each for each in scan(m, fit) if each.kind.name not in there]
    if found and found[0].saves > least:
        for each in [each for each in found if each.saves > RIVAL_SHARE * found[0].saves][:2]:
            p = with_shape(m, p, each)
    return p


def limited(m: Model) -> np.ndarray:
    """Return the numbers to start from: with a rate limit, a play, a delay, a slower servo or a trim where one leaves
    clearly less than none, for a servo so limited or so late, or a vehicle that its trim has lost, is no small forcing
    of another."""
    plain = square(m.white(m.null))
    late = np.repeat(m.null[None], len(SERVO_DELAYS) + len(SLOW_SERVOS), axis=0)
    late[:len(SERVO_DELAYS), m.index("delay")] += SERVO_DELAYS
    late[len(SERVO_DELAYS):, m.index("bandwidth")] *= SLOW_SERVOS
    trimmed = [gauss_newton(m, m.null, (m.index("misalignment"),)).p] if "misalignment" in m.names else []
    least, p = min(((square(m.white(q)), q) for q in (*late, *trimmed)), key=lambda each: each[0])
    best = None
    for kind in (kind for kind in CANDIDATE_KINDS if kind.cause and kind.place == "actuator" and kind.fits(m)):
        for values in kind.starts(m):
            found, table = Found(kind, values, np.ones(1), plain), m.numbers
            left = square(m.white(with_shape(m, m.null, found)))
            m.with_numbers(table, [])
            if left < least:
                least, best = left, found
    if not least < FAR_LESS * plain:
        return m.null
    return with_shape(m, m.null, best) if best is not None else p


def weather(m: Model, fit: Fit) -> str:
    """Return the weather that explains more than everything else does, with the nominal's numbers within their
    tolerances; "" if none.  The model is left in it.

    A walk begins at no disturbance, so what it saves of the moment that is taken to wander always is no weather's.
    """
    if not m.is_flown or m.is_windy or not m.is_unstable:
        return ""
    levels, table = m.levels.copy(), (m.numbers, m.shapes)
    all_else = likelihood(m, m.white(fit.p))
    for share in CALMER:
        m.levels[WEATHER["wind_walk"]] = levels[WEATHER["wind_walk"]] + math.log(share)
        all_else = max(all_else, likelihood(m, m.white(fit.p)))
    m.with_numbers(usual(m), [])
    band = frozenset(j for j, each in enumerate(m.numbers) if each.tol > 0.0)
    best = ("", all_else + WEATHER_NATS)
    for name in WEATHER:
        m.in_weather(name)
        alone = gauss_newton(m, m.null, tuple(sorted(band)), band, 2)
        fit_levels(m, alone.p, 4)
        value = likelihood(m, m.white(alone.p))
        if value > best[1]:
            best = (name, value)
    m.in_weather(best[0])
    if not best[0]:
        m.levels = levels
        m.with_numbers(*table)
        m.move_to(fit.p)
    return best[0]


def best_delay(m: Model) -> np.ndarray:
    """Return numbers to start a fit from: fitted at the best of a few delays; the nominal's for a flown log."""
    if "delay" not in m.names or m.is_flown:
        return m.null
    row = float(np.median(m.dt))
    free = tuple(j for j, each in enumerate(m.numbers) if each.name not in ("delay", "lag", "washout", "bandwidth",
                                                                           "gyro_delay", "attitude_delay"))
    least, best = math.inf, m.null
    for delay in (0.0, *np.geomspace(max(0.01, 0.5 * row), max(0.15, 3.0 * row), 5)):
        q = m.null.copy()
        q[m.index("delay")] = delay
        fit = gauss_newton(m, q, free, frozenset(), 2)
        value = square(fit.e) * (1.0 if delay else FAR_LESS)
        if value < least:
            least, best = value, fit.p
    return best


def decided(m: Model, reading: Reading, nominal: Nominal, el: Elimination) -> Result:
    """Decide the verdict from the elimination, its scores and the model's adequacy."""
    nats = 0.5 * (square(el.e_nominal) - square(el.e_final))
    gain = held_out(m, el.nominal, el.final, el.full, nats)
    inadequate, misfit = adequacy(m, el.final)
    controller = reading.controller
    others = {k.group.name: why for k in el.kept if (why := other_shape(m, el, k))}
    listed = [k for k in el.kept if k.group.cause and k.group.name not in others]
    unlisted = [k for k in el.kept if k not in listed]
    notes = tuple(noted(m, el))
    words = []
    for k in tuple(listed):
        if why := no_cause(m, el, k, controller):
            listed.remove(k)
            words.append(why)
    of_input = [k for k in listed if k.group.kind in INPUT_NUMBERS]
    if not m.is_flown and of_input and not acts(m, el):
        listed = [k for k in listed if k not in of_input]
        words.append("the input of another time explains as much as the log's own: nothing is said of it")
    modes = [k.group.kind for k in listed if k.group.kind in MODES]
    if m.weather and modes:
        words.append(f"what a {modes[0]} leaves is like {m.weather}: it is neither")
    names = [*named_beside(m, el, controller, bool(m.weather) and not modes),
             *(each for k in listed for each in named_of(m, el, k))]
    doubts = [others.get(k.group.name) or f"{k.group.kind} explains {0.5 * k.gain:.0f} nats and is no known cause"
              for k in unlisted]
    where = unlisted[0].group.place if unlisted else None
    is_foreign = controller is not None and controller.is_foreign
    if controller is not None and is_foreign:
        doubts.insert(0, f"the command is not the nominal controller's: {controller.words}")
        where = "controller"
    against = [*doubts, *words, *inadequate]
    if not m.is_flown:
        against += strangers(m, el, gain)

    def result(verdict: str, where: str | None, **more: Any) -> Result:
        return Result(reading, nominal, m, el, verdict, where, notes=notes, gain=gain, **more)

    if not (names or against or el.kept):
        return result("consistent", None)
    is_odd = sum(k.gain for k in unlisted) > (1.0 - UNKNOWN_LEFT) * sum(k.gain for k in listed)
    short = 2.0 * nats < MOST * el.removable
    noises = sum("noise of" in each for each in inadequate)
    loud = m.is_flown and (noises > 1 or (noises == 1 and gain.share > NAME_SHARE))
    is_poor = bool(listed) and bool(against) and (gain.share > (UNKNOWN_LEFT if m.is_flown else 1.0 - UNKNOWN_LEFT)
                                                  or short or loud)
    is_known = bool(names) and not (is_foreign or is_odd or is_poor)
    if is_known and not against:
        return result("explained", names[0].where, named=tuple(names))
    sure = tuple(each for each in names if each.where == "controller" or each.share > MOST)
    if is_known and sure and sum(k.share for k in el.kept) <= BETWEEN_THEM:
        return result("dominant", sure[0].where, named=sure, remaining=tuple(against), share=gain.share,
                      remaining_where=where or misfit)
    return result("unexplained", where or misfit or (names[0].where if names else "plant"), nearest=tuple(names),
                  doubts=tuple(against))


def other_shape(m: Model, el: Elimination, k: Kept) -> str:
    """Return in words what else, of no known cause, a kept number may be, so that it is not named; "": nothing.

    An attitude that drifts parts the columns as a gyro's bias does, and only the moment of the drift that the vehicle
    feels, which a slow disturbance may be too, tells the two apart.  A disturbance that weather leaves is neither.
    """
    name = k.group.kind
    if m.weather and name != k.group.name and k.group.place == "environment":
        return f"what {m.weather} leaves of the disturbance is like a {name}: it is neither"
    if name != "gyro_bias" or not m.is_flown:
        return ""
    table, bias = (m.numbers, m.shapes), m.index("gyro_bias")
    drift = next(kind for kind in CANDIDATE_KINDS if kind.name == "attitude_walk")
    p = with_shape(m, k.without, Found(drift, (), np.zeros(1), 0.0))
    free = tuple(sorted({*el.final.free, bias, len(p) - 1}))
    fit = gauss_newton(m, p, free, el.final.band | {bias}, 2)
    costs, error = compare(m, left_out(m, fit), el.e_final, el.unit)
    m.with_numbers(*table)
    m.move_to(el.final.p)
    return "an attitude reference that drifts explains as much as a gyro_bias: another reference would decide" \
        if costs < ALIKE_Z * error else ""


def is_rest(m: Model, el: Elimination, k: Kept, largest: Kept) -> bool:
    """Whether a number fits only what the largest cause leaves by not being the same along the log: where that changes
    with time and its square, by as much as itself, the number is not needed."""
    if k is largest or k.group.is_event or largest.group.is_event:
        return False
    fit, of = el.final, largest.group.numbers[:largest.group.linear]
    off, tau = (fit.p - m.null)[list(fit.free)], m.tau[m.rows]
    J = np.column_stack([fit.J, *(fit.J[:, fit.at(j)] * by for j in of for by in (tau, tau**2))])
    sizes = [abs(fit.p[j] - m.null[j]) + 1e-12 for j in of for _ in range(2)]
    prior = np.concatenate([m.prior[list(fit.free)], sizes])**-2.0
    C = np.linalg.inv(gram(J) + np.diag(prior))
    moved = -C @ (along(J, fit.e) + prior * np.append(off, np.zeros(len(sizes))))
    at = [fit.at(j) for j in k.group.numbers[:k.group.linear]]
    left = off[at] + moved[at]
    return float(left @ np.linalg.solve(C[np.ix_(at, at)], left)) < MIN_SQUARES_SAVED * len(at)


def strangers(m: Model, el: Elimination, gain: Gain) -> list[str]:
    """Return what speaks against a model of a log that the nominal's own simulation did not fly: "consistent" is then
    no claim of noise alone."""
    out = []
    base, error = compare(m, el.e_final, el.e_full, el.unit)
    if base > ALIKE_Z * error and base > MIN_SQUARES_SAVED:
        out.append(f"left-out blocks: worse than the full model by {0.5 * base:.0f} +- {0.5 * error:.0f} nats")
    if gain.floor < AHEAD:
        out.append(f"the full model's error ahead is {gain.floor:.2f} of what these numbers leave")
    for ch, name in enumerate(("theta", "theta_dot")):
        if m.has[name] and m.levels[ch] - m.levels0[ch] > math.log(LEVEL):
            out.append(f"noise of {name} is {math.exp(m.levels[ch] - m.levels0[ch]):.1f} times the declared")
    return out


def noted(m: Model, el: Elimination) -> list[str]:
    """Return notes on the columns, from numbers that are no causes (gyro bias, scale, delay) and are not nominal."""
    out = []
    for j in el.notes:
        value, std = float(el.final.p[j]), el.std_full.get(j, 0.0)
        if abs(value - m.null[j]) > max(3.0 * std, m.tol[j]):
            out.append(f"columns: {m.numbers[j].name} {value:.4g} +- {std:.2g} (theta_dot against theta; no cause)")
    return out


def acts(m: Model, el: Elimination) -> bool:
    """Whether the log's own input explains clearly more than the input of another time (a placebo)."""
    inputs = [m.index(name) for name in ("k1", "term beta^2", "inertia") if name in m.names]
    rest = tuple(j for j in range(len(m.numbers)) if j not in inputs and m.numbers[j].name not in
                 ("delay", "lag", "washout", "k1_slope", "bandwidth", "gain", "null_angle"))
    q = el.full.p.copy()
    q[inputs] = 0.0
    none = gauss_newton(m, q, rest, frozenset(), 2)
    without = square(none.e)
    own = without - float((m.white(el.full.p)**2).sum())
    track, integral, wins = m.track, m.integral, [5.0]
    for part in TURNING_SHARES:
        turned = np.roll(track.commands, int(part * len(track.commands)))
        m.track = replace(track, commands=turned)
        m.integral = np.append(0.0, np.cumsum(turned * np.diff(track.ticks)))
        m.inputs.clear()
        fit = gauss_newton(m, none.p, tuple(sorted({*rest, *inputs})), frozenset(), 2)
        wins.append(without - square(fit.e))
    m.track, m.integral = track, integral
    m.inputs.clear()
    m.move_to(el.final.p)
    return own > PLACEBO * max(wins)


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
    number, value = m.numbers[j], el.final.p[j]
    if number.parameter == "scale" and not value > 0.0:
        return f"{name} has the opposite sign: a convention, or a wrong nominal"
    if number.name == k.group.name and (value <= m.low[j] + 1e-9 or value >= m.high[j] - 1e-9):
        return f"{name} would be {value:.3g}, the end of its range, or beyond: something else is wrong"
    if controller is not None and controller.is_named and m.unsure > 0.0 and k.group.place == "actuator":
        return f"{name}: the commands between the rows are another controller's, and tell nothing of the servo"
    if name == "inertia" and m.is_commanded and not (m.is_flown or m.has_beta):
        return f"{name}: no row measures the nozzle, whose servo may be of another form"
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
        k, std = WEATHER[m.weather], level_deviation(m, el.final.p, WEATHER[m.weather])
        level = math.exp(m.levels[k])
        given: dict[str, tuple[Any, float | None]] = {"level": (level, std)}
        if m.weather == "turbulence":   # of another spectrum the log shows the rms alone, to sqrt(time/2 span)
            given = {"level": (level, math.hypot(std, level * math.sqrt(0.5 * m.tau_g / (m.t[-1] - m.t[0])))),
                     "time_constant": (m.tau_g, None)}
        found.append(Named(m.weather, "environment", given, tuple(WEATHER.keys() - {m.weather}), math.nan, math.nan))
    return found


def named_of(m: Model, el: Elimination, k: Kept) -> list[Named]:
    """Return a kept group as causes in the catalogue's words; a sine in the place of the angle is two terms; a servo
    that is both later and slower is one cause: a scale that is as late as both, not told from a delay."""
    cause = k.group.cause
    values: dict[str, tuple[Any, float | None]] = {}
    for j in k.group.numbers:
        number, value, std = m.numbers[j], float(el.final.p[j]), k.std.get(j)
        is_scale, own = number.parameter == "scale", m.given.get(number.name)   # of the nominal's own effects
        extra = value if own is None else value / own if is_scale else value - own
        # that is nobody's fault
        part = number.tol / TOLERANCE_SIGMAS * (abs(value) if is_scale else 1.0)
        values[number.parameter] = (extra, None if std is None else math.hypot(std, part))
    if cause == "missing_term":
        j, number = k.group.numbers[0], m.numbers[k.group.numbers[0]]
        coefficient = (float(el.final.p[j]) - number.null, k.std.get(j))
        values = {"term": (number.parameter, None), "coefficient": coefficient}
    if cause == "periodic_disturbance":
        s, c = (float(el.final.p[j]) for j in k.group.numbers[:2])
        w = float(el.final.p[k.group.numbers[2]])
        values = {"amplitude": (math.hypot(s, c), k.std.get(k.group.numbers[0])),
                  "frequency": (w, k.std.get(k.group.numbers[2])),
                  "phase": (math.remainder(math.atan2(c, s) - w * m.centre, 2.0 * math.pi), None)}
    if cause == "input_washout":
        v, std = values["time_constant"]
        values = {"time_constant": (1.0 / v if v else math.inf, (std or 0.0) / v**2 if v else None)}
    late = {"delay", "bandwidth"} <= {each.group.name for each in el.kept}
    if late and k.group.name == "delay":
        return []          # it is said with the bandwidth
    if late and k.group.name == "bandwidth":
        (value, std), delay = values["scale"], m.index("delay")
        scale = m.servo.lag / (m.servo.lag / value + float(el.final.p[delay] - m.null[delay]))
        if abs(scale - 1.0) < max(m.tol[k.group.numbers[0]], 2.0 * (std or 0.0)):
            return []      # they undo one another
        values = {"scale": (scale, std)}
    if cause == "actuator_bandwidth" and "lag" in values:
        lag, std = values["lag"]
        scale = m.servo.lag / (m.servo.lag + lag)
        values = {"scale": (scale, None if std is None else scale / (m.servo.lag + lag) * std)}
    if "share" in values:
        share, width = (float(el.final.p[j]) for j in k.group.numbers)
        values.pop("share")
        if cause == "actuator_backlash":
            at = [el.final.at(j) for j in k.group.numbers]
            C, slope = covariance(m, el.final, el.unit)[np.ix_(at, at)], np.array([width, share])
            values = {"half_width": (share * width, math.sqrt(slope @ C @ slope))}
    alike = {*k.alike} - {""} | set(EQUAL_CAUSES.get(k.group.name, ()))
    alike |= {"actuator_delay"} if late and k.group.name == "bandwidth" else set()
    if cause == "gyro_delay" and values["delay"][0] < 0.0 and not m.is_flown:
        cause, values = "attitude_delay", {"delay": (-values["delay"][0], values["delay"][1])}
    named = Named(cause, CATALOGUE[cause].where, values, tuple(sorted(alike - {cause})), 0.5 * k.gain, k.share)
    if k.group.name != "sine":
        return [named]
    size, std = values["coefficient"]
    return [named, replace(named, parameters={"term": ("theta", None), "coefficient": (-size, std)}, alike=())]

"""Determine a vehicle's numbers from its log, each with standard deviation, and the reasons where one is missing."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from sim.errors import InputError

from ..chi_square import quantile
from ..formatting import with_std
from ..judge.lack import Lack
from ..judge.question import question
from ..judge.window import WRONG, against
from ..log.log import Log
from ..log.phases import checked_flight
from ..log.rates import INTERPOLATED, rate_of
from ..weakform.fit import gls
from ..weakform.late import Lead
from ..weakform.modes import FAST_THETA, term_modes
from . import weak
from .channels import Channels, channels
from .law import ShownLaw, shown_law
from .model import BY_COMMAND, BY_MEASUREMENT, command, run
from .scoring import Fitted, fit
from .search import Found, is_held, search

TIMING = 0.001         # s, one sigma, to which times are right without being wrong, as in [diagnosis]
K1_SIGMAS = 3.0        # standard deviations from 0, without which there is no k1
COLLINEAR = 0.99       # |correlation| of a6 and k1 beyond which only a combination is known,
VAGUE = 0.3            # if both are known no better than this, relative
WORTH = 0.5            # of the larger of the two terms, that one standard deviation of a6 may be worth
ROUGHLY = 0.25         # relative, of the nozzle sensor's noise where no command tells how the nozzle moves
LEVEL_UNCERTAINTY = 0.05  # the same of the other levels: between the rows the model is not exact
STAND = 0.005          # relative: no stand's equation is truer; authors' own numbers for one device differ by 1.7 %
SAME = 0.99             # of chi square: coefficients of two halves that differ less may be the same
UNSEEN = 1.0           # standard deviation of a level's logarithm above which it is not seen, only limited

Number = tuple[float, float]   # value, standard deviation


@dataclass(frozen=True, eq=False)
class First:
    """The first nominal of a log; a Number is (value, standard deviation).

    t (n,) [s of the log] nodes, a6, k1, a6_std, k1_std (n,) [1/s^2] at them;  sine: a6 is the coefficient of sin(theta)
    terms    coefficients of theta_dot [1/s] and sign(theta_dot) [rad/s^2], if the model has them
    delay    [s] of the command to the nozzle (or to the motion, if no nozzle is measured), or of nozzle to motion
    servo    natural frequency [rad/s] and damping ratio, where a command and the nozzle tell them
    law      the controller, where the commands show it
    offsets  moment [rad/s^2], gyro_bias [rad/s];  noise  one sigma a sample or period;  wind  as in [wind]
    refused  sentences on what the log cannot tell;  notes  on what was left out;  a6_k1_corr  of the first node
    r2  of held-out rows, predicted
    """

    path: str
    start: float
    rows: int
    period: float
    duration: float
    t: np.ndarray
    a6: np.ndarray
    a6_std: np.ndarray
    k1: np.ndarray
    k1_std: np.ndarray
    sine: bool
    terms: dict[str, Number]
    delay: Number | None
    delay_of: str
    servo: tuple[Number, Number] | None
    offsets: dict[str, Number]
    noise: dict[str, Number]
    wind: dict[str, Number]
    r2: float | None
    notes: tuple[str, ...]
    refused: tuple[str, ...] = field(default=())
    a6_k1_corr: float = 0.0
    law: ShownLaw | None = None


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # of models that are tried, and diverge: they lose
def first(log: Log) -> First:
    """Determine the vehicle's numbers from its log.  InputError if columns, rows or motion are missing, or a column
    holds another quantity, or another multiple of it, than its name says."""
    seen = checked_flight(log, refuse_columns=True)
    if seen.doubtful:
        raise InputError(f"{log.path}: {seen.doubtful}")
    log, c = seen.log, channels(seen.log)
    c = replace(c, notes=(*(fault.message for fault in seen.mended if fault.kind == "phases"), *c.notes))
    moving = c.theta if c.has("theta") else c.theta_dot
    if np.nanmax(moving) == np.nanmin(moving):
        raise InputError(f"{c.path}: column {'theta' if c.has('theta') else 'theta_dot'}: the same value in every row; "
                         "nothing can be determined of a vehicle that does not move")
    for name in ("beta", "beta_cmd"):
        rate = rate_of(log.t, getattr(log, name))
        if rate.kind == INTERPOLATED:
            raise InputError(f"{log.path}: column {name}: it is {rate.words}; log it as it acts")
    result = search(c)
    nominal = answer(result)
    is_beta = c.has("beta") and not result.channels.has("beta")   # it drives as it stands
    nominal = replace(nominal, delay_of="beta") if is_beta else replace(nominal, law=shown_law(log))
    refused = reasons(nominal, result, "beta" if c.has("beta") else "beta_cmd")
    lost = [fault.message for fault in seen.faults if fault.kind == "stale"] if refused else []   # why, before what
    return replace(nominal, refused=(*lost, *refused))


def is_constant(c: Channels) -> bool:
    """Whether the input (command, else nozzle) has one value in the whole log."""
    u = command(c)
    return float(np.nanmax(u)) == float(np.nanmin(u))


# ---- the numbers


def answer(result: Found) -> First:
    """Return the nominal's numbers with their standard deviations from the model that the search found."""
    c, fitted, model = result.channels, result.fitted, result.fitted.model
    na, nk = len(model.node_a), len(model.node_k)
    std = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0) * spread(result))
    if model.sine:
        std[:len(model.linear)] = np.hypot(std[:len(model.linear)], STAND * np.abs(model.linear))
    std[:len(model.linear)] = np.hypot(std[:len(model.linear)], hidden(result))
    off = between_nodes(result, fitted)
    a6_std, k1_std = np.hypot(std[:na], off[:na]), np.hypot(std[na:na + nk], off[na:])
    names = [name for name, there in (("theta_dot", model.damping), ("sign(theta_dot)", model.friction)) if there]
    rest = zip(names, model.rest.tolist(), std[na + nk:].tolist(), strict=False)
    return First(
        path=c.path, start=c.start, rows=len(c.t), period=c.period, duration=float(c.t[-1]) + c.period,
        t=model.node_a + c.start, a6=model.linear[:na], a6_std=a6_std, k1=model.linear[na:na + nk], k1_std=k1_std,
        sine=model.sine, terms={name: (value, deviation) for name, value, deviation in rest},
        delay=delay(fitted, c),
        delay_of="beta" if model.source == BY_MEASUREMENT or not c.has("beta_cmd") else "command",
        servo=servo(fitted), offsets=offsets(fitted), noise=noise(fitted, c), wind=wind(fitted), r2=result.r2,
        notes=c.notes, a6_k1_corr=correlation(fitted.covariance, 0, na))


def correlation(covariance: np.ndarray, j: int, k: int) -> float:
    """Return the correlation of numbers j and k; 0 where one has no variance."""
    below = math.sqrt(max(covariance[j, j] * covariance[k, k], 0.0))
    return min(max(float(covariance[j, k]) / below, -0.9999), 0.9999) if below > 0.0 else 0.0


def spread(result: Found) -> float:
    """Return the factor on the coefficients' variances by which two halves of the log differ more than they should; 1
    where they agree or where a6 and k1 vary."""
    c, model = result.channels, result.fitted.model
    if len(model.node_a) > 1:
        return 1.0
    half = len(c.t) // 2
    parts = [fit(model, part, free=()) for part in (c.part(0, half), c.part(half, len(c.t)))]
    q = len(model.linear)
    off = parts[0].model.linear - parts[1].model.linear
    if model.no_input:
        keep = np.arange(q) != 1
        off, q = off[keep], q - 1
    both = (parts[0].covariance + parts[1].covariance)[:len(model.linear), :len(model.linear)]
    both = both[np.ix_(keep, keep)] if model.no_input else both
    scale = np.sqrt(np.maximum(np.diag(both), 1e-300))
    chi = float((off / scale) @ np.linalg.lstsq(both / np.outer(scale, scale), off / scale, rcond=1e-9)[0])
    return max(chi / q, 1.0) if chi > quantile(SAME, q) else 1.0


def hidden(result: Found) -> np.ndarray:
    """Return the error (q,) of the coefficients from commands between the rows, at most: their change if every second
    command is left out; 0 where the nozzle is measured."""
    c, model = result.channels, result.fitted.model
    if c.has("beta") or model.no_input or is_held(c):
        return np.zeros(len(model.linear))
    fewer = replace(c, beta_cmd=np.where(np.arange(len(c.t)) % 2 == 0, c.beta_cmd, math.nan), driven=True)
    return np.asarray(fit(model, fewer, free=()).model.linear - model.linear)


def between_nodes(result: Found, fitted: Fitted) -> np.ndarray:
    """Return the error (na + nk,) of a6, k1 at the nodes from taking them as straight between: the change when nodes
    are put between, beyond chance (Hausman 1978: the difference's variance is that of the variances)."""
    model = fitted.model
    n = len(model.node_a) + len(model.node_k)
    if result.finer is None:
        return np.zeros(n)
    a, k = result.finer.model.at(model.node_a)[0], result.finer.model.at(model.node_k)[1]
    finer = np.diag(result.finer.covariance)
    chance = np.concatenate([finer[0:2 * len(a) - 1:2], finer[2 * len(a) - 1:2 * len(a) + 2 * len(k) - 2:2]])
    chance = np.maximum(chance - np.diag(fitted.covariance)[:n], 0.0)
    off = np.concatenate([a, k]) - model.linear[:n]
    return np.sqrt(np.maximum(off**2 - chance, 0.0))


def delay(fitted: Fitted, c: Channels) -> Number | None:
    """Return the delay [s] and its std, None if it is not fitted.  A command held over rows changed half a period
    before the row that shows it, on average; any command's time is known to a period's spread."""
    model = fitted.model
    if "delay" not in model.free:
        return None
    value, std = model.numbers["delay"], fitted.std("delay")
    if model.source == BY_MEASUREMENT:
        return value, std
    if not is_held(c):
        return value, math.hypot(std, c.period / math.sqrt(12.0))
    return value + 0.5 * c.period, math.hypot(std, c.period / math.sqrt(12.0))


def servo(fitted: Fitted) -> tuple[Number, Number] | None:
    model = fitted.model
    if model.source != BY_COMMAND:
        return None
    w, zeta = model.numbers["servo"], model.numbers["damping"]
    return ((w, w * fitted.std("servo")), (zeta, zeta * fitted.std("damping") if "damping" in model.free else 0.0))


def offsets(fitted: Fitted) -> dict[str, Number]:
    """Return the fitted moment [rad/s^2] and gyro_bias [rad/s]."""
    model, q = fitted.model, len(fitted.model.linear)
    std = np.sqrt(np.maximum(np.diag(fitted.covariance)[q:q + len(model.offsets)], 0.0))
    return dict(zip(("moment", "gyro_bias"), zip(model.offsets.tolist(), std.tolist(), strict=True), strict=False))


def noise(fitted: Fitted, c: Channels) -> dict[str, Number]:
    """Return one sigma by name: of sensors a sample, of command and unmodelled acceleration [rad/s^2] a period."""
    model = fitted.model
    levels = {}
    for name, key, period in (("theta", "r_theta", 1.0), ("theta_dot", "r_theta_dot", 1.0), ("beta", "r_beta", 1.0),
                              ("command", "q_b", c.period), ("acceleration", "q_a", c.period)):
        if key in model.free and not (key == "q_b" and model.source != BY_COMMAND):
            value = math.sqrt(model.numbers[key] / period)
            rough = ROUGHLY if key == "r_beta" and model.source == BY_MEASUREMENT else LEVEL_UNCERTAINTY
            levels[name] = (value, value * math.hypot(0.5 * fitted.std(key), rough))
            if fitted.std(key) > UNSEEN:
                limit = math.sqrt(unseen(fitted, c, key) / period)
                levels[name] = (limit, limit)
    return levels


def unseen(fitted: Fitted, c: Channels, key: str) -> float:
    """Return the noise level `key` (a variance or a density) at which ln L falls by 0.5: the log cannot show a smaller
    one."""
    model, level = fitted.model, fitted.model.numbers[key]
    for _ in range(100):
        level *= 2.0
        if run(replace(model, numbers=model.numbers | {key: level}), c).ln_l < fitted.ln_l - 0.5:
            break
    return level


def wind(fitted: Fitted) -> dict[str, Number]:
    """Return the fitted wind levels, those seen, as angles: accelerations over the largest |a6|.  Where a6 is vague
    they stay accelerations [rad/s^2, rad/s^2/sqrt(s)], named `moment_...`."""
    model = fitted.model
    k = int(np.argmax(np.abs(model.linear[:len(model.node_a)])))
    a6, std = abs(float(model.linear[k])), math.sqrt(float(fitted.covariance[k, k]))
    vague = not std < VAGUE * a6
    per, relative = (1.0, 0.0) if vague else (float(np.max(model.coupling)) / a6, std / a6)
    levels = {}
    for name in ("walk", "turbulence"):
        if name in model.free and fitted.std(name) < UNSEEN:
            value = per * model.numbers[name]
            levels[f"moment_{name}" if vague else name] = (value, value * math.hypot(fitted.std(name), relative))
    if "turbulence_time" in model.free and fitted.std("turbulence") < UNSEEN:
        value = model.numbers["turbulence_time"]
        levels["turbulence_time"] = (value, value * fitted.std("turbulence_time"))
    return levels


# ---- what the log cannot tell


def reasons(numbers: First, result: Found, driver: str) -> list[str]:
    """Return sentences on why numbers of the nominal cannot be given; [] if all can.

    driver  name of the column that drives the vehicle (beta or beta_cmd)
    """
    c = result.channels
    if is_constant(c):
        return [f"k1 cannot be determined: {driver} is {float(np.nanmax(command(c))):g} throughout; log a stretch in "
                "which it moves"]
    said = []
    if not np.any(np.abs(numbers.k1) > K1_SIGMAS * numbers.k1_std):
        said.append(f"k1 cannot be determined: {with_std(numbers.k1.mean(), numbers.k1_std.mean())} 1/s^2 may be 0; "
                    f"log a stretch in which {driver} moves more")
    return said + (lacking(numbers, result, driver) or impossible(numbers, driver)) + unseparated(numbers, result)


def impossible(numbers: First, driver: str) -> list[str]:
    """Return sentences on numbers that no vehicle has, beyond WRONG std: delay below 0, damping that drives."""
    said = []
    if numbers.delay is not None and numbers.delay[0] < -WRONG * math.hypot(numbers.delay[1], TIMING):
        said.append(f"{driver} follows the motion by {with_std(-1e3 * numbers.delay[0], 1e3 * numbers.delay[1])} "
                    "ms: it is no input of it, or its stamps are late")
    value, std = numbers.terms.get("theta_dot", (0.0, 0.0))
    return [*said, driving(value, std, driver)] if value > WRONG * std else said


def driving(value: float, std: float, driver: str) -> str:
    """Return the sentence on a rate damping [1/s] of the wrong sign (above 0)."""
    return (f"the rate damping comes out {with_std(value, std)} 1/s: of the wrong sign, no body's motion drives "
            f"itself; {driver} is filtered or late, or theta and theta_dot are, or little but {driver} moves them")


def lacking(numbers: First, result: Found, driver: str) -> list[str]:
    """Return sentences on effects that the model lacks and that would move its numbers, found by `judge.question`."""
    m, model = result.motion, result.fitted.model
    a6, k1 = (x / x[np.argmax(np.abs(x))] if np.any(x) else np.ones(len(m.t)) for x in model.at(m.t))  # as they vary
    if model.sine:
        a6 = np.ones(len(m.t))
    m = replace(m, beta=weak.acting(m, model))
    rows = replace(m, theta=a6 * m.theta, gamma=a6 * m.gamma, beta=k1 * m.beta, fast=a6 * m.fast)
    asked = question(rows, (*result.terms[:2], "1"), result.terms[2:])
    if asked.unchecked:
        return [f"what a6 and k1 rest on could not be tested: {asked.unchecked}"]
    found = [lack for lack in asked.lacks
             if not (lack.what == "delay" and asked.lead is not None and is_known(numbers, asked.lead))]
    if len(model.node_a) == 1:   # else the answer is of many numbers
        modes = term_modes(rows, asked.terms)
        fit = gls(modes)
        known = {result.terms[0]: (float(numbers.a6.mean()), float(numbers.a6_std.mean())),
                 result.terms[1]: (float(numbers.k1.mean()), float(numbers.k1_std.mean())), "1": (0.0, math.inf)}
        xi, std = np.array([(known | numbers.terms)[term] for term in asked.terms]).T
        found = [] if fit.is_singular else against(rows, asked.terms, xi, std, fit, modes, found)
    return [lack_words(lack, driver) for lack in found]


def is_known(numbers: First, lead: Lead) -> bool:
    """Whether a lead of the input that remains is within K1_SIGMAS of the error of the model's delay."""
    std = 0.0 if numbers.delay is None else numbers.delay[1]
    return abs(lead.value) < K1_SIGMAS * math.hypot(std, lead.std)


def lack_words(lack: Lack, driver: str) -> str:
    """Return the sentence that says why a first nominal without the effect `lack` would be wrong."""
    said = {"placebo": f"k1 cannot be determined: {driver} of another time of the log explains the motion as well as "
                       f"{driver} does (placebo)",
            "gamma": "gamma does not act as theta does with the other sign: another unit, or the other sign",
            FAST_THETA: "what theta does slowly does not act as what it does fast: log gamma or alpha, or give theta "
                        "less its reference"}
    if lack.what in said:
        return said[lack.what]
    assert lack.size is not None
    if lack.what == "driving":
        return driving(lack.size, lack.std, driver)
    if lack.what == "clock":
        return (f"the time by which {driver} leads grows by {1e3 * lack.size:.3g} ms a second: {driver} and the motion "
                "are stamped by two clocks")
    if lack.what == "delay":
        words = f"leads the motion by {1e3 * lack.size:.0f} ms" if lack.size >= 0.0 else \
            f"follows the motion by {-1e3 * lack.size:.0f} ms: it is no input of it, or its stamps are late"
        return f"{driver} {words} ({lack.shares})"
    what = {"beta_ddot": "the acceleration of the nozzle acts too", "1": "a constant acts too"}
    return f"{what.get(lack.what, f'the term {lack.what} is in the log')}, {lack.size:.3g} ({lack.shares})"


def unseparated(numbers: First, result: Found) -> list[str]:
    """Return one sentence if a6 and k1 cannot be told apart (theta and beta move together), or a6 cannot be determined
    (theta hardly moves); else []."""
    model, m = result.fitted.model, result.motion
    na, nk = len(model.node_a), len(model.node_k)
    covariance = result.fitted.covariance
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    alike = [abs(covariance[k, na + k] / scale[k] / scale[na + k]) > COLLINEAR for k in range(min(na, nk))]
    vague = (numbers.a6_std > VAGUE * np.abs(numbers.a6)) & (numbers.k1_std > VAGUE * np.abs(numbers.k1))
    if all(alike) and np.all(vague):
        ratio = float(np.mean(numbers.a6) / np.mean(numbers.k1))
        return [f"a6 and k1 cannot be told apart: theta and beta move together; a6/k1 = {ratio:.3g} alone is known; "
                "log a stretch with a test input"]
    _, _, phi = weak.columns(m, result.terms, result.delay)
    theta, beta = (float(np.std(phi[:, k] - phi[:, 0] * (phi[:, k].sum() / phi[:, 0].sum()))) for k in (1, 2))
    worth = float(np.median(numbers.a6_std)) * theta
    if worth > WORTH * max(float(np.median(np.abs(numbers.k1))) * beta, float(np.median(np.abs(numbers.a6))) * theta):
        return [f"a6 cannot be determined: {with_std(numbers.a6.mean(), numbers.a6_std.mean())} 1/s^2; log a stretch "
                "in which theta moves more"]
    return []

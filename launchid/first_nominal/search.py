"""The search from a log to its model: source of the nozzle angle, terms, variation of a6 and k1, wind.

Every choice is made by the likelihood with Schwarz' penalty, from the plain model upward.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sim.errors import InputError

from ..judge.terms import INCREMENT, LARGE
from ..selection import step_by_step
from ..series import filled
from ..sums import combined, inner, square
from ..weakform.noise import noise_variance
from ..weakform.prepare import LONGEST_ROW_STEP
from ..weakform.rows import Rows
from . import weak
from .channels import Channels
from .model import BY_COMMAND, BY_INPUT, BY_MEASUREMENT, Model, command, run
from .scoring import Fitted, fit, penalised, scores, solved

FEWEST_INCREMENTS = 20   # of the weak form, from which first numbers come
REPEATED_COMMANDS = 0.25  # of rows repeat the command: it is issued less often than it is logged
COMMAND_SHARE = 0.5    # share of the nozzle's variance that a delayed command explains, if it drives it
FIRST_SERVO_FREQUENCY = 40.0  # rad/s, where a servo's frequency is first looked for
SERVO_DAMPING = 0.7
FASTEST = 5.0          # over the sample period: a servo beyond it is done within a row
FASTEST_UNSEEN = 1.0   # the same where no sensor shows it and its damping ratio is free: two lags, of a row and more
MOST_COMMAND_DELAY = 0.4  # s: the longest delay looked for
EARLIEST = -0.05       # s: a nozzle that follows the motion is no input, and is seen
NODE_COUNTS = (2, 3, 5, 9, 17)
NEAREST = 4.0          # s between nodes
MARGIN = 5.0           # nats, beside the penalty, that a further term must bring
WIND_MARGIN = -7.0     # the same of wind: calm believed in wind is 4 std wrong, wind in calm only wide
# rad/s^2/sqrt(s), rad/s^2, s: wind, at first
FIRST_LEVELS = {"walk": 0.003, "turbulence": 0.005, "turbulence_time": 1.0}
MIN_WIND_SHARE = 0.02  # of the largest |a6|, by which wind acts at least
TERMS = {"damping": "theta_dot", "friction": "sign(theta_dot)"}
PLAIN_TERMS = ("theta", "beta")
NOZZLE_NUMBERS = ("r_beta", "q_b", "servo")  # of a nozzle that no command tells
STAND_TERMS = tuple((gravity, "beta", *rest) for gravity in ("theta", "sin(theta)")
                    # where a stand's model may begin
                    for rest in ((), ("theta_dot",), ("theta_dot", "sign(theta_dot)")))


@dataclass(frozen=True, eq=False)
class Found:
    """The model that the search found.

    channels  the data fitted: those of the log, or with beta in the place of the command
    fitted  the model at its maximum;  finer  refitted with nodes between its nodes, None: constant
    motion, terms, delay [s]   of the weak form;  r2  share of held-out variance that it predicts
    """

    channels: Channels
    fitted: Fitted
    finer: Fitted | None
    motion: Rows
    terms: tuple[str, ...]
    delay: float
    r2: float


def sizes(c: Channels, m: Rows) -> dict[str, float]:
    """Return the largest magnitude of theta, theta_dot, beta, beta_rate and moment, by name; rad and s."""
    def size(x: np.ndarray) -> float:
        return float(np.nanmax(np.abs(x))) + 1e-12
    u = filled(c.beta if c.has("beta") else command(c), c.t)
    return {"theta": size(m.theta), "theta_dot": size(m.theta_dot), "beta": size(u),
            "beta_rate": size(np.diff(u)) / c.period + 1e-12,
            "moment": size(weak.columns(m, ())[1]) / INCREMENT}


def bounds(c: Channels) -> dict[str, tuple[float, float]]:
    """Return name -> (low, high) of servo [rad/s], damping ratio, turbulence_time [s]: what a log can show."""
    length = float(c.t[-1])
    return {"servo": (1.0 / length, FASTEST / c.period), "damping": (0.05, 5.0),
            "turbulence_time": (2.0 * c.period, length)}


def source_of(c: Channels) -> str:
    """Return what moves the nozzle: BY_COMMAND (through a servo), BY_MEASUREMENT, or BY_INPUT (beta not measured)."""
    if not c.has("beta"):
        return BY_INPUT
    if not c.has("beta_cmd"):
        return BY_MEASUREMENT
    beta, u = filled(c.beta, c.t), filled(c.beta_cmd, c.t)
    left = [_unexplained(beta, np.interp(c.t - d, c.t, u))
            for d in np.arange(0.0, MOST_COMMAND_DELAY, max(c.period, 0.01))]
    return BY_COMMAND if min(left) < 1.0 - COMMAND_SHARE else BY_MEASUREMENT


def _unexplained(y: np.ndarray, x: np.ndarray) -> float:
    """Return the share of y's variance that a straight line in x leaves."""
    y, x = y - y.mean(), x - x.mean()
    below = square(x) * square(y)
    return 1.0 - inner(x, y) ** 2 / below if below > 0.0 else 1.0


def servo_start(c: Channels) -> float:
    """Return the delay [s] from command to nozzle in excess of the lag of a servo of FIRST_SERVO_FREQUENCY."""
    beta, u = filled(c.beta, c.t), filled(c.beta_cmd, c.t)
    grid = np.arange(0.0, MOST_COMMAND_DELAY, max(c.period / 2.0, 0.002))
    best = float(grid[int(np.argmin([_unexplained(beta, np.interp(c.t - d, c.t, u)) for d in grid]))])
    return max(best - 2.0 * SERVO_DAMPING / FIRST_SERVO_FREQUENCY, 0.0)


def start(c: Channels, source: str, m: Rows, terms: tuple[str, ...], delay: float) -> Model:
    """Return the plain model with first numbers: coefficients of the weak form, noises from the channels' roughness."""
    _, y, phi = weak.columns(m, terms, delay)
    xi = dict(zip(("1", *terms), weak.solve(phi, y).tolist(), strict=True))
    left = y - combined(phi, weak.solve(phi, y))
    numbers = {"q_a": max(square(left) / len(left) / INCREMENT, 1e-12), "delay": delay}
    free = ["q_a"]
    for name, channel in (("r_theta", c.theta), ("r_theta_dot", c.theta_dot)):
        if c.has(name[2:]):
            numbers[name] = noise_variance(channel)
            free.append(name)
    if source != BY_INPUT:
        numbers["r_beta"] = noise_variance(c.beta)
        free.append("r_beta")
    if source == BY_COMMAND:
        numbers |= {"servo": FIRST_SERVO_FREQUENCY, "damping": SERVO_DAMPING, "delay": servo_start(c),
                    "q_b": numbers["r_beta"] * c.period}
        free += ["q_b", "servo", "damping"]
    elif source == BY_MEASUREMENT:
        u = filled(c.beta, c.t)
        rough = float(np.var(np.diff(u))) / c.period**2
        numbers |= {"servo": 2.0 / c.period / 5.0, "q_b": max(rough, 1e-12) * 2.0 / c.period / 5.0}
        free += ["q_b", "servo"]
    linear = np.array([xi[term] for term in terms])
    offsets = np.array([xi["1"], 0.0][:1 + (c.has("theta") and c.has("theta_dot"))])
    return Model(source, np.zeros(1), np.zeros(1), linear, offsets, numbers, (*free, "delay"),
                 sine="sin(theta)" in terms, damping="theta_dot" in terms, friction="sign(theta_dot)" in terms,
                 smooth=3.0 * math.sqrt(numbers.get("r_theta_dot", 0.0)) or 0.05 * float(np.max(np.abs(m.theta_dot))),
                 sizes=sizes(c, m), bounds=bounds(c))


def search(c: Channels) -> Found:
    """Find the model of a log.

    A beta without a command is either the nozzle's own angle, smooth and measured with noise, or itself the input, as
    it stands in each row: then its roughness moves the vehicle, by a delay or by a servo that no sensor shows.  The
    likelihood decides, for the plain model and again once the terms are found.
    """
    found = driven_instead(begin(c))
    found = driven_instead(replace(found, fitted=fit(grown(found.fitted, found.channels).model, found.channels)))
    c, now = found.channels, found.fitted
    gravity = "sin(theta)" if now.model.sine else "theta"
    terms = (gravity, "beta", *(term for name, term in TERMS.items() if getattr(now.model, name)))
    return replace(found, finer=between(now, c), terms=terms, r2=weak.held_out(found.motion, terms, found.delay))


def driven_instead(found: Found) -> Found:
    """Return `found`, or its model with another path from beta or command to the nozzle where that is more likely."""
    c, model = found.channels, found.fitted.model
    if model.source == BY_INPUT and not model.no_input:
        return replace(found, fitted=servo_instead(found.fitted, c))
    if model.source != BY_MEASUREMENT:
        return found
    c = replace(c, beta_cmd=c.beta, beta=np.full(len(c.t), math.nan))
    left = {name: value for name, value in model.numbers.items() if name not in NOZZLE_NUMBERS}
    driven = replace(model, source=BY_INPUT, numbers=left, free=tuple(name for name in model.free if name in left))
    now = servo_instead(fit(driven, c), c)
    return found if now.bic + nozzle_alone(found) <= found.fitted.bic + MARGIN else replace(
        found, channels=c, fitted=now)


def begin(c: Channels) -> Found:
    """Return the plain model of a log: two terms, or a test stand's terms at large angles, without wind and nodes."""
    u = command(c)
    idle = float(np.nanmax(u)) == float(np.nanmin(u))
    source = BY_INPUT if idle else source_of(c)
    m = weak.motion(c, source != BY_INPUT)
    if len(weak.columns(m, ())[1]) < FEWEST_INCREMENTS:
        edges = m.bounds.tolist()
        longest = max((float(m.t[b - 1] - m.t[a]) for a, b in itertools.pairwise(edges) if b > a), default=0.0)
        raise InputError(f"{c.path}: no stretch without a lost row is longer than {longest:.2g} s (a step beyond "
                         f"{LONGEST_ROW_STEP:g} periods of {c.period:g} s ends one); a first nominal needs some of "
                         f"{INCREMENT:g} s: log every row, with even stamps")
    best = None
    for terms in STAND_TERMS if large(c) else (PLAIN_TERMS,):
        delay = 0.0 if source == BY_COMMAND or idle else best_delay(c, m, terms)
        model = start(c, source, m, terms, delay)
        if idle:
            model = replace(model, no_input=True, free=tuple(name for name in model.free if name != "delay"),
                            linear=np.where(np.arange(len(model.linear)) == 1, 0.0, model.linear))
        now = fit(model, c)
        if best is None or now.bic > best.fitted.bic + (-MARGIN if now.model.sine and not best.fitted.model.sine
                                                        else MARGIN):
            best = Found(c, now, None, m, terms, delay, 0.0)   # at large angles it is sin(theta), unless it is not
    assert best is not None
    return best


def nozzle_alone(found: Found) -> float:
    """Return the penalised ln L of the nozzle's motion and noise, fitted to beta alone: to be added to a model that
    takes beta as input before it is compared with one that explains beta."""
    c, model = found.channels, found.fitted.model
    unseen = np.full(len(c.t), math.nan)
    alone = fit(replace(model.with_coefficients(0.0 * model.coefficients), free=NOZZLE_NUMBERS),
                replace(c, theta=unseen, theta_dot=unseen))
    return penalised(alone.ln_l, replace(alone.model, linear=np.zeros(0)), alone.final)


def large(c: Channels) -> bool:
    """Whether theta reaches angles at which sin(theta) is not theta; False for a log without theta."""
    return c.has("theta") and bool(np.nanmax(np.abs(c.theta)) > LARGE)


def best_delay(c: Channels, m: Rows, terms: tuple[str, ...]) -> float:
    """Return the input delay [s] at which the weak form with these terms fits best."""
    return weak.best_delay(m, terms, EARLIEST, MOST_COMMAND_DELAY, max(c.period, 0.005))


def is_held(c: Channels) -> bool:
    """Whether the command often repeats from row to row: it is issued less often than it is logged."""
    u = command(c)
    return bool(np.mean(np.diff(u[np.isfinite(u)]) == 0.0) > REPEATED_COMMANDS)


def servo_instead(now: Fitted, c: Channels) -> Fitted:
    """Return the most likely of: model `now`, with a servo that no sensor shows, with two lags (free damping)."""
    delay = now.model.numbers["delay"]
    numbers = now.model.numbers | {"servo": FIRST_SERVO_FREQUENCY, "damping": SERVO_DAMPING, "q_b": 0.0,
                                   "delay": max(delay - 2.0 * SERVO_DAMPING / FIRST_SERVO_FREQUENCY, 0.0)}
    ranges = now.model.bounds | {"delay": (0.0, MOST_COMMAND_DELAY)}   # else a negative one stands for a faster servo
    servo = fit(replace(now.model, source=BY_COMMAND, numbers=numbers, free=(*now.model.free, "servo"),
                        bounds=ranges), c)
    ranges |= {"servo": (1.0 / float(c.t[-1]), FASTEST_UNSEEN / c.period)}
    lags = fit(replace(servo.model, free=(*servo.model.free, "damping"), bounds=ranges), c)
    return max((now, servo, lags), key=lambda each: each.bic)


def grown(now: Fitted, c: Channels) -> Fitted:
    """Add to the plain model the part that gains most, until none gains more than its penalty; then remove parts that
    no longer pay.  Wind is asked of the plain model, and again once nodes and terms are there."""
    plain = now

    def fitted(model: Model) -> Fitted:
        return fit(model, c, free=still(model))

    def larger(now: Fitted) -> Iterator[Fitted]:
        hoped = max(((hope(model, c), k, model) for k, model in enumerate(candidates(now.model, c))), default=None)
        more = [fitted(hoped[2])] if hoped is not None and hoped[0] > now.bic + MARGIN else []
        if now is not plain and not now.model.walk:
            yield from more
            more = []
        yield from sorted((*map(fitted, windy(now.model, c)), *more), key=lambda each: -each.bic)

    def without(now: Fitted) -> Iterator[Fitted]:
        return map(fitted, thinner(now.model))

    def pays(more: Fitted, now: Fitted) -> bool:
        return more.bic > now.bic + MARGIN

    def does_as_well(less: Fitted, now: Fitted) -> bool:
        return less.bic + (WIND_MARGIN if now.model.walk and not less.model.walk else 0.0) > now.bic

    return step_by_step(step_by_step(now, larger, pays), without, does_as_well)


def hope(model: Model, c: Channels) -> float:
    """Return the penalised ln L to expect of a model after one scoring step from the given numbers, without fitting it;
    exact where the model is linear in what was added."""
    none = replace(model, free=())
    base = run(none, c)
    score, information = scores(none, c, base)
    gradient = score.sum(axis=0)
    gain = 0.5 * float(gradient @ solved(information, gradient, 0.0))
    return penalised(base.ln_l + gain, model, base)


def candidates(model: Model, c: Channels) -> Iterator[Model]:
    """Yield models with one linear addition each: nodes, rate damping, dry friction."""
    end, count = float(c.t[-1]), len(model.node_a)
    more = [k for k in NODE_COUNTS if k > count and (k == 2 or end / (k - 1) >= NEAREST)]
    for k in more[:2] if count > 1 else more[:3]:
        yield model.with_nodes(*[np.linspace(0.0, end, k)] * 2)
    rest = model.rest
    if not model.damping:
        front = model.linear[:len(model.linear) - len(rest)]
        yield replace(model, damping=True, linear=np.concatenate([front, [0.0], rest]))
    if not model.friction and large(c):   # of bearings, in test stands
        yield replace(model, friction=True, linear=np.append(model.linear, 0.0))


def windy(model: Model, c: Channels) -> Iterator[Model]:
    """Yield the model with wind, or, where it has wind and a6 varies, with wind that acts in proportion to a6; none at
    large angles."""
    if large(c):
        return
    if not model.walk:
        yield replace(model, numbers=model.numbers | FIRST_LEVELS, free=(*model.free, *FIRST_LEVELS))
    elif len(model.node_a) > 1:
        a6 = np.abs(model.linear[:len(model.node_a)])
        a6 = np.maximum(a6, MIN_WIND_SHARE * np.max(a6))
        yield replace(model, node_c=model.node_a, coupling=a6 / np.max(a6))


def thinner(model: Model) -> Iterator[Model]:
    """Yield the model without wind, without rate damping, without friction, for each of them that it has."""
    if model.walk:
        yield replace(model, free=tuple(name for name in model.free if name not in FIRST_LEVELS),
                      numbers={name: value for name, value in model.numbers.items() if name not in FIRST_LEVELS})
    front, rest = model.linear[:len(model.linear) - len(model.rest)], model.rest
    if model.damping:
        yield replace(model, damping=False, linear=np.concatenate([front, rest[1:]]))
    if model.friction:
        yield replace(model, friction=False, linear=np.concatenate([front, rest[:-1]]))


def still(model: Model) -> tuple[str, ...]:
    """Return the free numbers to refit when models are compared: unmodelled acceleration, wind, and a measured nozzle's
    delay."""
    names = (*FIRST_LEVELS, *(("delay",) if model.source == BY_MEASUREMENT else ()))
    return ("q_a", *(name for name in names if name in model.free))


def between(now: Fitted, c: Channels) -> Fitted | None:
    """Return the model refitted with nodes between its nodes; None where a6 and k1 are constant."""
    nodes = now.model.node_a
    if len(nodes) == 1:
        return None
    finer = np.linspace(nodes[0], nodes[-1], 2 * len(nodes) - 1)
    return fit(now.model.with_nodes(finer, finer), c, free=())

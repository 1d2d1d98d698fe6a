"""The faults between channels: units, signs, exchanged columns.

Three relations hold whatever the vehicle does:

    rate        theta = integral of theta_dot (+ bias): see `slope`
    nozzle      beta = the actuator's answer to beta_cmd (+ bias), never before it
    controller  beta_cmd = C(theta) - C(theta_ref) (+ bias, + test input), C the nominal's

Each is a regression with free gains over means of short blocks.  Physical effects leave the gains within a factor 2.5
of 1; degrees, signs and exchanged columns do not.  One rule tells all of these: of the repairs of one column, or of
two exchanged, that is named which fulfils a relation that was not fulfilled, and breaks none; beta and beta_cmd, which
fulfil theirs either way, are told by which of them moves first.  It is then made on a
copy and the next is looked for.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...sections import Nominal
from ...sums import square
from .fault import Fault
from .slope import CLEAR, DEGREES, NO_FIT, Columns, Fit, block_means, near, rate_fit, regress

SLACK = 2.6              # a gain of 1 within this factor: gains of effects are 0.4..2.5
MUCH_BETTER = 0.25       # of the share that a relation left unexplained is left after a repair
NOZZLE_BLOCK = 0.05      # s, of the actuator and of the controller: shorter than the latter's derivative filter
PARTIAL = 0.5            # share of the rest's variance that one part of the controller must explain to have a gain
DELAYS = (0.0, 0.02, 0.04, 0.06, 0.1)  # s, of a controller that computes slowly
FAULTS_AT_MOST = 4
FULFILLED = 1.0 - CLEAR  # misfit at most of a relation that holds
SAME = 1e-6              # of the logarithm of a misfit: rounding
LEAST = 1e-9             # misfit of a log without noise
AT_LIMIT = 0.999         # of the largest command: held by the deflection limit
NOZZLE_LAG = 0.12        # s: looked for between command and nozzle
LAG_SMOOTH = 0.03        # s: about the servo's own time, over which changes are taken
LAG_PARTS = 4            # of a row: steps of the lag
FORWARD_SHARE = 0.85     # of what lags >= 0 leave unexplained is left at negative ones: 0.4..0.7 if exchanged, else 1
LAG_CLEAR = 0.2          # share of the nozzle's changes explained at the best lag
WRONG_SIGN, WRONG_SIZE = 2.0, 8.0   # misfits of relations that tell so clearly: each repair is MUCH_BETTER
PARTS = {"rate": ("theta", "theta_dot"), "nozzle": ("beta", "beta_cmd"),
         "controller": ("theta", "theta_ref", "beta_cmd")}
THEN = {"rate": "theta is the integral of theta_dot", "nozzle": "beta follows beta_cmd",
        "controller": "beta_cmd is what the controller makes of theta and theta_ref"}
AGAINST = {("rate", "theta"): "the integral of theta_dot", ("rate", "theta_dot"): "the slope of theta",
           ("nozzle", "beta"): "beta_cmd", ("nozzle", "beta_cmd"): "beta"}
EXCHANGED = (("theta", "theta_dot"), ("theta", "beta"), ("theta_dot", "beta"), ("theta", "theta_ref"))
RELATED = ("theta_dot", "theta", "beta", "beta_cmd", "theta_ref")
WORDS = {"swapped": "{} look exchanged over the whole log: {}; exchange the two column names",
         "unit": "{} looks like degrees over the whole log: {}; multiply it by pi/180",
         "sign": "{} has the opposite sign over the whole log: {}; multiply it by -1"}


@dataclass(frozen=True)
class Change:
    """One repair: `channels` times `factor`, or exchanged."""

    kind: str
    channels: tuple[str, ...]
    factor: float = 1.0

    def repaired(self, columns: Columns) -> Columns:
        if self.kind == "swapped":
            first, second = self.channels
            return columns | {first: columns[second], second: columns[first]}
        return columns | {name: columns[name] * self.factor for name in self.channels}


def relation_faults(columns: Columns, period: float, nominal: Nominal,
                    times: np.ndarray) -> Iterator[tuple[Change, Fault]]:
    """Faults between the channels, one after the other, each found with those before repaired.

    columns  measured channels on uniform `times` (n,) [s], `period` [s] apart
    """
    for _ in range(FAULTS_AT_MOST):
        change, reason = _first(columns, period, nominal, times)
        if change is None:
            return
        text = WORDS[change.kind].format(" and ".join(change.channels), reason)
        channel = change.channels[0] if len(change.channels) == 1 else None
        yield change, Fault(change.kind, channel, float(times[0]), float(times[-1]), len(times), text)
        columns = change.repaired(columns)


def _first(columns: Columns, period: float, nominal: Nominal, times: np.ndarray) -> tuple[Change | None, str]:
    """The repair after which the relations are fulfilled best, and why; None: there is none, or no need of any."""
    fits = {relation: fit_of(relation, columns, period, nominal, times) for relation in PARTS}
    before = {relation: misfit(fit) for relation, fit in fits.items()}
    best, change, reason = sum(map(math.log, before.values())), None, ""
    for tried in _changes(columns, max(before.values())):
        changed = tried.repaired(columns)
        after = before | {relation: misfit(fit_of(relation, changed, period, nominal, times))
                          for relation, names in PARTS.items() if set(names) & set(tried.channels)}
        better = [relation for relation in PARTS if before[relation] > FULFILLED
                  and after[relation] <= MUCH_BETTER * before[relation]]
        broken = any(after[relation] > max(before[relation], FULFILLED) for relation in PARTS)
        total = sum(map(math.log, after.values()))
        if better and not broken and total < best - SAME:
            best, change, reason = total, tried, _reason(tried, better[0], fits[better[0]])
    if change is None and command_follows(columns, period):
        return Change("swapped", ("beta", "beta_cmd")), "beta_cmd follows beta, which no actuator does"
    return change, reason


def _changes(columns: Columns, worst: float) -> Iterator[Change]:
    """The repairs that a relation of such a misfit may need; of two that are as good the first one is made."""
    names = [name for name in RELATED if name in columns] if worst >= WRONG_SIGN else []
    for kind, factor in (("unit", 1.0 / DEGREES), ("sign", -1.0)):
        yield from (Change(kind, (name,), factor) for name in names)
    if worst > FULFILLED:
        yield from (Change("swapped", pair) for pair in EXCHANGED if set(pair) <= set(columns))


def _reason(change: Change, relation: str, fit: Fit) -> str:
    """The relation that a repair fulfils, whose fit was this before it."""
    if change.kind == "swapped":
        return f"then {THEN[relation]}"
    against = AGAINST.get((relation, change.channels[0]), "the controller's command")
    if change.kind == "sign":
        return f"it moves against {against}"
    gain = max(fit.gain[:2], key=lambda each: abs(math.log(abs(each) or 1.0)))
    return f"it is {max(abs(gain), 1.0 / abs(gain)):.1f} times {against}"


def misfit(fit: Fit) -> float:
    """The share that a relation with gains of 1 leaves unexplained.  It is 1 where the relation says nothing clearly,
    and beyond where it says clearly that a sign or a size is another one."""
    if not fit.explained > CLEAR:
        return 1.0
    gains = [gain for gain, partial in zip(fit.gain[:2], fit.partial[:2], strict=True) if partial > PARTIAL]
    if not all(near(abs(gain), 1.0, SLACK) for gain in gains):
        return WRONG_SIZE
    return WRONG_SIGN if min(gains, default=1.0) < 0.0 else max(1.0 - fit.explained, LEAST)


# ---- the relations


def fit_of(relation: str, columns: Columns, period: float, nominal: Nominal, times: np.ndarray) -> Fit:
    """The regression of one relation; none where a column of it is not there."""
    if not set(PARTS[relation]) <= set(columns):
        return NO_FIT
    if relation == "rate":
        return rate_fit(columns, "theta", "theta_dot", period)
    return nozzle_fit(columns, period, nominal) if relation == "nozzle" else \
        control_fit(columns, period, nominal, times)


def nozzle_fit(columns: Columns, period: float, nominal: Nominal) -> Fit:
    """beta = gain * (nominal actuator's answer to beta_cmd) + bias."""
    rows = max(1, round(NOZZLE_BLOCK / period))
    answer = _actuated(columns["beta_cmd"], period, nominal)
    return regress(block_means(columns["beta"], rows), [block_means(answer, rows)])


def control_fit(columns: Columns, period: float, nominal: Nominal, times: np.ndarray) -> Fit:
    """beta_cmd = gain * C(theta) + gain * C(-theta_ref) + bias, of the delay at which it explains most."""
    if nominal.controller is None:
        return NO_FIT
    rows = max(1, round(NOZZLE_BLOCK / period))
    parts = [_controlled(columns["theta"], period, nominal), -_controlled(columns["theta_ref"], period, nominal)]
    if nominal.test_input is not None:
        parts.append(nominal.test_input.at(times))
    command, best = block_means(columns["beta_cmd"], rows), NO_FIT
    size = np.abs(columns["beta_cmd"])
    free = block_means(1.0 * (size < AT_LIMIT * np.max(size)), rows) == 1.0
    for shift in sorted({round(delay / period) for delay in DELAYS}):
        late = [block_means(np.concatenate((np.full(shift, part[0]), part[:len(part) - shift])), rows)[free]
                for part in parts]
        fit = regress(command[free], late)
        best = fit if fit.explained > best.explained else best
    return best


def _answer(x: np.ndarray, period: float, transfer: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The answer (n,) to x (n,), held at its first value before, of a transfer function of s [1/s]."""
    n = len(x)
    spectrum = np.fft.rfft(x - x[0], 2 * n)
    s = 2.0j * math.pi * np.fft.rfftfreq(2 * n, period)
    return np.asarray(x[0] * transfer(s[:1]).real + np.fft.irfft(spectrum * transfer(s), 2 * n)[:n])


def _actuated(command: np.ndarray, period: float, nominal: Nominal) -> np.ndarray:
    """The nominal actuator's answer; the command itself if it has none."""
    actuator = nominal.actuator
    if actuator is None:
        return command
    w, zeta = actuator.frequency, actuator.damping_ratio
    if actuator.is_first_order:
        return _answer(command, period, lambda s: np.exp(-s * actuator.delay) / (1.0 + s / w))
    return _answer(command, period, lambda s: np.exp(-s * actuator.delay) / (1.0 + 2.0 * zeta * s / w + (s / w)**2))


def _controlled(angle: np.ndarray, period: float, nominal: Nominal) -> np.ndarray:
    """C(angle) = kp angle + kd (its pseudo-derivative)."""
    controller = nominal.controller
    assert controller is not None
    tau = max(controller.derivative_time_constant, period)
    return _answer(angle, period, lambda s: controller.kp + controller.kd * s / (1.0 + tau * s))


# ---- command and nozzle exchanged


def command_follows(columns: Columns, period: float) -> bool:
    """Whether changes of beta_cmd come after those of beta, which no relation without time tells."""
    if not set(PARTS["nozzle"]) <= set(columns):
        return False
    early, late = _unexplained(columns["beta_cmd"], columns["beta"], period)
    return early < 1.0 - LAG_CLEAR and early < FORWARD_SHARE * late


def _moves(x: np.ndarray, rows: int) -> np.ndarray:
    """Mean of the next rows less mean of the last, at every row."""
    total = np.concatenate(([0.0], np.cumsum(x - x.mean())))
    means = (total[rows:] - total[:-rows]) / rows
    return np.asarray(means[rows:] - means[:-rows])


def _unexplained(command: np.ndarray, nozzle: np.ndarray, period: float) -> tuple[float, float]:
    """Shares of the nozzle's changes that the command's do not explain, shifted to later and to earlier or equal."""
    lags = max(2, round(NOZZLE_LAG / period))
    u, b = (_moves(x, max(1, round(LAG_SMOOTH / period))) for x in (command, nozzle))
    n = len(u)
    norm = math.sqrt(square(u) * square(b))
    if n < 4 * lags or norm <= 0.0:
        return 1.0, 1.0
    # between rows too: of a narrow band the rows alone may hit the crest on one side only
    product = np.conj(np.fft.rfft(u, 2 * n)) * np.fft.rfft(b, 2 * n)
    correlation = np.fft.irfft(product, 2 * n * LAG_PARTS) * LAG_PARTS / norm
    reach = lags * LAG_PARTS
    left = 1.0 - np.maximum(correlation, 0.0) ** 2
    return float(np.min(left[-reach:])), float(np.min(left[:reach + 1]))

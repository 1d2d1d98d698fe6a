"""Find faults between columns: units, signs, exchanged columns.

Three relations hold whatever the vehicle does:

    rate        theta = integral of theta_dot (+ bias): see `slope`
    nozzle      beta = the actuator's response to beta_cmd (+ bias), never before it
    controller  beta_cmd = C(theta) - C(theta_ref) (+ bias, + test input), C the nominal's

Each is a regression with free gains over means of short blocks.  Physical effects leave the gains within a factor 2.5
of 1; degrees, signs and exchanged columns do not.  A fault is reported only where the data show it clearly; it is then
repaired on a copy and the next is sought.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim.sections import Nominal

from ..sums import square
from .fault import Fault
from .slope import (
    CLEAR,
    DEGREES,
    NO_FIT,
    RATE_BLOCK,
    SAME_UNIT,
    Columns,
    Fit,
    block_means,
    near,
    rate_fit,
    regress,
)

UNIT_SLACK = 2.2         # a gain of 57.3 or its inverse within this factor: gains of effects are 0.4..2.5
GAIN_SLACK = 2.6         # a gain of +-1 within this factor
NOZZLE_BLOCK = 0.1       # s
CONTROL_BLOCK = 0.05     # s: shorter than the controller's derivative filter
VERY_CLEAR = 0.8         # to tell exchanged columns
MUCH_BETTER = 0.25       # of the unexplained share is left when columns are exchanged back
PARTIAL = 0.5            # share of the rest's variance that one part of the controller must explain
DELAYS = (0.0, 0.02, 0.04, 0.06, 0.1)  # s, of a controller that computes slowly
AT_LIMIT = 0.999         # of the largest command: held by the deflection limit, if in more than
AT_LIMIT_ROWS = 3        # rows
CUT_OFF = 1e-4           # of an impulse response may be cut off
FAST_PART = 10.0          # times as fast, of the servo of second order that stands for one of first
ROW_PARTS = 8            # in which the servo's answer is summed: it is about as fast as the log
NOZZLE_LAG = 0.12       # s: looked for between command and nozzle
LAG_SMOOTH = 0.03        # s: about the servo's own time, over which changes are taken
LAG_PARTS = 4            # of a row: steps of the lag
FORWARD_SHARE = 0.85     # of what lags >= 0 leave unexplained is left at negative ones: 0.4..0.7 if exchanged, else 1
LAG_CLEAR = 0.2          # share of the nozzle's changes explained at the best lag
ROUGHER = 3.0            # times: the measured attitude against a reference
FAR_OUT = 0.6            # rad: an attitude reference of small-angle flight does not reach it
FAULTS_AT_MOST = 4
RELATED_COLUMNS = ("theta", "theta_dot", "beta", "beta_cmd", "theta_ref", "alpha")
RELATION_WORDS = {"swapped": "{} look exchanged over the whole log: {}; exchange the two column names",
                  "unit": "{} looks like degrees over the whole log: {}; multiply it by pi/180",
                  "sign": "{} has the opposite sign over the whole log: {}; multiply it by -1"}


@dataclass(frozen=True)
class Change:
    """One repair: multiply `channels` by `factor`, or, of kind `swapped`, exchange the two; `reason` in words."""

    kind: str
    channels: tuple[str, ...]
    factor: float
    reason: str

    def repaired(self, columns: Columns) -> Columns:
        if self.kind == "swapped":
            first, second = self.channels
            return columns | {first: columns[second], second: columns[first]}
        return columns | {name: columns[name] * self.factor for name in self.channels}


def relation_faults(columns: Columns, period: float, nominal: Nominal,
                    times: np.ndarray) -> Iterator[tuple[Change, Fault]]:
    """Yield (its repair, the Fault) for each fault between columns, sought after those before are repaired on a copy.

    columns  name -> (n,), measured, on uniform `times` (n,) [s], which are `period` [s] apart
    """
    for _ in range(FAULTS_AT_MOST):
        change = _first(columns, period, nominal, times)
        if change is None:
            return
        yield change, _fault(change, times)
        columns = change.repaired(columns)


def _fault(change: Change, times: np.ndarray) -> Fault:
    text = RELATION_WORDS[change.kind].format(" and ".join(change.channels), change.reason)
    channel = change.channels[0] if len(change.channels) == 1 else None
    return Fault(change.kind, channel, float(times[0]), float(times[-1]), len(times), text)


def _first(columns: Columns, period: float, nominal: Nominal, times: np.ndarray) -> Change | None:
    """Return the repair of the clearest fault between these columns; None if there is none."""
    rate = rate_fit(columns, "theta", "theta_dot", period)
    nozzle = nozzle_fit(columns, "beta_cmd", "beta", period, nominal)
    control = control_fit(columns, "theta", "theta_ref", period, nominal, times)
    return (_exchanged(columns, period, nominal, rate, nozzle, control) or _in_degrees(rate, nozzle, control)
            or _far_out(columns, nominal) or _reversed(rate, nozzle, control) or _other_alpha(columns, period))


# ---- the relations


def nozzle_fit(columns: Columns, command: str, nozzle: str, period: float, nominal: Nominal) -> Fit:
    """Fit `nozzle` = gain * (nominal actuator's response to `command`) + bias; NO_FIT if a column is missing."""
    if command not in columns or nozzle not in columns:
        return NO_FIT
    answer = actuated(columns[command], period, nominal)
    rows = max(1, round(NOZZLE_BLOCK / period))
    return regress(block_means(columns[nozzle], rows), [block_means(answer, rows)])


def control_fit(columns: Columns, angle: str, reference: str, period: float, nominal: Nominal,
                times: np.ndarray) -> Fit:
    """Fit beta_cmd = g1 C(angle) - g2 C(reference) + bias off its limit, at the best delay; C: nominal controller."""
    controller = nominal.controller
    if controller is None or not {"beta_cmd", angle, reference} <= set(columns):
        return NO_FIT
    command = columns["beta_cmd"]
    size = np.abs(command)
    limited = size >= AT_LIMIT * np.max(size)
    free = ~limited if np.count_nonzero(limited) > AT_LIMIT_ROWS else np.ones(len(size), bool)
    rows = max(1, round(CONTROL_BLOCK / period))
    whole = block_means(free.astype(float), rows) == 1.0
    parts = [_controlled(columns[angle], period, nominal), -_controlled(columns[reference], period, nominal)]
    if nominal.test_input is not None:
        parts.append(nominal.test_input.at(times))
    best = NO_FIT
    for delay in DELAYS:
        shift = round(delay / period)
        late = [block_means(np.concatenate((np.full(shift, part[0]), part[:len(part) - shift])), rows)[whole]
                for part in parts]
        fit = regress(block_means(command, rows)[whole], late)
        best = fit if fit.explained > best.explained else best
    return best


def filtered(x: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Return x (n,) through an impulse response (m,), as if x had its first value ever before."""
    m = len(response)
    padded = np.concatenate((np.full(m - 1, x[0]), x))
    size = quick_size(2 * len(padded))
    return np.asarray(np.fft.irfft(np.fft.rfft(padded, size) * np.fft.rfft(response, size), size)
                      [m - 1:m - 1 + len(x)])


def quick_size(rows: int) -> int:
    """Return a length of at least `rows` at which a Fourier transform is quick: the next power of two."""
    return int(1 << (rows - 1).bit_length())


def actuated(command: np.ndarray, period: float, nominal: Nominal) -> np.ndarray:
    """Return the nominal actuator's response (n,) to a command (n,); the command if it has none, or no damping."""
    actuator = nominal.actuator
    if actuator is None or not (actuator.is_first_order or actuator.damping_ratio > 0.0):
        return command
    w, zeta = actuator.frequency, actuator.damping_ratio
    if actuator.is_first_order:  # as an overdamped one, whose fast part is done within a tenth of it
        w, zeta = w * math.sqrt(FAST_PART), 0.5 * (1.0 + FAST_PART) / math.sqrt(FAST_PART)
    slowest = w * (zeta - math.sqrt(zeta * zeta - 1.0) if zeta > 1.0 else zeta)
    count = min(len(command), math.ceil((-math.log(CUT_OFF) / slowest + actuator.delay) / period) + 1)
    t = (np.arange(count * ROW_PARTS) + 0.5) * period / ROW_PARTS - actuator.delay
    root = w * np.sqrt(complex(zeta * zeta - 1.0))
    slow, fast = zeta * w - root, zeta * w + root
    after = np.maximum(t, 0.0)
    shape = after * np.exp(-slow * after) if root == 0.0 else (np.exp(-slow * after) - np.exp(-fast * after)) / root
    response = shape.real.reshape(count, ROW_PARTS).sum(axis=1)
    total = response.sum()
    return filtered(command, response / total) if total > 0.0 else command


def answered(command: np.ndarray, period: float, nominal: Nominal) -> np.ndarray:
    """Return what the nozzle does (n,) [rad] under a logged command that acts one row later than it is logged, as
    `actuated`."""
    answer = actuated(command, period, nominal)
    return np.concatenate([answer[:1], answer[:-1]])


def _controlled(angle: np.ndarray, period: float, nominal: Nominal) -> np.ndarray:
    """Return the nominal controller's kp angle + kd (filtered derivative of angle), (n,)."""
    controller = nominal.controller
    assert controller is not None
    tau = controller.derivative_time_constant
    change = np.diff(angle, prepend=angle[0])
    if tau <= 0.0:
        derivative = change / period
    else:
        count = min(len(angle), math.ceil(-math.log(CUT_OFF) * (tau + period) / period) + 1)
        derivative = filtered(change, (tau / (tau + period)) ** np.arange(count)) / (tau + period)
    return np.asarray(controller.kp * angle + controller.kd * derivative)


# ---- exchanged columns


def _better(found: Fit, now: Fit) -> bool:
    """Whether `found`, with columns exchanged, holds clearly and leaves far less than `now`, as they are."""
    return (near(found.gain[0], 1.0, GAIN_SLACK) and found.explained > VERY_CLEAR
            and 1.0 - found.explained < MUCH_BETTER * (1.0 - now.explained))


def _exchanged(columns: Columns, period: float, nominal: Nominal, rate: Fit, nozzle: Fit,
               control: Fit) -> Change | None:
    """Return the repair of two columns that stand under each other's names; None if there are none."""
    known = "theta_dot" in columns
    if known and _better(rate_fit(columns, "theta_dot", "theta", period), rate):
        return Change("swapped", ("theta", "theta_dot"), 1.0, "theta is the slope of theta_dot")
    as_angle = rate_fit(columns, "beta", "theta_dot", period) if known else NO_FIT
    as_nozzle = nozzle_fit(columns, "beta_cmd", "theta", period, nominal)
    if _better(as_angle, rate) and (as_nozzle is NO_FIT or as_nozzle.explained > nozzle.explained):
        return Change("swapped", ("theta", "beta"), 1.0, "theta_dot is the slope of beta")
    as_rate = rate_fit(columns, "theta", "beta", period)
    as_nozzle = nozzle_fit(columns, "beta_cmd", "theta_dot", period, nominal)
    if known and _better(as_rate, rate) and (as_nozzle is NO_FIT or as_nozzle.explained > nozzle.explained):
        return Change("swapped", ("theta_dot", "beta"), 1.0, "beta is the slope of theta")
    if _reference_is_attitude(columns, period, rate, nozzle, control):
        return Change("swapped", ("theta", "theta_ref"), 1.0, "theta_ref moves as the measured attitude does")
    if _command_follows(columns, period, nozzle):
        return Change("swapped", ("beta", "beta_cmd"), 1.0, "beta_cmd follows beta, which no actuator does")
    return None


def _reference_is_attitude(columns: Columns, period: float, rate: Fit, nozzle: Fit, control: Fit) -> bool:
    """Whether theta_ref is the measured attitude: theta_dot is its slope or it is rougher, and control gains are -1."""
    if "theta_ref" not in columns or "theta" not in columns:
        return False
    reversed_ = control.explained > VERY_CLEAR and all(near(gain, -1.0, GAIN_SLACK) for gain in control.gain[:2])
    roughness = [float(np.mean(np.abs(np.diff(columns[name], 2)))) for name in ("theta_ref", "theta")]
    rougher = roughness[0] > ROUGHER * roughness[1]
    as_angle = rate_fit(columns, "theta_ref", "theta_dot", period)
    if control is NO_FIT:
        return rougher and _better(as_angle, rate)
    moves = rougher if as_angle is NO_FIT else as_angle.explained > rate.explained
    return reversed_ and moves and nozzle.explained > CLEAR and near(nozzle.gain[0], 1.0, GAIN_SLACK)


def _command_follows(columns: Columns, period: float, nozzle: Fit) -> bool:
    """Whether changes of beta_cmd come after those of beta, which no actuator does."""
    if "beta_cmd" not in columns or not near(nozzle.gain[0], 1.0, UNIT_SLACK * DEGREES):
        return False
    early, late = _unexplained(columns["beta_cmd"], columns["beta"], period)
    return early < 1.0 - LAG_CLEAR and early < FORWARD_SHARE * late


def _changes(x: np.ndarray, rows: int) -> np.ndarray:
    """Return mean of the next `rows` rows of x (n,) less mean of the last ones, (n + 1 - 2 rows,), at each row."""
    total = np.concatenate(([0.0], np.cumsum(x - x.mean())))
    means = (total[rows:] - total[:-rows]) / rows
    return np.asarray(means[rows:] - means[:-rows])


def _unexplained(command: np.ndarray, nozzle: np.ndarray, period: float) -> tuple[float, float]:
    """Return the least unexplained shares of the nozzle's changes (if it leads the command, if it follows it)."""
    lags = max(2, round(NOZZLE_LAG / period))
    u, b = (_changes(x, max(1, round(LAG_SMOOTH / period))) for x in (command, nozzle))
    n = len(u)
    norm = math.sqrt(square(u) * square(b))
    if n < 4 * lags or norm <= 0.0:
        return 1.0, 1.0
    # between rows too: of a narrow band the rows alone may hit the crest on one side only
    size = quick_size(2 * n)
    product = np.conj(np.fft.rfft(u, size)) * np.fft.rfft(b, size)
    correlation = np.fft.irfft(product, size * LAG_PARTS) * LAG_PARTS / norm
    reach = lags * LAG_PARTS
    left = 1.0 - np.maximum(correlation, 0.0) ** 2
    return float(np.min(left[-reach:])), float(np.min(left[:reach + 1]))


# ---- units and signs


def _in_degrees(rate: Fit, nozzle: Fit, control: Fit) -> Change | None:
    """Return the repair of one angle in degrees among radians; None if there is none."""
    back = 1.0 / DEGREES

    def seen(gain: float) -> str:
        return f"{max(abs(gain), 1.0 / abs(gain)):.1f} times"

    if rate.explained > CLEAR and near(abs(rate.gain[0]), back, SAME_UNIT):
        return Change("unit", ("theta_dot",), back, f"it is {seen(rate.gain[0])} the slope of theta")
    if rate.explained > CLEAR and near(abs(rate.gain[0]), DEGREES, SAME_UNIT):
        return Change("unit", ("theta",), back, f"its slope is {seen(rate.gain[0])} theta_dot")
    if nozzle.explained > CLEAR and near(abs(nozzle.gain[0]), DEGREES, UNIT_SLACK):
        return Change("unit", ("beta",), back, f"it is {seen(nozzle.gain[0])} beta_cmd")
    if nozzle.explained > CLEAR and near(abs(nozzle.gain[0]), back, UNIT_SLACK):
        return Change("unit", ("beta_cmd",), back, f"it is {seen(nozzle.gain[0])} beta")
    if control.explained > VERY_CLEAR:
        for k, name in enumerate(("theta", "theta_ref")):
            if control.partial[k] > PARTIAL and near(abs(control.gain[k]), back, UNIT_SLACK):
                return Change("unit", (name,), back, f"it is {seen(control.gain[k])} what beta_cmd answers")
    return None


def _other_alpha(columns: Columns, period: float) -> Change | None:
    """Return the repair of an alpha in degrees or of wrong sign, or None: gamma is slow, fast alpha is like theta."""
    if not {"theta", "alpha"} <= set(columns):
        return None
    rows = max(2, round(RATE_BLOCK / period))
    fit = regress(np.diff(block_means(columns["alpha"], rows)), [np.diff(block_means(columns["theta"], rows))])
    gain = fit.gain[0]
    if not fit.explained > CLEAR:
        return None
    sign = " with the opposite sign" if gain < 0.0 else ""
    for factor, said in ((DEGREES, "57.3 times"), (1.0 / DEGREES, "1/57.3 of")):
        if near(abs(gain), factor, UNIT_SLACK):
            return Change("unit", ("alpha",), 1.0 / gain, f"it moves by {said} theta{sign}")
    return Change("sign", ("alpha",), -1.0, "it moves against theta") if near(gain, -1.0, GAIN_SLACK) else None


def _far_out(columns: Columns, nominal: Nominal) -> Change | None:
    """Return the repair of a theta_ref in degrees, or None: it is far beyond the nominal's guidance, and theta does not
    follow it as it is."""
    reference = columns.get("theta_ref")
    if reference is None or nominal.guidance is None:
        return None
    largest, known = float(np.max(np.abs(reference))), max(map(abs, nominal.guidance.theta_ref))
    if not (largest > FAR_OUT and known > 0.0 and near(largest / known, DEGREES, UNIT_SLACK)):
        return None
    follows = regress(columns["theta"], [reference]) if "theta" in columns else NO_FIT
    if follows.explained > VERY_CLEAR and near(follows.gain[0], 1.0, UNIT_SLACK):
        return None  # both are
    return Change("unit", ("theta_ref",), 1.0 / DEGREES, f"it reaches {largest:.3g}, the guidance {known:.3g} rad")


def _reversed(rate: Fit, nozzle: Fit, control: Fit) -> Change | None:
    """Return the repair of one column with the opposite sign; None if there is none."""
    clear = control.explained > VERY_CLEAR
    attitude, reference = (
        (1 if near(control.gain[k], 1.0, GAIN_SLACK) else -1 if near(control.gain[k], -1.0, GAIN_SLACK) else 0)
        if clear and control.partial[k] > PARTIAL else 0 for k in (0, 1))
    if rate.explained > CLEAR and near(rate.gain[0], -1.0, GAIN_SLACK):
        name = "theta" if attitude < 0 < reference else "theta_dot"
        return Change("sign", (name,), -1.0, "theta_dot is minus the slope of theta")
    if nozzle.explained > CLEAR and near(nozzle.gain[0], -1.0, GAIN_SLACK):
        name = "beta_cmd" if attitude < 0 and reference <= 0 else "beta"
        return Change("sign", (name,), -1.0, "beta moves against beta_cmd")
    if attitude > 0 > reference:
        return Change("sign", ("theta_ref",), -1.0, "the controller's command moves with it, not against it")
    return None

"""Replay the nominal's controller over a log's own columns: would it have issued the commands that the log holds?

The log holds what the controller saw, theta (law `attitude`), theta_dot (law `rate`) or both (law `gyro`) and their
references, so each command can be computed again, by the simulator's own law.  The controller's state when the log
begins, or after missing rows, is not known.  Without filters it is one number, the pseudo-derivative or the integral,
and the first logged command gives it; with filters the replay waits until they have faded, and an integral behind them
is what the commands then are off by.  A filter that follows a mode is replayed with the estimator over the log's rows;
where that is not yet where the one on board was, in a log that begins in flight, the commands tell (`followed`).

The rows must be at the controller's periods, one or several a period; a slower log lacks errors.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.flight import excitation, sections
from sim.following import Followed
from sim.kernels import kernel
from sim.nominal import Controller, Nominal
from sim.plant import packed
from sim.sections import LAWS
from sim.vehicle.controller import GYRO_LAW, RATE_LAW, filtered, limited, pseudo_derivative

from ..log.log import Log
from ..series import filled
from ..sums import combined, least_squares, products, square
from .followed import told_by_commands

MEMORY_LEFT = 1e-5    # of what the controller remembered: less is nothing
MIN_COMMANDS = 20     # commands, without which nothing is said
MOST_COMPUTING_PERIODS = 6  # periods of computing time that are tried
OFF_GRID = 0.25  # of a row's distance, by which a stamp may be off the controller's periods
ON_GRID = 0.99   # of the stamps that must be no further off
MOST_PERIODS_A_ROW = 100  # times the rows: a log of more periods has a stamp that is none
SAME_GAIN = 2e-3      # relative, of a gain; of a period, of a delay: closer is the same
MISFIT_LEFT = 0.5     # of a misfit: what other gains leave less of is no noise, however small it is
MOST_SECTIONS = 25    # golden, of a period
NEAR_LIMIT = 0.999    # of the deflection limit: beyond it a command tells nothing of gains
MOST_DECIMALS = 9     # of a column that was rounded
NO_COMMANDS = np.zeros(0)
NO_FILTERS = np.zeros((0, 0, 5))
# constants of `run_controller`: kp, kd [s], derivative time constant [s], period [s], limit [rad], ki, the law's number
KP, KD, LAW_TIME_CONSTANT, LAW_PERIOD, LIMIT, KI, LAW_NUMBER = range(7)


@kernel
def run_controller(constants, filters, tuned, error, rates, excitation, logged, integrals, computed, answers):
    """Run the controller over errors, one a period; after an error that is not known it begins anew.

    constants (7,)           in     of the law, KP to LAW_NUMBER
    filters (s,) SECTION     inout  of the controller
    tuned (ticks, s, 5)      in     b0, b1, b2, a1, a2 of each filter at each period; (0, ., 5): they do not change
    error (ticks,)           in     [rad] or [rad/s], NaN where not known
    rates (ticks,)           in     [rad/s] the gyro's errors of law `gyro`; (0,): another law
    excitation (ticks,)      in     [rad] test input
    logged (ticks,)          in     [rad] commands that give its state where it begins; (0,): it begins at 0
    integrals (ticks,)       in     [rad] where it begins, what the integral of law `rate` then is; (0,): 0
    computed (ticks,)        out    [rad] commands, before the computing time, NaN where it has no error
    answers (ticks,) int64   out    periods since it began, -1 where it has not
    """
    kp, kd = constants[KP], constants[KD]
    tau, period, limit = constants[LAW_TIME_CONSTANT], constants[LAW_PERIOD], constants[LIMIT]
    ki, is_rate, is_gyro = constants[KI], constants[LAW_NUMBER] == RATE_LAW, constants[LAW_NUMBER] == GYRO_LAW
    memory = ki if is_rate else kd   # what it remembers acts by this gain
    is_told = logged.shape[0] > 0 and filters.shape[0] == 0 and memory != 0.0 and not is_gyro
    since, before, remembered = -1, 0.0, 0.0
    for k in range(error.shape[0]):
        computed[k], answers[k] = math.nan, -1
        if math.isnan(error[k]) or (is_gyro and math.isnan(rates[k])):
            since = -1
            continue
        begins = since < 0
        if begins:
            before, remembered = error[k], integrals[k] if integrals.shape[0] > 0 else 0.0
            for section in filters:
                section.first, section.second = 0.0, 0.0
        held = remembered
        if is_rate:
            remembered += period * error[k]
        elif is_gyro:
            remembered = rates[k]
        else:
            remembered = pseudo_derivative(tau, period, error[k], before, remembered)
        before = error[k]
        since += 1
        if begins and is_told:
            if not abs(logged[k]) < NEAR_LIMIT * limit:
                since = -1
                continue
            remembered = (logged[k] - excitation[k] - kp * error[k]) / memory
        command = kp * error[k] + memory * remembered
        if tuned.shape[0] > 0:
            for j in range(filters.shape[0]):
                own = filters[j]
                own.b0, own.b1, own.b2 = tuned[k, j, 0], tuned[k, j, 1], tuned[k, j, 2]
                own.a1, own.a2 = tuned[k, j, 3], tuned[k, j, 4]
        command = filtered(filters, command) + excitation[k]
        computed[k], answers[k] = limited(limit, command), since
        if is_rate and computed[k] != command:
            remembered = held


def constants_of(nominal: Nominal) -> np.ndarray:
    """Return the constants (7,) of `run_controller` (KP to LAW_NUMBER), gains scaled by the nominal's effects."""
    c, on_board = nominal.controller, packed(nominal)
    assert c is not None
    limit = nominal.actuator.deflection_limit if nominal.actuator is not None else math.inf
    return np.array([on_board.kp_scale * c.kp, on_board.kd_scale * c.kd, c.derivative_time_constant, c.period, limit,
                     c.ki, float(LAWS.index(c.law))])


def later(x: np.ndarray, lag: float) -> np.ndarray:
    """Return commands x (periods,) delayed by `lag` periods of computing time, 0 before the first; a fractional lag
    gives the mean over a period, as in the effect (`sim.effects.controller`)."""
    whole, part = int(lag), lag - int(lag)
    shifted = [x if by == 0 else np.concatenate([np.zeros(min(by, len(x))), x[:-by]]) for by in (whole, whole + 1)]
    return shifted[0] if part == 0.0 else (1.0 - part) * shifted[0] + part * shifted[1]


@dataclass(frozen=True, eq=False)
class Explanation:
    """Gains and computing time that explain logged commands best.

    gains, std     (2,) kp and kd [s], of the law `rate` kp and ki; (3,) standard deviations, of the delay too, if the
                   rest is white
    delay          [s] of computing time beyond the nominal's
    before, after  [rad] rms of logged less computed command, with the nominal's gains and with these
    """

    gains: np.ndarray
    std: np.ndarray
    delay: float
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Replay:
    """The nominal's controller over a log; arrays (ticks,), one entry a period of the controller.

    t           [s];  error [rad] or [rad/s] as the controller saw it;  excitation [rad] of the test input
    logged      [rad] commands;  computed: [rad] commands of the nominal's controller
    misfit      [rad] logged less computed or, if larger, the spread of the commands in a period's rows; NaN where one
                is missing, or both are at the limit
    tolerance   [rad] rms misfit that is still agreement: [diagnosis] command, and the rounding of the columns
    rates       [rad/s] the gyro's error of law `gyro`, else (0,);  tuned  as `run_controller`'s
    """

    nominal: Nominal
    t: np.ndarray
    error: np.ndarray
    excitation: np.ndarray
    logged: np.ndarray
    computed: np.ndarray
    misfit: np.ndarray
    tolerance: float
    rates: np.ndarray = field(default_factory=lambda: NO_COMMANDS)
    tuned: np.ndarray = field(default_factory=lambda: NO_FILTERS)

    def judged(self, t_start: float, t_end: float) -> np.ndarray:
        """Return (ticks,) bool: those from t_start to t_end [s] whose misfit is known."""
        return np.isfinite(self.misfit) & (self.t >= t_start) & (self.t < t_end)

    def contradicts(self, ticks: np.ndarray) -> bool:
        """Whether the commands of these ticks (ticks,) bool are another controller's: their rms misfit is above the
        tolerance, or other gains explain it."""
        off = rms(self.misfit[ticks])
        if off > self.tolerance:
            return True
        found = self.explained(ticks, lags=(0.0,))
        own = constants_of(self.nominal)[_gains_at(self.nominal)]
        return bool(found.after < MISFIT_LEFT * off and np.any(np.abs(found.gains - own) > SAME_GAIN * np.abs(own)))

    def explained(self, ticks: np.ndarray, lags: Sequence[float] | None = None) -> Explanation:
        """Return the gains and computing time that explain the commands of these ticks (ticks,) bool best: a command is
        linear in the gains.

        lags: [periods] of computing time that are tried; None: whole ones up to MOST_COMPUTING_PERIODS, then fractions.
        The controller's state where a stretch of known errors begins (of the law `rate`: of commands below the limit,
        which holds the integral) fades at the controller's own rate, and is fitted and removed.
        """
        constants, rows = constants_of(self.nominal), np.arange(len(self.error))
        is_rate, gains_at = constants[LAW_NUMBER] == RATE_LAW, _gains_at(self.nominal)
        early, before = packed(self.nominal).computing_time / constants[LAW_PERIOD], rms(self.misfit[ticks])
        known = np.isfinite(self.error)
        if len(self.rates) > 0:
            known = known & np.isfinite(self.rates)
        error, rates = (filled(x, known=known) if len(x) > 0 else x for x in (self.error, self.rates))
        parts = []
        for gain in gains_at:
            alone = constants.copy()
            alone[[*gains_at, LIMIT]] = 0.0, 0.0, math.inf
            alone[gain] = 1.0
            parts.append(issued(self.nominal, alone, error, np.zeros(len(rows)), is_late=False, rates=rates,
                                tuned=self.tuned)[0])
        unlimited = np.isfinite(self.logged) & (np.abs(self.logged) < NEAR_LIMIT * constants[LIMIT])
        breaks = ~(known & unlimited) if is_rate else ~known
        since = rows - np.maximum.accumulate(np.where(breaks, rows, -1))
        free = ticks & unlimited & (since > math.ceil(early) + MOST_COMPUTING_PERIODS + 1)
        if np.count_nonzero(free) < MIN_COMMANDS:
            return Explanation(np.full(2, math.nan), np.full(3, math.nan), 0.0, before, before)
        _, first, stretch = np.unique(np.cumsum(breaks)[free], return_index=True, return_inverse=True)
        fades = 1.0 if is_rate else constants[LAW_TIME_CONSTANT] / (constants[LAW_TIME_CONSTANT]
                                                                    + constants[LAW_PERIOD])
        memory = np.power(fades, since[free] - since[free][first][stretch])
        if not is_rate and (len(self.rates) > 0 or len(sections(self.nominal)) > 0):
            memory = np.zeros_like(memory)   # there is none, or what filters remember is waited for
        size = np.maximum(np.bincount(stretch, memory**2), 1e-300)

        def fit(lag: float) -> tuple[float, np.ndarray, np.ndarray]:
            total = [*(later(x, early + lag) for x in parts), self.logged - later(self.excitation, early + lag)]
            columns = np.column_stack([x[free] - memory * (np.bincount(stretch, memory * x[free]) / size)[stretch]
                                       for x in total])
            design, wanted = columns[:, :2], columns[:, 2]
            x = least_squares(design, wanted)
            after = rms(wanted - combined(design, x))
            std = after * np.sqrt(np.maximum(np.diag(np.linalg.pinv(products(design, design))), 0.0))
            return after, x, np.maximum(std, len(wanted) * np.finfo(float).eps * np.abs(x))   # of sums (Higham 2002)

        lag = min(range(MOST_COMPUTING_PERIODS + 1) if lags is None else lags, key=lambda each: fit(each)[0])
        after, x, std = fit(lag)
        is_between = lags is None and after > self.tolerance
        for low, high in ((lag, lag + 1.0), (max(lag - 1.0, 0.0), lag)) if is_between else ():
            between = lowest(lambda each: fit(each)[0], low, high, MOST_SECTIONS)
            if fit(between)[0] < MISFIT_LEFT * after:
                lag, (after, x, std) = between, fit(between)
        moves = np.gradient(x[0] * later(parts[0], early + lag) + x[1] * later(parts[1], early + lag))[free]
        late = after / max(math.sqrt(square(moves)), 1e-12) * constants[LAW_PERIOD]
        return Explanation(x[:2], np.append(std[:2], late), lag * constants[LAW_PERIOD], before, after)

    def words(self, found: Explanation) -> str:
        """Return one sentence: which gains and delay would explain the commands, or that none do."""
        constants = constants_of(self.nominal)
        names = ("kp", "ki") if constants[LAW_NUMBER] == RATE_LAW else ("kp", "kd")
        late = found.delay / constants[LAW_PERIOD]
        said = ", ".join(f"{name} {gain:.4g}" for name, gain in zip(names, found.gains, strict=True))
        said += f", {late:.3g} periods of delay" if late else ""
        if found.after < 0.1 * found.before:
            return f"{said} would explain them (rms {found.after:.2g} rad left)"
        return f"no gains and delay explain them (best: {said}, rms {found.after:.2g} rad left)"


def lowest(cost: Callable[[float], float], low: float, high: float, steps: int) -> float:
    """Return x at which a cost with one minimum between low and high is least, by `steps` of a golden section."""
    for _ in range(steps):
        left, right = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, right) if cost(left) < cost(right) else (left, high)
    return 0.5 * (low + high)


def rms(x: np.ndarray) -> float:
    """Return the root mean square of x (n,); 0 if n is 0."""
    return float(np.sqrt(np.mean(x**2))) if len(x) else 0.0


def _gains_at(nominal: Nominal) -> list[int]:
    """Return the indices of the law's two gains among its constants."""
    return [KP, KI] if nominal.controller is not None and nominal.controller.is_rate_law else [KP, KD]


def issued(nominal: Nominal, constants: np.ndarray, error: np.ndarray, test: np.ndarray,
           logged: np.ndarray = NO_COMMANDS, is_late: bool = True, rates: np.ndarray = NO_COMMANDS,
           tuned: np.ndarray = NO_FILTERS, integrals: np.ndarray = NO_COMMANDS,
           filters: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return (commands (ticks,) [rad], periods (ticks,) since the controller began) of `run_controller`; is_late:
    commands delayed by the computing time of the nominal's effects; filters: in place of the nominal's."""
    computed, answers = np.empty(len(error)), np.empty(len(error), np.int64)
    run_controller(constants, sections(nominal) if filters is None else filters, tuned, error, rates, test, logged,
                   integrals, computed, answers)
    return later(computed, packed(nominal).computing_time / constants[LAW_PERIOD]) if is_late else computed, answers


def _wait(nominal: Nominal) -> int:
    """Return the periods until the controller's state has faded to MEMORY_LEFT; 2**31 if it never does."""
    c = nominal.controller
    assert c is not None
    poles = [0.0] if c.law != "attitude" else [c.derivative_time_constant / (c.derivative_time_constant + c.period)]
    slowest = max(*poles, *(float(np.max(np.abs(np.roots(section.a)))) for section in c.filters), MEMORY_LEFT)
    return math.ceil(math.log(MEMORY_LEFT) / math.log(slowest)) if slowest < 1.0 else 2**31


def _integrals(own: Controller, off: np.ndarray, answers: np.ndarray, wait: int) -> np.ndarray:
    """Return (ticks,) what the integral of law `rate` was where each stretch of errors begins: what the first commands
    are off by, (ticks,) [rad], once the filters have faded."""
    passed = math.prod(sum(each.b) / sum(each.a) for each in own.filters)
    integrals, begins = np.zeros(len(off)), np.flatnonzero(answers == 0)
    for first, last in zip(begins, [*begins[1:], len(off)], strict=True):
        told = off[first + wait:last]
        told = told[np.isfinite(told)][:MIN_COMMANDS]
        if len(told) > 0:
            integrals[first] = float(np.median(told)) / (own.ki * passed)
    return integrals


def resolution(x: np.ndarray) -> float:
    """Return the power of ten (up to 0.1) that all values of a column are multiples of, as rounding leaves them; 0 if
    there is none, or values are few."""
    x = np.unique(x[np.isfinite(x)])
    for decimals in range(1, MOST_DECIMALS + 1) if len(x) > MIN_COMMANDS else ():
        if np.all(np.abs(x * 10.0**decimals - np.rint(x * 10.0**decimals)) < 1e-4):
            return float(10.0**-decimals)
    return 0.0


def replay(log: Log, nominal: Nominal) -> Replay | str:
    """Replay the nominal's controller over a log; return one sentence instead if it cannot be replayed."""
    own = nominal.controller
    if own is None:
        return "the nominal has no [controller]"
    names = ("beta_cmd", *(name for pair in own.reads for name in pair))
    lacking = [name for name in names if not np.isfinite(getattr(log, name)).any()]
    if lacking:
        return f"the log has no {' and no '.join(lacking)}"
    held = max(1, round(own.period / log.period))
    if log.period > 1.5 * own.period:
        return f"the log's rows are {log.period:g} s apart, the controller's commands {own.period:g} s"
    step = own.period / held
    t_first = float(log.t[np.isfinite(log.t)][0])
    at = (log.t - t_first) / step
    on = (np.abs(at - np.rint(at)) < OFF_GRID) & (at > -OFF_GRID) & (at < MOST_PERIODS_A_ROW * len(at))
    if on.mean() < ON_GRID:
        return f"the log's rows are not at the controller's periods of {own.period:g} s"
    index = np.rint(at[on]).astype(np.int64)
    count = (int(index.max()) // held + 2) * held
    grid = {name: np.full(count, math.nan) for name in names}
    for name, column in grid.items():
        column[index] = getattr(log, name)[on]
    follows = Followed(nominal, log.samples(), log.period) if own.followed else None
    logged, seen, reference, *gyro = grid.values()
    rate, rate_reference = gyro or (NO_COMMANDS, NO_COMMANDS)
    return replayed(nominal, t_first, step, held, logged, seen, reference, rate, rate_reference, follows)


def replayed(nominal: Nominal, t_first: float, step: float, held: int, logged: np.ndarray, seen: np.ndarray,
             reference: np.ndarray, rate: np.ndarray = NO_COMMANDS, rate_reference: np.ndarray = NO_COMMANDS,
             follows: Followed | None = None) -> Replay | str:
    """Replay as `replay`, over columns (rows,) on a grid of rows a `step` [s] apart from t_first [s] on, `held` of them
    a period: logged [rad] commands, `seen` by the controller, its `reference`, of law `gyro` also the rate and its
    reference; NaN where not known.  follows: the filters over time where they follow a mode."""
    own, sensors, constants = nominal.controller, nominal.sensors, constants_of(nominal)
    assert own is not None
    is_waiting = len(own.filters) > 0 or packed(nominal).computing_time > 0.0
    wait = _wait(nominal) if is_waiting else 1 if constants[_gains_at(nominal)[1]] else 0
    impulse = constants.copy()
    impulse[LIMIT] = math.inf
    answer = issued(nominal, impulse, np.eye(1, 200)[0], np.zeros(200), rates=np.zeros(200))[0]
    declared = sensors.theta_dot_step if own.is_rate_law else sensors.theta_step
    steps = (max(declared, resolution(seen)), resolution(reference))
    tolerance = math.sqrt(nominal.diagnosis.command**2 + resolution(logged)**2 / 12.0
                          + math.fsum(each**2 for each in steps) / 12.0 * math.fsum(answer**2))

    def begun(phase: int) -> Replay:
        """Return the replay of a controller whose periods begin with row `phase` of each `held` rows."""
        rows, z, wanted, *gyro = (
            np.append(column, np.full(held, math.nan))[phase:len(column) // held * held + phase].reshape(-1, held)
            for column in (logged, seen, reference, rate, rate_reference) if len(column) > 0)
        rates = gyro[0][:, 0] - gyro[1][:, 0] if gyro else NO_COMMANDS
        error, first = z[:, 0] - wanted[:, 0], t_first + phase * step
        tick = max(round(first / own.period), 0)
        test = excitation(nominal, tick + len(error), own.period)[tick:]
        known = np.isfinite(rows)
        sent = np.where(known.any(axis=1), rows[np.arange(len(rows)), np.argmax(known, axis=1)], math.nan)
        moved = np.max(np.where(known, np.abs(rows - sent[:, None]), 0.0), axis=1)
        t = first + own.period * np.arange(len(error))
        tuned = NO_FILTERS if follows is None else follows.at(t)

        def free(computed: np.ndarray) -> np.ndarray:
            return np.minimum(np.abs(sent), np.abs(computed)) < NEAR_LIMIT * constants[LIMIT]

        def judged_misfit(computed: np.ndarray, answers: np.ndarray) -> np.ndarray:
            off = sent - computed
            return np.where((answers >= wait) & free(computed), np.where(moved > np.abs(off), moved, off), math.nan)

        computed, answers = issued(nominal, constants, error, test, NO_COMMANDS if is_waiting else sent, rates=rates,
                                   tuned=tuned)
        if is_waiting and own.ki != 0.0:
            integrals = _integrals(own, np.where(free(computed), sent - computed, math.nan), answers, wait)
            computed, answers = issued(nominal, constants, error, test, integrals=integrals)
        off = judged_misfit(computed, answers)
        if follows is not None and not packed(nominal).computing_time and np.any(np.abs(off) > tolerance):
            law = issued(nominal, impulse, error, np.zeros(len(error)), rates=rates, filters=sections(nominal)[:0])[0]
            tuned = told_by_commands(own, law, np.where(free(sent), sent - test, math.nan), tuned, tolerance)
            computed, answers = issued(nominal, constants, error, test, rates=rates, tuned=tuned)
            off = judged_misfit(computed, answers)
        return Replay(nominal, t, error, test, sent, computed, off, tolerance, rates, tuned)

    tried = [each for each in map(begun, range(held)) if np.count_nonzero(np.isfinite(each.misfit)) >= MIN_COMMANDS]
    if not tried:
        return "too few commands follow: of gaps, or of filters that remember longer than the log"
    return min(tried, key=lambda each: rms(each.misfit[np.isfinite(each.misfit)]))

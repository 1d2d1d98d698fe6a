"""Fit the controller that flew: logged commands as a linear law of attitude, rate, reference and its own past.

    u_k = sum a_i u_(k-i) + b_i theta_(k-i) + c_i theta_dot_(k-i) + d_i reference_(k-i) + constant

1. *Ticks*.  Rows at which a new command is issued; commands that are held over several rows count once.
2. *Order and columns*.  From order 0 on, the simplest combination of columns first (Ljung, System Identification, 1999,
   ch. 4 and 16: an ARX structure, chosen on data that were left out): every other block of rows tells the coefficients,
   the others are predicted.  A law that flew on these very columns leaves nothing there but what rounding makes.
3. *Rounding*.  The digits of the columns are noise of known size on both sides; the normal equations less that noise
   (Soderstrom, Automatica 43, 2007: bias-compensated least squares) are free of its bias to first order.
4. *Reference not logged*.  It is taken to be piecewise constant, else piecewise linear: first or second differences of
   the law hold without it, but for the few rows at its steps or kinks, which are left out.
5. *Gains that change*.  In a window every coefficient may go linearly with time.

What no such law explains is refused: a limiter, a dead band, or columns that are not what the controller saw, as
another sensor's or those of rows between its ticks.  A regression on such columns would be biased, and no interval
would say so: for these there is `robustness.closed_loop`.

Commands at the deflection limit, and those that follow from them, are left out.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from sim.flight import excitation
from sim.nominal import Nominal

from ..log.log import Log
from ..log.steps import quantum_of
from ..sums import combined, least_squares, orthonormal, products
from .law import Law, shift
from .replay import MIN_COMMANDS, NEAR_LIMIT, OFF_GRID, ON_GRID, resolution, rms

MOST_ORDER = 6         # of a law: a PID with a notch and a low-pass has six
EXACT = 1e-5           # of the rms step of the command: an exact law leaves less on rows that were left out
NOTHING = 1e-9         # the same, of what sums of doubles make
NEARLY = 1e-3          # the same, of gains that change: their products are no straight lines
ROUNDED = 1.15         # times what rounding makes: more is left by another law
AS_GOOD = 0.98         # of what a law leaves: one of the next order that leaves less is the better one
ROUNDING = {0: 0.2, 1: 0.05, 2: 0.01}   # of the rms step, that rounding may make, by differences taken: of more no
#                        law can be told from one of another order
FEWEST = 3 * MIN_COMMANDS   # ticks that tell a law
SEARCHED = 1500        # ticks on which an order is tried
HELD = 0.25            # of the commands repeat the one before: the log is faster than what issues them
HELD_AGREES = 0.98     # of the changes that must come at multiples of the same number of rows
PERIOD_DIGITS = 9      # of a period: stamps are known no better
BLOCKS = 10            # of rows, every other one left out
DETERMINED = 1e-7      # of the largest singular value of the scaled columns: a smaller one tells nothing
KINKS = 0.1            # of the rows that may be left out as kinks of a reference that is not logged
KINK_SIGMAS = 8.0      # medians of the residual, beyond which a row is at a kink
KINK_ROUNDS = 30       # of leaving such rows out
AT_LIMIT = 3           # commands as large as the largest: it is a limit
PAIRS = {"error": ("theta", "theta_ref"), "rate_error": ("theta_dot", "rate_ref")}


@dataclass(frozen=True, eq=False)
class Answered:
    """A log at its controller's ticks: arrays (n,), NaN where not known.

    t [s];  columns  name -> theta, theta_dot, theta_ref, rate_ref, beta;  command [rad] less the nominal's test input;
    free  bool, the command is not at the limit;  period [s];  steps  name -> resolution of the column's digits
    """

    t: np.ndarray
    columns: dict[str, np.ndarray]
    command: np.ndarray
    free: np.ndarray
    period: float
    steps: dict[str, float]

    def part(self, t_start: float, t_end: float) -> "Answered":
        """Return the ticks from t_start to t_end [s]."""
        rows = (self.t >= t_start) & (self.t < t_end)
        return replace(self, t=self.t[rows], columns={name: x[rows] for name, x in self.columns.items()},
                       command=self.command[rows], free=self.free[rows])


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """A law that explains logged commands.

    law         at the middle of the ticks, if its gains change
    numbers     (k,) its coefficients a, b, c; covariance (k, k), 0 of a law that leaves nothing
    order, of   how many commands back it remembers; the columns that it answers
    left, size  [rad] rms that it leaves on rows left out; rms step of the command
    is_slow     whether its gains change linearly in the ticks
    is_likely   whether it is the likelihood's, of a log that does not hold what the controller saw
    """

    law: Law
    numbers: np.ndarray
    covariance: np.ndarray
    order: int
    of: tuple[str, ...]
    left: float
    size: float
    is_slow: bool = False
    is_likely: bool = False

    def laws(self, numbers: np.ndarray) -> Law:
        """Return the laws of m controllers whose numbers are the rows of `numbers` (m, k)."""
        return law_of_numbers(numbers, self.order, self.of, self.law.period)

    @property
    def gains_std(self) -> dict[str, float]:
        """Return the standard deviations of `Law.gains`, by their slopes in the numbers."""
        if not self.covariance.any():
            return dict.fromkeys(self.law.gains(), 0.0)
        slopes = []
        for k, step in enumerate(1e-3 * np.sqrt(np.diag(self.covariance)) + 1e-300):
            ends = [self.laws(self.numbers + sign * step * np.eye(len(self.numbers))[k]).gains()
                    for sign in (-1.0, 1.0)]
            slopes.append({name: (ends[1].get(name, math.nan) - ends[0][name]) / (2.0 * step) for name in ends[0]})
        return {name: float(np.sqrt(max(x @ self.covariance @ x, 0.0))) for name in self.law.gains()
                for x in [np.array([each.get(name, math.nan) for each in slopes])]}


def answered(log: Log, nominal: Nominal | None = None) -> Answered | str:
    """Return a log at its controller's ticks; one sentence instead if they cannot be told.

    nominal  gives test input and deflection limit
    """
    there = {name for name in ("beta_cmd", "theta", "theta_dot") if np.isfinite(getattr(log, name)).any()}
    if "beta_cmd" not in there or len(there) < 2:
        return "the log has no " + ("beta_cmd" if "beta_cmd" not in there else "theta and no theta_dot")
    t_first = float(log.t[np.isfinite(log.t)][0])
    at = (log.t - t_first) / log.period
    on = (np.abs(at - np.rint(at)) < OFF_GRID) & (at > -OFF_GRID) & (at < 100.0 * len(at))
    if on.mean() < ON_GRID:
        return f"the log's rows are not {log.period:g} s apart"
    index = np.rint(at[on]).astype(np.int64)
    grid = {name: np.full(int(index.max()) + 1, math.nan)
            for name in ("beta_cmd", "theta", "theta_dot", "theta_ref", "rate_ref", "beta")}
    for name, column in grid.items():
        column[index] = getattr(log, name)[on]
    held, phase = _held(grid["beta_cmd"])
    steps = {name: resolution(column) or quantum_of(column) for name, column in grid.items()}
    command, *_ = columns = [column[phase::held] for column in grid.values()]
    period = float(f"{held * log.period:.{PERIOD_DIGITS}g}")
    t = t_first + log.period * (phase + held * np.arange(len(command)))
    limit = _limit(command, nominal)
    free = np.abs(command) < NEAR_LIMIT * limit
    if nominal is not None and nominal.test_input is not None:
        first = max(round(float(t[0]) / period), 0)
        command = command - excitation(nominal, first + len(command), period)[first:]
    return Answered(t, dict(zip(list(grid)[1:], columns[1:], strict=True)), command, free, period, steps)


def _held(command: np.ndarray) -> tuple[int, int]:
    """Return over how many rows each command is held, and the first row of one."""
    whole = np.isfinite(command[1:]) & np.isfinite(command[:-1])
    changed = (command[1:] != command[:-1]) & whole
    places = np.flatnonzero(changed) + 1
    if len(places) < MIN_COMMANDS or np.mean(changed[whole]) > 1.0 - HELD:
        return 1, 0
    apart = np.diff(places)
    held = int(np.median(apart))
    phase = int(np.bincount(places % held).argmax())
    return (held, phase) if np.mean(places % held == phase) > HELD_AGREES else (1, 0)


def _limit(command: np.ndarray, nominal: Nominal | None) -> float:
    """Return the deflection limit [rad]: the nominal's, else the largest command, if several are as large; else inf."""
    if nominal is not None and nominal.actuator is not None:
        return nominal.actuator.deflection_limit
    size = np.abs(command[np.isfinite(command)])
    largest = float(size.max(initial=0.0))
    return largest if np.count_nonzero(size > largest * (1.0 - 1e-9)) > AT_LIMIT else math.inf


# ---- the law


def fit_law(ticks: Answered, slow: bool = False) -> FittedLaw | str:
    """Return the law of the lowest order that explains the commands; one sentence instead if none does.

    slow  its coefficients go linearly with time
    """
    if np.count_nonzero(ticks.free & np.isfinite(ticks.command)) < FEWEST:
        return "too few commands"
    best = math.inf
    differences = (0,) if np.isfinite(ticks.columns["theta_ref"]).any() else (1, 2)   # of one that is not logged
    first = max((len(ticks.t) - SEARCHED) // 2, 0)
    short = replace(ticks, t=ticks.t[first:first + SEARCHED], command=ticks.command[first:first + SEARCHED],
                    free=ticks.free[first:first + SEARCHED],
                    columns={name: x[first:first + SEARCHED] for name, x in ticks.columns.items()})
    for order, taken in itertools.product(range(MOST_ORDER + 1), differences):
        for of in _structures(ticks):
            tried = _regression(short, order, of, slow, taken)
            if tried is None:
                continue
            best = min(best, tried.share)
            if not tried.is_exact:
                continue
            whole = _regression(ticks, order, of, slow, taken)
            if whole is not None and whole.is_exact and not _is_short(ticks, whole, order, of, slow, taken):
                return whole.fitted
    if not math.isfinite(best):
        return "the motion does not tell a law: attitude and commands hardly move apart"
    return (f"no linear law of up to {MOST_ORDER} commands explains them: {100.0 * best:.2g} % of their rms step is "
            "left on rows left out")


def _is_short(ticks: Answered, found: "_Tried", order: int, of: tuple[str, ...], slow: bool, taken: int) -> bool:
    """Whether a law that leaves more than sums of doubles do is beaten by one of the next order."""
    if found.share < NOTHING:
        return False
    longer = _regression(ticks, order + 1, of, slow, taken)
    return longer is not None and longer.share < AS_GOOD * found.share


def _structures(ticks: Answered) -> list[tuple[str, ...]]:
    """Return the combinations of columns that a law may answer, the simplest first."""
    theta, rate, reference, rate_ref = (np.isfinite(ticks.columns[name]).any()
                                        for name in ("theta", "theta_dot", "theta_ref", "rate_ref"))
    moves = reference and float(np.nanmax(ticks.columns["theta_ref"]) - np.nanmin(ticks.columns["theta_ref"])) > 0.0
    if not reference:
        tried = [("theta",), ("theta_dot",), ("theta", "theta_dot")]
    elif not moves:
        tried = [("error",), ("theta_dot",), ("error", "theta_dot")]
    else:
        tried = [("error",), ("error", "theta_dot"), ("theta", "theta_ref"), ("theta_dot", "theta_ref"),
                 ("theta", "theta_dot", "theta_ref")]
    if rate_ref:
        tried.insert(1, ("rate_error",))
    lacks = {name for name, there in (("theta", theta), ("error", theta), ("theta_dot", rate), ("rate_error", rate))
             if not there}
    return [each for each in tried if not lacks & set(each)]


@dataclass(frozen=True, eq=False)
class _Tried:
    """A regression: what it leaves as a share of the rms step of the command, whether that is nothing, the law."""

    share: float
    is_exact: bool
    fitted: FittedLaw


def _regression(ticks: Answered, order: int, of: tuple[str, ...], slow: bool, taken: int) -> _Tried | None:
    """Return the regression on these columns, differenced `taken` times; None if the rows do not tell it."""
    differences = 0 if "rate_error" in of else taken
    made = _table(ticks, order, of, differences)
    if made is None:
        return None
    table, noise = made if not slow else _with_slopes(*made)
    step = rms(np.diff(ticks.command)[np.isfinite(np.diff(ticks.command))])
    if differences:
        table = _without_kinks(table, noise)
    plain = _solved(table, np.zeros_like(noise)) if noise.any() else None
    if plain is not None and rms(table[:, 0] - combined(table[:, 1:], plain)) < NOTHING * step:
        noise = np.zeros_like(noise)   # digits that are few by nature, as a reference's, are exact
    out = np.arange(len(table)) * BLOCKS // max(len(table), 1) % 2 == 1
    x, told = (_solved(rows, noise) for rows in (table, table[~out]))
    if x is None or told is None:
        return None
    left = rms(table[out, 0] - combined(table[out, 1:], told))
    sized = np.append(1.0, -x)
    rounding = math.sqrt(max(float(sized @ noise @ sized), 0.0))
    is_rounded = left < ROUNDED * rounding and rounding < ROUNDING[differences] * step
    answers = tuple(name for name in of if name != "theta_ref")
    count = order + (order + 1) * len(answers)
    covariance = np.zeros((count, count))
    if rounding > 0.0 or slow:
        covariance = _covariance(table, x, noise, order + differences)[:count, :count]
    law = law_of_numbers(x[:count], order, answers, ticks.period)
    fitted = FittedLaw(law, x[:count], covariance, order, answers, left, step, slow)
    return _Tried(left / max(step, 1e-300), is_rounded or left < (NEARLY if slow else EXACT) * step, fitted)


def _table(ticks: Answered, order: int, of: tuple[str, ...],
           differences: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return rows (n, k) of a command, its past, the columns `of` with their lags, and 1, all `differences` times
    differenced, and the covariance (k, k) of what rounding adds to them; None if they are too few."""
    columns, noises = [ticks.command], [ticks.steps["beta_cmd"] ** 2 / 12.0]
    for name in of:
        names = PAIRS.get(name, (name,))
        columns.append(ticks.columns[names[0]] - (ticks.columns[names[1]] if len(names) > 1 else 0.0))
        noises.append(sum(ticks.steps[each] ** 2 for each in names) / 12.0)
    columns = [np.diff(x, differences) for x in columns]
    n, lags = len(columns[0]) - order, order + 1
    if n < FEWEST:
        return None
    table = np.column_stack([x[order - i:len(x) - i] for x in columns for i in range(lags)]
                            + ([] if differences else [np.ones(n)]))
    used = np.isfinite(table).all(axis=1)
    for lag in range(order + differences + 1):
        used &= ticks.free[order + differences - lag:len(ticks.free) - lag]
    table = table[used]
    if len(table) < 10 * table.shape[1]:
        return None
    return table, _rounding([(lags, noise) for noise in noises], differences, table.shape[1])


def _with_slopes(table: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows with every coefficient's part that grows linearly from -1/2 to 1/2, and the rounding in them."""
    middle = np.linspace(-0.5, 0.5, len(table))
    count = len(noise)
    wide = np.zeros((2 * count - 1,) * 2)
    wide[:count, :count], wide[count:, count:] = noise, noise[1:, 1:] / 12.0
    return np.column_stack([table, table[:, 1:] * middle[:, None]]), wide


def _without_kinks(table: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return the rows of a table (n, k) that one law explains; a few others are at kinks of the reference.

    Least trimmed squares by concentration steps (Rousseeuw and Van Driessen, Data Mining and Knowledge Discovery 12,
    2006): a law that is exact elsewhere puts the kinks among the largest residuals.
    """
    count, kept = round((1.0 - KINKS) * len(table)), np.arange(len(table))
    for _ in range(KINK_ROUNDS):
        x = _solved(table[kept], noise)
        if x is None:
            break
        rest = np.abs(table[:, 0] - combined(table[:, 1:], x))
        nearest = np.sort(np.argsort(rest, kind="stable")[:count])
        if np.array_equal(nearest, kept):
            break
        kept = nearest
    else:
        x = _solved(table[kept], noise)
    if x is None:
        return table
    rest = np.abs(table[:, 0] - combined(table[:, 1:], x))
    return table[rest <= KINK_SIGMAS * np.median(rest)]


def _rounding(sizes: list[tuple[int, float]], differences: int, count: int) -> np.ndarray:
    """Return the covariance (count, count) of what rounding adds to command, its past, the columns with their lags; of
    twice differenced columns it is correlated over two ticks."""
    weights = {0: (1.0,), 1: (2.0, -1.0), 2: (6.0, -4.0, 1.0)}[differences]
    covariance, first = np.zeros((count, count)), 0
    for lags, variance in sizes:
        for away, weight in enumerate(weights):
            for i in range(lags - away):
                a, b = first + i, first + i + away
                covariance[a, b] = covariance[b, a] = weight * variance
        first += lags
    return covariance


def _solved(table: np.ndarray, noise: np.ndarray) -> np.ndarray | None:
    """Return the coefficients (k - 1,) of the first of the columns (n, k) in the others; None if they do not tell them.

    noise (k, k): the covariance of what rounding adds to a row
    """
    y, design = table[:, 0], table[:, 1:]
    scale = np.sqrt(np.mean(design**2, axis=0))
    if not scale.all():
        return None
    singular = np.linalg.svd(orthonormal(design / scale)[1], compute_uv=False)
    if singular[-1] < DETERMINED * singular[0]:
        return None
    if not noise.any():
        return least_squares(design / scale, y) / scale
    scale, own = np.append(1.0, scale), noise * len(table)
    total = (products(table, table) - own) / np.outer(scale, scale)
    if np.linalg.eigvalsh(total[1:, 1:])[0] <= 0.0:
        return None   # rounding is as large as what moves
    return np.asarray(np.linalg.solve(total[1:, 1:], total[1:, 0])) / scale[1:]


def _covariance(table: np.ndarray, x: np.ndarray, noise: np.ndarray, lags: int) -> np.ndarray:
    """Return the covariance of coefficients whose residuals are correlated over `lags` ticks (Newey and West,
    Econometrica 55, 1987, of a known length)."""
    design = table[:, 1:]
    scale = np.sqrt(np.mean(design**2, axis=0))
    scores = design * (table[:, 0] - combined(design, x))[:, None] / scale
    scores -= scores.mean(axis=0)
    middle = products(scores, scores)
    for lag in range(1, lags + 1):
        shared = products(scores[lag:], scores[:-lag])
        middle += (1.0 - lag / (lags + 1.0)) * (shared + shared.T)
    inverse = np.linalg.pinv((products(design, design) - noise[1:, 1:] * len(table)) / np.outer(scale, scale))
    return np.asarray(inverse @ middle @ inverse) / np.outer(scale, scale)


def law_of_numbers(numbers: np.ndarray, order: int, of: tuple[str, ...], period: float) -> Law:
    """Return the law or laws of numbers (k,) or (m, k): past commands, then the columns `of` with their lags."""
    lags, one = order + 1, np.ones((*numbers.shape[:-1], 1))
    parts = {"lag": np.concatenate([one, -numbers[..., :order]], axis=-1)}
    for k, name in enumerate(of):
        parts[name] = numbers[..., order + k * lags:order + (k + 1) * lags]
    none, turn = np.zeros_like(parts["lag"]), shift(lags)
    theta = parts.get("error", parts.get("theta", none))
    rate = parts.get("theta_dot", parts.get("rate_error", none))
    lag = parts["lag"] @ turn
    lag[..., -1] = np.where(np.abs(lag[..., -1]) < 1e-9 * np.abs(parts["lag"]).sum(axis=-1), 0.0, lag[..., -1])
    return Law(theta @ turn, rate @ turn, lag, period)



"""The look: which alternatives of the table predict rows left out better, one after the other.

The nominal's numbers are free within a factor of FACTOR, for a structure may be missing beside a number that is off; an
alternative that needs none of them changed goes before one that does.
"""

from dataclasses import dataclass

import numpy as np

from launchid.diagnosis.data.record import Record
from launchid.weakform.rows import column
from launchid.sums import square

from .score import BLOCKS, Fitted, Rows, convolved, gain, left_out, rows_of, shortest, weights_of
from .signals import Signals, Travel, signals_of
from .table import TABLE, Alternative, View, wander

STEPS = 3              # alternatives in one equation
SIGNIFICANT = 4.0      # standard errors of a gain
SHARE = 0.04           # of the error left out, that a step must take away
LEAST = 0.01           # and of the nominal's own
TIED = 2.0             # standard errors within which two do as well
FACTOR = 3.0           # by which a number of the nominal may be off
CANCELS = 4.0          # times what it explains, that an alternative may move
BETWEEN = 9            # numbers between two of a grid
FEWEST_ROWS = 200


@dataclass(frozen=True, eq=False)
class Tried:
    """An alternative beside what is there already.

    number  its own;  size  its coefficient, the first of several;  gain, deviation  of squared errors left out
    fitted  with it;  design (k, c)  all columns, its own last
    """

    alternative: Alternative
    number: float
    size: float
    gain: float
    deviation: float
    fitted: Fitted
    design: np.ndarray


@dataclass(frozen=True)
class Step:
    """A part of the equation that is missing.

    share     of the error left out that it takes away;  z  standard errors of that
    number    its own (a delay [s], a frequency [rad/s], a time [s]), 0 where it has none;  size  its coefficient
    alike     names of the others that do as well;  is_listed  it and they are in the catalogue
    """

    name: str
    alike: tuple[str, ...]
    is_listed: bool
    share: float
    z: float
    number: float
    size: float


@dataclass(frozen=True)
class Look:
    """The result of a look at a log's equation of motion.

    free   share of the nominal's error left out that stays with its numbers free;  left  with all steps
    """

    steps: tuple[Step, ...]
    free: float
    left: float


class Equation:
    """The equation of motion of a log: its rows, the nominal's columns, and the alternatives beside them."""

    def __init__(self, signals: Signals, rows: Rows) -> None:
        self.signals = signals
        self.travel: Travel = {}
        self.kept: list[tuple[Alternative, float]] = []
        smooth = weights_of(0, max(rows.steps[0] // 2, 1), signals.period)
        edge = len(smooth) // 2
        rate = np.pad(signals.rate, edge, mode="edge")
        self.rate = convolved(rate, smooth)[:len(signals.rate)] if len(smooth) > 2 else signals.rate
        self.rate = np.pad(self.rate, (0, len(signals.rate) - len(self.rate)), mode="edge")
        self.rows = rows
        plain = rows.mean(*signals.equation) - self.base({}) @ self.numbers
        self.rows = rows.weighed(plain)
        self.y = self.rows.mean(*signals.equation)
        self.block = self.rows.stretch(BLOCKS)

    def view(self, travel: Travel, left: np.ndarray | None = None) -> View:
        """The log with this on the input's way."""
        return View(self.signals, self.rows, travel, self.signals.on_its_way(travel), self.rate,
                    left if left is not None else np.zeros(len(self.rows.weight)))

    @property
    def numbers(self) -> np.ndarray:
        """The nominal's numbers of the columns of `base`, 0 where it has none."""
        return self._numbers

    def base(self, travel: Travel) -> np.ndarray:
        """(k, c) the nominal's terms, a constant, and what the nominal says may be there beside them."""
        view, nominal = self.view(travel), self.signals.record.nominal
        columns, numbers, constant = [], [], 0.0
        for x, is_there in ((self.signals.a6 * self.signals.attack, view.has("theta")), (view.effect, view.moves)):
            if is_there:
                columns.append(view.mean(x))
                numbers.append(1.0)
        for term, coefficient in nominal.terms:
            if term == "1":
                constant = coefficient
                continue
            x = column(term, self.signals.attack, self.rate, view.input, self.signals.t)
            columns.append(coefficient * view.mean(x))
            numbers.append(1.0)
        columns.append(view.mean(np.ones(len(self.rate))))
        numbers.append(constant)
        if nominal.wind is not None or nominal.drift is not None or nominal.offsets is not None:
            slow = wander(view)
            columns.extend(slow.T)
            numbers.extend([0.0] * slow.shape[1])
        self._numbers = np.array(numbers)
        return np.column_stack(columns)

    def design(self, travel: Travel) -> np.ndarray:
        """(k, c) the base and the alternatives that are kept."""
        view = self.view(travel)
        return np.column_stack([self.base(travel), *(each.columns(view, number) for each, number in self.kept
                                                     if each.columns is not None)])

    def judged(self, designs: list[np.ndarray], held: bool = False) -> tuple[Fitted, bool]:
        """(The best of several designs, whether it is no answer); with the nominal's numbers held where one of them
        would be off by more than FACTOR, or `held`."""
        own, count = np.flatnonzero(self.numbers), len(self.numbers)
        best = left_out(designs, self.y, self.rows.fold)
        design, size = designs[best.at], np.std(designs[best.at], axis=0)
        whole = max(float(np.std(self.y)), *(float(size[j] * abs(self.numbers[j])) for j in own), 0.0)
        ratio = best.xi[own] / self.numbers[own]
        is_off = bool(np.any((size[own] > 0.0) & ~((ratio > 1.0 / FACTOR) & (ratio < FACTOR))))
        if not held and not is_off and not np.any(size[count:] * np.abs(best.xi[count:]) > CANCELS * whole):
            return best, False
        found = []
        for design in designs:
            free = np.delete(design, own, axis=1)
            y = self.y - design[:, own] @ self.numbers[own]
            found.append(left_out([free], y, self.rows.fold))
        at = min(range(len(designs)), key=lambda j: square(found[j].errors))
        xi = np.zeros(designs[at].shape[1])
        xi[own] = self.numbers[own]
        xi[np.delete(np.arange(len(xi)), own)] = found[at].xi
        size = np.std(designs[at], axis=0)
        return Fitted(found[at].errors, xi, at), bool(np.any(size[count:] * np.abs(xi[count:]) > CANCELS * whole))

    def tried(self, alternative: Alternative, errors: np.ndarray) -> Tried | None:
        """An alternative beside what is there, whose errors left out are `errors` (k,); None: it is no answer."""
        view = self.view(self.travel, errors)
        if alternative.travel in self.travel or not alternative.when(view):
            return None
        grid = list(alternative.grid(view))
        found = self._best_of(alternative, view, grid, errors)
        if found is None or not alternative.between or len(grid) < 2 or found.gain < 0.5 * SHARE * square(errors):
            return found
        at = grid.index(found.number)
        low, high = (grid[at - 1] if at else 0.5 * grid[0]), grid[min(at + 1, len(grid) - 1)]
        return self._best_of(alternative, view, np.linspace(low, high, BETWEEN).tolist(), errors) or found

    def _best_of(self, alternative: Alternative, view: View, grid: list[float], errors: np.ndarray) -> Tried | None:
        start = self.design(self.travel)
        designs = [self.design({**self.travel, alternative.travel: number}) if alternative.columns is None else
                   np.column_stack([start, alternative.columns(view, number)]) for number in grid]
        whole = [k for k, design in enumerate(designs) if np.all(np.isfinite(design))]
        if not whole:
            return None
        designs, grid = [designs[k] for k in whole], [grid[k] for k in whole]
        fitted, is_none = self.judged(designs)
        size = float(fitted.xi[start.shape[1]]) if alternative.columns is not None else grid[fitted.at]
        if is_none or not alternative.low <= size <= alternative.high:
            return None
        gained, deviation = gain(errors, fitted.errors, self.block)
        return Tried(alternative, grid[fitted.at], size, gained, max(deviation, 1e-300), fitted, designs[fitted.at])

    def keep(self, tried: Tried) -> None:
        """Take an alternative into the equation."""
        if tried.alternative.columns is None:
            self.travel = {**self.travel, tried.alternative.travel: tried.number}
        else:
            self.kept.append((tried.alternative, tried.number))


def look(record: Record) -> Look | None:
    """Find what is missing in a record's equation of motion, first what takes away most.

    None where it has too few rows, or where the nominal has effects, which are in none of these columns."""
    if record.nominal.effects or record.rows < FEWEST_ROWS:
        return None
    signals = signals_of(record)
    x, order = signals.equation
    rows = rows_of(len(x), signals.period, order, shortest(x, order, signals.noise, signals.period), signals.missing)
    if rows is None:
        return None
    equation = Equation(signals, rows)
    null = square(equation.y - equation.base({}) @ equation.numbers)
    errors = equation.judged([equation.design({})])[0].errors
    free = square(errors) / null
    steps: list[Step] = []
    while len(steps) < STEPS:
        best = _next(equation, errors, null, {step.name for step in steps})
        if best is None:
            break
        tried, alike = best
        before = square(errors)
        steps.append(Step(tried.alternative.name, tuple(each.name for each in alike),
                          tried.alternative.is_listed and all(each.is_listed for each in alike), tried.gain / before,
                          tried.gain / tried.deviation, tried.number, tried.size))
        equation.keep(tried)
        errors = tried.fitted.errors
    return Look(tuple(steps), free, square(errors) / null)


def _next(equation: Equation, errors: np.ndarray, null: float,
          present: set[str]) -> tuple[Tried, list[Alternative]] | None:
    """(The alternative that takes away most, those that do as well); None where none is significant."""
    found = [each for each in (equation.tried(alternative, errors) for alternative in TABLE
                               if alternative.name not in present) if each is not None]
    best = max(found, key=lambda each: each.gain, default=None)
    before = square(errors)
    if best is None or best.gain < SIGNIFICANT * best.deviation or best.gain < max(SHARE * before, LEAST * null):
        return None

    def is_as_good(other: np.ndarray, than: np.ndarray, least: float) -> bool:
        behind, deviation = gain(other, than, equation.block)
        return behind < max(TIED * deviation, SHARE * square(than), least)

    near = [each for each in found
            if each is not best and is_as_good(each.fitted.errors, best.fitted.errors, LEAST * null)]
    alike = [each.alternative for each in near if is_as_good(each.fitted.errors, best.fitted.errors, 0.0)]
    if near:  # who needs none of the nominal's numbers changed goes first
        held = [(each, equation.judged([each.design], held=True)[0].errors) for each in (best, *near)
                if each.gain > SIGNIFICANT * each.deviation]
        first, own = min(held, key=lambda pair: square(pair[1]))
        if is_as_good(own, best.fitted.errors, LEAST * null):
            best = first
            alike = [each.alternative for each, other in held if each is not first and is_as_good(other, own, 0.0)]
    return best, alike

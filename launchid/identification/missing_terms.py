"""The question whether something that a window's answer lacks predicts rows left out better, by more than its error.

The question is put for the terms of LACKING, for a beta that acts later or sooner, for a beta of another time (the
placebo: a k1 that it gives as well is none), and for no term at all.  All in the weak form (`weak_form`): increments of
theta_dot over 0.2 s against the integrals of the terms, every column averaged over 0.05 s before and after, so that the
acceleration of beta is one of them.  Within a piece of the log coefficients are constants, a6 and k1 lines in time,
which may bend (DRIFT).
"""

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np

from launchid_core import Estimate

from ..sums import combined, least_squares, products, square
from .weak_form import SLOPE, Rows, averaged, increments, running_integral, slope, slope_rows, term_integrals

PIECE = 5.0          # s over which one set of coefficients, with their slopes in time, holds
BLOCK = 2            # increments that are left out together
FOLDS = 6            # of the blocks of a piece; each is predicted by the others
STARTS = 8           # increments that begin within the length of one
RANK = 1.0e-10       # of the squares of the columns: what moves less in the other folds is not fitted there
BETTER = 2.0         # standard errors by which rows left out must be predicted better
ONE = 1              # block: what moves in one alone is no term of the vehicle
MOST = 0.5           # of the error of rows left out
TOLERANCE = 0.02     # relative: a6 and k1 may be off by that without being wrong, as in [diagnosis]; what predicts less
#                      than that of the motion (rms) is no term, but may be the integrals' own error
LARGE = 0.5          # rad: below it sin(theta) is theta within 4 %
LEAST_BENDS = 2      # straight parts of a piece in which a6 and k1 may drift; of longer ones every PIECE
MOST_BENDS = 24      # of the longest: work and memory are bounded
DRIFT = "drift"      # of a6 and k1, beyond a line in time
OF_A6, OF_K1 = range(2)
LACKING = ("1", "theta_dot", "sign(theta_dot)", "sin(theta)", "beta_ddot", "beta^2")
Name = str | tuple[str, int]
SHIFTS = tuple(0.1 + 0.8 * k / 19 for k in range(20))  # of the log, circular: placebos


def active_terms(estimate: Estimate) -> tuple[str, ...]:
    """The terms of the theta_ddot equation that the estimate has."""
    return tuple(term for term, on in zip(estimate.terms, estimate.support[:, 1].tolist(), strict=True) if on)


@dataclass(frozen=True)
class Lack:
    """Something that the answer lacks and that predicts rows left out better.

    what     a term; `delay`, `placebo`, `nothing`, or `interpolated`: beta is not known between its own values
    before, after   share of the variance of the increments left out that is predicted without and with it
    size     coefficient of the term [its units], delay [s]; None for the others
    """

    what: str
    before: float
    after: float
    size: float | None = None

    @property
    def shares(self) -> str:
        """The shares that are predicted with it and without it, in words."""
        return (f"with it {100.0 * self.after:.3g} % of the rows left out are predicted, without "
                f"{100.0 * self.before:.3g} %")

    @property
    def is_most(self) -> bool:
        """Whether most of the error left out is gone with it."""
        return self.after - self.before > MOST * (1.0 - self.before)


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of the log with one set of coefficients.

    rows   (k, c + 1)  increments of all candidate columns, theta_dot's last
    block  (k,) int64  the block that each is of
    gram   (FOLDS, c + 1, c + 1)  products of the columns, scaled to one size each, in every fold of blocks
    size   (c + 1,)    these sizes, over the whole piece: what moves in one block alone is not fitted to rounding
    """

    rows: np.ndarray
    block: np.ndarray
    gram: np.ndarray
    size: np.ndarray

    def left_out(self, columns: list[int]) -> np.ndarray:
        """(k,) errors of the increments, predicted with these columns as the other folds have them."""
        fold, errors = self.block % FOLDS, np.empty(len(self.rows))
        for f in range(FOLDS):
            gram = np.sum(self.gram, axis=0) - self.gram[f]
            xi = np.linalg.lstsq(gram[np.ix_(columns, columns)], gram[columns, -1], rcond=RANK)[0]
            at = fold == f
            scaled = xi * self.size[-1] / self.size[columns]
            errors[at] = self.rows[at, -1] - combined(self.rows[np.ix_(at, columns)], scaled)
        return errors

    def beside(self, columns: list[int], place: int) -> tuple[float, float]:
        """(coefficient times weight, weight) of a column beside others, by what of it they do not hold."""
        gram = np.sum(self.gram, axis=0)
        xi = np.linalg.lstsq(gram[np.ix_(columns, columns)], gram[np.ix_(columns, [place, -1])], rcond=RANK)[0]
        rest = gram[np.ix_([place, -1], [place, -1])] - gram[np.ix_([place, -1], columns)] @ xi
        return float(rest[0, 1] * self.size[place] * self.size[-1]), float(rest[0, 0] * self.size[place] ** 2)


def piece_of(rows: np.ndarray, block: np.ndarray) -> Piece:
    """A piece of its increments and their blocks."""
    size = np.sqrt(np.sum(rows**2, axis=0))
    scaled = rows / np.where(size > 0.0, size, 1.0)
    gram = np.array([products(part, part) for part in (scaled[block % FOLDS == f] for f in range(FOLDS))])
    return Piece(rows, block, gram, np.where(size > 0.0, size, 1.0))


@dataclass(frozen=True, eq=False)
class Question:
    """The candidates' columns over all pieces of a log.

    names   of the columns: terms of the answer, their slopes in time, terms that it lacks, terms in another beta as
            (term, k), k = 0 for the delayed one, k > 0 for the placebos, and a6 and k1 bent in time, (DRIFT, OF_A6 or
            OF_K1)
    base    places of the answer's terms and slopes
    """

    rows: Rows
    names: tuple[Name, ...]
    base: list[int]
    betas: list[np.ndarray]
    pieces: list[Piece]

    def left_out(self, columns: list[int]) -> np.ndarray:
        """(k,) errors of all pieces."""
        return np.concatenate([piece.left_out(columns) for piece in self.pieces])

    @functools.cached_property
    def block(self) -> np.ndarray:
        """(k,) int64 the block of each error."""
        first = np.cumsum([0, *(int(piece.block[-1]) + 1 for piece in self.pieces)])
        return np.concatenate([k + piece.block for k, piece in zip(first, self.pieces, strict=False)])

    def instead(self, k: int, columns: list[int]) -> list[int]:
        """The columns with another beta in every term that has one."""
        terms = [name[0] if isinstance(name, tuple) else name for name in (self.names[j] for j in columns)]
        return [self.names.index((term, k)) if term != DRIFT and (term, k) in self.names else j
                for term, j in zip(terms, columns, strict=True)]


def question(rows: Rows, terms: tuple[str, ...], delayed: float | None, longest: float) -> Question | None:
    """The candidates of a log; None where it is too short for one piece of FOLDS blocks.

    terms    of the answer;  delayed [s]  by how much beta leads, None: not asked;  longest [s]  of the windows
    """
    span, block = rows.span, BLOCK * rows.span
    count = max(1, len(rows.t) // max(round(PIECE / rows.period), round(longest / rows.period), FOLDS * block))
    bends = min(max(LEAST_BENDS, round(len(rows.t) * rows.period / (count * PIECE))), MOST_BENDS)
    betas = [rows.beta if delayed is None else np.interp(rows.t - delayed, rows.t, rows.beta)]
    betas += [np.roll(rows.beta, round(share * len(rows.t))) for share in SHIFTS]
    names: tuple[Name, ...] = ()
    pieces = []
    for first, end in itertools.pairwise(np.linspace(0, len(rows.t), count + 1).astype(int).tolist()):
        at = slice(first, end)
        names, columns = candidates(rows, at, terms, betas, bends)
        starts, steps = increments(rows.t[at], columns, span, max(1, span // STARTS))
        within = starts % block <= block - span
        if len(np.unique(starts[within] // block)) >= FOLDS:
            pieces.append(piece_of(steps[within], starts[within] // block))
    base = [j for j, name in enumerate(names) if name in (*terms, *slopes_of(terms))]
    return Question(rows, names, base, betas, pieces) if pieces else None


def slopes_of(terms: tuple[str, ...]) -> tuple[str, ...]:
    """The terms of a6 and k1 that drift, beside those of an answer that has none."""
    return tuple(f"tau*{term}" for term in ("theta", "beta") if term in terms and f"tau*{term}" not in terms)


def candidates(rows: Rows, at: slice, terms: tuple[str, ...], betas: list[np.ndarray],
               bends: int) -> tuple[tuple[Name, ...], np.ndarray]:
    """(names, columns (k, c + 1)) of a piece: means of the candidates' running integrals over SLOPE before and after
    each row that has them, theta_dot's last.

    bends  straight parts of which a6 and k1 may be made (DRIFT)
    """
    t, slopes = rows.t[at], slopes_of(terms)
    bent = "theta" in terms and bool(np.max(np.abs(rows.attack)) > LARGE)
    lacking = tuple(term for term in LACKING if term not in terms and (term != "sin(theta)" or bent)
                    and (term != "beta_ddot" or (rows.has_rate and rows.period <= SLOPE)))
    inputs = tuple(term for term in (*terms, *slopes) if "beta" in term)
    drifting = {k: x for k, (term, x) in enumerate((("theta", rows.attack[at]), ("beta", rows.beta[at])))
                if term in terms}
    drift = [running_integral(t, x * hat) for x in drifting.values() for hat in hats(t, bends)]
    integrals = np.column_stack([term_integrals(rows, at, (*terms, *slopes), rows.beta),
                                 *(term_integrals(rows, at, inputs, beta) for beta in betas), *drift,
                                 rows.theta_dot[at]])
    names: tuple[Name, ...] = (*lacking, *terms, *slopes, *((term, k) for k in range(len(betas)) for term in inputs),
             *((DRIFT, k) for k in drifting for _ in range(bends - 1)))
    inclines = averaged(t, integrals, slope_rows(rows.t))
    return names, np.column_stack([lacking_columns(rows, at, lacking, betas[0]), inclines])


def hats(t: np.ndarray, bends: int) -> np.ndarray:
    """(bends - 1, n) hats in time over equal parts of t (n,): with a constant and a line they make every function that
    is straight within the parts."""
    nodes = np.linspace(t[0], t[-1], bends + 1)
    return np.array([np.interp(t, nodes, row) for row in np.eye(bends + 1)[1:-1]]).reshape(bends - 1, len(t))


def lacking_columns(rows: Rows, at: slice, names: tuple[str, ...], beta: np.ndarray) -> np.ndarray:
    """(k, n) columns, as of `candidates`, of terms of LACKING: of beta_ddot it is the slope of beta, of sin(theta) what
    it is beside theta.

    beta (rows,) [rad]  shifted to when it acts, as a power of it is; the nozzle's own inertia acts at its own time, and
    a shift that only imitates it must not hide it
    """
    t, around, attack, theta_dot = rows.t[at], slope_rows(rows.t), rows.attack[at], rows.theta_dot[at]
    values = {"1": np.ones(len(t)), "theta_dot": theta_dot, "sign(theta_dot)": np.sign(theta_dot),
              "sin(theta)": np.sin(attack) - attack, "beta^2": beta[at] ** 2}
    columns = [slope(t, rows.beta[at])[around:len(t) - around] if name == "beta_ddot"
               else averaged(t, running_integral(t, values[name])[:, None], around)[:, 0] for name in names]
    return np.column_stack(columns) if columns else np.zeros((len(t) - 2 * around, 0))


def is_better(before: np.ndarray, after: np.ndarray, block: np.ndarray, whole: np.ndarray,
              left_out: int = 0) -> bool:
    """Errors (k,) whose squares are less by more than BETTER standard errors, and TOLERANCE of `whole` (k,), rms.

    block (k,)  which belong together;  left_out  so many blocks, of the largest gain, must not be needed for it

    The squares differ by d'd + 2 d'e with d the difference of the predictions and e the errors after, of which chance
    is the second part: its sum over blocks has the squares' sum as its variance.
    """
    gains = np.sort(np.bincount(block, before**2 - after**2))
    chance = np.bincount(block, 2.0 * after * (before - after))
    gain = float(np.sum(gains[:len(gains) - left_out]))
    return gain > max(BETTER * math.sqrt(square(chance)), TOLERANCE**2 * square(whole))


def lacks(q: Question, delayed: float | None) -> list[Lack]:
    """The lacks that predict the blocks left out better than the answer, and than the answer with the lacks before
    them.

    That a6 and k1 bend in time is no lack, for the standard deviations hold it; where they do, it is put in first.
    """
    whole = np.concatenate([piece.rows[:, -1] for piece in q.pieces])
    columns, lacking = q.base, []
    error = q.left_out(columns)
    bent = [*columns, *(j for j, name in enumerate(q.names) if name in ((DRIFT, OF_A6), (DRIFT, OF_K1)))]
    if is_better(error, drifted := q.left_out(bent), q.block, whole):
        columns, error = bent, drifted
    while True:
        asked = {term: [*columns, q.names.index(term)] for term in LACKING
                 if term in q.names and q.names.index(term) not in columns}
        if delayed is not None and q.instead(0, columns) != columns:
            asked["delay"] = q.instead(0, columns)
        errors = {what: q.left_out(each) for what, each in asked.items()}
        better = [what for what in errors if is_better(error, errors[what], q.block, whole, ONE)]
        if not better:
            break
        what = min(better, key=lambda each: square(errors[each]))
        size = delayed if what == "delay" else pooled(q, columns, q.names.index(what))
        lacking.append(Lack(what, _predicted(error, whole), _predicted(errors[what], whole), size))
        columns, error = asked[what], errors[what]
    if not is_better(whole, error, q.block, whole):
        lacking.append(Lack("nothing", _predicted(error, whole), 0.0))
    straight = [j for j in columns if q.names[j] != (DRIFT, OF_K1)]  # which holds the true beta
    error = q.left_out(straight)
    others = [q.instead(k, straight) for k in range(1, len(q.betas))]
    vain = min((q.left_out(each) for each in others if each != straight), key=square, default=None)
    if vain is not None and not is_better(vain, error, q.block, whole):
        lacking.append(Lack("placebo", _predicted(error, whole), _predicted(vain, whole)))
    return lacking


def _predicted(errors: np.ndarray, whole: np.ndarray) -> float:
    """Share of the squares that is predicted."""
    return 1.0 - square(errors) / square(whole) if square(whole) > 0.0 else 0.0


def pooled(q: Question, beside: list[int], place: int) -> float:
    """Coefficient of a column beside others, one for the whole log."""
    above, below = np.sum([piece.beside(beside, place) for piece in q.pieces], axis=0).tolist()
    return above / below if below > 0.0 else 0.0


def moved_by(q: Question, at: slice, terms: tuple[str, ...], lack: Lack) -> dict[str, tuple[float, float]]:
    """(By how much the coefficients of an answer for the rows `at` would move with what it lacks, sizes of their
    columns) by term."""
    rows = q.rows
    around = slope_rows(rows.t)
    if at.stop - at.start <= len(terms) + 1 + 2 * around:
        return {}

    def solved(y: np.ndarray, beta: np.ndarray) -> np.ndarray:
        phi = averaged(rows.t[at], term_integrals(rows, at, terms, beta), around)
        return least_squares(phi - phi.mean(axis=0), y - y.mean())

    if lack.what == "delay":
        y = averaged(rows.t[at], rows.theta_dot[at][:, None], around)[:, 0]
        off = solved(y, q.betas[0]) - solved(y, rows.beta)
    else:
        off = solved(lack.size * lacking_columns(rows, at, (lack.what,), q.betas[0])[:, 0], rows.beta)
    phi = averaged(rows.t[at], term_integrals(rows, at, terms, rows.beta), around)
    sizes = np.sqrt(np.sum((phi - phi.mean(axis=0)) ** 2, axis=0))
    return dict(zip(terms, zip(off.tolist(), sizes.tolist(), strict=True), strict=True))


def is_moved(q: Question, at: slice, answer: dict[str, tuple[float, float]], lack: Lack) -> bool:
    """Whether what the answer lacks is most of the error, or would move a coefficient by more than its standard
    deviation and TOLERANCE, of itself and of the largest term.

    at      rows of the answer;  answer  (coefficient, standard deviation) of its terms
    """
    if lack.size is None or lack.is_most or lack.what == "delay":  # at another time it is another input
        return True
    moved = moved_by(q, at, tuple(answer), lack)
    least = TOLERANCE * max((abs(answer[term][0]) * size for term, (_, size) in moved.items()), default=0.0)
    return any(abs(by) > max(answer[term][1], TOLERANCE * abs(answer[term][0])) and abs(by) * size > least
               for term, (by, size) in moved.items())

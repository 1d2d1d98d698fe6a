"""Ask once whether terms describe a log: pieces of the whole log, whatever its windows are.

There are three answers: it holds; it does not hold (`Lack`: what, how much, what to do); it cannot be tested
(`UNCHECKED`, with what would allow it). The tests are made in pieces of JUDGE_PIECE seconds of the whole log, and what
they find counts in each window whose numbers it would move. Tested is, in this order, whether beta is known between its
own values, whether it acts when it is logged, whether beta of another time explains as much (placebo), whether a term
that the answer lacks explains what is left, and whether that is as white as was assumed.
"""

from dataclasses import dataclass, field

import numpy as np

from ..weakform.late import Lead
from ..weakform.pieces import Piece, Whole, beside, pieces_of, pooled
from ..weakform.rows import Rows
from .input import STRETCH, placebo
from .lack import LACKING, Lack
from .table import TESTS
from .terms import lacks_of

STRONG = 0.05        # of the changes of theta_dot, that a term explains beside a beta that is no input of them


@dataclass(frozen=True, eq=False)
class Question:
    """Result of testing whether `terms` describe a log: fitted pieces, lead of beta, lacks, or why unchecked."""

    rows: Rows
    terms: tuple[str, ...]
    pieces: list[Piece]
    lead: Lead | None
    lacks: list[Lack]
    unchecked: str = ""
    known: dict[str, tuple[float, float]] = field(default_factory=dict)   # of optional terms: coefficient, deviation
    doubt: dict[str, float] = field(default_factory=dict)   # variance of terms, by other frequencies
    is_constant: bool = False   # no coefficient changes with time, so a nominal says

    @property
    def whole(self) -> Whole:
        """The terms as they were fitted to the pieces."""
        return Whole(self.terms, self.pieces, self.known, self.doubt, self.is_constant)

    @property
    def is_placebo(self) -> bool:
        """Whether beta of another time explains about as much as beta itself; then no window is valid."""
        return any(lack.what == "placebo" for lack in self.lacks)


def question(rows: Rows | None, terms: tuple[str, ...], optional: tuple[str, ...] = (), *,
             is_late: bool = False) -> Question:
    """Test whether terms describe a log, with those of `optional` whose coefficient exceeds its deviation.

    rows      None: nothing can be tested;  is_late   when beta acts was fitted before, and no shift of it is tested
    """
    if rows is None:
        return Question(rows, terms, [], None, [], "theta and beta have no two rows together")  # type: ignore[arg-type]
    typical = rows.stretch
    if typical < min(STRETCH, 0.9 * (rows.t[-1] - rows.t[0])):
        return Question(rows, terms, [], None, [], f"gaps leave stretches of {typical:.2g} s: a shift of beta, and "
                        f"what is slower, cannot be tested; log at least {STRETCH:g} s without a gap")
    whole = pieces_of(rows, terms)
    pieces = [piece for piece in whole if not piece.fit.is_singular]
    if not pieces:
        reason = (f"{len(rows.t)} rows are too few to test {len(terms)} coefficients; log longer, or more often"
                  if not whole else "theta and beta hardly move, or move as one: no coefficient can be tested; log a "
                  "stretch in which beta moves by itself")
        return Question(rows, terms, [], None, [], reason)
    if "theta_dot" in terms and not rows.has_rate:
        k = terms.index("theta_dot")
        fades = -float(np.average([piece.fit.xi[k] for piece in pieces],
                                  weights=[1.0 / piece.fit.covariance[k, k] for piece in pieces]))
        if fades * rows.period > TESTS["rows faster than the damping"].limit:
            return Question(rows, terms, [], None, [], f"theta_dot fades within {1.0 / fades:.2g} s, and is not "
                            f"measured: log it, or theta every {1.0 / (3.0 * fades):.1g} s")
    known = {}
    for term in optional:
        more = beside(pieces, (*terms, term))
        size, std, _ = pooled(more)
        if abs(size) > std:
            terms, pieces, known[term] = (*terms, term), more, (size, std)
    lacks, lead = lacks_of(rows, terms, pieces, is_late)
    wider = (*terms, *(lack.what for lack in lacks if lack.what in LACKING))
    asked = pieces if wider == terms else beside(pieces, wider)
    clear = any(lack.is_most for lack in lacks)
    if not clear and placebo(asked, wider, rows, lead):   # of a beta that explains nothing no shift is proved
        strong = [lack for lack in lacks if lack.what not in ("delay", "clock") and lack.after - lack.before > STRONG]
        return Question(rows, terms, pieces, None, [*strong, Lack("placebo")], known=known)
    return Question(rows, terms, pieces, lead, lacks, known=known)

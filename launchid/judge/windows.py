"""Judge the windows of a log: the numbers of each against the tests of the whole log."""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from launchid_core import Config, Estimate, EstimateStatus
from sim.nominal import Nominal

from ..log.check import CheckedLog
from ..log.rates import INTERPOLATED
from ..weakform.bands import agreeing_top
from ..weakform.estimate import widened, window_fits
from ..weakform.fit import Fit
from ..weakform.late import Late, Lead
from ..weakform.modes import Modes, term_modes
from ..weakform.pieces import PER_COEFFICIENT, means_of
from ..weakform.prepare import usable
from ..weakform.rows import Rows
from .input import late_input, lead_of
from .lack import AT_REST, LACKING, Lack, is_passive
from .question import Question, question
from .refusal import active_terms, refused
from .window import WindowFit, against, agrees, held_out, is_driving, left_over, of_fit, small_effect

MOST_NUISANCES = 3   # that are fitted one after the other: a friction, a delay of beta, what is left of it
EARLIEST = 1.0       # rows by which beta may act sooner than its row, where a logger writes it once it has acted
WEAK_STATUSES = (EstimateStatus.SEPARATION, EstimateStatus.LOW_INFORMATION)  # what something missing may look like


@dataclass(frozen=True, eq=False)
class Judged:
    """The windows as judged: estimates (refused if the log contradicts them), fit of each, lacks, when beta acts, what
    was not tested, the weak form's estimates before, terms that were tested, and of the weak form the covariance (q, q)
    of each window's terms (None: it has none), those of its terms that joined since the log shows them, and the highest
    frequency [rad/s] that it uses."""

    estimates: list[Estimate]
    fits: list[WindowFit]
    lacks: list[Lack]
    lead: Lead | None = None
    late: Late | None = None
    unchecked: str = ""
    fitted: list[Estimate] = field(default_factory=list)
    terms: tuple[str, ...] = ()
    covariances: list[np.ndarray | None] = field(default_factory=list)
    joined: tuple[str, ...] = ()
    top: float = math.inf


def judged_windows(seen: CheckedLog, config: Config, estimates: list[Estimate], is_weak: bool,
                   optional: tuple[str, ...] = (), joining: tuple[str, ...] = ()) -> Judged:
    """Test the numbers of each window on the whole log, and refuse those that it contradicts.

    is_weak   replace the numbers of the estimates by those of the weak form; only their windows are used
    optional  terms that the answer has too where their coefficient exceeds its deviation
    joining   terms that the answer has too where the log shows that they act
    """
    if config.formulation == "filtered":   # it judges itself: of it the fits alone
        rows = usable(seen)
        fits = [held_out(rows, e, e.whiteness if math.isfinite(e.whiteness) else None)
                if rows is not None and e.valid else WindowFit() for e in estimates]
        return Judged(estimates, fits, [])
    if seen.rates["beta"].kind == INTERPOLATED:
        return Judged([refused(e) for e in estimates], [WindowFit() for _ in estimates], [Lack(INTERPOLATED)],
                      fitted=estimates)
    rows, asked, late, doubts = question_to(seen, config.terms if is_weak else asked_terms(config, estimates),
                                            optional if is_weak else (), is_weak, joining)
    if rows is None:
        return Judged([refused(e, EstimateStatus.SHORT) if e.valid else e for e in estimates],
                      [WindowFit() for _ in estimates], [], unchecked=asked.unchecked, fitted=estimates)
    made, covariances = _made(rows, estimates, asked, doubts, is_weak, config.formulation)
    lacks = {lack.what: lack for _, _, each, _ in made for lack in each}
    untested = sum(e.status == EstimateStatus.UNCHECKED for e, *_ in made)
    reason = asked.unchecked or (f"{untested} windows have too few rows to test {len(asked.terms)} coefficients: "
                                 "longer windows, or fewer gaps, allow it" if untested else "")
    terms, moving = asked.terms if is_weak else config.terms, tuple(x for x in config.terms if "beta" not in x)
    if is_weak and not np.ptp(rows.beta) and {"theta", "sin(theta)"} & set(moving) and moving != config.terms:
        rest = question(rows, tuple(dict.fromkeys((*moving, *optional))))
        if rest.pieces:
            terms, reason = rest.terms, ""
            lacks = {lack.what: lack for lack in (Lack(AT_REST), *rest.lacks)}
    return Judged([e for e, *_ in made], [fit for _, fit, *_ in made], list(lacks.values()), asked.lead, late, reason,
                  [fitted for *_, fitted in made], terms, covariances if is_weak else [],
                  tuple(term for term in asked.terms if term in joining and term not in config.terms), rows.top)


@lru_cache(maxsize=1)
def question_to(seen: CheckedLog, terms: tuple[str, ...], optional: tuple[str, ...], is_weak: bool,
                joining: tuple[str, ...] = ()) -> tuple[Rows | None, Question, Late | None, list[np.ndarray]]:
    """Return (usable rows of a log, the tests of its terms, how beta acts later than it is logged, betas (n,) that may
    act instead (`Late.doubts`)); cached, for one answer holds for all windows of a log.

    is_weak   the numbers are fitted to these rows: a beta that acts at another time than it is logged does so in them,
              what acts of `joining` joins the terms, and the tests are made again
    """
    logged = usable(seen)
    found = _asked(logged, terms, optional, is_weak, joining)
    if is_weak and logged is not None and not any(lack.what == "delay" for lack in found[1].lacks):
        top = agreeing_top(found[1].pieces, found[1].terms)
        if math.isfinite(top):
            by_all = means_of(found[1].pieces, found[1].terms)
            rows, asked, late, doubts = _asked(replace(logged, top=top), terms, optional, is_weak, joining)
            by_slow = means_of(asked.pieces, asked.terms)
            doubt = {term: (by_all[term] - value) ** 2 for term, value in by_slow.items() if term in by_all}
            found = rows, replace(asked, doubt=doubt), late, doubts
    rows, asked, late, doubts = found
    return rows, replace(asked, is_constant=is_constant(seen.nominal)), late, doubts


def is_constant(nominal: Nominal | None) -> bool:
    """Whether a nominal says that a6 and k1 do not change with time."""
    return nominal is not None and not np.ptp(nominal.vehicle.a6) and not np.ptp(nominal.vehicle.k1)


def _asked(logged: Rows | None, terms: tuple[str, ...], optional: tuple[str, ...], is_weak: bool,
           joining: tuple[str, ...]) -> tuple[Rows | None, Question, Late | None, list[np.ndarray]]:
    """Return the answer of `question_to` for the usable rows of a log."""
    rows, asked, late, doubts = logged, question(logged, terms, optional), None, list[np.ndarray]()
    for _ in range(MOST_NUISANCES if is_weak else 0):
        found = {lack.what: lack for lack in asked.lacks}
        if asked.is_placebo or "clock" in found or not found or logged is None:
            break
        if acting := tuple(what for what, lack in found.items() if what in joining and is_passive(lack)):
            terms = (*terms, *acting)
        elif late is None:
            wider = (*asked.terms, *(what for what in found if what in LACKING))
            lead = asked.lead if "delay" in found else lead_of(asked.pieces, asked.terms, logged)
            if lead is None or not lead.is_sure or lead.value < -EARLIEST * logged.period:
                break
            if lead.value < 0.0:
                late = Late(lead)
            else:
                late = late_input(logged, wider) if "delay" in found else late_input(logged, asked.terms, wider)
            if late is None:
                break
            rows, doubts = late.acting(logged), late.doubts(logged)
        else:
            break
        asked = question(rows, terms, optional, is_late=late is not None)
    return rows, asked if late is None else replace(asked, lead=late.lead), late, doubts


def asked_terms(config: Config, estimates: list[Estimate]) -> tuple[str, ...]:
    """Return those of the library's terms that any valid window has, all if no window is valid; and always beta, to
    test its placebo."""
    seen = {term for e in estimates if e.valid for term in active_terms(e)} or set(config.terms)
    return tuple(term for term in config.terms if term in seen or term == "beta")


def _made(rows: Rows, estimates: list[Estimate], asked: Question, doubts: list[np.ndarray],
          is_weak: bool, formulation: str) -> tuple[list[tuple[Estimate, WindowFit, list[Lack], Estimate]],
                                                    list[np.ndarray | None]]:
    """Return for every window (estimate, its fit, what it lacks, the estimate before it was refused), and its
    coefficients' covariance."""
    windows = list[tuple[Rows, tuple[str, ...], Modes | None]]()
    for e in estimates:
        terms = asked.terms if is_weak or not e.valid else active_terms(e)
        part = rows.part(rows.cut(e.t_start, e.t_end))
        m = term_modes(part, terms) if len(part.t) > 1 else None
        windows.append((part, terms, m if m and len(m.y) >= PER_COEFFICIENT * (len(terms) + 1) else None))
    fits = window_fits(rows, windows, asked.whole, doubts, is_weak)
    made = [((refused(e, EstimateStatus.UNCHECKED) if e.valid else e), WindowFit(), list[Lack](), e)
            if m is None or fit is None else _of_window(rows, part, m, fit, e, terms, asked, is_weak, formulation)
            for e, (part, terms, m), fit in zip(estimates, windows, fits, strict=True)]
    return made, [None if fit is None or fit.is_singular else fit.covariance for fit in fits]


def _of_window(rows: Rows, part: Rows, m: Modes, fit: Fit, e: Estimate, terms: tuple[str, ...], asked: Question,
               is_weak: bool, formulation: str) -> tuple[Estimate, WindowFit, list[Lack], Estimate]:
    """Return (a window's estimate, its fit, what it lacks, the estimate before it was refused)."""
    made = of_fit(part, m, fit, e, terms) if is_weak else widened(e, m, fit, terms, formulation)
    if asked.unchecked:
        return (refused(made, EstimateStatus.UNCHECKED) if made.valid else made), WindowFit(), [], made
    p, unexplained = left_over(fit, m) if not fit.is_singular else (None, None)
    shown = held_out(rows, made, p) if made.valid else WindowFit()
    if not made.valid:
        lacking = [lack for lack in asked.lacks if lack.is_most] or asked.lacks
        lacking = lacking if made.status in WEAK_STATUSES or asked.is_placebo else []
        return (refused(made) if lacking else made), shown, lacking, made
    values = dict(zip(made.terms, made.xi[:, 1].tolist(), strict=True))
    xi = np.array([values[term] for term in terms])
    std = np.array([made.terms_std.get(term, 0.0) for term in terms])
    lacking = against(part, terms, xi, std, fit, m, asked.lacks)
    if is_weak and asked.is_constant and lacking and (by := small_effect(part, terms, fit, m, lacking)) is not None:
        made = of_fit(part, m, replace(fit, covariance=fit.covariance + np.outer(by, by)), e, terms)
        if not made.valid:
            return made, shown, lacking, made
        std, lacking = np.array([made.terms_std[term] for term in terms]), []
    if unexplained is not None and not lacking:
        lacking = [unexplained]
    if is_weak and "theta_dot" in terms:
        k = terms.index("theta_dot")
        if is_driving(xi[k], std[k], np.abs(xi) * np.sqrt(np.sum(m.phi**2, axis=0)), k):
            lacking = [Lack("driving", size=float(xi[k]), std=float(std[k]))]
    if not is_weak and not lacking and not fit.is_singular and not agrees(m, fit, xi, std):
        lacking = [Lack("coefficients")]
    return (refused(made) if lacking else made), shown, lacking, made

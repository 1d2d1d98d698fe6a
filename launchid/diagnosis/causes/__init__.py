"""The causes that may be wrong: each cause of the catalogue as one record, all that the diagnosis knows of it.

To add a cause: its physics in `sim.effects`, its record in the file of its place here, its test.  Search, judge and
report ask the record; none of them knows a cause by its name.

A form is a cause of the catalogue under another law.  It is not sought beside the catalogue's hypotheses: it is
fitted in the place of a found cause that it resembles, and takes that place only where it explains more by
`TOLD_APART`.  Nearer than that it is one of the causes that the log cannot tell apart: a servo that is slow by a
first-order lag and one that is late are alike in a log no faster than the lag.  So it is offered only where all causes
that it resembles are: it would stand for the one that is missing.
"""

from collections.abc import Iterable

from ..data.record import Record
from . import actuator, environment, plant, sensor
from .controller import MISMATCH
from .environment import TURBULENCE, WIND_WALK
from .hypothesis import Cause, Correction, Form, Free, Hypothesis, Start, Steps, Values, pinned
from .plant import MISSING_TERM, missing_term

__all__ = ["HYPOTHESES", "LINES", "MISMATCH", "RECORDS", "SOUGHT", "Cause", "Correction", "Form", "Free", "Hypothesis",
           "Start", "Steps", "Values", "has_forms", "missing_term", "other_form", "pinned", "what_decides",
           "what_is_like"]

_PLACES = (*plant.CAUSES, *environment.CAUSES, *actuator.CAUSES, *sensor.CAUSES)
LINES = tuple(each for each in _PLACES if each.is_line)
HYPOTHESES = tuple(each for each in _PLACES if not each.is_line)
SOUGHT = (*HYPOTHESES, *LINES)
RECORDS = {each.cause: each for each in (*SOUGHT, MISSING_TERM, MISMATCH, TURBULENCE, WIND_WALK)}


def what_decides(cause: str, rivals: Iterable[str]) -> list[str]:
    """Measurements that would tell a cause from these: its own record's word first, then theirs."""
    among = set(rivals)
    own = [what for other, what in RECORDS[cause].decides if other in among]
    theirs = [what for each in RECORDS.values() if each.cause in among
              for other, what in each.decides if other == cause]
    return list(dict.fromkeys([*own, *theirs]))


def what_is_like(cause: str, rival: str) -> str | None:
    """The form in which one of two causes is like the other, where the catalogue's own is not."""
    return dict(RECORDS[cause].like).get(rival) or dict(RECORDS[rival].like).get(cause)


def has_forms(hypothesis: Hypothesis) -> bool:
    """Whether the hypothesis' cause has another form, be it this one."""
    return RECORDS[hypothesis.cause].form is not None


def other_form(record: Record, cause: Cause, known: Iterable[Hypothesis]) -> Cause | None:
    """The start of the search for another form of this cause; None: a known cause has none, or it is that."""
    form = cause.hypothesis.form
    if form is None:
        return None
    resembled = {form.hypothesis.cause, *(each.cause for each in SOUGHT
                                          if each.form is not None and each.form.hypothesis == form.hypothesis)}
    if not resembled <= {hypothesis.cause for hypothesis in known}:
        return None
    return Cause(form.hypothesis, form.start(record, cause.values))

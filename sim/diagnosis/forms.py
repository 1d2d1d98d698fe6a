"""Other physical forms of a cause: what the log may mean as well, once one that is like them is found.

A form is a cause of the catalogue under another law.  It is not sought beside the catalogue's hypotheses: it is
fitted in the place of a found cause that it resembles, and takes that place only where it explains more by
`TOLD_APART`.  Nearer than that it is one of the causes that the log cannot tell apart: a servo that is slow by a
first-order lag and one that is late are alike in a log no faster than the lag.  So it is offered only where all causes
that it resembles are: it would stand for the one that is missing.
"""

import math
from collections.abc import Callable, Iterable

from .fit import Cause
from .hypotheses import Hypothesis, Values, command_is_known, only_start, rate_limits, rates, size
from .record import Record

TOLD_APART = 4.0       # nats: a rival so near explains the log as well (odds of 55 to 1 are beyond doubt's reach)
FIRST_WIND_UP = 0.3    # from where its search starts, and the share of the rate limit that it makes up for
MOST_WIND_UP = 20.0

LAG = Hypothesis("actuator_bandwidth", (size("scale", 0.02, 0.02, 1.0),), 1.0, only_start, command_is_known,
                 fixed=(("lag", 1.0),))
WIND_UP = Hypothesis("actuator_rate_limit", (rate_limits(), size("wind_up", 0.05, 0.0, MOST_WIND_UP)), math.inf,
                     lambda record: [(FIRST_WIND_UP,)], command_is_known, rates)


def _as_lag(record: Record, values: Values) -> Values:
    """A lag as late as the delay [s]."""
    servo = record.actuator
    return (1.0 / (1.0 + values[0] * servo.natural_frequency / (2.0 * servo.damping_ratio)),)


def _as_slow(record: Record, values: Values) -> Values:
    return (min(values[0], 1.0),)


def _ahead(record: Record, values: Values) -> Values:
    """The lower limit that a servo wound up keeps to as often."""
    return values[0] / (1.0 + FIRST_WIND_UP), FIRST_WIND_UP


FORMS: dict[str, tuple[Hypothesis, Callable[[Record, Values], Values]]] = {
    "actuator_delay": (LAG, _as_lag), "actuator_bandwidth": (LAG, _as_slow), "actuator_rate_limit": (WIND_UP, _ahead)}


def other_form(record: Record, cause: Cause, known: Iterable[Hypothesis]) -> Cause | None:
    """Where the search of another form of this cause starts; None: there is none of a known cause, or it is that."""
    if cause.hypothesis.label not in FORMS or cause.hypothesis == FORMS[cause.hypothesis.label][0]:
        return None
    form, start = FORMS[cause.hypothesis.label]
    resembled = {form.cause, *(label for label, (other, _) in FORMS.items() if other == form)}
    if not resembled <= {hypothesis.cause for hypothesis in known}:
        return None
    return Cause(form, start(record, cause.values))

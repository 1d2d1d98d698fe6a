"""Read the text of a requirement on a campaign.

    lost<PROBABILITY@CONFIDENCE             a flight is lost with a probability below PROBABILITY
    METRIC<VALUE:SHARE@CONFIDENCE           more than SHARE of the flights keep METRIC below VALUE

Both ask for the same thing: a flight fails with a probability below `probability`, said with `confidence`.  A flight
that is lost fails every requirement.
"""

import re
from dataclasses import dataclass
from decimal import Decimal

from sim.errors import UsageError

from ..journal import Row
from .flight import METRICS

NUMBER = r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
PERCENT = re.compile(rf"{NUMBER}\s*%", re.ASCII)   # as a share
REQUIREMENT = re.compile(rf"\s*(\w+)\s*<\s*{NUMBER}\s*(?::\s*{NUMBER}\s*)?@\s*{NUMBER}\s*", re.ASCII)
SHOWN_TEXT = 60  # characters of a wrong text that are shown
EXPECTED = ("expected lost<PROBABILITY@CONFIDENCE as in 'lost<0.00135@0.9', or METRIC<VALUE:SHARE@CONFIDENCE as in "
            "'max_alpha<0.2:0.99@0.9'")


@dataclass(frozen=True)
class Requirement:
    """A flight fails with a probability below `probability`, to prove with `confidence`; it fails if it is lost or if
    `metric` is not below `limit`."""

    text: str
    metric: str          # lost, or one of METRICS
    limit: float | None  # of the metric; None: of lost
    probability: float
    confidence: float

    def fails(self, row: Row) -> bool:
        """Whether the flight of this row fails: it is lost, or its metric is not below the limit, or NaN."""
        if row["lost"] or self.limit is None:
            return bool(row["lost"])
        return not float(row[self.metric]) < self.limit


def requirement(text: str) -> Requirement:
    """Return the requirement that a text says, as in `lost<0.00135@0.9`; UsageError of one line for any other text."""
    match = REQUIREMENT.fullmatch(PERCENT.sub(lambda found: str(Decimal(found[1]) / 100), text))
    if match is None:
        raise _wrong(text, EXPECTED)
    metric, limit, share, confidence = match.groups()
    if metric != "lost" and metric not in METRICS:
        raise _wrong(text, f"{metric} is not measured; expected lost, {', '.join(METRICS)}")
    if (metric == "lost") == (share is not None):
        raise _wrong(text, EXPECTED)
    _between(text, "the confidence", confidence)
    if share is None:
        _between(text, "the probability", limit)
        return Requirement(text.strip(), metric, None, float(limit), float(confidence))
    if not 0.0 < float(limit) < float("inf"):
        raise _wrong(text, f"the value {limit}: expected above 0 {METRICS[metric]}, for {metric} is a magnitude")
    _between(text, "the share", share)
    return Requirement(text.strip(), metric, float(limit), float(1 - Decimal(share)), float(confidence))


def _between(text: str, name: str, number: str) -> None:
    if not 0.0 < float(number) < 1.0:
        raise _wrong(text, f"{name} {number}: expected between 0 and 1, neither of them")


def _wrong(text: str, why: str) -> UsageError:
    shown = text if len(text) <= SHOWN_TEXT else text[:SHOWN_TEXT] + "..."
    return UsageError(f"--requirement {shown!r}: {why}")

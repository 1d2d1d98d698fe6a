"""A selection with one thing changed: one of its causes."""

from collections.abc import Iterator
from dataclasses import replace

from .profile import TOLD_APART, penalty, profile
from .selection import Ranked, Selection

NEAREST = 2           # rivals of a cause that are tried in its place where it is in doubt


def instead_of_each(of: Selection) -> Iterator[Selection]:
    """The selection with one cause replaced by another that explains the log as well, the nearest first, all else
    fitted anew; what was replaced is no rival any more."""
    fitted = of.model.fit
    for k, (own, *rivals) in enumerate(of.rivals):
        near = [each for each in rivals if each.evidence > own.evidence - TOLD_APART]
        for rival in near[:NEAREST]:
            causes = (*of.model.causes[:k], rival.cause, *of.model.causes[k + 1:])
            model = profile(fitted.record, causes, fitted.delta, fitted.filter)
            evidence = own.evidence + model.log_likelihood - of.model.log_likelihood + \
                penalty(fitted.record, own.cause.hypothesis) - penalty(fitted.record, rival.cause.hypothesis)
            others = [Ranked(model.causes[k], evidence), *(each for each in rivals if each is not rival)]
            yield replace(of, model=model, evidence=[*of.evidence[:k], evidence, *of.evidence[k + 1:]],
                          rivals=[*of.rivals[:k], others, *of.rivals[k + 1:]])

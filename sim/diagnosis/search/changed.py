"""A selection with one thing changed: its time, its noise levels, one of its causes."""

from collections.abc import Iterator
from dataclasses import replace

from .profile import TOLD_APART, Model, penalty, profile
from .selection import Ranked, Selection

NEAREST = 2           # rivals of a cause that are tried in its place where it is in doubt


def with_time(of: Selection, until: float) -> Selection:
    """The same with time until then [s of the diagnosis' clock]."""
    def later(model: Model) -> Model:
        return replace(model, fit=replace(model.fit, record=replace(model.fit.record, until=until)))

    nominal = later(of.nominal)
    return replace(of, nominal=nominal, model=nominal if of.model is of.nominal else later(of.model),
                   calm=None if of.calm is None else later(of.calm),
                   instead=None if of.instead is None else with_time(of.instead, until))


def relevelled(of: Selection) -> Selection:
    """The same with the noise levels fitted to its causes, for which a search that was cut had no time."""
    if not of.model.causes:
        return of
    fitted = of.model.fit
    return replace(of, model=profile(fitted.record, (), fitted.delta, fitted.filter, fitted=fitted))


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

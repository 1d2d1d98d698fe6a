"""A diagnosis in plain words, for the terminal and the report's first lines."""

import math
from collections.abc import Mapping

from sim.shown import saying_what_plus_minus_is, with_std

from ..causes import RECORDS, Cause, what_decides, what_is_like
from ..judge.diagnosis import Diagnosis
from ..judge.gain import Gain
from ..judge.limits import Limit
from ..judge.measure import percent
from ..judge.named import Named

ANGULAR = ("rad", "rad/s", "rad/s^2")
ALONE = 3              # digits of a value whose standard deviation nobody made
NOTHING = 0.005        # of the error: rounded to percent, none
NATS = ": by so much the log-likelihood rises with it beside all else in the model, less a penalty for its numbers; " \
       "3 nats are odds of 20 to 1"

def error_words(gain: Gain) -> str:
    """The words that define the error."""
    return f"error: mean square of the errors of predictions {gain.longest:g} s ahead, beyond noise, on held-out " \
           "rows, to which nothing was fitted"


def amount(value: float | str, std: float | None, unit: str, hertz: bool = False) -> str:
    """A value with its standard deviation, to two digits of that; angles in degrees too, a frequency in Hz."""
    if isinstance(value, str):
        return value
    shown = with_std(value, std) if std and math.isfinite(std) else f"{value:.{ALONE}g}"
    if unit == "rad/s" and hertz:
        return f"{shown} rad/s ({value / (2.0 * math.pi):.3g} Hz)"
    degrees = f" ({math.degrees(value):.3g} {unit.replace('rad', 'deg')})" if unit in ANGULAR and value else ""
    return f"{shown}{' ' + unit if unit else ''}{degrees}"


def sentence(cause: Named) -> str:
    """The sentence that says what a cause means, with its size."""
    units = {**cause.units, **({"coefficient": ""} if "term" in cause.values else {})}
    values = {name: amount(value, cause.std.get(name), units.get(name, ""), name == "frequency")
              for name, value in cause.values.items()}
    steps = ", ".join(f"{fraction:.3g} at {time:.2f} s" for time, fraction in cause.steps)
    return cause.record.meaning(cause.values).format(**values) + (f", gradually: {steps}" if steps else "")


def values_words(cause: Cause, shift: float) -> str:
    """The values of a ranked cause, without their standard deviations, which are not made for what is not chosen.

    shift  [s] of the record's clock
    """
    of = cause.hypothesis
    said = [f"{name} {value}" for name, value in of.fixed]
    for free, value in zip(of.free, cause.values, strict=True):
        at = value + shift if free.name == "time" else value
        said.append(f"{free.name} {amount(at, None, of.unit(free.name), free.name == 'frequency')}")
    return ", ".join(said)


def alternatives(made: Diagnosis, cause: Named) -> list[str]:
    """The causes that the log cannot distinguish from a cause: with form where the catalogue's own is not like it, and
    size."""
    sizes: dict[str, str] = {}
    if made.selection is not None and made.record is not None:
        for chosen, ranking in zip(made.selection.model.causes, made.selection.rivals, strict=False):
            if chosen.hypothesis.cause == cause.cause:
                for each in ranking:
                    sizes.setdefault(each.cause.hypothesis.cause, values_words(each.cause, made.record.shift))
    return _rivals(cause, sizes)


def look_alikes(cause: Named) -> str:
    """The same without a diagnosis, and so without sizes."""
    return ", ".join(_rivals(cause, {}))


def _rivals(cause: Named, sizes: Mapping[str, str]) -> list[str]:
    said = []
    for rival in cause.rivals:
        how = [words for words in (what_is_like(cause.cause, rival), sizes.get(rival)) if words]
        said.append(rival + (f" ({'; '.join(how)})" if how else ""))
    return said


def would_decide(cause: Named) -> list[str]:
    """Measurements that would tell a cause from its look-alikes."""
    return what_decides(cause.cause, cause.rivals)


def places(made: Diagnosis) -> str:
    """The places where the causes may be: a set that spans places names them all."""
    sets = [list(dict.fromkeys((cause.where, *(RECORDS[rival].where for rival in cause.rivals))))
            for cause in made.causes]
    return " and ".join(dict.fromkeys(", ".join(of[:-1]) + " or " + of[-1] if len(of) > 1 else of[0] for of in sets))


def predicts_better(made: Diagnosis) -> bool:
    """The model with its causes is better than the nominal on rows that nothing was fitted to; else it is not shown."""
    gain = made.gain
    return gain is not None and gain.nats > 0.0 and (gain.share is None or gain.share < 1.0)


def headline(made: Diagnosis) -> str:
    """The verdict in one sentence."""
    if made.verdict == "bad-data":
        return f"BAD DATA: {len(made.data.faults)} fault(s) in the log; nothing about the vehicle is claimed."
    if made.verdict == "consistent":
        return "CONSISTENT: the log is what the simulation would have given; nothing is wrong that it could show."
    if made.is_cut_short:
        return "UNEXPLAINED: the search was stopped before its end; nothing is concluded from it."
    if made.verdict == "unexplained" and made.selection is None:
        return "UNEXPLAINED: the simulation does not stay with the log, so no cause was sought."
    if made.verdict == "unexplained":
        return f"UNEXPLAINED: simulation and measurement part at the {made.where}, and no known cause fits."
    causes = " and ".join(" or ".join((cause.label, *cause.rivals)) for cause in made.causes)
    if made.verdict == "dominant":
        share = made.gain.share if made.gain is not None else None
        rest = "not all is explained" if share is None else shares(share)
        return f"DOMINANT ({places(made)}): {causes}; {rest}."
    return f"EXPLAINED ({places(made)}): {causes}."


def shares(left: float) -> str:
    """The words for the share of the error that is explained and the share `left` that remains."""
    gone, rest = percent(left)
    return f"{gone} of the error explained, {rest} remain"


def how_it_ended(made: Diagnosis) -> list[str]:
    """The reason why the search is not complete; [] where it is."""
    own = made.nominal.diagnosis
    if made.is_cut_short:
        return [f"the search was stopped after {own.time_limit:g} s ([diagnosis] time_limit): whether a known cause "
                "fits is not known"]
    if made.is_spent:
        return [f"the search ended with its effort ([diagnosis] effort, {own.effort:g}): the best answer so far"]
    return []


def worth(made: Diagnosis) -> str | None:
    """The words for how much of the error the causes explain, what remains and where; None without causes."""
    if not made.causes:
        return None
    gain, rest = made.gain, made.remainder
    if gain is None:
        said = "what they take away was not measured"
    elif gain.share is None:
        said = f"over {gain.longest:g} s all error of the simulation may be noise; {percent(gain.whole)[1]} of its " \
               "square remain with the causes"
    elif gain.share < NOTHING and made.verdict == "explained":
        said = "the whole error is explained"
    else:
        said = shares(gain.share)
    if made.verdict != "dominant" or rest is None:
        return f"{said}."
    return f"{said}; what remains is at the {rest.where}: {rest.words}."


def lines(made: Diagnosis) -> list[str]:
    """The whole verdict for a terminal."""
    said = [headline(made)]
    said += [f"  {fault.message}" for fault in made.data.faults]
    if made.used is not None:
        said.append(f"  {made.used.words}")
    said += [f"  {words}" for words in how_it_ended(made)]
    for k, cause in enumerate(made.causes):
        said.append(f"  {cause.label}: {sentence(cause)} (evidence {cause.evidence:.0f} nats{'' if k else NATS})")
        if cause.where == "controller" and made.controller is not None and made.controller.time_constant is not None:
            said.append(f"    and the time constant of its derivative is {made.controller.time_constant:.4g} s")
        if cause.rivals:
            decides = would_decide(cause)
            said.append(f"    this log cannot distinguish it from {', '.join(alternatives(made, cause))}"
                        + (f"; this would: {' or '.join(decides)}" if decides else ""))
    said += [f"  within what the nominal leaves open, so not named as a cause: {cause.label}: {sentence(cause)}"
             for cause in made.open]
    explains = worth(made)
    if explains is not None:
        gain = made.gain
        said.append(f"  {explains}" + ("" if gain is None or gain.share is None else f" ({error_words(gain)})"))
    said += [f"  doubt: {doubt}" for doubt in made.doubts]
    if made.verdict == "dominant":
        said += [f"  not everything is explained: {reason}" for reason in made.remaining]
    for k, cause in enumerate(made.nearest):
        said.append(f"  nearest (not the cause): resembles {cause.label}, {cause.evidence:.0f} nats"
                    f"{'' if k else NATS}")
    if made.proposal is not None:
        said.append(f"  proposal: {made.proposal}")
    said += _gain_lines(made) + _ranking_lines(made) + _noise_lines(made) + _limit_lines(made)
    return saying_what_plus_minus_is(said)


def _gain_lines(made: Diagnosis) -> list[str]:
    gain = made.gain
    if gain is None:
        return []
    if not predicts_better(made):
        return [f"gain on {gain.source} (nothing fitted to them): none; with the nearest causes the predictions are no "
                "better, so they are not shown"]
    said = [f"gain on {gain.source} (nothing fitted to them): {gain.nats:.0f} nats; prediction error over its change "
            "(0: perfect, 1: no better than no change),",
            f"  {'horizon':>8}  " + "  ".join(f"{channel:>22}" for channel in gain.nrmse[gain.longest])]
    for horizon, row in gain.nrmse.items():
        said.append(f"  {horizon:>6g} s  " + "  ".join(f"{before:>9.3g} -> {after:<9.3g}"
                                                       for before, after in row.values()))
    if made.user is not None:
        said.append("  on-board estimator on flights of the extension, RMS error (share of 95 % intervals that hold): "
                    + ", ".join(f"{name} {100 * made.user.error[name][0]:.2g} % ({made.user.coverage[name][0]:.2f}) -> "
                                f"{100 * made.user.error[name][1]:.2g} % ({made.user.coverage[name][1]:.2f})"
                                for name in ("a6", "k1") if math.isfinite(made.user.error[name][1])))
    if gain.closed_loop is not None:
        said.append(f"  closed loop simulated again: attitude error {gain.closed_loop[0]:.3g} -> "
                    f"{gain.closed_loop[1]:.3g} rad rms")
    return said


def _ranking_lines(made: Diagnosis) -> list[str]:
    if made.selection is None or not made.selection.rankings or not made.selection.rankings[0]:
        return []
    said = [f"ranking of the first cause (nats of evidence of each alone, before others join; {made.threshold:.0f} "
            "needed)"]
    for each in made.selection.rankings[0]:
        values = values_words(each.cause, 0.0 if made.record is None else made.record.shift)
        said.append(f"  {each.cause.hypothesis.cause:<24}{each.evidence:>10.0f}  {values}")
    return said


def _noise_lines(made: Diagnosis) -> list[str]:
    if not made.noise:
        return []
    levels = ", ".join(f"{name} x{level['factor']:.2f}{' (differs)' if level['significant'] else ''}"
                       for name, level in made.noise.items())
    return [f"noise levels relative to the nominal's: {levels}"]


def given(limit: Limit) -> str:
    """The other parameters of a cause at which its limit holds, in words."""
    units = ((name, value, RECORDS[limit.cause].unit(name)) for name, value in limit.at)
    return ", ".join(f"{name} {value:.4g}{f' {unit}' if unit else ''}" for name, value, unit in units)


def _limit_lines(made: Diagnosis) -> list[str]:
    if not made.limits:
        return []
    seen = [limit for limit in made.limits if limit.size is not None]
    blind = [limit.cause for limit in made.limits if limit.size is None]
    said = ["detection limits (sizes that this log shows with 50 % probability):"]
    for limit in seen:
        assert limit.size is not None
        at = given(limit)
        away = "" if limit.neutral == 0.0 or math.isinf(limit.neutral) else f" from {limit.neutral:g}"
        where = f" ({at})" if at else ""
        said.append(f"  {limit.cause:<24}{limit.parameter} {limit.size:.2g} {limit.unit}{away}{where}")
    if blind:
        said.append(f"  at no size: {', '.join(blind)}")
    return said

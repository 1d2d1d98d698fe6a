"""A diagnosis in plain words, for the terminal and the report's first lines."""

import math

from ..causes import what_decides, what_is_like
from ..judge.diagnosis import Diagnosis
from ..judge.named import Named
from ..judge.user_gain import INTERVAL

ANGULAR = ("rad", "rad/s", "rad/s^2")


def amount(value: float | str, std: float | None, unit: str, hertz: bool = False) -> str:
    """A value with its 95 % half-width; angles in degrees too, a frequency in Hz."""
    if isinstance(value, str):
        return value
    spread = "" if not std or not math.isfinite(std) else f" +- {INTERVAL * std:.2g}"
    if unit == "rad/s" and hertz:
        return f"{value:.4g}{spread} rad/s ({value / (2.0 * math.pi):.3g} Hz)"
    degrees = f" ({math.degrees(value):.3g} {unit.replace('rad', 'deg')})" if unit in ANGULAR and value else ""
    return f"{value:.4g}{spread}{' ' + unit if unit else ''}{degrees}"


def sentence(cause: Named) -> str:
    """What a cause means, with its size."""
    units = {**cause.units, **({"coefficient": ""} if "term" in cause.values else {})}
    values = {name: amount(value, cause.std.get(name), units.get(name, ""), name == "frequency")
              for name, value in cause.values.items()}
    steps = ", ".join(f"{fraction:.3g} at {time:.2f} s" for time, fraction in cause.steps)
    return cause.record.meaning(cause.values).format(**values) + (f", gradually: {steps}" if steps else "")


def look_alikes(cause: Named) -> str:
    """What the log cannot tell a cause from; in which form, where the catalogue's own is not like it."""
    like = {rival: what_is_like(cause.cause, rival) for rival in cause.rivals}
    return ", ".join(rival if how is None else f"{rival} ({how})" for rival, how in like.items())


def would_decide(cause: Named) -> list[str]:
    """Measurements that would tell a cause from its look-alikes."""
    return what_decides(cause.cause, cause.rivals)


def headline(made: Diagnosis) -> str:
    """The verdict in one sentence."""
    if made.verdict == "bad-data":
        return f"BAD DATA: {len(made.data.faults)} fault(s) in the log; nothing about the vehicle is claimed."
    if made.verdict == "consistent":
        return "CONSISTENT: the log is what the simulation would have given; nothing is wrong that it could show."
    if made.verdict == "unexplained":
        return f"UNEXPLAINED: simulation and measurement part at the {made.where}, and no known cause fits."
    causes = " and ".join(" or ".join((cause.label, *cause.rivals)) for cause in made.causes)
    if made.verdict == "dominant":
        assert made.remainder is not None
        return f"DOMINANT ({made.where}): {causes}; {100 * made.remainder.share:.0f} % of the error remain, at the " \
               f"{made.remainder.where}: {made.remainder.words}."
    return f"EXPLAINED ({made.where}): {causes}."


def lines(made: Diagnosis) -> list[str]:
    """The whole verdict for a terminal."""
    said = [headline(made)]
    said += [f"  {fault.message}" for fault in made.data.faults]
    if made.used is not None:
        said.append(f"  {made.used.words}")
    if made.is_cut_short:
        said.append(f"  the search was ended after its time ({made.nominal.diagnosis.time_limit:g} s, [diagnosis] "
                    "time_limit): the best answer so far")
    for cause in made.causes:
        said.append(f"  {cause.label}: {sentence(cause)} (evidence {cause.evidence:.0f} nats)")
        if cause.where == "controller" and made.controller is not None and made.controller.time_constant is not None:
            said.append(f"    and the time constant of its derivative is {made.controller.time_constant:.4g} s")
        if cause.rivals:
            decides = would_decide(cause)
            said.append(f"    this log cannot tell it from {look_alikes(cause)}"
                        + (f"; what would: {' or '.join(decides)}" if decides else ""))
    said += [f"  no cause, the nominal leaves so much open: {cause.label}: {sentence(cause)}" for cause in made.open]
    said += [f"  doubt: {doubt}" for doubt in made.doubts]
    if made.verdict == "dominant":
        said += [f"  not all: {reason}" for reason in made.remaining]
    for cause in made.nearest:
        said.append(f"  nearest (not the cause): resembles {cause.label}, {cause.evidence:.0f} nats")
    if made.proposal is not None:
        said.append(f"  proposal: {made.proposal}")
    said += _gain_lines(made) + _ranking_lines(made) + _noise_lines(made) + _limit_lines(made)
    return said


def _gain_lines(made: Diagnosis) -> list[str]:
    gain = made.gain
    if gain is None:
        return []
    said = [f"gain on {gain.source} (nothing fitted to them): {gain.nats:.0f} nats; prediction error over its change,",
            f"  {'horizon':>8}  " + "  ".join(f"{channel:>22}" for channel in gain.nrmse[1.0])]
    for horizon, row in gain.nrmse.items():
        said.append(f"  {horizon:>6g} s  " + "  ".join(f"{before:>9.4f} -> {after:<9.4f}"
                                                       for before, after in row.values()))
    if made.user is not None:
        said.append("  a6, k1 by the on-board estimator, flights of the extension, RMS error (95 % intervals hold): "
                    + ", ".join(f"{name} {100 * made.user.error[name][0]:.2g} % ({made.user.coverage[name][0]:.2f}) -> "
                                f"{100 * made.user.error[name][1]:.2g} % ({made.user.coverage[name][1]:.2f})"
                                for name in ("a6", "k1")))
    if gain.closed_loop is not None:
        said.append(f"  closed loop simulated again: attitude error {gain.closed_loop[0]:.3g} -> "
                    f"{gain.closed_loop[1]:.3g} rad rms")
    return said


def _ranking_lines(made: Diagnosis) -> list[str]:
    if made.selection is None or not made.selection.rankings or not made.selection.rankings[0]:
        return []
    said = [f"ranking (nats of evidence after the penalty; {made.threshold:.0f} needed)"]
    for each in made.selection.rankings[0]:
        values = ", ".join(f"{free.name} {value:.4g}" for free, value in
                           zip(each.cause.hypothesis.free, each.cause.values, strict=True))
        said.append(f"  {each.cause.hypothesis.cause:<24}{each.evidence:>10.1f}  {values}")
    return said


def _noise_lines(made: Diagnosis) -> list[str]:
    if not made.noise:
        return []
    levels = ", ".join(f"{name} x{level['factor']:.2f}{' (differs)' if level['significant'] else ''}"
                       for name, level in made.noise.items())
    return [f"noise over the nominal's: {levels}"]


def _limit_lines(made: Diagnosis) -> list[str]:
    if not made.limits:
        return []
    seen = [limit for limit in made.limits if limit.size is not None]
    blind = [limit.cause for limit in made.limits if limit.size is None]
    said = ["could not have been seen below (even odds):"]
    for limit in seen:
        assert limit.size is not None
        at = ", ".join(f"{name} {value:.4g}" for name, value in limit.at)
        away = "" if limit.neutral == 0.0 or math.isinf(limit.neutral) else f" from {limit.neutral:g}"
        where = f" ({at})" if at else ""
        said.append(f"  {limit.cause:<24}{limit.parameter} {limit.size:.2g} {limit.unit}{away}{where}")
    if blind:
        said.append(f"  not at all: {', '.join(blind)}")
    return said

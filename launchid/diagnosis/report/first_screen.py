"""The first screen of a report: the verdict in plain words, what looks like it, what it rests on and is worth.

Each term is explained where it first stands.
"""

import math

from sim.shown import PLUS_MINUS

from ...charts.markup import list_of, text
from ..judge.constancy import CONSTANCY_LIMIT, SEGMENTS
from ..judge.diagnosis import Diagnosis
from ..judge.measure import NOISE
from ..search.selection import needed
from .words import NATS, alternatives, error_words, how_it_ended, predicts_better, sentence, worth, would_decide

NARROW = 0.5            # of a limit: a test passed so narrowly is worth a word
THIN = 2.0              # times the evidence needed: less is worth a word
CHANNEL_WORDS = {"theta": "attitude sensor", "theta_dot": "gyro", "beta": "nozzle sensor"}


def plain(made: Diagnosis) -> str:
    """The finding: how large it is, how much of the error it explains, what remains and where; HTML."""
    said = _cause_lines(made)
    explains = worth(made)
    if explains is not None:
        said.append(f"<b>{text(explains[0].upper() + explains[1:])}</b>")
    terms = [] if made.gain is None or made.gain.share is None or explains is None else [f"{error_words(made.gain)}."]
    terms += [f"Nats{NATS}."] if any(" nats" in line for line in said) else []
    terms += [f"{PLUS_MINUS}."] if any("&plusmn;" in line for line in said) else []
    note = f'<p class="note">{text(" ".join(each[0].upper() + each[1:] for each in terms))}</p>' if terms else ""
    return f'<div class="plain">{"".join(f"<p>{line}</p>" for line in said)}{note}</div>'


def rows(made: Diagnosis) -> str:
    """The rows below the picture that say what the verdict rests on; HTML."""
    said: list[tuple[str, list[str]]] = []
    if made.verdict != "bad-data":
        said += [("Cannot be told from", _alike_lines(made)), ("Evidence", [text(x) for x in evidence(made)]),
                 ("Gain", [_gain_line(made)])]
    if made.verdict == "dominant":
        said.append(("Not all", [text(reason) for reason in made.remaining]))
    said.append(("Doubts", [text(doubt) for doubt in doubts(made)]))
    return "<dl>" + "".join(f"<dt>{name}</dt><dd>{list_of(lines)}</dd>" for name, lines in said if lines) + "</dl>"


def _cause_lines(made: Diagnosis) -> list[str]:
    if made.verdict == "bad-data":
        return [text(fault.message) for fault in made.data.faults]
    if made.is_cut_short:
        return [text(f"{words[0].upper()}{words[1:]}.") for words in how_it_ended(made)]
    if made.verdict == "consistent":
        return ["No cause is needed: what is measured less what is simulated is noise."]
    if made.causes:
        return [f"<b>{text(each.label)}</b>: {text(sentence(each))}"
                + text(f"; or, as well, {' or '.join(alternatives(made, each))}" if each.rivals else "") + "."
                for each in made.causes]
    if made.selection is None:
        return ["None was sought: over a simulation that runs away no cause has evidence."]
    near = ", ".join(f"{each.label}, {sentence(each)} ({each.evidence:.0f} nats)" for each in made.nearest)
    lines = ["None of the catalogue. " + text(f"The nearest, which is not the cause: {near}." if near else
                                              "No known cause comes near.")]
    return lines + ([f"Proposal: {text(made.proposal)}"] if made.proposal is not None else [])


def _alike_lines(made: Diagnosis) -> list[str]:
    """The set that a cause belongs to, with the sizes that would do, and what would decide."""
    lines = []
    for each in made.causes:
        if each.rivals:
            decides = would_decide(each)
            lines.append(f"<b>{text(each.label)}</b> from {text(', '.join(alternatives(made, each)))} in this log; "
                         + text(f"what would decide: {' or '.join(decides)}." if decides else
                                "a log with other manoeuvres might decide."))
    return lines or (["Nothing: every other cause explains the log clearly worse."] if made.causes else [])


def evidence(made: Diagnosis) -> list[str]:
    """The evidence of the verdict, a line each; its first says what a nat is, and a limit."""
    worst = max(made.left, key=lambda each: each.gain / each.limit, default=None)
    left = "" if worst is None else f"A disturbance {worst.words} explains {worst.gain:.0f} nats more (limit, what " \
                                    f"chance gives: {worst.limit:.0f})."
    if made.verdict == "consistent":
        tried = [step[0] for step in made.selection.rankings if step] if made.selection is not None else []
        best = f"The best, {tried[0].cause.hypothesis.cause}, reached {tried[0].evidence:.1f}." if tried else ""
        return [f"No hypothesis reached the {made.threshold:.0f} nats needed{NATS}. {best} {left}".replace("  ", " ")]
    lines: list[str] = []
    for each in made.causes or made.nearest:
        least = needed(made.threshold, len(lines))
        same = f" ({least:.0f} needed); its size over {SEGMENTS} parts of the log: chi-squared " \
               f"{each.constancy.chi_squared:.0f}, limit {CONSTANCY_LIMIT:.0f} (a true cause is the same all along)" \
               if each.constancy is not None else ""
        lines.append(f"{'' if made.causes else 'nearest, '}{each.label}: {each.evidence:.0f} nats{same}"
                     f"{'' if lines else NATS.replace(': by', '; nats: by')}.")
    return [*lines, left] if left else lines


def _gain_line(made: Diagnosis) -> str:
    gain = made.gain
    if gain is None:
        return "None to measure: the model was not extended." if made.verdict == "consistent" else \
            "Not measured: there is no extended model to measure."
    if not predicts_better(made):
        return text("None: with the nearest causes the predictions are no better, so they are not shown. Held out "
                    f"({gain.source}).")
    shares = ", ".join(f"{channel} {before:.3g} -> {after:.3g}" for channel, (before, after)
                       in gain.nrmse[gain.longest].items() if math.isfinite(before + after)) or "not measurable"
    loop = "" if gain.closed_loop is None else \
        f"; attitude in closed loop {gain.closed_loop[0]:.2g} -> {gain.closed_loop[1]:.2g} rad rms"
    which = "" if made.causes else "With the nearest, which is not the cause: "
    return text(f"{which}Error of predicting {gain.longest:g} s ahead, as a share of the channel's change: {shares}"
                f"{loop}. Held out (rows to which nothing was fitted, {gain.source}): {gain.nats:+.0f} nats.")


def doubts(made: Diagnosis) -> list[str]:
    """The doubts about the verdict or its bounds; never empty."""
    if made.verdict == "bad-data":
        return ["Nothing about the vehicle is concluded from a log with faults."]
    said = [*how_it_ended(made), *made.doubts]
    for k, each in enumerate(made.causes):
        least = needed(made.threshold, k)
        if each.evidence < THIN * least:
            said.append(f"{each.cause}: little evidence, {each.evidence:.0f} nats, {least:.0f} needed")
        if each.constancy is not None and NARROW * CONSTANCY_LIMIT < each.constancy.chi_squared <= CONSTANCY_LIMIT:
            said.append(f"{each.cause}: its size varies along the log more than most true causes' "
                        f"(chi-squared {each.constancy.chi_squared:.0f}, limit {CONSTANCY_LIMIT:.0f})")
    said += [f"something small may be left at the {each.disturbance.place}, {each.words}" for each in made.left[:1]
             if NARROW * each.limit < each.gain <= each.limit]
    loud = [f"{name} {level['factor']:.3g}" for name, level in made.noise.items() if level["significant"]]
    if loud:
        said.append(f"noise differs from the declared, by factors of: {', '.join(loud)} "
                    f"(beyond {NOISE:g} it forbids EXPLAINED)")
    missing = [word for name, word in CHANNEL_WORDS.items() if made.record and name not in made.record.channels]
    if missing:
        said.append(f"the log has no {' and no '.join(missing)}: what only it shows was not looked for")
    return said or ["None of the tests failed or came near its limit. Causes smaller than the limits below "
                    "cannot be excluded."]

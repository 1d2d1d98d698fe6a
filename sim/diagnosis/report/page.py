"""The report of a diagnosis: one page that needs no network, the verdict as JSON, the extended nominal, the figures.

The first screen holds verdict, cause, evidence, gain and doubts; what follows is what they rest on.  Figures need
matplotlib; without it the page says so and has everything else.
"""

import base64
import json
import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from ...effects import CATALOGUE
from ...errors import InputError
from ...files import remove, write_text
from ...nominal import write_nominal
from ..data.record import CHANNELS
from ..data.world import SLOW_MOMENT, TURBULENCE, WALK
from ..judge.constancy import CONSTANCY_LIMIT, SEGMENTS
from ..judge.diagnosis import Diagnosis
from ..judge.gain import Gain
from ..judge.limits import LOOK_ALIKE, Limit
from ..judge.user_gain import INTERVAL
from ..model.noise import LEVELS, declared
from ..search.selection import needed
from .answer import NEARLY_ALIKE
from .words import ANGULAR, amount, headline, look_alikes, sentence, would_decide

NARROW = 0.5            # of a limit: a test passed so narrowly is worth a word
THIN = 2.0             # times the evidence needed: less is worth a word
WORLD_UNITS = {TURBULENCE: "rad", WALK: "rad/sqrt(s)", SLOW_MOMENT: "rad/s^2"}
NOISE_UNITS = ("rad", "rad/s", "rad", "rad", "rad/s^2")
CHANNEL_WORDS = {"theta": "attitude sensor", "theta_dot": "gyro", "beta": "nozzle sensor"}
COLOURS = {"consistent": "#1b5e20", "explained": "#12355b", "dominant": "#3b3170", "unexplained": "#8a4b00",
           "bad-data": "#7f1d1d"}
EXTENSION = ("extension.toml", "extension.vehicle.csv", "extension.uncertainty.csv")
NO_FIGURES = "There are no figures: they need matplotlib (pip install 'launchid[plots]')."
TEMPLATE = Path(__file__).with_name("template.html")

Drawn = list[tuple[str, bytes]]   # files of the figures and their PNG
PICTURES = {  # file: heading, and how to read it
    "faults.png": ("The log as it is", "Hatched: where the data check found fault."),
    "closed_loop.png": ("Flight and simulation, in closed loop",
        "The simulation flies the log's reference, without noise. Grey: measured; dashed: the nominal; solid: "
        "with the causes."),
    "innovations.png": ("Prediction errors along the log",
        "Innovations: measured less predicted one row ahead, by a filter that corrects itself at each row. Dotted: "
        "+-3 standard deviations, which 0.3 % leave if the model is right. Before: the causes taken out."),
    "correlations.png": ("Is what is left random? Correlations",
        "Of whitened innovations with their own and each other's past. Grey: 99 % of a random sequence's."),
    "spectra.png": ("Is what is left random? Spectra",
        "Of whitened innovations; 1 is white noise. Lines are named that chance would make in 1 % of spectra; "
        "slow misfit rises to the left."),
    "ranking.png": ("Evidence for each hypothesis",
        "Everything else refitted for each; dark: taken into the model, beside which the next is sought."),
    "sizes.png": ("Is the cause the same all along?",
        "Its size from eight parts of the log that tell equally much. A true cause agrees with itself."),
    "disturbance.png": ("What the nominal lacks",
        "Angular acceleration that the filter had to add, smoothed over 0.3 s, and what it goes with (line: "
        "running median)."),
    "isolability.png": ("Which causes look alike in this log",
        "|cosine| between what the causes would do to this log. Black: no size tells them apart.")}

GLOSSARY = (
    ("a6, k1", "the vehicle in pitch: theta_ddot = a6 theta + k1 beta; aerodynamic instability and control "
               "effectiveness [1/s^2]; theta the attitude, beta the nozzle angle"),
    ("nominal, extended", "the simulation as it was believed; the same with the named causes (extension.toml)"),
    ("nats", "evidence: by how much the logarithm of the log's likelihood rises with a cause, less a penalty for its "
             "free numbers. 3 nats are odds of 20 to 1, 12 nats 160 000 to 1"),
    ("innovation", "measured less predicted, one row ahead; whitened: divided by what noise explains, so that a right "
                   "model leaves random numbers of variance 1"),
    ("held out", "measured on parts of the log (or on a second log) that nothing was fitted to; blocked folds: "
                 "alternate blocks of 1.25 s are left out in turn"),
    ("prediction error", "NRMSE: RMS error of a prediction over a horizon, divided by the RMS change of the channel "
                         "over it: 0 is perfect, 1 no better than saying that nothing changes"),
    ("constancy", "chi-squared of a cause's size over eight parts of the log; true causes stay below the limit"),
    ("tolerance", "one-sigma error of a6 and k1 that is not worth calling wrong ([diagnosis] of the nominal)"))


def write_report(made: Diagnosis, result: dict[str, Any], folder: str) -> None:
    """Write report.html, verdict.json, extension.toml (if the model was extended) and the figures into a folder.

    made    the diagnosis;  result  its JSON;  folder  made if need be; InputError in one line if it cannot
    Files of an earlier report that this one lacks are removed.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        for name in (*EXTENSION, *PICTURES):
            remove(path / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); expected a folder to write into") from None
    drawn = _draw(made, path)
    if made.extension is not None:
        write_nominal(made.extension, path / "extension.toml")
    write_text(path / "verdict.json", [json.dumps(result, indent=1), "\n"])
    write_text(path / "report.html", [page(made, drawn)])


def _draw(made: Diagnosis, folder: Path) -> Drawn | None:
    """The figures that this diagnosis has, written and as PNG; None without matplotlib."""
    try:
        from .figures import DRAWN, save
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("matplotlib"):
            raise
        return None
    drawn = []
    for name in PICTURES if made.verdict != "bad-data" else ("faults.png",):
        figure = DRAWN[name](made)
        if figure is not None:
            save(figure, folder / name)
            drawn.append((name, (folder / name).read_bytes()))
    return drawn


def page(made: Diagnosis, drawn: Drawn | None) -> str:
    """The whole page."""
    parts = [(title, body) for title, body in _sections(made, drawn) if body]
    links = "".join(f'<a href="#s{k}">{text(title)}</a> ' for k, (title, _) in enumerate(parts))
    body = "".join(f'<section id="s{k}"><h2>{text(title)}</h2>{body}</section>'
                   for k, (title, body) in enumerate(parts))
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        headline=text(headline(made)), colour=COLOURS[made.verdict], log=text(Path(made.log.path).name),
        nominal=text(made.nominal.name), first_screen=_first_screen(made), links=links, sections=body)


def text(words: object) -> str:
    """Words as HTML."""
    return escape(str(words)).replace("+-", "&plusmn;").replace("-&gt;", "&rarr;")


def table(head: Sequence[str], rows: Iterable[Sequence[str]], chosen: Sequence[bool] = ()) -> str:
    """A table of cells that are HTML already; '' without rows. `chosen` rows are set off."""
    marks = ['<tr class="chosen">' if mark else "<tr>" for mark in chosen]
    body = [f"{marks[k] if k < len(marks) else '<tr>'}{''.join(f'<td>{cell}</td>' for cell in row)}</tr>"
            for k, row in enumerate(rows)]
    top = "".join(f"<th>{text(cell)}</th>" for cell in head)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(body)}</tbody></table>\n" if body else ""


def _list(items: Sequence[str]) -> str:
    """One as it is, more as a list; HTML in and out."""
    return items[0] if len(items) == 1 else f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"


def _first_screen(made: Diagnosis) -> str:
    rows = [("Faults" if made.verdict == "bad-data" else "Cause", _cause_lines(made))]
    if made.verdict != "bad-data":
        rows += [("Cannot be told from", _alike_lines(made)), ("Evidence", [text(x) for x in evidence(made)]),
                 ("Gain", [_gain_line(made)])]
    rows.append(("Doubts", [text(doubt) for doubt in doubts(made)]))
    return "<dl>" + "".join(f"<dt>{name}</dt><dd>{_list(lines)}</dd>" for name, lines in rows if lines) + "</dl>"


def _cause_lines(made: Diagnosis) -> list[str]:
    if made.verdict == "bad-data":
        return [text(fault.message) for fault in made.data.faults]
    if made.verdict == "consistent":
        return ["None is needed: what is measured less what is simulated is noise."]
    if made.causes:
        return [f'<span class="size"><b>{text(each.cause)}</b> ({text(each.where)}): {text(sentence(each))}.</span>'
                for each in made.causes]
    near = ", ".join(f"{each.cause} ({each.evidence:.0f} nats)" for each in made.nearest)
    lines = ["None of the catalogue. " + text(f"The nearest, which is not the cause: {near}." if near else
                                              "No known cause comes near.")]
    return lines + ([f"Proposal: {text(made.proposal)}"] if made.proposal is not None else [])


def _alike_lines(made: Diagnosis) -> list[str]:
    """The set that a cause belongs to, and what would decide."""
    lines = []
    for each in made.causes:
        if each.rivals:
            decides = would_decide(each)
            lines.append(f"<b>{text(each.cause)}</b> from {text(look_alikes(each))} in this log; "
                         + text(f"what would decide: {' or '.join(decides)}." if decides else
                                "a log with other manoeuvres might decide."))
    return lines or (["Nothing: every other cause explains the log clearly worse."] if made.causes else [])


def evidence(made: Diagnosis) -> list[str]:
    """What the verdict rests on, a line each."""
    worst = max(made.left, key=lambda each: each.gain / each.limit, default=None)
    left = "" if worst is None else f"A disturbance {worst.words} explains {worst.gain:.1f} nats more (limit " \
                                    f"{worst.limit:.0f})."
    if made.verdict == "consistent":
        tried = [step[0] for step in made.selection.rankings if step] if made.selection is not None else []
        best = f"The best, {tried[0].cause.hypothesis.cause}, reached {tried[0].evidence:.1f}." if tried else ""
        return [f"No hypothesis reached the {made.threshold:.0f} nats needed. {best} {left}".replace("  ", " ")]
    lines: list[str] = []
    for each in made.causes or made.nearest:
        least = needed(made.threshold, len(lines))
        same = f" ({least:.0f} needed); its size over {SEGMENTS} parts of the log: chi-squared " \
               f"{each.constancy.chi_squared:.0f}, limit {CONSTANCY_LIMIT:.0f}" if each.constancy is not None else ""
        lines.append(f"{'' if made.causes else 'nearest, '}{each.cause}: {each.evidence:.0f} nats{same}.")
    return [*lines, left] if left else lines


def _gain_line(made: Diagnosis) -> str:
    gain = made.gain
    if gain is None:
        return "None to measure: the model was not extended." if made.verdict == "consistent" else \
            "Not measured: there is no extended model to measure."
    shares = ", ".join(f"{channel} {before:.3g} -> {after:.3g}" for channel, (before, after) in gain.nrmse[1.0].items()
                       if math.isfinite(before + after)) or "not measurable"
    loop = "" if gain.closed_loop is None else \
        f"; attitude in closed loop {gain.closed_loop[0]:.2g} -> {gain.closed_loop[1]:.2g} rad rms"
    which = "" if made.causes else "With the nearest, which is not the cause: "
    return text(f"{which}Error of predicting 1 s ahead, as a share of the channel's change: {shares}{loop}. "
                f"Held out ({gain.source}): {gain.nats:+.0f} nats.")


def doubts(made: Diagnosis) -> list[str]:
    """What speaks against the verdict or bounds it; never empty."""
    if made.verdict == "bad-data":
        return ["Nothing about the vehicle is concluded from a log with faults."]
    said = list(made.doubts)
    for k, each in enumerate(made.causes):
        least = needed(made.threshold, k)
        if each.evidence < THIN * least:
            said.append(f"{each.cause}: little evidence, {each.evidence:.0f} nats, {least:.0f} needed")
        if each.constancy is not None and NARROW * CONSTANCY_LIMIT < each.constancy.chi_squared <= CONSTANCY_LIMIT:
            said.append(f"{each.cause}: its size varies along the log more than most true causes' "
                        f"(chi-squared {each.constancy.chi_squared:.0f}, limit {CONSTANCY_LIMIT:.0f})")
    said += [f"something small may be left at the {each.disturbance.place}, {each.words}" for each in made.left[:1]
             if NARROW * each.limit < each.gain <= each.limit]
    loud = [f"{name} {level['factor']:.2g}" for name, level in made.noise.items() if level["significant"]]
    if loud:
        said.append(f"noise differs from the declared, by factors of: {', '.join(loud)} (no part of the verdict)")
    missing = [word for name, word in CHANNEL_WORDS.items() if made.record and name not in made.record.channels]
    if missing:
        said.append(f"the log has no {' and no '.join(missing)}: what only it shows was not looked for")
    return said or ["None of the tests failed or came near its limit. Causes smaller than the limits below "
                    "cannot be excluded."]


def _sections(made: Diagnosis, drawn: Drawn | None) -> list[tuple[str, str]]:
    pictures = "".join(_figure(*each) for each in drawn) if drawn is not None else f"<p>{text(NO_FIGURES)}</p>"
    terms = table(("term", "meaning"), [(f"<b>{text(name)}</b>", meaning) for name, meaning in GLOSSARY])
    data = [("Data check", _data(made)), ("Controller check", f"<p>{text(_controller(made))}</p>")]
    if made.verdict == "bad-data":
        return [*data[:1], ("Figures", pictures), ("Terms", terms), ("To reproduce", _again(made))]
    return [("Ranked hypotheses", _ranking(made)), ("Held-out gain", _gain(made.gain)), ("Figures", pictures),
            ("Noise", _noise(made)), ("Could not have been seen", _limits(made)), ("Look-alikes", _pairs(made)),
            ("Left over", _left(made)), *data, ("Terms", terms), ("To reproduce", _again(made))]


def _figure(name: str, png: bytes) -> str:
    title, caption = PICTURES[name]
    return (f'<figure><h3>{text(title)}</h3><img alt="{text(title)}" src="data:image/png;base64,'
            f"{base64.b64encode(png).decode('ascii')}\"><figcaption>{text(caption)}</figcaption></figure>\n")


def _ranking(made: Diagnosis) -> str:
    rows, chosen = [], []
    for k, step in enumerate(made.selection.rankings if made.selection is not None else []):
        least = needed(made.threshold, k)
        for place, each in enumerate(step):
            hypothesis = each.cause.hypothesis
            values = ", ".join([f"{name} {value}" for name, value in hypothesis.fixed] + [
                f"{free.name} {amount(value, None, hypothesis.unit(free.name))}" for free, value in
                zip(hypothesis.free, each.cause.values, strict=True)])
            rows.append((str(k + 1), text(hypothesis.cause), hypothesis.where, f"{each.evidence:.1f}",
                         f"{least:.0f}", text(values)))
            chosen.append(place == 0 and each.evidence >= least)
    final = table(("in the model", "where", "evidence [nats]", "size, 95 %"), [
        (text(each.cause), text(each.where), f"{each.evidence:.1f}", text(", ".join(
            f"{name} {amount(value, each.std.get(name), each.units.get(name, ''))}"
            for name, value in each.values.items()))) for each in (*made.causes, *made.nearest)])
    note = "Bold: taken into the model at that step. Hypotheses that promised nothing at first sight are left out."
    return f'{final}<p class="note">{note if rows else "No hypothesis promised anything."}</p>' + table(
        ("step", "hypothesis", "where", "evidence [nats]", "needed", "values"), rows, chosen)


def _gain(gain: Gain | None) -> str:
    if gain is None:
        return ""
    channels = [name for name in CHANNELS if any(name in row for row in gain.nrmse.values())]
    rows = [(channel, *(f"{row[channel][0]:.4f} &rarr; {row[channel][1]:.4f}".replace("nan", "-")
                        if channel in row else "" for row in gain.nrmse.values())) for channel in channels]
    loop = "" if gain.closed_loop is None else \
        f" Attitude error in closed loop: {gain.closed_loop[0]:.3g} &rarr; {gain.closed_loop[1]:.3g} rad rms."
    before, after = gain.log_likelihood
    return (f'<p class="note">Measured on {text(gain.source)}, to which nothing was fitted. Prediction error over the '
            "change of the channel, nominal &rarr; with the causes:</p>"
            + table(("channel", *(f"over {horizon:g} s" for horizon in gain.nrmse)), rows)
            + f"<p>Log-likelihood per row {before:.4f} &rarr; {after:.4f}: {gain.nats:+.0f} nats in all.{loop}</p>")


def _noise(made: Diagnosis) -> str:
    if not made.noise or made.record is None:
        return ""
    names = (*LEVELS, *(each.name for each in made.record.world.levels))
    units = (*NOISE_UNITS, *(WORLD_UNITS[each.name] for each in made.record.world.levels))
    levels = dict(zip(names, zip(declared(made.record), units, strict=True), strict=True))
    rows = []
    for name, level in made.noise.items():
        spread = "" if level["std"] is None else f" +- {INTERVAL * level['std']:.2g}"
        rows.append((text(name), f"{levels[name][0]:.3g} {levels[name][1]}", text(f"{level['factor']:.3g}{spread}"),
                     "differs" if level["significant"] else "as declared"))
    return table(("noise of", "declared", "measured over declared, 95 %", "(no part of the verdict)"), rows)


def _limits(made: Diagnosis) -> str:
    rows = [(text(each.cause), CATALOGUE[each.cause].where, text(_limit(each)),
             text(", ".join(f"{name} {value:.4g}" for name, value in each.at)))
            for each in made.limits if each.size is not None]
    blind = ", ".join(each.cause for each in made.limits if each.size is None)
    return ('<p class="note">In this log, its manoeuvres, noise and columns, a cause of this size is found at even '
            "odds; a smaller one may be there unseen.</p>" + table(("cause", "where", "smallest size", "given"), rows)
            + (f"<p>Not at all, at any size: {text(blind)}.</p>" if blind else ""))


def _limit(limit: Limit) -> str:
    assert limit.size is not None
    if limit.neutral == 1.0:
        return f"{limit.parameter} off by {100.0 * limit.size:.2g} %"
    word = "below " if math.isinf(limit.neutral) else ""
    degrees = f" ({math.degrees(limit.size):.2g} {limit.unit.replace('rad', 'deg')})" if limit.unit in ANGULAR else ""
    return f"{limit.parameter} {word}{limit.size:.2g} {limit.unit}{degrees}"


def _pairs(made: Diagnosis) -> str:
    rows = [] if made.isolability is None else [
        (text(a), text(b), f"{c:.4f}", "no size tells them apart" if c >= LOOK_ALIKE else "hard to tell apart")
        for a, b, c in made.isolability.pairs(NEARLY_ALIKE)]
    return table(("cause", "and", "|cosine|", ""), rows) or \
        f"<p>No two causes reach |cosine| {NEARLY_ALIKE:g}: this log tells them all apart.</p>"


def _left(made: Diagnosis) -> str:
    before = {(each.disturbance.place, each.shape): each.gain for each in made.left_nominal}
    rows = [(text(each.disturbance.place), text(each.words), f"{each.gain:.1f}", f"{each.limit:.0f}",
             f"{before.get((each.disturbance.place, each.shape), math.nan):.1f}".replace("nan", ""))
            for each in made.left]
    return '<p class="note">What a disturbance beside the model would explain.</p>' + table(
        ("place", "shape", "model [nats]", "limit", "nominal [nats]"), rows) if rows else ""


def _data(made: Diagnosis) -> str:
    rows = [(text(each.kind), text(each.channel or "rows"), f"{each.t_start:.6g}", f"{each.t_end:.6g}",
             str(each.rows), text(each.message)) for each in made.data.faults]
    return f"<p>{int(made.data.usable.sum())} of {len(made.log.t)} rows have usable time stamps.</p>" + (
        table(("fault", "in", "from [s]", "to [s]", "rows", "what"), rows) or "<p>No fault found.</p>")


def _controller(made: Diagnosis) -> str:
    found = made.controller
    if found is None:
        return "Not checked: that needs beta_cmd and theta_ref in the log and a [controller] in the nominal."
    if found.kind == "none":
        return f"The logged command is the nominal controller's ({found.before:.2g} rad rms apart)."
    late = "" if found.time_constant is None else f", derivative time constant {found.time_constant:.4g} s"
    return (f"The logged command is not the nominal controller's: {found.before:.2g} rad rms apart. Best explanation "
            f"({found.kind}): kp times {found.kp_scale:.4g}, kd times {found.kd_scale:.4g}, delay {found.delay:.4g} s"
            f"{late}; {found.after:.2g} rad rms are left.")


def _again(made: Diagnosis) -> str:
    log = Path(made.log.path).name
    nominal = Path(made.nominal.path).name if made.nominal.path else made.nominal.name
    second = " --holdout LOG2.csv" if made.gain is not None and made.gain.source == "a second log" else ""
    lines = [f"launchid diagnose {log} {nominal}{second} --report DIR"]
    if made.extension is not None:
        lines += ["launchid simulate extension.toml --out extended.csv", f"launchid diagnose {log} extension.toml"]
    return "<pre>" + "\n".join(text(line) for line in lines) + "</pre>" + (
        '<p class="note">extension.toml lies beside this page: the nominal with the causes as effects. The last line '
        "must say CONSISTENT.</p>" if made.extension is not None else "")

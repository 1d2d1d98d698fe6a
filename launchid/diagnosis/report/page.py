"""The report of a diagnosis: one page that needs no network, the verdict as JSON, the extended nominal, the figures.

The first screen holds the verdict in plain words and the picture of the misfit (`first_screen`); what follows is what
they rest on.  Figures need matplotlib; without it the page says so and has everything else.  Those of curves are drawn
again by the browser (`launchid.charts`), to zoom and read; where it runs no scripts the pictures stay.
"""

import json
import math
from pathlib import Path
from typing import Any

from sim.effects import CATALOGUE
from sim.errors import InputError
from sim.files import make_folder, remove, write_text
from sim.nominal import rewrite_nominal

from ...charts.markup import table, text
from ...charts.page import page as made_page
from ...charts.page import picture
from ..data.record import CHANNELS
from ..data.world import SLOW_MOMENT, TURBULENCE, WALK
from ..judge.diagnosis import Diagnosis
from ..judge.gain import Gain
from ..judge.limits import LOOK_ALIKE, Limit
from ..judge.measure import NOISE
from ..model.noise import LEVELS, declared
from ..search.selection import needed
from . import first_screen as first
from .answer import NEARLY_ALIKE
from .words import ANGULAR, amount, given, headline

WORLD_UNITS = {TURBULENCE: "rad", WALK: "rad/sqrt(s)", SLOW_MOMENT: "rad/s^2"}
NOISE_UNITS = ("rad", "rad/s", "rad", "rad", "rad/s^2")
COLOURS = {"consistent": "#1b5e20", "explained": "#12355b", "dominant": "#3b3170", "unexplained": "#8a4b00",
           "bad-data": "#7f1d1d"}
EXTENSION = ("extension.toml", "extension.vehicle.csv", "extension.uncertainty.csv")
NO_FIGURES = "There are no figures: they need matplotlib (pip install 'launchid[plots]')."

Drawn = list[tuple[str, bytes, dict[str, Any] | None]]   # files of the figures, their PNG, what is drawn live of them
FIRST = "misfit.png"
PICTURES = {  # file: heading, and how to read it
    "faults.png": ("The log as it is", "Hatched: where the data check found fault."),
    FIRST: ("Measured against predicted",
        "Each prediction runs free for 1 s from the state as known at its start. Grey: measured; dashed: as simulated; "
        "solid: with the causes (where there is one line only, nothing known predicts better). Drawn from the fit to "
        "the whole log; Gain below is measured on rows held out."),
    "closed_loop.png": ("Flight and simulation, in closed loop",
        "The simulation flies the log's reference, without noise. Grey: measured; dashed: the nominal; solid: "
        "with the causes."),
    "innovations.png": ("Prediction errors along the log",
        "Innovations: measured less predicted one row ahead, by a filter that corrects itself at each row. Dotted: "
        "3 standard deviations to either side, which 0.3 % leave if the model is right. Before: the causes taken out."),
    "correlations.png": ("Is what is left random? Correlations",
        "Of whitened innovations with their own and each other's past. Grey: 99 % of a random sequence's."),
    "spectra.png": ("Is what is left random? Spectra",
        "Of whitened innovations; 1 is white noise. Lines are named that chance would make in 1 % of spectra; "
        "slow misfit rises to the left."),
    "ranking.png": ("Evidence for each hypothesis",
        "At each step, everything else refitted for each, beside the causes of the steps before; dark: taken into the "
        "model, beside which the next is sought."),
    "sizes.png": ("Is the cause the same all along?",
        "Its size from eight parts of the log that tell equally much. A true cause agrees with itself."),
    "disturbance.png": ("What the nominal lacks",
        "Angular acceleration that the filter had to add, smoothed over 0.3 s, and what it goes with (line: "
        "running median)."),
    "isolability.png": ("Which causes look alike in this log",
        "|cosine| between what the causes would do to this log, of those that are like another one (0.9 and more, "
        "numbers). Black: no size tells them apart.")}

GLOSSARY = (
    ("a6, k1", "the vehicle in pitch: theta_ddot = a6 theta + k1 beta; aerodynamic instability and control "
               "effectiveness [1/s^2]; theta the attitude, beta the nozzle angle"),
    ("nominal, extended", "the simulation as it was believed; the same with the named causes (extension.toml)"),
    ("nats", "evidence: by how much the logarithm of the log's likelihood rises with a cause, less a penalty for its "
             "free numbers. 3 nats are odds of 20 to 1, 12 nats 160 000 to 1"),
    ("+-", "behind a number: one standard deviation; a 95 % interval is called that"),
    ("innovation", "measured less predicted, one row ahead; whitened: divided by what noise explains, so that a right "
                   "model leaves random numbers of variance 1"),
    ("held out", "measured on parts of the log (or on a second log) that nothing was fitted to; blocked folds: "
                 "alternate blocks of 1.25 s are left out in turn"),
    ("prediction error", "NRMSE: RMS error of a prediction over a horizon, divided by the RMS change of the channel "
                         "over it: 0 is perfect, 1 no better than saying that nothing changes"),
    ("constancy", "chi-squared of a cause's size over eight parts of the log; true causes stay below the limit"),
    ("tolerance", "one-sigma error of a6 and k1 that is not worth calling wrong ([diagnosis] of the nominal)"))


def write_report(made: Diagnosis, result: dict[str, Any], folder: str | Path) -> None:
    """Write report.html, verdict.json, extension.toml (if the model was extended) and the figures into a folder.

    made    the diagnosis;  result  its JSON;  folder  made if need be; InputError in one line if it cannot
    Files of an earlier report that this one lacks are removed.
    """
    path = make_folder(folder)
    try:
        for name in (*EXTENSION, *PICTURES):
            remove(path / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); expected a folder to write into") from None
    drawn = _draw(made, path)
    if made.extension is not None:
        rewrite_nominal(made.extension, path / "extension.toml")
    write_text(path / "verdict.json", [json.dumps(result, indent=1), "\n"])
    write_text(path / "report.html", [page(made, drawn)])


def _draw(made: Diagnosis, folder: Path) -> Drawn | None:
    """The figures that this diagnosis has, written and as PNG; None without matplotlib."""
    try:
        from ...charts.figure import figure_json
        from .figures import DRAWN, drawable, save
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("matplotlib"):
            raise
        return None
    drawn = []
    for name in drawable(made):
        figure = DRAWN[name](made)
        if figure is not None:
            save(figure, folder / name)
            drawn.append((name, (folder / name).read_bytes(), figure_json(figure)))
    return drawn


def page(made: Diagnosis, drawn: Drawn | None) -> str:
    """The whole page."""
    above = f"launchid diagnose: measured {Path(made.log.path).name} against the simulation of {made.nominal.name}"
    return made_page(headline(made), above, COLOURS[made.verdict], first_screen(made, drawn), _sections(made, drawn))


def first_screen(made: Diagnosis, drawn: Drawn | None) -> str:
    """The verdict in plain words, the picture of the misfit, what the verdict rests on."""
    misfit = "".join(_figure(*each) for each in drawn or () if each[0] == FIRST)
    return first.plain(made) + misfit + first.rows(made)


def _sections(made: Diagnosis, drawn: Drawn | None) -> list[tuple[str, str]]:
    pictures = f"<p>{text(NO_FIGURES)}</p>" if drawn is None else "".join(
        _figure(*each) for each in drawn if each[0] != FIRST)
    terms = table(("term", "meaning"), [(f"<b>{text(name)}</b>", meaning) for name, meaning in GLOSSARY])
    data = [("Data check", _data(made)), ("Controller check", f"<p>{text(_controller(made))}</p>")]
    if made.verdict == "bad-data":
        return [*data[:1], ("Figures", pictures), ("Terms", terms), ("To reproduce", _again(made))]
    return [("Ranked hypotheses", _ranking(made)), ("Held-out gain", _gain(made.gain)), ("Figures", pictures),
            ("Noise", _noise(made)), ("Could not have been seen", _limits(made)), ("Look-alikes", _pairs(made)),
            ("Left over", _left(made)), *data, ("Terms", terms), ("To reproduce", _again(made))]


def _figure(name: str, png: bytes, live: dict[str, Any] | None) -> str:
    """A figure's picture, and what a browser with scripts draws in the place of that."""
    return picture(name.partition(".")[0], *PICTURES[name], png, live)


def _ranking(made: Diagnosis) -> str:
    if made.selection is None:
        return ""
    rows, chosen = [], []
    for k, step in enumerate(made.selection.rankings):
        least = needed(made.threshold, k)
        for place, each in enumerate(step):
            hypothesis = each.cause.hypothesis
            values = ", ".join([f"{name} {value}" for name, value in hypothesis.fixed] + [
                f"{free.name} {amount(value, None, hypothesis.unit(free.name))}" for free, value in
                zip(hypothesis.free, each.cause.values, strict=True)])
            rows.append((str(k + 1), text(hypothesis.cause), hypothesis.where, f"{each.evidence:.0f}",
                         f"{least:.0f}", text(values)))
            chosen.append(place == 0 and each.evidence >= least)
    head = ("in the model", "where", "evidence beside all others in it [nats]", "size +- one standard deviation")
    final = table(head, [
        (text(each.label), text(each.where), f"{each.evidence:.0f}", text(", ".join(
            f"{name} {amount(value, each.std.get(name), each.units.get(name, ''))}"
            for name, value in each.values.items()))) for each in (*made.causes, *made.nearest)])
    note = "Evidence at a step is beside the causes of the steps before alone, another number than beside all that " \
           "joined later. Bold: taken into the model. Hypotheses that promised nothing at first sight are left out."
    return f'{final}<p class="note">{note if rows else "No hypothesis promised anything."}</p>' + table(
        ("step", "hypothesis", "where", "evidence at that step [nats]", "needed", "values"), rows, chosen)


def _gain(gain: Gain | None) -> str:
    if gain is None:
        return ""
    channels = [name for name in CHANNELS if any(name in row for row in gain.nrmse.values())]
    rows = [(channel, *(f"{row[channel][0]:.3g} &rarr; {row[channel][1]:.3g}".replace("nan", "-")
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
        spread = "" if level["std"] is None else f" +- {level['std']:.2g}"
        rows.append((text(name), f"{levels[name][0]:.3g} {levels[name][1]}", text(f"{level['factor']:.3g}{spread}"),
                     "differs" if level["significant"] else "as declared"))
    return table(("noise of", "declared", "measured over declared +- one standard deviation",
                  f"(beyond {NOISE:g} it forbids EXPLAINED)"), rows)


def _limits(made: Diagnosis) -> str:
    rows = [(text(each.cause), CATALOGUE[each.cause].where, text(_limit(each)),
             text(given(each)))
            for each in made.limits if each.size is not None]
    if not made.limits:
        return ""
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
    if made.isolability is None:
        return ""
    rows = [
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

"""The command `launchid` (`python -m sim` is the same).  The only place that prints.

Exit status: 0 done; 2 wrong usage; 3 bad input; one line on stderr, never a
traceback.  stdout is data, stderr is talk.
"""

import argparse
import itertools
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np

from launchid_core import FORMULATIONS, NOISE_LEVELS, SOLVERS, Config

from .errors import InputError, UsageError
from .files import make_folder, write_text
from .identify import onboard_model, report, run, whole_log
from .log import REQUIRED, Log, read_log, write_flight
from .nominal import Nominal, load_nominal, write_nominal

ABSURD = 1000.0  # times the log's length: a stamp further from its middle is no time of this log
USAGE_STATUS, INPUT_STATUS, INTERRUPTED_STATUS = 2, 3, 130


class Parser(argparse.ArgumentParser):
    """argparse with one line per error."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{self.prog}: {message} (see {self.prog} --help)")


def say(text: str) -> None:
    """Talk, on stderr: one line, whatever a path or a key holds."""
    print("".join(c if c.isprintable() else ascii(c)[1:-1] for c in text), file=sys.stderr)


def parser() -> Parser:
    """The command's words."""
    top = Parser(prog="launchid", description="On-board identification of launcher dynamics: experiments and logs.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    from .experiments import CASES, CONFIDENCE
    sub = commands.add_parser("reproduce", help="the paper's experiments: figures, table, verdict")
    sub.add_argument("--case", default="all", choices=[*CASES, CONFIDENCE, "all"])
    sub.add_argument("--seeds", type=int, default=20, help="flights per case (20, the paper's)")
    sub.add_argument("--out", default="results", metavar="DIR", help="folder for figures and tables (results)")
    sub.set_defaults(run=reproduce_command)

    sub = commands.add_parser("simulate", help="fly a nominal and write its log")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help="a file, or constant | vega_like | greensite_cr826")
    sub.add_argument("--out", required=True, metavar="LOG.csv")
    sub.add_argument("--seed", type=int, default=0)
    sub.add_argument("--suite", default="flight", choices=["flight", "ideal"])
    sub.add_argument("--period", type=float, metavar="S", help="of the log; the suite's own if left out")
    sub.add_argument("--effect", action="append", default=[], metavar="NAME:PARAMETER=VALUE[,PARAMETER=VALUE...]",
                     help="fly a cause of the catalogue too; repeatable")
    sub.set_defaults(run=simulate_command)

    sub = commands.add_parser("identify", help="a6, k1 and the active terms of a log, window by window")
    sub.add_argument("log", metavar="LOG.csv")
    sub.add_argument("--nominal", metavar="NOMINAL.toml", help="what the simulation believes")
    sub.add_argument("--window", default="1", metavar="S|all")
    add_choices(sub)
    sub.add_argument("--tracked", action="store_true", help="also the tracked estimate and sudden changes (filtered)")
    sub.add_argument("--json", metavar="PATH|-")
    sub.add_argument("--plot", metavar="PATH")
    sub.set_defaults(run=identify_command)
    sub = commands.add_parser("plan", help="the smallest test input that reaches an accuracy")
    sub.add_argument("nominal", metavar="NOMINAL.toml")
    sub.add_argument("--accuracy", type=float, required=True, metavar="X", help="relative, one sigma, of a6 and k1")
    sub.add_argument("--window", type=float, required=True, metavar="S")
    sub.add_argument("--out", required=True, metavar="NEW.toml")
    sub.set_defaults(run=plan_command)
    sub = commands.add_parser("diagnose", help="what the simulation gets wrong on a log, why, and what fixing it gains")
    sub.add_argument("log", metavar="LOG.csv")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help="what the simulation believes")
    sub.add_argument("--holdout", metavar="LOG2.csv", help="a second log, to judge the extended model on")
    sub.add_argument("--json", metavar="PATH|-")
    sub.add_argument("--bootstrap", type=int, default=0, metavar="N",
                     help="measure the threshold on N clean flights of the nominal along this log (cached)")
    sub.add_argument("--report", metavar="DIR", help="folder for report.html, verdict.json, extension.toml, figures")
    sub.set_defaults(run=diagnose_command)
    add_uncertainty(commands)
    add_export(commands)
    return top


def add_choices(sub: argparse.ArgumentParser) -> None:
    """The words of an estimator's choices that a log or a nominal does not make."""
    sub.add_argument("--compression", type=int, default=1)
    sub.add_argument("--library", default="rigid-body")
    sub.add_argument("--formulation", choices=FORMULATIONS)
    sub.add_argument("--solver", default="stls", choices=SOLVERS)
    sub.add_argument("--threshold", type=float, metavar="X")
    sub.add_argument("--seed", type=int, default=0)
    sub.add_argument("--noise", default="estimated", choices=NOISE_LEVELS,
                     help="filtered: the nominal's noise levels are a prior (estimated) or exact (declared)")


def choices(args: argparse.Namespace) -> dict[str, Any]:
    """Config fields of these words."""
    return {name: getattr(args, name) for name in ("compression", "seed", "library", "solver", "threshold", "noise")}


def add_export(commands: Any) -> None:
    """The words of `export-c`."""
    sub = commands.add_parser("export-c", help="the estimator in C, for a flight computer: the same bits")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help="what the simulation believes")
    sub.add_argument("--out", required=True, metavar="DIR", help="folder for launchid.h, launchid.c, replay.c")
    sub.add_argument("--window", type=float, default=1.0, metavar="S")
    sub.add_argument("--period", type=float, metavar="S", help="between samples; the nominal's if left out")
    add_choices(sub)
    sub.set_defaults(run=export_command)


def export_command(args: argparse.Namespace) -> None:
    """launchid export-c"""
    from .export_c.program import c_files
    from .uncertainty.level import ranged_model
    nominal = load_nominal(args.nominal)
    formulation = args.formulation or "filtered"
    model = None
    if formulation == "filtered":
        model = ranged_model(nominal) if nominal.uncertainty is not None else onboard_model(nominal)
    period = nominal.sensors.period if args.period is None else args.period
    try:
        config = Config(window=args.window, sample_period=period, formulation=formulation, model=model, **choices(args))
    except ValueError as error:
        raise UsageError(str(error)) from None
    files, folder = c_files(config), make_folder(args.out)
    for name, text in files.items():
        write_text(folder / name, [text])
    say(f"{args.out}: {', '.join(files)}; cc -std=c99 -O2 -ffp-contract=off replay.c launchid.c -lm -o replay")


def add_uncertainty(commands: Any) -> None:
    """The words of `uncertainty` and `fit-lft`."""
    sub = commands.add_parser("uncertainty", help="where in its range each parameter is, and whether it left it")
    sub.add_argument("log", metavar="LOG.csv")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help="what the simulation believes, with [uncertainty]")
    sub.add_argument("--window", type=float, default=1.0, metavar="S")
    sub.add_argument("--json", metavar="PATH|-")
    sub.add_argument("--plot", metavar="PATH")
    sub.set_defaults(run=uncertainty_command)
    sub = commands.add_parser("fit-lft", help="the range sigma of a6 and k1, fitted from flights")
    sub.add_argument("logs", nargs="+", metavar="LOG.csv... NOMINAL.toml", help="one log a flight, the nominal last")
    sub.add_argument("--out", required=True, metavar="NEW.toml")
    sub.add_argument("--share", type=float, default=0.95, help="of vehicles that the range holds (0.95)")
    sub.add_argument("--confidence", type=float, default=0.95, help="that it holds them (0.95)")
    sub.add_argument("--profile", action="store_true", help="sigma over flight time, where the flights tell it")
    sub.set_defaults(run=fit_lft_command)


def uncertainty_command(args: argparse.Namespace) -> None:
    """launchid uncertainty"""
    from .uncertainty import level
    log = read_noting(args.log)
    nominal = load_nominal(args.nominal)
    try:
        estimates = level.follow(log, nominal, args.window)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if args.plot:
        from .plots import save, uncertainty_figure
        save(uncertainty_figure(log, estimates, nominal), args.plot)
    text = json.dumps(level.report(estimates), indent=1)
    if args.json == "-":
        print(text)
        return
    if args.json:
        write_text(args.json, [text, "\n"])
    print(f"{args.log}: delta of a = a0*(1 + sigma*delta) from the tracked estimate, window {args.window:g} s, "
          f"period {log.period:g} s, range of {args.nominal}")
    print(level.table(estimates))


def fit_lft_command(args: argparse.Namespace) -> None:
    """launchid fit-lft"""
    from .uncertainty import greybox
    *paths, nominal_path = args.logs
    if not paths:
        raise UsageError("fit-lft: expected at least one LOG.csv before NOMINAL.toml")
    for name, value in (("--share", args.share), ("--confidence", args.confidence)):
        if not 0.0 < value < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    nominal = load_nominal(nominal_path)
    flights = [greybox.deviations(read_noting(path), nominal) for path in paths]
    fit = greybox.fit(flights, args.share, args.confidence, args.profile)
    write_nominal(greybox.with_range(nominal, fit), args.out)
    print(greybox.table(fit, args.out))


def plan_command(args: argparse.Namespace) -> None:
    """launchid plan"""
    from .plan import plan
    result = plan(load_nominal(args.nominal), args.accuracy, args.window)
    write_nominal(result.nominal, args.out)
    multisine = result.nominal.test_input
    print(f"bound of the worse parameter, median over {args.window:g} s windows: {100 * result.before:.3g} % "
          f"without input, {100 * result.after:.3g} % with it")
    if multisine is None:
        print(f"{args.out}: no test input needed")
        return
    lines = ", ".join(f"{a:.3g} rad at {f:.3g} rad/s"
                      for a, f in zip(multisine.amplitude, multisine.frequency, strict=True))
    print(f"{args.out}: {lines}; {result.root_mean_square:.2e} rad rms, peak {result.peak:.2e} rad")


def diagnose_command(args: argparse.Namespace) -> None:
    """launchid diagnose"""
    from .diagnosis.report.answer import report
    from .diagnosis.report.words import lines
    from .diagnosis.verdict import diagnose
    at_least("--bootstrap", args.bootstrap, 0)
    log, nominal = read_noting(args.log, ("t", "theta")), load_nominal(args.nominal)
    holdout = read_noting(args.holdout, ("t", "theta")) if args.holdout else None
    progress = Progress()
    made = diagnose(log, nominal, holdout, bootstrap=args.bootstrap, say=progress)
    progress("")
    result = report(made)
    if args.report:
        from .diagnosis.report.page import write_report
        write_report(made, result, args.report)
    text = json.dumps(result, indent=1)
    if args.json == "-":
        print(text)
        return
    if args.json:
        write_text(args.json, [text, "\n"])
    print("\n".join(lines(made)))


class Progress:
    """A bar of the steps done and what is being done, on a terminal only: one line that is written over."""

    STEPS = 8  # of a diagnosis with one cause

    def __init__(self) -> None:
        self.done = 0

    def __call__(self, text: str) -> None:
        """An empty text clears the line."""
        if sys.stderr.isatty():
            full = min(self.done, self.STEPS)
            sys.stderr.write("\r\x1b[K" + (f"[{'#' * full}{'.' * (self.STEPS - full)}] {text}" if text else ""))
            sys.stderr.flush()
        self.done += 1


def at_least(name: str, value: int, low: int) -> None:
    """UsageError unless value >= low."""
    if value < low:
        raise UsageError(f"{name} {value}: expected an integer of at least {low}")


def reproduce_command(args: argparse.Namespace) -> None:
    """launchid reproduce"""
    at_least("--seeds", args.seeds, 1)
    from .experiments.report import reproduce
    print(reproduce(args.case, args.seeds, args.out))


def simulate_command(args: argparse.Namespace) -> None:
    """launchid simulate"""
    from .effects import from_text
    from .flight import fly_whole
    at_least("--seed", args.seed, 0)
    effects = [from_text(text) for text in args.effect]
    nominal = load_nominal(args.nominal)
    flight = fly_whole(nominal, args.seed, args.suite, args.period, effects=effects)
    write_flight(args.out, flight)
    say(f"{args.out}: {len(flight.t)} rows, {flight.period:g} s apart, seed {args.seed}"
        + ("; the vehicle was LOST and the log ends there" if flight.lost else ""))


def read_noting(path: str, required: tuple[str, ...] = REQUIRED) -> Log:
    """Read a log and say which columns were ignored."""
    log = read_log(path, required)
    if log.ignored:
        say(f"{path}: columns ignored: {', '.join(ascii(name)[1:-1] for name in log.ignored)}")
    return log


def choose_formulation(args: argparse.Namespace, log: Log) -> str:
    """As asked, or filtered with a nominal, else measured if the log has theta_ddot, else integral (`reproduce`)."""
    default = "measured" if "theta_ddot" in log.columns else "integral"
    formulation = args.formulation or ("filtered" if args.nominal else default)
    if formulation == "measured" and "theta_ddot" not in log.columns:
        raise UsageError("--formulation measured needs the column theta_ddot, which the log lacks")
    if formulation == "filtered" and not args.nominal:
        raise UsageError("--formulation filtered needs --nominal NOMINAL.toml (profile, actuator, noises)")
    if args.tracked and formulation != "filtered":
        raise UsageError("--tracked needs --formulation filtered and --nominal NOMINAL.toml")
    return str(formulation)


def identify_config(args: argparse.Namespace, log: Log, nominal: Nominal | None) -> Config:
    """Config for a log; UsageError for what the options ask and the log lacks."""
    formulation = choose_formulation(args, log)
    model = onboard_model(nominal) if formulation == "filtered" and nominal is not None else None
    if args.window == "all":
        t = log.t[np.isfinite(log.t)]
        t = t[np.abs(t - np.median(t)) <= ABSURD * len(t) * log.period]
        timing = whole_log(len(t), log.period, float(np.min(t)), float(np.max(t)))
    else:
        try:
            timing = {"window": float(args.window), "sample_period": log.period}
        except ValueError:
            raise UsageError(f"--window {args.window!r}: expected seconds or 'all'") from None
    try:
        return Config(**timing, formulation=formulation, model=model, **choices(args))
    except ValueError as error:
        raise UsageError(str(error)) from None


def structure_lines(windows: list[dict[str, Any]]) -> list[str]:
    """When a term of theta_ddot enters or leaves, from window to window; nothing while they stay."""
    lines = []
    valid = [w for w in windows if w["valid"]]
    for before, after in itertools.pairwise(valid):
        entered = [term for term in after["terms"] if term not in before["terms"]]
        left = [term for term in before["terms"] if term not in after["terms"]]
        if entered or left:
            words = [f"{', '.join(terms)} {verb}" for terms, verb in ((entered, "enters"), (left, "leaves")) if terms]
            lines.append(f"structure from {after['t_start']:.2f} s on: {'; '.join(words)}")
    return lines


def identify_table(result: dict[str, Any]) -> str:
    """The windows as a table for a terminal."""
    lines = [f"{'t_start':>9} {'t_end':>9} {'status':<15} {'a6 [1/s^2]':>22} {'k1 [1/s^2]':>22}  active terms"]

    def pair(window: dict[str, Any], name: str) -> str:
        if window[name] is None:
            return f"{'-':>22}"
        std = window[f"{name}_std"]
        return f"{window[name]:>11.5g}" + (f" +- {std:<7.2g}" if std is not None else " " * 11)

    for w in result["windows"]:
        terms = ", ".join(f"{term} {value:.4g}" for term, value in w["terms"].items())
        lines.append(f"{w['t_start']:>9.3f} {w['t_end']:>9.3f} {w['status']:<15} "
                     f"{pair(w, 'a6')} {pair(w, 'k1')}  {terms}")
    lines += structure_lines(result["windows"])
    for c in result.get("changes", []):
        lines.append(f"sudden change of {c['parameter']} at {c['t']:.2f} +- {c['t_std']:.2f} s: {c['before']:.4g} -> "
                     f"{c['after']:.4g} (size {c['size']:.3g} +- {c['size_std']:.2g})")
    samples = result["samples"]
    rejected = ", ".join(f"{name} {n}" for name, n in samples["rejected"].items()) or "none"
    lines.append(f"samples accepted {samples['accepted']}, rejected: {rejected}")
    return "\n".join(lines)


def identify_command(args: argparse.Namespace) -> None:
    """launchid identify"""
    log = read_noting(args.log)
    nominal: Nominal | None = load_nominal(args.nominal) if args.nominal else None
    config = identify_config(args, log, nominal)
    estimates, estimator = run(config, log.samples())
    result = report(estimates, estimator, args.tracked)
    if args.plot:
        from .plots import identify_figure, save
        save(identify_figure(log, estimates, nominal), args.plot)
    if args.json == "-":
        print(json.dumps(result, indent=1))
        return
    if args.json:
        write_text(args.json, [json.dumps(result, indent=1), "\n"])
    print(f"{args.log}: formulation {config.formulation}, library {args.library}, solver {config.solver}, "
          f"window {config.window:g} s, period {config.sample_period:g} s, {config.kept_rows} of {config.rows} rows")
    print(identify_table(result))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    try:
        args = parser().parse_args(argv)
        args.run(args)
        sys.stdout.flush()
    except UsageError as error:
        say(f"launchid: {error}" if not str(error).startswith("launchid") else str(error))
        return USAGE_STATUS
    except InputError as error:
        say(f"launchid: {error}")
        return INPUT_STATUS
    except KeyboardInterrupt:
        say("launchid: interrupted; files already written are whole")
        return INTERRUPTED_STATUS
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader has gone (as `| head` does)
    return 0

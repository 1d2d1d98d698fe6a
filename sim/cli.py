"""The command `launchid` (`python -m sim` is the same).  The only place that prints.

Exit status: 0 done; 2 wrong usage; 3 bad input; one line on stderr, never a
traceback.  stdout is data, stderr is talk.

What a command needs is imported when it runs, its files are read before anything
is that compiles: help, wrong words and missing files answer at once.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from launchid_core import FORMULATIONS, NOISE_LEVELS, SOLVERS, __version__

from .errors import InputError, UsageError
from .files import check_output, inputs_spared, make_folder, write_text

if TYPE_CHECKING:
    from .log import Log

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
    top.add_argument("--version", action="version", version=f"launchid {__version__}")
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
    sub = commands.add_parser("nominal", help="the first nominal of a vehicle, out of its log alone")
    sub.add_argument("log", metavar="LOG.csv", help="t, one of theta, theta_dot, and one of beta, beta_cmd")
    sub.add_argument("--out", required=True, metavar="NEW.toml")
    sub.add_argument("--json", metavar="PATH|-")
    sub.set_defaults(run=nominal_command)
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
    from .nominal import load_nominal
    nominal = load_nominal(args.nominal)
    from launchid_core import Config

    from .export_c.program import c_files
    from .identify import onboard_model
    from .uncertainty.level import ranged_model
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
    from .nominal import load_nominal
    log = read_noting(args.log)
    nominal = load_nominal(args.nominal)
    check_outputs(args.json, args.plot)
    from .uncertainty import level
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
    from .nominal import load_nominal, write_nominal
    *paths, nominal_path = args.logs
    if not paths:
        raise UsageError("fit-lft: expected at least one LOG.csv before NOMINAL.toml")
    for name, value in (("--share", args.share), ("--confidence", args.confidence)):
        if not 0.0 < value < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    nominal = load_nominal(nominal_path)
    logs = [read_noting(path) for path in paths]
    check_outputs(args.out)
    from .uncertainty import greybox
    flights = [greybox.deviations(log, nominal) for log in logs]
    fit = greybox.fit(flights, args.share, args.confidence, args.profile)
    write_nominal(greybox.with_range(nominal, fit), args.out)
    print(greybox.table(fit, args.out))


def plan_command(args: argparse.Namespace) -> None:
    """launchid plan"""
    from .nominal import load_nominal, write_nominal
    nominal = load_nominal(args.nominal)
    check_outputs(args.out)
    from .plan import plan
    result = plan(nominal, args.accuracy, args.window)
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
    from .nominal import load_nominal
    at_least("--bootstrap", args.bootstrap, 0)
    log, nominal = read_noting(args.log, "t", "theta"), load_nominal(args.nominal)
    holdout = read_noting(args.holdout, "t", "theta") if args.holdout else None
    check_outputs(args.json)
    from .diagnosis.report.answer import report
    from .diagnosis.report.words import lines
    from .diagnosis.verdict import diagnose
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


def check_outputs(*paths: str | None) -> None:
    """Refuse an output that cannot be written before anything is computed; after the inputs are read."""
    for path in paths:
        if path and path != "-":
            check_output(path)


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
    from .nominal import load_nominal
    at_least("--seed", args.seed, 0)
    nominal = load_nominal(args.nominal)
    check_outputs(args.out)
    from .effects import from_text
    from .flight import fly_whole
    from .log import write_flight
    effects = [from_text(text) for text in args.effect]
    flight = fly_whole(nominal, args.seed, args.suite, args.period, effects=effects)
    write_flight(args.out, flight)
    say(f"{args.out}: {len(flight.t)} rows, {flight.period:g} s apart, seed {args.seed}"
        + ("; the vehicle was LOST and the log ends there" if flight.lost else ""))


def read_noting(path: str, *required: str) -> "Log":
    """Read a log and say which columns were ignored."""
    from .log import REQUIRED, read_log
    log = read_log(path, required or REQUIRED)
    if log.ignored:
        say(f"{path}: columns ignored: {', '.join(ascii(name)[1:-1] for name in log.ignored)}")
    return log


def identify_command(args: argparse.Namespace) -> None:
    """launchid identify"""
    from .nominal import load_nominal
    log = read_noting(args.log)
    nominal = load_nominal(args.nominal) if args.nominal else None
    check_outputs(args.json, args.plot)
    from .identify import log_config, report, run, table
    config = log_config(log, nominal, args.window, args.formulation, args.tracked, **choices(args))
    if config.missing_commands > 0.0:
        say(f"{args.log}: slower than the controller: the commands between its rows are taken as held, and the "
            "standard deviations are wider for it")
    estimates, estimator = run(config, log.samples())
    result = report(estimates, estimator, args.tracked, log)
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
    print(table(result))


def nominal_command(args: argparse.Namespace) -> None:
    """launchid nominal"""
    log = read_noting(args.log, "t")
    check_outputs(args.out, args.json)
    from .first import first, lines, report, write
    made = first(log)
    if args.json:
        text = json.dumps(report(made), indent=1)
        print(text) if args.json == "-" else write_text(args.json, [text, "\n"])
    if made.refused:
        raise InputError(f"{args.log}: {'; '.join(made.refused)}")
    write(made, args.out)
    if args.json != "-":
        print("\n".join(lines(made, args.out)))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    try:
        args = parser().parse_args(argv)
        with inputs_spared():
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

"""The command `launchid` (`python -m sim` is the same).

Exit status: 0 done; 2 wrong usage; 3 bad input; one line on stderr, never a
traceback.  stdout is data, stderr is talk.

What a command needs is imported when it runs, its files are read before anything
is that compiles: help, wrong words and missing files answer at once.
"""

import argparse
import contextlib
import json
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from launchid_core import __version__

from .errors import INTERRUPTED, INTERRUPTED_STATUS, InputError, UsageError, extra_needed
from .files import check_output, inputs_spared, write_text
from .terminal import Progress, answer, leave_stdout, open_streams, say
from .words import LOG_HELP, NOMINAL_HELP, Parser, add_choices, add_command, add_map, add_outputs, add_strict, choices

if TYPE_CHECKING:
    from .answers.answer import Answer
    from .log import Log

USAGE_STATUS, INPUT_STATUS = 2, 3


def parser() -> Parser:  # noqa: PLR0915 - a statement an argument
    """The command's words."""
    top = Parser(prog="launchid", description="On-board identification of launcher dynamics: experiments and logs.",
                 epilog="launchid COMMAND --help says more of one. Files, units, exit status: docs/formats.md; "
                        "exit status 0 done, 2 wrong usage, 3 bad input.")
    top.add_argument("--version", action="version", version=f"launchid {__version__}", help="print the version")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    from .experiments import CASES, CONFIDENCE
    sub = add_command(commands, "reproduce", "the paper's experiments: figures, table, verdict",
                      "launchid reproduce --case windowed --seeds 3 --out results")
    sub.add_argument("--case", default="all", choices=[*CASES, CONFIDENCE, "all"],
                     help="one experiment, or all of them (default %(default)s)")
    sub.add_argument("--seeds", type=int, default=20, metavar="N",
                     help="flights per case (default %(default)s, the paper's)")
    sub.add_argument("--out", default="results", metavar="DIR",
                     help="folder for figures and tables (default %(default)s)")
    sub.set_defaults(run=reproduce_command)

    sub = add_command(commands, "simulate", "fly a nominal and write its log",
                      "launchid simulate vega_like --out v.csv --seed 3 --effect control_loss:fraction=0.3,time=60")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=NOMINAL_HELP)
    sub.add_argument("--out", required=True, metavar="LOG.csv", help="the log to write")
    sub.add_argument("--seed", type=int, default=0, metavar="N",
                     help="of all noise, from 0 on; the same seed gives the same bytes (default %(default)s)")
    sub.add_argument("--suite", default="flight", choices=["flight", "ideal"],
                     help="flight: the nominal's sensors; ideal: the truth, with theta_ddot (default %(default)s)")
    sub.add_argument("--period", type=float, metavar="S",
                     help="between rows [s], a multiple of the simulation's step (default: the suite's own)")
    sub.add_argument("--effect", action="append", default=[], metavar="NAME:PARAMETER=VALUE[,PARAMETER=VALUE...]",
                     help="fly a cause of the catalogue too, see launchid effects; repeatable (default: none)")
    sub.set_defaults(run=simulate_command)

    sub = add_command(commands, "identify", "a6, k1 and the active terms of a log, window by window",
                      "launchid identify v.csv --nominal vega_like --window 5 --tracked --plot v.png")
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    sub.add_argument("--nominal", metavar="NOMINAL.toml",
                     help=f"what the simulation believes: {NOMINAL_HELP} (default: none, nothing is believed)")
    sub.add_argument("--window", default="1", metavar="S|all",
                     help="length of a window [s], or all: the whole log is one (default %(default)s)")
    add_choices(sub)
    sub.add_argument("--tracked", action="store_true",
                     help="also the estimate tracked from window to window, and sudden changes (needs --nominal)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=identify_command)

    sub = add_command(commands, "nominal", "the first nominal of a vehicle, out of its log alone",
                      "launchid nominal dfki_pendulum_ddp --out mine.toml")
    sub.add_argument("log", metavar="LOG.csv", help=f"{LOG_HELP}; here one of theta and theta_dot, and one of beta and "
                                                    "beta_cmd, is enough")
    sub.add_argument("--out", required=True, metavar="NEW.toml", help="the nominal to write")
    add_map(sub)
    add_outputs(sub)
    sub.set_defaults(run=nominal_command)

    sub = add_command(commands, "plan", "the smallest test input that reaches an accuracy",
                      "launchid plan constant --accuracy 0.01 --window 5 --out new.toml")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=NOMINAL_HELP)
    sub.add_argument("--accuracy", type=float, required=True, metavar="X",
                     help="relative standard deviation of a6 and k1 that is to be reached, above 0 and below 1")
    sub.add_argument("--window", type=float, required=True, metavar="S", help="length of a window [s]")
    sub.add_argument("--out", required=True, metavar="NEW.toml", help="the nominal with its [test_input] to write")
    sub.set_defaults(run=plan_command)

    sub = add_command(commands, "diagnose", "what the simulation gets wrong on a log, why, and what fixing it gains",
                      "launchid diagnose v.csv vega_like --report report")
    sub.add_argument("log", metavar="LOG.csv", help=f"{LOG_HELP}; here one of theta and theta_dot, and one of beta and "
                                                    "beta_cmd, is enough")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"what the simulation believes: {NOMINAL_HELP}")
    sub.add_argument("--holdout", metavar="LOG2.csv",
                     help="a second log, to judge the extended model on (default: parts of the first, left out)")
    sub.add_argument("--bootstrap", type=int, default=0, metavar="N",
                     help="measure the threshold on N clean flights of the nominal along this log, cached; "
                          "0: the built-in one (default %(default)s)")
    sub.add_argument("--noise", default="bounded", choices=["bounded", "declared", "free"],
                     help="how far noise may be from the declared: within 0.3 to 3 times (wind 0.5 to 2), not at "
                          "all, or however it is (default %(default)s)")
    sub.add_argument("--report", metavar="DIR",
                     help="folder for report.html, verdict.json, extension.toml, figures (default: none)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub)
    sub.set_defaults(run=diagnose_command)
    add_uncertainty(commands)
    add_export(commands)
    add_convert(commands)
    sub = add_command(commands, "effects", "the causes that can be flown and diagnosed, with their parameters",
                      "launchid effects --json -")
    add_outputs(sub)
    sub.set_defaults(run=effects_command)
    return top


def add_convert(commands: Any) -> None:
    """The words of `convert`."""
    sub = add_command(commands, "convert", "a flight's file (ULog, MCAP, MAT, HDF5, Parquet, CSV) as a log",
                      "launchid convert flight.ulg --map px4.toml --out log.csv")
    sub.add_argument("flight", metavar="FLIGHT", help="the file; its format is told by its first bytes")
    add_map(sub)
    sub.add_argument("--out", metavar="LOG.csv", help="the log to write (default: none, with --list)")
    sub.add_argument("--list", action="store_true", help="say what the file holds instead: names for the map")
    sub.set_defaults(run=convert_command)


def convert_command(args: argparse.Namespace) -> None:
    """launchid convert"""
    if not args.list and not (args.map and args.out):
        raise UsageError("convert: expected --map MAP.toml and --out LOG.csv, or --list")
    from .convert.mapping import load_map
    of = load_map(args.map) if args.map else None
    from .answers.of_files import channel_lines, convert
    if args.list:
        answer("\n".join(channel_lines(args.flight, of.options if of else {})))
        return
    assert of is not None
    made = convert(args.flight, of, ("t",))
    check_outputs(args.out)
    made.write(args.out)
    warn(made)
    say(made.summary(args.out))


def add_export(commands: Any) -> None:
    """The words of `export-c`."""
    sub = add_command(commands, "export-c", "the estimator in C, for a flight computer: the same bits",
                      "launchid export-c constant --out port --window 5")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"what the simulation believes: {NOMINAL_HELP}")
    sub.add_argument("--out", required=True, metavar="DIR", help="folder for launchid.h, launchid.c, replay.c")
    sub.add_argument("--window", type=float, default=1.0, metavar="S",
                     help="length of a window [s] (default %(default)s)")
    sub.add_argument("--period", type=float, metavar="S", help="between samples [s] (default: the nominal's)")
    add_choices(sub)
    sub.set_defaults(run=export_command)


def export_command(args: argparse.Namespace) -> None:
    """launchid export-c"""
    from .nominal import load_nominal
    nominal = load_nominal(args.nominal)
    from .answers.of_nominals import export_c
    made = export_c(nominal, window=args.window, period=args.period, formulation=args.formulation, **choices(args))
    made.write(args.out)
    say(made.summary(args.out))


def add_uncertainty(commands: Any) -> None:
    """The words of `uncertainty` and `fit-lft`."""
    sub = add_command(commands, "uncertainty", "where in its range each parameter is, and whether it left it",
                      "launchid uncertainty v.csv vega_like --plot level.png")
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    sub.add_argument("nominal", metavar="NOMINAL.toml",
                     help=f"what the simulation believes, with [uncertainty]: {NOMINAL_HELP}")
    sub.add_argument("--window", type=float, default=1.0, metavar="S",
                     help="length of a window [s] (default %(default)s)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=uncertainty_command)
    sub = add_command(commands, "fit-lft", "the range sigma of a6 and k1, fitted from flights",
                      "launchid fit-lft flight1.csv flight2.csv constant --out new.toml")
    sub.add_argument("logs", nargs="+", metavar="LOG.csv... NOMINAL.toml", help="one log a flight, the nominal last")
    sub.add_argument("--out", required=True, metavar="NEW.toml", help="the nominal with its [uncertainty] to write")
    sub.add_argument("--share", type=float, default=0.95, metavar="X",
                     help="of vehicles that the range holds, between 0 and 1 (default %(default)s)")
    sub.add_argument("--confidence", type=float, default=0.95, metavar="X",
                     help="that it holds them, between 0 and 1 (default %(default)s)")
    sub.add_argument("--profile", action="store_true",
                     help="sigma over flight time, where the flights tell it, as a CSV beside NEW.toml")
    add_map(sub)
    add_strict(sub)
    sub.set_defaults(run=fit_lft_command)


def uncertainty_command(args: argparse.Namespace) -> None:
    """launchid uncertainty"""
    from .nominal import load_nominal
    log = read_noting(args.log, of=args.map)
    nominal = load_nominal(args.nominal)
    check_outputs(args.json, args.plot)
    check_plot(args.plot)
    from .answers.of_logs import uncertainty
    tell(uncertainty(log, nominal, window=args.window, strict=args.strict), args.json, args.plot)


def fit_lft_command(args: argparse.Namespace) -> None:
    """launchid fit-lft"""
    from .nominal import load_nominal
    *paths, nominal_path = args.logs
    if not paths:
        raise UsageError("fit-lft: expected at least one LOG.csv before NOMINAL.toml")
    for name, value in (("--share", args.share), ("--confidence", args.confidence)):
        if not 0.0 < value < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    nominal = load_nominal(nominal_path)
    logs = [read_noting(path, of=args.map) for path in paths]
    check_outputs(args.out)
    from .answers.of_logs import fit_lft
    made = fit_lft(logs, nominal, share=args.share, confidence=args.confidence, profile=args.profile,
                   strict=args.strict)
    made.write(args.out)
    warn(made)
    answer(made.summary(args.out))


def plan_command(args: argparse.Namespace) -> None:
    """launchid plan"""
    from .nominal import load_nominal
    nominal = load_nominal(args.nominal)
    check_outputs(args.out)
    from .answers.of_nominals import plan
    made = plan(nominal, accuracy=args.accuracy, window=args.window)
    made.write(args.out)
    answer(made.summary(args.out))


def diagnose_command(args: argparse.Namespace) -> None:
    """launchid diagnose"""
    from .nominal import load_nominal
    at_least("--bootstrap", args.bootstrap, 0)
    log, nominal = read_noting(args.log, "t", of=args.map), load_nominal(args.nominal)
    holdout = read_noting(args.holdout, "t", of=args.map) if args.holdout else None
    check_outputs(args.json)
    from .answers.of_logs import diagnose
    progress = Progress()
    made = diagnose(log, nominal, holdout=holdout, bootstrap=args.bootstrap, strict=args.strict, say=progress,
                    noise=args.noise)
    progress("")
    if args.report:
        made.write_report(args.report)
    tell(made, args.json)


def effects_command(args: argparse.Namespace) -> None:
    """launchid effects"""
    check_outputs(args.json)
    from .reference import Effects
    tell(Effects(), args.json)


def warn(made: "Answer") -> None:
    """Its warnings, on stderr."""
    for line in made.warnings:
        say(line)


def tell(made: "Answer", json_path: str | None, plot_path: str | None = None) -> None:
    """An answer where it is wanted: warnings, figure, JSON, and the summary unless stdout is the JSON's."""
    warn(made)
    if plot_path:
        made.plot(plot_path)
    if json_path == "-":
        answer(made.to_json())
        return
    if json_path:
        write_text(json_path, [made.to_json(), "\n"])
    answer(made.summary())


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
    answer(reproduce(args.case, args.seeds, args.out))


def simulate_command(args: argparse.Namespace) -> None:
    """launchid simulate"""
    from .nominal import load_nominal
    at_least("--seed", args.seed, 0)
    nominal = load_nominal(args.nominal)
    check_outputs(args.out)
    from .answers.of_nominals import simulate
    made = simulate(nominal, seed=args.seed, suite=args.suite, period=args.period, effects=args.effect)
    made.write(args.out)
    warn(made)
    say(made.summary(args.out))


def read_noting(path: str, *required: str, of: str | None = None) -> "Log":
    """Read a log, of another format with the map `of`, and say which columns were ignored."""
    from .log import REQUIRED, read_log
    if of:
        from .answers.of_files import convert
        from .convert.mapping import load_map
        made = convert(path, load_map(of), required or REQUIRED)
        warn(made)
        return made.log
    from .convert.readers import foreign_format
    if foreign := foreign_format(path):
        raise InputError(f"{path}: a file of the format {foreign}; expected --map MAP.toml, or a CSV log")
    log = read_log(path, required or REQUIRED)
    if log.ignored:
        say(f"{path}: columns ignored: {', '.join(ascii(name)[1:-1] for name in log.ignored)}")
    return log


def identify_command(args: argparse.Namespace) -> None:
    """launchid identify"""
    from .nominal import load_nominal
    log = read_noting(args.log, of=args.map)
    nominal = load_nominal(args.nominal) if args.nominal else None
    check_outputs(args.json, args.plot)
    check_plot(args.plot)
    from .answers.of_logs import identify
    tell(identify(log, nominal, window=args.window, formulation=args.formulation, tracked=args.tracked,
                  strict=args.strict, **choices(args)), args.json, args.plot)


@contextlib.contextmanager
def extras_named() -> Iterator[None]:
    """A module of an extra that is not installed is wrong usage, in one line."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None


def check_plot(path: str | None) -> None:
    """Refuse a plot that cannot be drawn before anything is computed."""
    if path:
        from .plots import check_suffix
        check_suffix(path)


def nominal_command(args: argparse.Namespace) -> None:
    """launchid nominal"""
    log = read_noting(args.log, "t", of=args.map)
    check_outputs(args.out, args.json)
    from .first import first, lines, report, write
    made = first(log)
    if args.json:
        text = json.dumps(report(made), indent=1)
        if args.json == "-":
            answer(text)
        else:
            write_text(args.json, [text, "\n"])
    if made.refused:
        raise InputError(f"{args.log}: {'; '.join(made.refused)}")
    write(made, args.out)
    if args.json != "-":
        answer("\n".join(lines(made, args.out)))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    open_streams()
    try:
        try:
            args = parser().parse_args(argv)
        except SystemExit:  # help and version, on stdout
            answer(end="")
            raise
        with inputs_spared(), extras_named():
            args.run(args)
    except UsageError as error:
        say(f"launchid: {error}" if not str(error).startswith("launchid") else str(error))
        return USAGE_STATUS
    except InputError as error:
        say(f"launchid: {error}")
        return INPUT_STATUS
    except KeyboardInterrupt:
        say(INTERRUPTED)
        return INTERRUPTED_STATUS
    except BrokenPipeError:
        leave_stdout()  # the reader has gone (as `| head` does)
    return 0

"""Options that several commands share, with their help, and the class of the parser."""

import argparse
import inspect
import os
import re
from collections.abc import Callable
from typing import Any, NoReturn

from launchid_core import FORMULATIONS, NOISE_LEVELS, SOLVERS
from sim.errors import UsageError, did_you_mean

NOISE_CHOICES = ("bounded", "declared", "free")  # how far a diagnosis lets noise levels be from the declared
NOMINAL_HELP = "a nominal: a TOML file, or constant | vega_like | greensite_cr826 | cr826_max_q"
LOG_HELP = ("read this CSV log: columns t, theta, beta [s, rad, rad] and what else was measured; a file, a pipe, - for "
            "standard input, or the name of a measured log of the package such as dfki_pendulum_dircol")


class Parser(argparse.ArgumentParser):
    """argparse.ArgumentParser that raises UsageError in one line, with the nearest word as a hint."""

    def error(self, message: str) -> NoReturn:
        if wrong := re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message):
            words = [word.strip("' ") for word in wrong[2].split(",")]
            message = f"{message[:wrong.start()]}{wrong[1]!r}: " + did_you_mean(
                wrong[1], words, f"expected one of {', '.join(words)}")
        raise UsageError(f"{self.prog}: {message} (see {self.prog} --help)")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; those left over are refused here, where the options of this command are known for a hint."""
        parsed, left = super().parse_known_args(args, namespace)
        if left:
            hint = did_you_mean(left[0].partition("=")[0], self._option_string_actions) if left[0][:1] == "-" else ""
            self.error(f"unrecognized arguments: {' '.join(left)}" + (f"; {hint}" if hint else ""))
        return parsed, left


def add_command(commands: Any, name: str, text: str, example: str,
                function: Callable[..., Any] | None = None) -> Parser:
    """Add a command with help, one example and --quiet to argparse's subparsers `commands`, its options' defaults from
    `function`'s parameters; return its parser."""
    sub: Parser = commands.add_parser(name, help=text, description=f"{name}: {text}.",
                                      epilog=f"example: {example}")
    if function is not None:
        sub.set_defaults(**{option: list(default) if isinstance(default, tuple) else default
                            for option, default in defaults(function).items()})
    sub.add_argument("--quiet", action="store_true", help="say nothing of progress and compilation on stderr")
    return sub


def defaults(function: Callable[..., Any]) -> dict[str, Any]:
    """Return name -> default of a function's keyword-only parameters that have one."""
    return {name: each.default for name, each in inspect.signature(function).parameters.items()
            if each.kind is each.KEYWORD_ONLY and each.default is not each.empty}


def given(function: Callable[..., Any], args: argparse.Namespace) -> dict[str, Any]:
    """Return name -> parsed value of those options that are keyword-only parameters of the command's function."""
    return {name: getattr(args, name) for name, each in inspect.signature(function).parameters.items()
            if each.kind is each.KEYWORD_ONLY and hasattr(args, name)}


def add_nominal(sub: argparse.ArgumentParser, help: str, required: bool = False) -> None:
    """Add the nominal as an argument after the log, or as --nominal; `nominal_of` reads it, and refuses to go without
    it if `required`."""
    sub.add_argument("nominal", metavar="NOMINAL.toml", nargs="?", help=help)
    sub.add_argument("--nominal", metavar="NOMINAL.toml", dest="nominal_option",
                     help="give the nominal as an option (default: none)")
    sub.set_defaults(nominal_required=required)


def nominal_of(args: argparse.Namespace) -> str | None:
    """Return the nominal's path or name from parsed arguments; UsageError if given twice, or required and missing."""
    if args.nominal and args.nominal_option:
        raise UsageError(f"{args.nominal} and --nominal {args.nominal_option}: expected one nominal")
    given: str | None = args.nominal or args.nominal_option
    if given is None and args.nominal_required:
        raise UsageError(f"{args.command}: no nominal; expected {args.command} LOG NOMINAL.toml")
    return given


def add_logs(sub: argparse.ArgumentParser, help: str, nominal_help: str, required: bool = False,
             most: int | None = 1) -> None:
    """Add LOG [LOG ...] [NOMINAL] as one list of words, and --nominal; `logs_of` tells them apart.

    required  a nominal must be there;  most  nominals, None: any number
    """
    then = "" if most == 0 else f"; then {'a nominal' if most == 1 else 'nominals'}: {nominal_help}"
    sub.add_argument("words", nargs="+", metavar="LOG.csv" if most == 0 else "LOG.csv|NOMINAL.toml",
                     help=f"{help}; several: flights of one vehicle{then}")
    if most != 0:
        sub.add_argument("--nominal", metavar="NOMINAL.toml", dest="nominal_option",
                         help="give the nominal as an option (default: none)")
    sub.set_defaults(nominal_required=required, most_nominals=most, nominal_option=None)


def is_nominal(word: str) -> bool:
    """Whether a word of the command is a nominal: a TOML file, or the name of a built-in one if no file has it."""
    from sim.nominal import NAMES
    return word.endswith(".toml") or (word in NAMES and not os.path.exists(word))


def logs_of(args: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Return (logs, nominals) among the words of a command; UsageError for no log, too many nominals, or none where one
    is required."""
    words, nominals = list(args.words), list[str]()
    while len(words) > 1 and is_nominal(words[-1]):
        nominals.insert(0, words.pop())
    if args.nominal_option:
        nominals.append(args.nominal_option)
    if args.most_nominals is not None and len(nominals) > args.most_nominals:
        raise UsageError(f"{' and '.join(nominals)}: expected {'one nominal' if args.most_nominals else 'logs alone'}")
    if args.nominal_required and not nominals:
        if len(words) > 1 and not os.path.exists(words[-1]):
            return words[:-1], words[-1:]   # a name that is none: who reads it says which is near
        raise UsageError(f"{args.command}: no nominal; expected {args.command} LOG [LOG ...] NOMINAL.toml")
    return words, nominals


def add_map(sub: argparse.ArgumentParser) -> None:
    """Add --map, which reads files of other formats, names and units as logs, and --from, --to, which cut a log."""
    sub.add_argument("--map", metavar="NAME|MAP.toml",
                     help="read the log with this map of names and units, px4 | ardupilot | betaflight | tvc or a "
                          "file: a ULog, DataFlash, MCAP, MAT, HDF5, Parquet or other text file; see "
                          "docs/convert.md (default: what the file says it is, else CSV in SI units)")
    sub.add_argument("--from", dest="from_", metavar="T|start",
                     help="use the log's rows from this time on, s of its own time; start: from the first row on, all "
                          "phases (default: the phase in which beta moves the vehicle, or all)")
    sub.add_argument("--to", metavar="T|end", help="use the log's rows up to this time, s of its own time (default: as "
                                                   "--from)")


def add_strict(sub: argparse.ArgumentParser) -> None:
    """Add --strict, which refuses a log (exit status 3) where the data check finds a fault, instead of a warning."""
    sub.add_argument("--strict", action="store_true",
                     help="refuse a log in which the data check finds something (units, signs, stamps): exit status 3 "
                          "instead of a warning")


def add_report(sub: argparse.ArgumentParser, name: str) -> None:
    """Add --report DIR, the folder of report.html; name: the JSON file beside it, for the help."""
    sub.add_argument("--report", metavar="DIR", help=f"write report.html, {name} and the figures into this folder "
                                                     "(default: none)")


def add_outputs(sub: argparse.ArgumentParser, plot: bool = False) -> None:
    """Add --json PATH and, with `plot`, --plot PATH, which write the result to files."""
    sub.add_argument("--json", metavar="PATH|-", help="also write the answer as JSON to this file; -: print the "
                                                      "JSON alone, on stdout (default: none)")
    if plot:
        sub.add_argument("--plot", metavar="PATH", help="draw the answer into this .png, .svg or .pdf; needs "
                                                        "launchid[plots] (default: none)")


def add_choices(sub: argparse.ArgumentParser, library: str = "%(default)s") -> None:
    """Add the estimator's options (library, formulation, solver, ...); library: --library's default in its help."""
    sub.add_argument("--compression", type=int, metavar="N",
                     help="use one of N rows of a window, drawn at random (default %(default)s: all)")
    sub.add_argument("--library", metavar="NAME|TERMS",
                     help="choose the candidate terms of the equation: rigid-body | linear | quadratic | quadratic+sin "
                          f"| lpv, or a comma list such as 'theta,beta,sin(theta)' (default {library})")
    sub.add_argument("--formulation", choices=FORMULATIONS,
                     help="choose how theta_ddot is obtained: from its column, by differencing theta_dot, by "
                          "integrating the equation, or by a Kalman filter with the nominal (default: filtered with a "
                          "nominal, else measured if the log has theta_ddot, else the weak form under the log's own "
                          "noise)")
    sub.add_argument("--solver", choices=SOLVERS,
                     help="choose the solver of the sparse regression (default %(default)s)")
    sub.add_argument("--threshold", type=float, metavar="X",
                     help="leave out a term whose coefficient is smaller than this, in its own unit (default: leave "
                          "out one that explains less than 0.5 %% of the acceleration by itself; inside lpv none)")
    sub.add_argument("--seed", type=int, metavar="N",
                     help="seed the draw of the rows that --compression uses, 0 or above (default %(default)s)")
    sub.add_argument("--noise", choices=NOISE_LEVELS,
                     help="filtered: estimate the noise levels, from the nominal's on (estimated), or keep them as the "
                          "nominal has them (declared) (default %(default)s)")

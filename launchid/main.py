"""All commands of `launchid` (`python -m sim` is the same).

What a command needs is imported when it runs, its files are read before anything is that compiles: help, wrong words
and missing files answer at once.
"""

from collections.abc import Sequence

from .cli.options import Parser
from .cli.run import parser_of, run
from .commands import (
    campaign,
    compare,
    convert,
    diagnose,
    effects,
    export_c,
    fit_lft,
    identify,
    margins,
    nominal,
    plan,
    reproduce,
    show,
    simulate,
    uncertainty,
    warm,
    watch,
)

COMMANDS = (simulate, show, identify, nominal, diagnose, compare, margins, uncertainty, plan, fit_lft, campaign,
            export_c, convert, watch, effects, warm, reproduce)


def parser() -> Parser:
    """Return the parser of `launchid` with all commands and their options."""
    return parser_of(COMMANDS)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `launchid` with these arguments (None: sys.argv[1:]); return the exit status of `cli.run.run`."""
    return run(COMMANDS, argv)

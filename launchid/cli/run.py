"""Run a command line: parse it, run the command, turn errors into one line and an exit status.

Exit status: 0 done; 2 wrong usage; 3 bad input; one line on stderr, never a traceback.  stdout has data alone.
"""

import contextlib
import os
from collections.abc import Sequence
from types import ModuleType

from launchid_core import __version__
from sim.errors import INTERRUPTED, INTERRUPTED_STATUS, InputError, UsageError, extras_named
from sim.files import inputs_spared

from .compilation import hush
from .options import Parser
from .terminal import answer, leave_stdout, open_streams, progress_shown, say

USAGE_STATUS, INPUT_STATUS = 2, 3


def parser_of(commands: Sequence[ModuleType]) -> Parser:
    """Return the parser of `launchid` with the commands of these modules and their options."""
    top = Parser(prog="launchid", description="Identify a launch vehicle's a6 and k1, in flight and from logs.",
                 epilog="launchid COMMAND --help lists the options of one command. Files and units: docs/formats.md. "
                        "Exit status: 0 done, 2 wrong usage, 3 bad input.")
    top.add_argument("--version", action="version", version=f"launchid {__version__}", help="print the version")
    subparsers = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in commands:
        command.add(subparsers)
    return top


def complete(top: Parser) -> None:
    """Print the shell's completions and exit, if the shell asks for them (argcomplete, where it is installed)."""
    if "_ARGCOMPLETE" in os.environ:
        with contextlib.suppress(ModuleNotFoundError):
            import argcomplete
            argcomplete.autocomplete(top)


def run(commands: Sequence[ModuleType], argv: Sequence[str] | None = None) -> int:
    """Run `launchid`, of which there are these commands, with these arguments (None: sys.argv[1:]); return the exit
    status: 0 done, 2 wrong usage, 3 bad input, 130 interrupted by Ctrl-C."""
    open_streams()
    try:
        try:
            top = parser_of(commands)
            complete(top)
            args = top.parse_args(argv)
        except SystemExit:  # help and version, on stdout
            answer(end="")
            raise
        if args.quiet:
            hush()
        with inputs_spared(), extras_named(), progress_shown(args.quiet):
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
    except OSError as error:  # a disk that fills meanwhile
        say(f"launchid: {error}")
        return INPUT_STATUS
    return 0

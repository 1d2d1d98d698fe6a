"""List the catalogue of effects: `launchid effects`."""

import argparse
from typing import Any

from ..cli.common import check_outputs, tell
from ..cli.options import add_command, add_outputs


def add(commands: Any) -> None:
    """Add `launchid effects` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "effects", "list the effects that can be flown and diagnosed, with their parameters",
                      "launchid effects --json -")
    add_outputs(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid effects` with its parsed arguments: print the catalogue of effects."""
    check_outputs(args.json)
    from ..cli.reference import Effects
    tell(Effects(), args.json)

"""The command `launchid simulate`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import at_least, check_outputs, read_nominal, warn
from ..cli.options import NOMINAL_HELP, add_command
from ..cli.terminal import say
from ..progress import report


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "simulate", "fly a nominal and write its log",
                      "launchid simulate vega_like --out v.csv --seed 3 --effect control_loss:fraction=0.3,time=60")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"fly {NOMINAL_HELP}")
    sub.add_argument("--out", required=True, metavar="LOG.csv", help="write the log to this file")
    sub.add_argument("--seed", type=int, default=0, metavar="N",
                     help="seed all random draws, 0 or above; the same seed gives the same bytes (default %(default)s)")
    sub.add_argument("--suite", default="flight", choices=["flight", "ideal"],
                     help="log what the nominal's sensors measure (flight), or the truth with theta_ddot (ideal) "
                          "(default %(default)s)")
    sub.add_argument("--period", type=float, metavar="S",
                     help="set the time between rows [s], a multiple of the simulation's step (default: the nominal's "
                          "sensor period; ideal: the step)")
    sub.add_argument("--effect", action="append", default=[], metavar="NAME:PARAMETER=VALUE[,PARAMETER=VALUE...]",
                     help="add an effect of the catalogue, see launchid effects; may be given several times (default: "
                          "none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid simulate`."""
    at_least("--seed", args.seed, 0)
    nominal = read_nominal(args.nominal)
    check_outputs(args.out)
    from ..results.of_nominals import simulate
    report(f"flying {nominal.name}")
    result = simulate(nominal, seed=args.seed, suite=args.suite, period=args.period, effects=args.effect)
    report(f"writing {args.out}")
    result.write(args.out)
    warn(result)
    say(result.summary(args.out))

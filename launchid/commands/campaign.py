"""The command `launchid campaign`: its options, and its run."""

import argparse
from typing import Any

from sim.errors import UsageError

from ..cli.common import check_folders, read_nominal
from ..cli.options import NOMINAL_HELP, add_command
from ..cli.terminal import answer, say
from ..progress import Counter


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "campaign", "fly many randomly drawn vehicles, and prove a requirement",
                      "launchid campaign vega_like --flights 10000 --requirement 'lost<0.00135@0.9' --out proof")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"fly {NOMINAL_HELP}")
    sub.add_argument("--flights", type=int, metavar="N",
                     help="fly at most this many, one a seed (default: none, required unless --merge)")
    sub.add_argument("--out", required=True, metavar="DIR",
                     help="write flights.csv, verdict.json and, with launchid[plots], campaign.png into this folder; "
                          "an interrupted campaign in it is continued")
    sub.add_argument("--requirement", action="append", default=[], metavar="TEXT",
                     help="prove this: lost<PROBABILITY@CONFIDENCE, or METRIC<VALUE:SHARE@CONFIDENCE with "
                          "METRIC one of max_theta_error | max_theta_dot | max_alpha | max_beta | max_beta_rate; "
                          "may be given several times (default: none)")
    sub.add_argument("--stop", default="decided", choices=["decided", "never"],
                     help="stop at the first flight that decides every requirement, by a sequential test (decided), or "
                          "fly all N and judge them by order statistics (never) (default %(default)s)")
    sub.add_argument("--seed", type=int, default=0, metavar="N",
                     help="set the seed of the first flight, 0 or above; each next flight has the next seed (default "
                          "%(default)s)")
    sub.add_argument("--executor", default="local", metavar="local|dask:ADDRESS",
                     help="fly in processes of this machine (local), or on the workers of a dask scheduler such as "
                          "dask:tcp://node1:8786, which needs launchid[cluster] (default %(default)s)")
    sub.add_argument("--workers", type=int, metavar="N", help="use this many processes (default: one a core)")
    sub.add_argument("--merge", nargs="+", default=[], metavar="DIR",
                     help="fly nothing, and judge the flights of these campaigns' folders, such as a job array's "
                          "(default: none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid campaign`."""
    from ..monte_carlo.requirement.executor import check_executor
    check_executor(args.executor)
    nominal = read_nominal(args.nominal)
    check_folders(args.out)
    from ..results.of_campaigns import PICTURE, campaign, foreseen
    is_flown = not args.merge and (args.flights or 0) > 0
    for line in foreseen(nominal, args.flights, args.requirement, args.stop) if is_flown else ():
        say(line)
    progress = Counter(args.flights or 1, "flights")
    try:
        result = campaign(nominal, out=args.out, flights=args.flights, requirement=args.requirement, seed=args.seed,
                          stop=args.stop, executor=args.executor, workers=args.workers, merge=args.merge,
                          progress=progress)
    except KeyboardInterrupt:
        if progress.done > 0:
            say(f"{args.out}: {progress.done} flights are kept; the same command goes on from there")
        raise
    try:
        result.plot(f"{args.out}/{PICTURE}")
    except UsageError as error:
        say(f"{args.out}: no {PICTURE}: {error}")
    answer(result.summary(args.out))

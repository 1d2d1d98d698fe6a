"""launchid campaign"""

import argparse
from typing import Any

from ..errors import UsageError
from ..terminal import Counter, answer, say
from ..words import NOMINAL_HELP, add_command
from .talk import check_folders


def add(commands: Any) -> None:
    """Its words."""
    sub = add_command(commands, "campaign", "fly many drawn vehicles, and prove a requirement",
                      "launchid campaign vega_like --flights 10000 --requirement 'lost<0.00135@0.9' --out proof")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=NOMINAL_HELP)
    sub.add_argument("--flights", type=int, metavar="N",
                     help="how many at most, one a seed (default: none, required unless --merge)")
    sub.add_argument("--out", required=True, metavar="DIR",
                     help="folder for flights.csv, verdict.json and, with launchid[plots], campaign.png; of a campaign "
                          "that was interrupted: it goes on there")
    sub.add_argument("--requirement", action="append", default=[], metavar="TEXT",
                     help="what is to be proved: lost<PROBABILITY@CONFIDENCE, or METRIC<VALUE:SHARE@CONFIDENCE with "
                          "METRIC one of max_theta_error | max_theta_dot | max_alpha | max_beta | max_beta_rate; "
                          "repeatable (default: none)")
    sub.add_argument("--stop", default="decided", choices=["decided", "never"],
                     help="decided: at the first flight that decides every requirement, with a test that allows it; "
                          "never: N is a plan, all are flown and then judged by order statistics (default %(default)s)")
    sub.add_argument("--seed", type=int, default=0, metavar="N",
                     help="of the first flight, from 0 on; the next has the next (default %(default)s)")
    sub.add_argument("--executor", default="local", metavar="local|dask:ADDRESS",
                     help="where it is flown: processes here, or the workers of a dask scheduler such as "
                          "dask:tcp://node1:8786, which needs launchid[cluster] (default %(default)s)")
    sub.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    sub.add_argument("--merge", nargs="+", default=[], metavar="DIR",
                     help="fly nothing: judge the flights of these campaigns' folders, such as a job array's "
                          "(default: none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """launchid campaign"""
    from ..nominal import load_nominal
    from ..requirement.executor import check_executor
    check_executor(args.executor)
    nominal = load_nominal(args.nominal)
    check_folders(args.out)
    from ..answers.of_campaigns import PICTURE, campaign, foreseen
    is_flown = not args.merge and (args.flights or 0) > 0
    for line in foreseen(nominal, args.flights, args.requirement, args.stop) if is_flown else ():
        say(line)
    progress = Counter(args.flights or 1, "flights")
    try:
        made = campaign(nominal, out=args.out, flights=args.flights, requirement=args.requirement, seed=args.seed,
                        stop=args.stop, executor=args.executor, workers=args.workers, merge=args.merge,
                        progress=progress)
    except KeyboardInterrupt:
        progress.clear()
        if progress.done > 0:
            say(f"{args.out}: {progress.done} flights are kept; the same command goes on from there")
        raise
    progress.clear()
    try:
        made.plot(f"{args.out}/{PICTURE}")
    except UsageError as error:
        say(f"{args.out}: no {PICTURE}: {error}")
    answer(made.summary(args.out))

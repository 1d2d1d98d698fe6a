"""Draw the columns of logs over each other: `launchid show`."""

import argparse
from pathlib import Path
from typing import Any

from ..cli.common import check_outputs, read_noting, reading
from ..cli.options import LOG_HELP, add_command, add_map
from ..cli.terminal import answer, say


def add(commands: Any) -> None:
    """Add `launchid show` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "show", "draw the columns of logs over each other, with what the data check finds",
                      "launchid show v.csv w.csv --out look.html")
    sub.add_argument("logs", metavar="LOG.csv", nargs="+", help=f"{LOG_HELP}; a column is enough")
    add_map(sub)
    sub.add_argument("--out", default="show.html", metavar="PICTURE|PAGE.html",
                     help="write a picture (.png, .svg, .pdf), or a page that zooms (.html), which needs no network; "
                          "either needs launchid[plots] (default %(default)s)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid show` with its parsed arguments: draw the logs, and print what the data check finds."""
    logs = [read_noting(path, "t", **reading(args)) for path in args.logs]
    is_page = Path(args.out).suffix.lower() in (".html", ".htm")
    check_outputs(args.out)
    from sim.canvas import check_suffix, save
    if not is_page:
        check_suffix(args.out)
    from ..figures.logs import logs_figure, looked_at
    looked = [looked_at(log) for log in logs]
    figure = logs_figure(looked)
    if is_page:
        from ..figures.logs import write_page
        write_page(looked, figure, args.out)
    else:
        save(figure, args.out)
    for each in looked:
        for line in each.lines:
            say(line)
        answer(each.log.summary())
    answer(f"{args.out}: drawn")

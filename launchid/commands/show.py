"""Draw the columns of logs over each other: `launchid show`, `launchid.show`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ..cli.common import check_outputs, read_nominal, read_noting, reading
from ..cli.options import LOG_HELP, NOMINAL_HELP, add_command, add_logs, add_map, logs_of
from ..cli.terminal import answer, say
from ..report.answer import Answer, flat

if TYPE_CHECKING:
    from sim.result import Columns, Figure

    from ..report.log_figures import Looked
    from ..sources import LogSource, LogSources, NominalSource

PAGES = (".html", ".htm")


def add(commands: Any) -> None:
    """Add `launchid show` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "show", "draw the columns of logs over each other, with what the data check finds",
                      "launchid show v.csv w.csv --out look.html")
    add_logs(sub, f"{LOG_HELP}; a column is enough", f"check the columns against {NOMINAL_HELP} (default: none)")
    add_map(sub)
    sub.add_argument("--out", default="show.html", metavar="PICTURE|PAGE.html",
                     help="write a picture (.png, .svg, .pdf), or a page that zooms (.html), which needs no network; "
                          "either needs launchid[plots] (default %(default)s)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid show` with its parsed arguments: draw the logs, and print what the data check finds."""
    names, nominals = logs_of(args)
    logs = [read_noting(path, "t", **reading(args)) for path in names]
    nominal = read_nominal(nominals[0]) if nominals else None
    check_outputs(args.out)
    if Path(args.out).suffix.lower() not in PAGES:
        from sim.canvas import check_suffix
        check_suffix(args.out)
    result = show(logs, nominal)
    result.write(args.out)
    for line in result.warnings:
        say(line)
    answer(f"{result.summary()}\n{args.out}: drawn")


def show(log: LogSources, nominal: NominalSource | None = None) -> Shown:
    """Look at logs before anything is computed: their columns, phases, and what the data check finds.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log; or a list of these
        A column beside t is enough.
    nominal : path, name of a built-in one, or Nominal, optional
        Check the columns against it.

    Returns
    -------
    Shown
        `plot` draws it, `write` makes a page of it.
    """
    from ..report.headline import shown_path
    from ..report.log_figures import looked_at
    from ..sources import is_several, load_nominal, read_log
    believed = None if nominal is None else load_nominal(nominal)
    given = cast("list[LogSource]", log) if is_several(log) else [cast("LogSource", log)]
    logs = [read_log(each, ("t",)) for each in given]
    looked = [looked_at(each, believed) for each in logs]
    names, options = " ".join(each.path for each in logs), logs[0].options
    follow = f"launchid nominal {names} --out first.toml{options}" if believed is None else \
        f"launchid identify {names} {shown_path(believed.path or believed.name)}{options}"
    faults = sum(len(each.faults) for each in looked)
    head = "The data check finds nothing." if not faults else \
        f"The data check finds {faults} fault{'s' * (faults > 1)}: see the lines above."
    report = {"headline": head, "next": follow, "logs": [
        {"log": each.log.path, "rows": len(each.log.t), "refused": each.refused or None,
         "faults": [fault.__dict__ for fault in each.faults], "phases": list(each.phases)} for each in looked]}
    return Shown(tuple(looked), report, tuple(line for each in looked for line in each.lines))


@dataclass(frozen=True, eq=False)
class Shown(Answer):
    """Result of `show`: logs as they are, and what the data check finds in them."""

    looked: tuple[Looked, ...]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        from ..report.headline import closing
        return "\n".join([*(each.log.summary() for each in self.looked), *closing(self.report)])

    def columns(self) -> Columns:
        rows = [{"log": each.log.path, **fault.__dict__} for each in self.looked for fault in each.faults]
        return flat(rows) or {name: [] for name in ("log", "kind", "channel", "t_start", "t_end", "rows", "message")}

    def _figure(self) -> Figure:
        from ..report.log_figures import logs_figure
        return logs_figure(self.looked)

    def write(self, path: str | Path) -> None:
        """Write a picture (.png, .svg, .pdf), or a page that zooms (.html)."""
        if Path(path).suffix.lower() in PAGES:
            from ..report.log_figures import write_page
            write_page(self.looked, self._figure(), str(path))
        else:
            self.plot(path)

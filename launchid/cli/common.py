"""Steps that the commands share: read inputs and print notes on them, refuse outputs early, print a result."""

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sim.errors import InputError, UsageError
from sim.files import check_folder, check_output, write_text

from ..progress import report
from .terminal import answer, say

if TYPE_CHECKING:
    from sim.nominal import Nominal

    from ..log.log import Log
    from ..report.answer import Answer


def warn(result: "Answer") -> None:
    """Print the warnings of a command's result on stderr, one a line."""
    for line in result.warnings:
        say(line)


def tell(result: "Answer", json_path: str | None, plot_path: str | None = None) -> None:
    """Print a result's warnings and summary, write its figure and JSON; json_path "-": JSON on stdout, no summary."""
    warn(result)
    if plot_path:
        result.plot(plot_path)
    if json_path == "-":
        answer(result.to_json())
        return
    if json_path:
        write_text(json_path, [result.to_json(), "\n"])
    answer(result.summary())


def check_outputs(*paths: str | None, plots: tuple[str | None, ...] = (), folder: str | None = None) -> None:
    """Raise, before anything is computed, for an output that cannot be written (None and "-" pass): InputError for a
    file or a folder; UsageError for a plot (`plots`) whose suffix is no figure format."""
    for path in (*paths, *plots):
        if path and path != "-":
            check_output(path)
    if any(plots):
        from sim.canvas import check_suffix
        for path in filter(None, plots):
            check_suffix(path)
    if folder:
        check_folder(folder)


def at_least(name: str, value: int, low: int) -> None:
    """Raise UsageError, which names the option `name`, unless value >= low."""
    if value < low:
        raise UsageError(f"{name} {value}: expected an integer of at least {low}")


def reading(args: argparse.Namespace) -> dict[str, Any]:
    """Return the parsed options that say how a log is read (`options.add_map`), as keywords of `read_noting`."""
    return {"map_path": args.map, "from_": args.from_, "to": args.to}


def read_noting(path: str, *required: str, map_path: str | None = None, from_: str | None = None,
                to: str | None = None) -> "Log":
    """Read a log (of another format with the map at `map_path`), and print on stderr which columns were ignored.

    from_, to  first and last time [s] of the rows that are used, as texts; None: all, or what the map says
    """
    from ..log.cut import cut_log
    from ..log.log import read_log
    from ..log.table import DRIVEN
    report(f"reading {path}")
    from ..convert.readers import map_by_itself, refuse_foreign
    asked, own = map_path, None if map_path else map_by_itself(path)
    if map_path or own:
        from ..convert.columns import converted
        from ..convert.mapping import map_for
        try:
            mapping = map_for(path, map_path or own or "", bool(map_path))
        except InputError:
            if own:
                refuse_foreign(path)   # which says what to do
            raise
        mapping = replace(mapping, cut=mapping.cut.but(from_, to))
        log, notes = converted(path, mapping, required or DRIVEN)
        for note in notes:
            say(note)
        return replace(log, options=_options(asked, from_, to))
    refuse_foreign(path)
    log = read_log(path, required or DRIVEN)
    if log.ignored:
        say(f"{path}: columns ignored: {', '.join(ascii(name)[1:-1] for name in log.ignored)}")
    return replace(cut_log(log, from_, to), options=_options(None, from_, to))


def _options(map_path: str | None, from_: str | None, to: str | None) -> str:
    """Return the options with which a log was read, as they follow its name in a command."""
    return "".join(f" {name} {value}" for name, value in (("--map", map_path), ("--from", from_), ("--to", to))
                   if value is not None)


def read_nominal(path: str) -> "Nominal":
    """Read a nominal, and print a warning on stderr if its controller turns the vehicle away from its reference."""
    from sim.nominal import load_nominal, wrong_feedback
    nominal = load_nominal(path)
    if warning := wrong_feedback(nominal):
        say(warning)
    return nominal

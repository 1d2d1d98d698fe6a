"""Compare a log with nominals: `launchid compare`, `launchid.compare`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

from sim.errors import UsageError

from ..argument_checks import integer
from ..cli.common import at_least, check_outputs, read_nominal, read_noting, reading, tell
from ..cli.options import (
    LOG_HELP,
    NOMINAL_HELP,
    add_command,
    add_logs,
    add_map,
    add_outputs,
    add_report,
    add_strict,
    given,
    logs_of,
)
from ..log.table import DRIVEN, REQUIRED

if TYPE_CHECKING:
    from sim.nominal import Nominal

    from ..report.comparison import Comparison
    from ..report.comparisons import Comparisons
    from ..sources import LogSource, LogSources, NominalSource


def add(commands: Any) -> None:
    """Add `launchid compare` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "compare", "hold a log beside nominals: predictions, flights, dispersions, responses",
                      "launchid compare v.csv vega_like report/extension.toml --report compared", compare)
    add_logs(sub, LOG_HELP, f"hold the log beside {NOMINAL_HELP}; of several, such as one and the extension.toml that "
                            "diagnose made of it, each", required=True, most=None)
    sub.add_argument("--flights", type=int, metavar="N",
                     help="fly each nominal this often with its dispersions, and give the log's place among them; 0: "
                          "none (default %(default)s)")
    add_report(sub, "compare.json")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid compare` with its parsed arguments: print the comparison, and write what options ask for."""
    at_least("--flights", args.flights, 0)
    names, paths = logs_of(args)
    nominals = [read_nominal(path) for path in paths]
    logs = [read_noting(name, *_required(nominals), **reading(args)) for name in names]
    check_outputs(args.json, plots=(args.plot,), folder=args.report)
    result = compare(logs if len(logs) > 1 else logs[0], *nominals, **given(compare, args))
    if args.report:
        result.write_report(args.report)
    tell(result, args.json, args.plot)


def compare(log: LogSources, *nominals: NominalSource, flights: int = 200,
            strict: bool = False) -> Comparison | Comparisons:
    """Compare a log with nominals: predictions 0.1, 0.5 and 1 s ahead, flights from the log's reference, the log's
    place among dispersed flights, frequency responses.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log; or a list of these
        A list: flights of one vehicle, each compared.
    *nominals : path, name of a built-in one, or Nominal
        One or several, such as a nominal and the extension that `diagnose` made of it.
    flights : int
        Dispersed flights of each nominal; 0: none.
    strict : bool
        Raise InputError where the data check finds a fault.

    Returns
    -------
    Comparison
        Of a list of logs Comparisons, which hold that of each.
    """
    import numpy as np

    from ..comparison.flown import LATEST_START, dispersed, flown
    from ..comparison.frequency_response import frequency_responses
    from ..comparison.prediction import predictions
    from ..log.check import checked
    from ..log.phases import flight_of
    from ..progress import Counter
    from ..report.comparison import Beside, Comparison, labels, masked, report
    from ..report.headline import of_compared, shown_path
    from ..sources import is_several, load_nominal, read_log, several_logs
    flights = integer("--flights", flights, 0)
    if not nominals:
        raise UsageError("compare: expected at least one nominal")
    believed = [load_nominal(nominal) for nominal in nominals]
    if is_several(log):
        from ..report.comparisons import Comparisons
        found = [cast("Comparison", compare(each, *believed, flights=flights, strict=strict))
                 for each in several_logs(log, _required(believed))]
        return Comparisons(found) if len(found) > 1 else found[0]
    log, said = flight_of(read_log(cast("LogSource", log), _required(believed)))
    made, first = list[Beside](), None
    count = Counter(flights * len(believed), "flights with the dispersions")
    for label, nominal in zip(labels(believed), believed, strict=True):
        seen = checked(log, nominal, strict=strict)
        said += seen.warnings
        clean = masked(seen.log, seen.data)
        first = first or clean
        made.append(Beside(label, nominal, predictions(seen.log, nominal, seen.data), flown(clean, nominal),
                           dispersed(clean, nominal, flights, count) if flights > 0 else None,
                           frequency_responses(clean, nominal)))
    t = log.t[np.isfinite(log.t)]
    if not 0.0 <= t.min() <= LATEST_START and any(each.nominal.controller is not None for each in made):
        said += (f"{log.path}: begins at {t.min():g} s; flights of a nominal begin at 0 s, so none is flown beside it",)
    assert first is not None
    answer = report(first, made)
    names = [shown_path(each.path or each.name) for each in believed]
    answer |= of_compared(answer, log.path, log.options,
                          names if len(set(names)) == len(names) else [each.label for each in made])
    return Comparison(first, made, answer, tuple(dict.fromkeys(said)))


def _required(nominals: Sequence[Nominal]) -> tuple[str, ...]:
    """Return the columns of a log that can be compared: with each servo known, commands stand for the nozzle."""
    return REQUIRED if any(each.actuator is None for each in nominals) else DRIVEN

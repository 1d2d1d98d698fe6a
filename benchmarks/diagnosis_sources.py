"""The sources of the labelled set: make the log and the nominal of a case.

    hidden = "slosh+actuator_delay"   a flight of the independent generator (tests/hidden) with these causes or effects
                                      that nobody listed, "" for none; nominal, seed, rate [Hz], and of `draw_spec`
                                      factor, variant, reference, duration [s], drop; air = "windy": in declared wind
    simulated = "EFFECT:P=V,... ..."  one of the project's own simulator; seed, duration, period [s], drop
    rebuilt = "ship"                  a function of tests/public_flights.py, which flies a stand of known truth; with
    foreign = "gust"                  a case of JSBSim's J246 (tests/foreign; needs the extra `judges`); seed
    log = "NAME"                      a measured log: of the package, of tests/public, or of a folder that is given

and what is done to its columns, in this order: as_command (the input is a command, no measured nozzle), drop, changes
(words of CHANGES: what loggers and their users do), shift (a placebo: the input moved circularly by this part of the
log).
"""

import copy
import dataclasses
import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # the generators are no installed packages

import public_flights  # noqa: E402
from diagnosis_labels import Case  # noqa: E402
from hidden import OTHER, PLAIN, Weather, draw_spec, fly  # noqa: E402
from hidden.catalogue import CAUSES  # noqa: E402

from launchid.log.log import MEASURED_LOGS, Log, flown_log, log_of_values, read_log  # noqa: E402
from sim.effects import from_text  # noqa: E402
from sim.flight import fly_whole  # noqa: E402
from sim.nominal import BUILT_IN, STAND_NOMINALS, Nominal, Wind, load_nominal  # noqa: E402
from sim.nominal.reader import nominal_of as nominal_of_table  # noqa: E402
from sim.nominal.table import Table  # noqa: E402

PUBLIC = ROOT / "tests" / "public"
DECLARED = Wind(turbulence=0.005, walk=0.002)   # of a windy flight: as the nominal declares it, and as it blows
WEATHER = Weather(DECLARED.turbulence, DECLARED.walk, DECLARED.turbulence_time, DECLARED.initial)
LOST = 0.05          # share of the rows that `lost` takes away
SPIKE = 0.3          # rad, of `spiked`
STOPPED = (0.4, 0.42)  # of the log, in which a `frozen` channel stands still
DRAWN = 7            # seed of what is drawn here

Columns = dict[str, np.ndarray]


class Absent(Exception):
    """A log, a package or a nominal is not on this machine; the message says which, and where to get it."""


class Material(NamedTuple):
    """A case's log, its nominal, and what only the generator knows.

    truth   {"cause.parameter": value} of the hidden causes
    places  at which an unlisted effect may be said to be; empty: nothing is known
    """

    log: Log
    nominal: Nominal
    truth: dict[str, float]
    places: tuple[str, ...]


def material(case: Case, nominals: dict[str, Any], folders: tuple[Path, ...] = ()) -> Material:
    """Return the log and the nominal of a case; Absent where this machine does not have them."""
    kind, name = case.source
    log, nominal, truth, places = MAKERS[kind](case, name, nominals, folders)
    if case.options.get("as_command"):
        log = as_command(log)
    columns = {key: value for key, value in log.measured().items() if key not in case.options.get("drop", ())}
    for words in case.options.get("changes", ()):
        verb, _, what = words.partition(" ")
        columns = CHANGES[verb](columns, *what.split())
    log = log_of_values(log.path, columns)
    if "shift" in case.options:
        log = shifted(log, case.options["shift"])
    return Material(log, nominal, truth, places)


# ---- where it comes from


Made = tuple[Log, Nominal, dict[str, float], tuple[str, ...]]
Maker = Callable[[Case, str, dict[str, Any], tuple[Path, ...]], Made]


def _hidden(case: Case, name: str, nominals: dict[str, Any], folders: tuple[Path, ...]) -> Made:
    """Fly the independent generator; columns that are dropped were never written."""
    options, nominal = case.options, load_nominal(case.nominal)
    given = {key: options[key] for key in ("rate", "reference", "duration") if key in options}
    given |= {"drop": tuple(options.get("drop", ()))}
    seed = options["seed"]
    if options.get("air") == "windy":
        nominal = dataclasses.replace(nominal, wind=DECLARED)
        given["wind"] = dataclasses.replace(WEATHER, variant=OTHER if seed // 4 % 2 else PLAIN)
    columns, label = fly(draw_spec(seed, tuple(name.split("+")) if name else None, case.nominal,
                                   options.get("factor", 1.0), options.get("variant", PLAIN), **given))
    truth = {f"{cause['cause']}.{value.contract}": cause["parameters"][value.contract] for cause in label.causes
             for value in CAUSES[cause["cause"]].values[:1]}
    places = tuple(sorted(frozenset().union(*label.places)))
    return log_of_values(case.name, columns), nominal, truth, places


def _simulated(case: Case, name: str, nominals: dict[str, Any], folders: tuple[Path, ...]) -> Made:
    """Fly the project's own simulator with the effects `name`."""
    options, nominal = case.options, named_nominal(case.nominal, nominals)
    if "duration" in options:
        nominal = dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation,
                                                                              duration=options["duration"]))
    flight = fly_whole(nominal, options.get("seed", 1), period=options.get("period"),
                       effects=[from_text(text) for text in name.split()])
    return flown_log(flight, case.name), nominal, {}, ()


def _rebuilt(case: Case, name: str, nominals: dict[str, Any], folders: tuple[Path, ...]) -> Made:
    """Fly a stand of known truth."""
    columns = getattr(public_flights, name)(**case.options.get("with", {}))
    return log_of_values(case.name, columns), named_nominal(case.nominal, nominals), {}, ()


def _foreign(case: Case, name: str, nominals: dict[str, Any], folders: tuple[Path, ...]) -> Made:
    """Fly JSBSim's launcher, with the nominal of its own numbers."""
    try:
        from foreign import j246_cases
    except ImportError:
        raise Absent("JSBSim (extra `judges`) is not installed") from None
    seed = case.options["seed"]
    known, flight = j246_cases.flown(name, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.toml"
        j246_cases.write_log(path.with_suffix(".csv"), flight)
        j246_cases.write_nominal(path, known, seed)
        log, nominal = read_log(path.with_suffix(".csv")), load_nominal(path)
    truth = {f"{known.causes[0]}.{known.parameter}": known.size} if known.causes and math.isfinite(known.size) else {}
    return log, nominal, truth, ()


def _log(case: Case, name: str, nominals: dict[str, Any], folders: tuple[Path, ...]) -> Made:
    """Read a measured log, and its nominal: built in, of the set, or NAME.toml beside the log."""
    path = next((folder / f"{name}.csv" for folder in (MEASURED_LOGS, PUBLIC, *folders)
                 if (folder / f"{name}.csv").is_file()), None)
    if path is None:
        raise Absent(f"{name}.csv is in none of the folders given (benchmarks/real_suite.py says where it is from)")
    return read_log(path, ("t",)), named_nominal(case.nominal, nominals), {}, ()


MAKERS: dict[str, Maker] = {"hidden": _hidden, "simulated": _simulated, "rebuilt": _rebuilt, "foreign": _foreign,
                            "log": _log}


def named_nominal(name: str, nominals: dict[str, Any]) -> Nominal:
    """Return a built-in nominal, or one of the set's tables `nominals`; ValueError if it is neither."""
    if name in BUILT_IN + STAND_NOMINALS:
        return load_nominal(name)
    if name not in nominals:
        raise ValueError(f"nominal {name}: expected one of {', '.join((*BUILT_IN, *STAND_NOMINALS, *nominals))}")
    return nominal_of_table(Table(Path(f"{name}.toml"), copy.deepcopy(nominals[name]) | {"name": name}))


# ---- what is done to it


def shifted(log: Log, part: float) -> Log:
    """Return the log with its input, nozzle and command, moved circularly by this part of the log: a placebo."""
    rows = round(part * len(log.t))
    return dataclasses.replace(log, beta=np.roll(log.beta, rows), beta_cmd=np.roll(log.beta_cmd, rows))


def as_command(log: Log) -> Log:
    """Return the log with its measured nozzle as command; unchanged if it has a command."""
    if np.isfinite(log.beta_cmd).any():
        return log
    columns = tuple("beta_cmd" if name == "beta" else name for name in log.columns)
    return dataclasses.replace(log, columns=columns, beta=np.full(len(log.t), math.nan), beta_cmd=log.beta)


def _scaled(columns: Columns, name: str, by: str) -> Columns:
    """Return the columns with one scaled: another unit, or the other sign."""
    return columns | {name: float(by) * columns[name]}


def _swapped(columns: Columns, first: str, second: str) -> Columns:
    """Return the columns with two under each other's name."""
    return columns | {first: columns[second], second: columns[first]}


def _lost(columns: Columns) -> Columns:
    """Return the columns without a share LOST of rows, drawn one by one."""
    rows = len(columns["t"])
    kept = np.sort(np.random.default_rng(DRAWN).choice(rows, round((1.0 - LOST) * rows), replace=False))
    return {name: values[kept] for name, values in columns.items()}


def _spiked(columns: Columns, name: str) -> Columns:
    """Return the columns with a spike of SPIKE in one row of a channel."""
    values = columns[name].copy()
    values[len(values) // 2] += SPIKE
    return columns | {name: values}


def _frozen(columns: Columns, name: str) -> Columns:
    """Return the columns with a channel that repeats one value for a while, as a link that stops."""
    values, rows = columns[name].copy(), len(columns["t"])
    first, last = (round(part * rows) for part in STOPPED)
    values[first:last] = values[first]
    return columns | {name: values}


def _thinned(columns: Columns, every: str) -> Columns:
    """Return every so many rows only."""
    return {name: values[::int(every)] for name, values in columns.items()}


def _clipped(columns: Columns, name: str, part: str) -> Columns:
    """Return the columns with a channel cut at this part of its largest value: a sensor that saturates."""
    top = float(part) * np.nanmax(np.abs(columns[name]))
    return columns | {name: np.clip(columns[name], -top, top)}


def _early(columns: Columns, name: str, rows: str) -> Columns:
    """Return the columns with a channel moved earlier by whole rows: its stamps are older than they say."""
    return columns | {name: np.concatenate([columns[name][int(rows):], columns[name][-1:].repeat(int(rows))])}


CHANGES: dict[str, Callable[..., Columns]] = {
    "scaled": _scaled, "swapped": _swapped, "lost": _lost, "spiked": _spiked, "frozen": _frozen, "thinned": _thinned,
    "clipped": _clipped, "early": _early}

"""Read MAP.toml, which says which channel of a flight's file is which column of the log, its unit and its stamps."""

import math
import re
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim.csv_text import shown
from sim.errors import InputError, UsageError, did_you_mean
from sim.files import reads

from ..log.cut import END, START, WHOLE, Cut
from ..log.log import OPTIONAL, REQUIRED, SHORTEST_STEP
from ..log.table import UNITS
from . import named
from .text import HEAD_LINES
from .units import ANGLE_UNITS, TIME_UNITS

SHORT_UNITS = {"degrees": "deg", "degree": "deg", "radians": "rad", "radian": "rad"}
LONG_UNIT_NAMES = re.compile("|".join(SHORT_UNITS))
HELD_COLUMNS = ("beta_cmd", "theta_ref", "rate_ref")  # what a computer says holds until it says something else
TAKES = ("nearest", "held", "linear")
AXES = ("x", "y", "z")
ORDERS = ("wxyz", "xyzw")
ONLY_OF = {"weights": "sum", "order": "quaternion", "axis": "quaternion", "reference": "quaternion"}


@dataclass(frozen=True)
class Source:
    """Source of one column of the log: a weighted sum of channels, or the angle of a quaternion about one axis.

    channels   of the sum, or the quaternion's four, w first;  weights: of the sum
    axis       0, 1, 2: of the quaternion; None: a sum.  reference: attitude w, x, y, z of angle 0; None: that of row 0
    scale, offset, factor  value in the column's SI unit = factor*(scale*raw + offset)
    take       value that a row gets: "nearest", "held" (the last before it) or "linear"
    time       channel of its stamps; None: the map's, in its own group
    within     [s] farthest value from a row that counts; None: see `columns`
    """

    column: str
    channels: tuple[str, ...]
    weights: tuple[float, ...]
    axis: int | None = None
    reference: tuple[float, ...] | None = None
    scale: float = 1.0
    offset: float = 0.0
    factor: float = 1.0
    take: str = "nearest"
    time: str | None = None
    within: float | None = None


@dataclass(frozen=True)
class Map:
    """Map of a flight's file to a log, as it was read from `path`.

    sources  in the order of the log's columns
    time     channel of the stamps, of which `units` make a second; from_first: t = 0 is at the first
    clock    column whose rows are the log's; None: the slower of theta and beta
    options  of a text file, see `text.read_text`
    period   [s] of rows without stamps; None: they have stamps
    cut      the rows that are used, of the log's own time
    notes    one line each: what a map by name took for what
    """

    path: str
    sources: tuple[Source, ...]
    time: str
    units: int
    from_first: bool
    clock: str | None
    options: dict[str, Any]
    period: float | None = None
    cut: Cut = WHOLE
    notes: tuple[str, ...] = ()

    def channels(self) -> frozenset[str]:
        """Return the names of all channels that the map can need of a file: of its sources and their stamps."""
        stamps = _stamps(self.sources, self.time) if self.period is None else frozenset()
        return stamps.union(*(source.channels for source in self.sources))


def map_for(flight: str | Path, path: str | Path, was_asked: bool = True) -> Map:
    """Return the map of a flight's file: a named one (px4, ardupilot, betaflight, tvc), one read from `path`, or one
    that says by `base` which named one it begins with.

    was_asked  the user named it;  InputError, in one line, if it cannot be used or the file lacks what it names
    """
    path, flight = str(path), str(flight)
    is_name = path in named.NAMES and not Path(path).exists()
    table = {"base": path} if is_name else _read(path)
    base = table.pop("base", None)
    if base is None:
        return _Reader(path, table).map()
    if base not in named.NAMES:
        raise InputError(f"{path}: base = {_cut(base)}: " + did_you_mean(
            str(base), named.NAMES, f"expected one of {', '.join(named.NAMES)}"))
    from .readers import read_channels
    options = table.get("file")
    channels = read_channels(flight, options if isinstance(options, dict) else {})
    made = named.table_of(base, flight, channels, table)
    said = named.notes(base, flight, made, was_asked)
    return replace(_Reader(f"map {base}" if is_name else path, made).map(), notes=tuple(said))


def load_map(path: str | Path) -> Map:
    """Read and check a map; raise InputError, in one line that names file and key, if it cannot be used."""
    path = str(path)
    table = _read(path)
    if "base" in table:
        raise InputError(f"{path}: base = {_cut(table['base'])} is for a file that is there, whose channels tell the "
                         "rest; expected [time] and [columns]")
    return _Reader(path, table).map()


def _read(path: str) -> dict[str, Any]:
    """Return a map's TOML table; InputError, in one line, if it is none."""
    try:
        reads(path)
        return tomllib.loads(Path(path).read_bytes().decode("utf-8"))
    except OSError as error:
        wanted = did_you_mean(path, named.NAMES, f"expected a map, or one of {', '.join(named.NAMES)}, see "
                              "docs/convert.md")
        raise InputError(f"{path}: cannot be read ({error.strerror}); {wanted}") from None
    except (UnicodeDecodeError, ValueError) as error:
        raise InputError(f"{path}: {str(error).splitlines()[0]}") from None
    except RecursionError:
        raise InputError(f"{path}: nested too deeply; expected a map, see docs/convert.md") from None


def _stamps(sources: tuple[Source, ...], time: str) -> frozenset[str]:
    """Return the channels that may hold these sources' stamps: `time` in the group of each or in none, their own."""
    groups = {name.rpartition("/")[0] for source in sources for name in source.channels}
    return frozenset({time, *(f"{group}/{time}" for group in groups), *(each.time for each in sources if each.time)})


def _cut(value: object) -> str:
    """Return a value as text for a message, cut to a readable length."""
    try:
        return shown(repr(value))[1:-1]
    except (ValueError, RecursionError):  # an integer of too many digits for Python to print
        return "..."


class _Reader:
    """Reader and checker of one map's TOML table; its errors name the key."""

    def __init__(self, path: str, table: dict[str, Any]) -> None:
        self.path, self.table = path, table

    def fail(self, place: str, value: object, expected: str) -> InputError:
        return InputError(f"{self.path}: {place} = {_cut(value)}: expected {expected}")

    def section(self, place: str, value: Any, known: tuple[str, ...]) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.fail(place, value, "a section")
        for key in value:
            if key not in known:
                name = key if value is self.table else f"{place}.{key}"
                raise InputError(f"{self.path}: unknown key '{name}'; expected one of {', '.join(known)}")
        return value

    def word(self, place: str, table: dict[str, Any], key: str, words: tuple[str, ...] | None, default: Any) -> Any:
        value = table.get(key, default)
        if value is default:
            return value
        if not isinstance(value, str) or (words is not None and value not in words):
            raise self.fail(f"{place}.{key}", value, "a text" if words is None else f"one of {', '.join(words)}")
        return value

    def number(self, place: str, value: Any, low: float = -math.inf) -> float:
        try:
            number = math.nan if isinstance(value, bool) or not isinstance(value, (int, float)) else float(value)
        except OverflowError:
            number = math.nan
        if not math.isfinite(number) or number < low:
            raise self.fail(place, value, "a number" + (f" of at least {low:g}" if low > -math.inf else ""))
        return number

    def map(self) -> Map:
        self.section("map", self.table, ("time", "columns", "file", "cut"))
        columns = self.section("columns", self.table.get("columns", {}), REQUIRED[1:] + OPTIONAL)
        time = self.section("time", self.table.get("time", {}), ("name", "unit", "origin", "clock", "period", "format"))
        if not columns:
            raise InputError(f"{self.path}: [columns] is empty; expected [columns.theta] and others")
        period = self.period(time)
        if unstamped := [name for name, value in columns.items() if "period" in time and isinstance(value, dict)
                         and "time" in value]:
            raise InputError(f"{self.path}: columns.{unstamped[0]}.time is of stamps, time.period of rows without any; "
                             "leave one of them out")
        names = [name for name in REQUIRED[1:] + OPTIONAL if name in columns]
        sources = tuple(self.source(name, columns[name]) for name in names)
        options = self.options()
        if form := self.word("time", time, "format", None, None):
            options |= {"format": form, "stamps": _stamps(sources, time["name"])}
        return Map(
            path=self.path, sources=sources, time=time.get("name", ""),
            units=TIME_UNITS[self.word("time", time, "unit", tuple(TIME_UNITS), "s")],
            from_first=self.word("time", time, "origin", ("first", "file"), "first") == "first",
            clock=self.word("time", time, "clock", tuple(names), None),
            options=options, period=period, cut=self.cut())

    def cut(self) -> Cut:
        """Return the rows that [cut] chooses: from, to [s], or "start" and "end"."""
        ends = self.section("cut", self.table.get("cut", {}), ("from", "to"))
        for key, value in ends.items():
            if isinstance(value, bool) or not isinstance(value, (int, float, str)):
                raise self.fail(f"cut.{key}", value, f'a time in s, or "{START if key == "from" else END}"')
        try:
            return WHOLE.but(ends.get("from"), ends.get("to"), ("cut.from", "cut.to"))
        except UsageError as error:
            raise InputError(f"{self.path}: {error}") from None

    def period(self, time: dict[str, Any]) -> float | None:
        """Return the period [s] of rows without stamps; None if [time] names a channel of stamps."""
        if "period" not in time:
            if not isinstance(time.get("name"), str):
                raise self.fail("time.name", time.get("name"), "the name of the stamps' channel, or a time.period [s]")
            return None
        for key in ("name", "unit", "format", "origin"):
            if key in time:
                raise InputError(f"{self.path}: time.{key} is of stamps, time.period of rows without any; leave one "
                                 "of them out")
        return self.number("time.period", time["period"], SHORTEST_STEP)

    def options(self) -> dict[str, Any]:
        """Return the checked options of a text file ([file]): delimiter, decimal, header."""
        options = self.section("file", self.table.get("file", {}), ("delimiter", "decimal", "header"))
        for key in ("delimiter", "decimal"):
            value = options.get(key, "x")
            if not isinstance(value, str) or len(value) != 1 or value in '"\r\n' or (
                    key == "decimal" and value.isspace()):
                raise self.fail(f"file.{key}", value, "one character")
        if options.get("delimiter", ";") == options.get("decimal", "."):
            raise self.fail("file.decimal", options["decimal"], "another character than the delimiter")
        header = options.get("header", 0)
        if not isinstance(header, int) or isinstance(header, bool) or not 0 <= header <= HEAD_LINES:
            raise self.fail("file.header", header, f"the number of the header's line, up to {HEAD_LINES}, 0 for none")
        return options

    def source(self, name: str, value: Any) -> Source:
        place = f"columns.{name}"
        table = self.section(place, value, ("from", "sum", "weights", "quaternion", "order", "axis", "reference",
                                            "unit", "scale", "offset", "take", "time", "within"))
        given = [key for key in ("from", "sum", "quaternion") if key in table]
        if len(given) != 1:
            raise InputError(f"{self.path}: [{place}] has {' and '.join(given) or 'no source'}; "
                             "expected one of from, sum, quaternion")
        self.fits_the_source(name, place, table, given[0])
        channels, weights, axis, reference = getattr(self, f"of_{given[0]}")(place, table)
        suffix = UNITS[name].removeprefix("rad")
        if isinstance(table.get("unit"), str):
            table = table | {"unit": LONG_UNIT_NAMES.sub(lambda found: SHORT_UNITS[found[0]], table["unit"])}
        unit = self.word(place, table, "unit", tuple(f"{angle}{suffix}" for angle in ANGLE_UNITS), f"rad{suffix}")
        within = None if "within" not in table else self.number(f"{place}.within", table["within"], 0.0)
        return Source(
            name, channels, weights, axis, reference, self.number(f"{place}.scale", table.get("scale", 1.0)),
            self.number(f"{place}.offset", table.get("offset", 0.0)), ANGLE_UNITS[unit.removesuffix(suffix)],
            self.word(place, table, "take", TAKES, "held" if name in HELD_COLUMNS else "nearest"),
            self.word(place, table, "time", None, None), within)

    def fits_the_source(self, name: str, place: str, table: dict[str, Any], given: str) -> None:
        """Raise InputError for keys that this kind of source (`given`: from, sum, quaternion) would not use."""
        if given == "quaternion" and UNITS[name] != "rad":
            raise InputError(f"{self.path}: {place}.quaternion: a quaternion is an attitude, {name} is not; expected "
                             "from or sum")
        if given == "quaternion" and table.get("unit", "rad") != "rad":
            raise InputError(f"{self.path}: {place}.unit = {table['unit']!r}: a quaternion has no unit, the angle "
                             "launchid makes of it is in rad; leave unit out")
        for key, kind in ONLY_OF.items():
            if key in table and given != kind:
                raise InputError(f"{self.path}: {place}.{key} belongs to {kind}, not to {given}; leave it out")

    def names(self, place: str, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list) or not value or not all(isinstance(each, str) for each in value):
            raise self.fail(place, value, "a list of channels")
        return tuple(value)

    def of_from(self, place: str, table: dict[str, Any]) -> tuple[tuple[str, ...], tuple[float, ...], None, None]:
        if not isinstance(table["from"], str):
            raise self.fail(f"{place}.from", table["from"], "the name of a channel")
        return (table["from"],), (1.0,), None, None

    def of_sum(self, place: str, table: dict[str, Any]) -> tuple[tuple[str, ...], tuple[float, ...], None, None]:
        channels = self.names(f"{place}.sum", table["sum"])
        weights = table.get("weights", [1.0] * len(channels))
        if not isinstance(weights, list) or len(weights) != len(channels):
            raise self.fail(f"{place}.weights", weights, f"a list of {len(channels)} numbers")
        return channels, tuple(self.number(f"{place}.weights", each) for each in weights), None, None

    def of_quaternion(self, place: str, table: dict[str, Any]) -> tuple[tuple[str, ...], tuple[float, ...], int,
                                                                        tuple[float, ...] | None]:
        value = table["quaternion"]
        channels = tuple(f"{value}[{k}]" for k in range(4)) if isinstance(value, str) else \
            self.names(f"{place}.quaternion", value)
        if len(channels) != 4:
            raise self.fail(f"{place}.quaternion", value, "four channels, or the name of an array of four")
        if self.word(place, table, "order", ORDERS, ORDERS[0]) == "xyzw":
            channels = (channels[3], *channels[:3])
        axis = AXES.index(self.word(place, table, "axis", AXES, "y"))
        reference = table.get("reference", "first")
        if reference == "first":
            return channels, (1.0,) * 4, axis, None
        if not isinstance(reference, list) or len(reference) != 4:
            raise self.fail(f"{place}.reference", reference, '"first", or a quaternion [w, x, y, z]')
        numbers = tuple(self.number(f"{place}.reference", each) for each in reference)
        if not any(numbers):
            raise self.fail(f"{place}.reference", reference, "a quaternion that is not 0")
        return channels, (1.0,) * 4, axis, numbers

"""Maps by name: the columns of PX4, ArduPilot, Betaflight and hobby TVC flight computers among a file's channels.

A named map is a list of what each column may be called; the first that the file has is taken.  A map of one's own that
says `base = "px4"` begins with it, and replaces what it names itself.

PX4: uORB messages as the ULog file format has them (docs.px4.io, "ULog File Format", msg/).  ArduPilot: messages ATT,
IMU, AETR, RCOU of "Onboard Message Log Messages" (ardupilot.org).  Betaflight: the CSV of blackbox_decode.  TVC: names
seen in public logs of model rockets; a unit that the name does not say is told by the numbers, and said.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sim.errors import InputError

from .text import Channels
from .units import ANGLE_UNITS, TIME_UNITS

NAMES = ("px4", "ardupilot", "betaflight", "tvc")
OF_FORMAT = {"ULog": "px4", "ArduPilot DataFlash": "ardupilot"}   # of files whose format tells the map
SERVO_SCALE = 0.09    # degrees a microsecond: a hobby servo turns by 45 degrees from 1500 to 2000 us
SERVO_MIDDLE = 1500.0  # us
ELEVATOR = 0.01       # degrees of a unit of AETR, which goes from -4500 to 4500
DEGREES = 180.0 / math.pi
RATE_UNITS = (1.0, math.pi / 180.0, 0.1, math.pi / 1800.0, 10.0, math.pi / 18.0)  # rad/s of a logged unit of a gyro
FEWEST_ROWS = 50      # in which a gyro's unit is told
SAME_UNIT = 0.25      # of the logarithm of a ratio, within which a unit is one of RATE_UNITS: they are 1.7 apart

Table = dict[str, Any]


class Recipe(NamedTuple):
    """Named map: tables [time] and [columns.NAME] to choose from, in order of preference."""

    time: Sequence[Table]
    columns: Mapping[str, Sequence[Table]]


def _array(name: str, k: int, **keys: Any) -> Table:
    return {"from": f"{name}[{k}]", **keys}


RECIPES = {
    "px4": Recipe(
        [{"name": "timestamp", "unit": "us", "clock": "theta"}],
        {"theta": [{"quaternion": "vehicle_attitude/q", "axis": "y"}],
         "theta_dot": [_array("vehicle_angular_velocity/xyz", 1), {"from": "vehicle_attitude/pitchspeed"},
                       _array("sensor_combined/gyro_rad", 1)],
         "beta_cmd": [_array("vehicle_torque_setpoint/xyz", 1, take="held"),
                      _array("actuator_controls_0/control", 1, take="held"),
                      _array("actuator_servos/control", 0, take="held")],
         "theta_ref": [{"quaternion": "vehicle_attitude_setpoint/q_d", "axis": "y"}]}),
    "ardupilot": Recipe(
        [{"name": "TimeUS", "unit": "us", "clock": "theta"}],
        {"theta": [{"from": "ATT/Pitch", "unit": "deg"}],
         "theta_dot": [{"from": "IMU/GyrY"}, {"from": "IMU.0/GyrY"}, {"from": "RATE/P", "unit": "deg/s"}],
         "beta_cmd": [{"from": "AETR/Elev", "unit": "deg", "scale": ELEVATOR},
                      {"from": "RCOU/C2", "unit": "deg", "scale": SERVO_SCALE, "offset": -SERVO_SCALE * SERVO_MIDDLE}],
         "theta_ref": [{"from": "ATT/DesPitch", "unit": "deg"}]}),
    "betaflight": Recipe(
        [{"name": "time (us)", "unit": "us"}, {"name": "time", "unit": "us"}],
        {"theta": [{"from": "attitude[1]", "unit": "deg", "scale": 0.1}, {"from": "pitch", "unit": "deg"}],
         "theta_dot": [{"from": "gyroADC[1]", "unit": "deg/s"}, {"from": "gyroADC[1] (deg/s)", "unit": "deg/s"}],
         "beta_cmd": [{"from": f"servo[{k}]", "unit": "deg", "scale": SERVO_SCALE,
                       "offset": -SERVO_SCALE * SERVO_MIDDLE} for k in (5, 1, 0, 2, 3, 4, 6, 7)] + [
                           {"from": "axisSum[1]", "scale": 1e-3},
                           {"sum": ["axisP[1]", "axisI[1]", "axisD[1]"], "weights": [1e-3, 1e-3, 1e-3]}]}),
}

# of hobby logs: column -> patterns of names in lower case without blanks and marks, the unit that the name says
AXIS = "(y|pitch)"
TILT, TURN = "(angle|tilt|ori|orientation|attitude)", "(gyro|gyr|omega|rate|angvel|angularvelocity)"
OUT = "(servo|tvc|gimbal|nozzle|servoout|output|tvcout)"
TIME = {r"(time|t|elapsed)?(ms|millis|milliseconds)|timestampms": "ms",
        r"(time|t|elapsed)?(us|micros|microseconds)|timestampus": "us", r"(time|t|elapsed)(s|sec|seconds)": "s",
        r"time|t|timestamp|elapsed|elapsedtime|flighttime": ""}
ANGLE = {rf"(pitch|{AXIS}{TILT}|{TILT}{AXIS})(deg|degrees)": "deg", rf"(pitch|{TILT}{AXIS})(rad|radians)": "rad",
         rf"pitch|{AXIS}(angle|ori|tilt)|{TILT}{AXIS}|euler{AXIS}": ""}
RATE = {rf"{TURN}{AXIS}(dps|degs|degpers)|pitchrate(dps|degs)|g{AXIS}dps": "deg/s",
        rf"{TURN}{AXIS}(rads|radpers)|pitchrate(rads)": "rad/s",
        rf"{TURN}{AXIS}|pitchrate|g{AXIS}|gyroraw{AXIS}": ""}
SERVO = {rf"(servo|tvc|gimbal|pwm|pwmout|servoout|output)({AXIS}|1)?(us|micros|pwm)|pwm{AXIS}": "us",
         rf"{OUT}({AXIS}|1)?(deg|degrees)": "deg", rf"({OUT}|pidout)({AXIS})": ""}
QUATERNIONS = (("q0", "q1", "q2", "q3"), ("qw", "qx", "qy", "qz"), ("quatw", "quatx", "quaty", "quatz"))


def table_of(name: str, path: str, channels: Channels, own: Table) -> Table:
    """Return the map of this name as a table like that of MAP.toml, for the channels of a file; `own` keys of a user's
    map go before it: a whole column, or some keys of one, such as its scale.

    Raises
    ------
    InputError
        If the file lacks what the map needs: an attitude, an input, stamps.
    """
    given = {key: each for key, each in own.get("columns", {}).items() if isinstance(each, dict)}
    if name == "tvc":
        return _merged(_hobby(path, channels, own.get("time", {}), given), own)
    there = {*channels, *channels.unread}
    recipe = RECIPES[name]

    def has(table: Table) -> bool:
        if "quaternion" in table:
            return all(f"{table['quaternion']}[{k}]" in there for k in range(4))
        return all(each in there for each in table.get("sum", [table.get("from", "")]))

    columns = {column: found for column, tables in recipe.columns.items()
               if (found := next((dict(table) for table in tables if has(table)), None)) is not None}
    time = next((dict(table) for table in recipe.time if any(each == table["name"] or each.endswith(f"/{table['name']}")
                                                             for each in there)), None)
    _refuse_lacking(name, path, there, {**columns, **given}, time or own.get("time"), recipe)
    attitude = str(columns.get("theta", {}).get("from"))
    if name == "betaflight" and attitude in channels and np.any(channels[attitude] % 1.0 != 0.0):
        columns["theta"].pop("scale", None)   # tenths of degrees are whole numbers
    time = dict(time or {})
    if time.get("clock") not in {**columns, **given}:
        time.pop("clock", None)
    return _merged({"time": time, "columns": columns}, own)


def _merged(made: Table, own: Table) -> Table:
    """Return a named map's table with a user's own keys: [time] and each column key by key; a source of another kind
    replaces that of the map."""
    time = own.get("time", {})
    out = {**made, **{key: each for key, each in own.items() if key not in ("time", "columns")}}
    out["time"] = time if "period" in time else {**made["time"], **time}
    columns = dict(made["columns"])
    for name, each in own.get("columns", {}).items():
        is_own = not isinstance(each, dict) or {"from", "sum", "quaternion"} & set(each)
        columns[name] = each if is_own else {**columns.get(name, {}), **each}
    if "beta" in columns and "beta_cmd" not in own.get("columns", {}) and "beta" in own.get("columns", {}):
        columns.pop("beta_cmd", None)
    return {**out, "columns": columns}


def _refuse_lacking(name: str, path: str, there: set[str], columns: Table, time: Table | None, recipe: Recipe) -> None:
    lacking = [] if time else [f"stamps ({recipe.time[0]['name']})"]
    for column in ("theta", "beta_cmd"):
        if column not in columns and not (column == "beta_cmd" and "beta" in columns):
            first = recipe.columns[column][0]
            lacking.append(f"{column} ({first.get('from', first.get('quaternion'))})")
    if lacking:
        raise InputError(f"{path}: the map {name} finds no {' and no '.join(lacking)} among {len(there)} channels "
                         f'(launchid convert FILE --list); name it in a map that says base = "{name}"')


def recognised(channels: Channels) -> str | None:
    """Return the named map of a table of text by its header; None if it is not unambiguous.  A hobby log without stamps
    is one too: its map says what is missing."""
    there = {*channels, *channels.unread}
    if "loopIteration" in there and any(each.startswith("gyroADC[1]") for each in there):
        return "betaflight"
    found = {column: _matches(there, patterns) for column, patterns in
             (("time", TIME), ("theta", ANGLE), ("theta_dot", RATE), ("beta_cmd", SERVO))}
    is_whole = len(found["beta_cmd"]) == 1 and len(found["time"]) <= 1 and len(found["theta"]) <= 1
    return "tvc" if is_whole and (found["theta"] or _quaternion(there)) and not {"t", "theta"} <= there else None


def notes(name: str, path: str, table: Table, was_asked: bool) -> list[str]:
    """Return lines on a named map that was used: which one, and what it took for which column."""
    said = ", ".join(f"{column} from {_source(each)}" for column, each in table["columns"].items())
    first = f"{path}: read with --map {name}: {said}" if not was_asked else f"{path}: {said}"
    beta = table["columns"].get("beta_cmd", {})
    if beta.get("scale") in (SERVO_SCALE, -SERVO_SCALE):
        first += (f"; {SERVO_SCALE:g} degrees a microsecond are a hobby servo's: k1 scales with it, and has the sign "
                  "of the linkage; what that is goes into a map")
    return [first]


def _source(table: Table) -> str:
    unit = f" [{table['unit']}]" if "unit" in table else ""
    return f"{table.get('from') or table.get('quaternion') or '+'.join(table.get('sum', []))}{unit}"


# ---- hobby logs


def _plain(name: str) -> str:
    """Return a column's name in lower case, letters and digits alone."""
    return re.sub(r"[^a-z0-9]", "", name.casefold())


def _matches(there: set[str], patterns: Mapping[str, str]) -> dict[str, str]:
    """Return name -> unit ("" where the name does not say it) of the channels that the patterns fit."""
    found = {}
    for each in sorted(there):
        for pattern, unit in patterns.items():
            if re.fullmatch(pattern, _plain(each)):
                found[each] = unit
                break
    return found


def _quaternion(there: set[str]) -> list[str] | None:
    """Return the four channels of an attitude, w first; None if there is none."""
    plain = {_plain(each): each for each in there}
    return next(([plain[each] for each in four] for four in QUATERNIONS if set(four) <= set(plain)), None)


def _hobby(path: str, channels: Channels, own_time: Table, own: Table) -> Table:
    """Return the map of a model rocket's log by its names, with units by its numbers where these do not say them; what
    a user's map has of its own (`own_time`, `own` columns) need not be found."""
    there = {*channels, *channels.unread}
    time, theta, rate, beta = (_first(_matches(there, each)) for each in (TIME, ANGLE, RATE, SERVO))
    four = _quaternion(there)
    if own_time.get("period") is not None or own_time.get("name") is not None:
        time = (str(own_time.get("name", "")), own_time.get("unit", "s"))
    if time is None:
        raise InputError(f'{path}: the map tvc finds no time among {", ".join(sorted(there)[:6])}, ...; give its '
                         'period in a map: base = "tvc", [time] period = 0.02')
    is_told = "theta" in own or theta is not None or four is not None
    if not is_told or (beta is None and not {"beta", "beta_cmd"} & set(own)):
        lacks = "servo (servo_y, tvc_us)" if is_told else "attitude (pitch_deg, q0..q3)"
        raise InputError(f"{path}: the map tvc finds no {lacks} among {', '.join(sorted(there)[:8])}; name it in a map "
                         'that says base = "tvc"')
    columns: Table = {}
    unit = time[1] or _time_unit(channels[time[0]])
    t = channels[time[0]] if time[0] in channels else np.arange(len(next(iter(channels.values())))) * float(
        own_time.get("period", 1.0))
    if theta is not None:
        columns["theta"] = {"from": theta[0], "unit": theta[1] or _angle_unit(channels[theta[0]])}
    elif four is not None:
        columns["theta"] = {"quaternion": four, "axis": "y"}
    if rate is not None:
        columns["theta_dot"] = {"from": rate[0], "unit": rate[1]} if rate[1] else {
            "from": rate[0], "scale": _rate_unit(channels, t, unit, columns.get("theta", {}), rate[0])}
    if beta is None:
        return {"time": {"name": time[0], "unit": unit}, "columns": columns}
    servo = channels[beta[0]]
    middle = float(np.nanmedian(servo))
    if beta[1] == "us" or (not beta[1] and 700.0 < middle < 2300.0):
        columns["beta_cmd"] = {"from": beta[0], "unit": "deg", "scale": SERVO_SCALE,
                               "offset": -SERVO_SCALE * SERVO_MIDDLE}
    elif not beta[1] and 60.0 < middle < 120.0:   # a servo library's angle, 90 in the middle
        columns["beta_cmd"] = {"from": beta[0], "unit": "deg", "offset": -90.0}
    else:
        columns["beta_cmd"] = {"from": beta[0], "unit": beta[1] or _angle_unit(servo)}
    return {"time": {"name": time[0], "unit": unit}, "columns": columns}


def _first(found: dict[str, str]) -> tuple[str, str] | None:
    """Return the channel whose name says its unit, else the first; None if there is none."""
    return min(found.items(), key=lambda each: (each[1] == "", each[0]), default=None)


def _time_unit(t: np.ndarray) -> str:
    """Return the unit of stamps by their step: a flight computer logs every 1 ms to 0.5 s."""
    steps = np.diff(np.asarray(t, float))
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    return "s" if step < 0.9 else "ms" if step < 900.0 else "us"


def _angle_unit(x: np.ndarray) -> str:
    """Return the unit of an angle by its size: beyond half a turn it is no radian."""
    return "deg" if float(np.nanmax(np.abs(x), initial=0.0)) > 0.5 * math.pi else "rad"


def _rate_unit(channels: Channels, stamps: np.ndarray, unit: str, theta: Table, rate: str) -> float:
    """Return the factor [rad/s] of a gyro by its integral against the attitude; 1 if the log does not tell it."""
    if not theta:
        return 1.0
    t, gyro = np.asarray(stamps, float) / TIME_UNITS[unit], np.asarray(channels[rate], float)
    if "from" in theta:
        angle = np.asarray(channels[theta["from"]], float) * ANGLE_UNITS[theta["unit"]]
    else:
        w, _, y, _ = (np.asarray(channels[each], float) for each in theta["quaternion"])
        angle = np.unwrap(2.0 * np.arctan2(y, w), period=2.0 * math.pi)
    good = np.isfinite(t) & np.isfinite(angle) & np.isfinite(gyro)
    t, angle, gyro = t[good], angle[good], gyro[good]
    if len(t) < FEWEST_ROWS:
        return 1.0
    area = np.concatenate([[0.0], np.cumsum(0.5 * (gyro[1:] + gyro[:-1]) * np.diff(t))])
    hop = max(1, len(t) // FEWEST_ROWS)
    x, y = area[hop:] - area[:-hop], angle[hop:] - angle[:-hop]
    x, y = x - x.mean(), y - y.mean()
    power = float(np.sum(x * x))
    ratio = abs(float(np.sum(x * y))) / power if power > 0.0 else 0.0
    if not ratio > 0.0:
        return 1.0
    best = min(RATE_UNITS, key=lambda each: abs(math.log(ratio / each)))
    return best if abs(math.log(ratio / best)) < SAME_UNIT else 1.0

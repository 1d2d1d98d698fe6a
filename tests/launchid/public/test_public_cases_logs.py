"""Kinds of logs whose units, order, origin or axes were not what they seem, or that were refused for a false reason:
what must come out of each.  `public_flights` flies most of them with a known truth, a6 = 2 and k1 = -6.
"""

import dataclasses
import math
import warnings

import numpy as np
import public_flights as flights
import pytest
import shortened

from launchid.commands.fit_lft import fit_lft
from launchid.commands.identify import identify
from launchid.commands.simulate import simulate
from launchid.first_nominal import first
from launchid.log.check import faults
from launchid.log.log import Log, flown_log, log_of, write_columns
from launchid.main import main
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import BUILT_IN, Nominal, load_nominal
from sim.sections import Wind

Columns = dict[str, np.ndarray]
ROW = 0.008      # s
DEGREE = math.radians(1.0)


@pytest.fixture(scope="module")
def plain() -> Columns:
    """16 s of a vehicle in closed loop."""
    columns = flights.fly(16.0, row=ROW)
    return {name: columns[name] for name in ("t", "theta", "theta_dot", "beta", "beta_cmd")}


def kinds(columns: Columns, nominal: Nominal | None = None) -> list[tuple[str, str | None]]:
    return [(fault.kind, fault.channel) for fault in faults(log_of(columns), nominal)]


def times(columns: Columns, **factors: float) -> Columns:
    return columns | {name: columns[name] * factor for name, factor in factors.items()}


def short(name: str, seconds: float = 30.0, **sensors: float) -> Nominal:
    return shortened.short(seconds, name, sensors=sensors)


# ---- units of t, out of theta_dot and the slope of theta


UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9, "row numbers": 1.0 / ROW, "units of": 1e4}


@pytest.mark.parametrize("unit", UNITS)
def test_a_t_in_another_unit_is_said_with_that_unit_by_every_command(plain, tmp_path, capsys, unit):
    path = tmp_path / "log.csv"
    write_columns(path, times(plain, t=UNITS[unit]))
    for command in (["identify", path], ["identify", path, "--strict"], ["nominal", path, "--out", tmp_path / "n.toml"],
                    ["identify", path, "--nominal", "constant"], ["uncertainty", path, "constant"]):
        capsys.readouterr()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert main([str(word) for word in command]) == 3
        out, err = capsys.readouterr()
        assert out == "" and len(err.splitlines()) == 1 and f"looks like {unit}" in err and "degrees" not in err


def test_both_units_are_told_where_t_and_theta_dot_are_of_another(plain):
    with pytest.raises(InputError, match="looks like milliseconds"):
        faults(log_of(times(plain, t=1e3, theta_dot=1.0 / DEGREE)), None)
    assert kinds(times(plain, theta_dot=1.0 / DEGREE)) == [("unit", "theta_dot")]
    assert kinds(times(plain, theta=1.0 / DEGREE)) == [("unit", "theta")]


@pytest.mark.parametrize("factor", [8.0, 20.0, 125.0, 1000.0])
def test_a_factor_that_is_no_unit_s_is_said_and_not_called_degrees(plain, factor):
    for columns in (times(plain, theta_dot=factor), times(plain, theta_dot=1.0 / factor)):
        fault, = faults(log_of(columns), None)
        assert fault.kind == "unit" and "times the slope of theta" in fault.message and "degrees" not in fault.message


def test_a_nominal_of_another_rate_does_not_make_seconds_milliseconds(plain):
    """The period that a nominal believes tells the unit of t only where theta_dot does not."""
    wrong = short("constant", period=ROW / 1000.0)
    assert ("unit", "t") not in kinds(plain, wrong)
    with pytest.raises(InputError, match="milliseconds"):
        faults(log_of({name: plain[name] for name in ("t", "theta", "beta")}), wrong)


# ---- order and origin


@pytest.mark.parametrize("nominal", [None, "constant"])
def test_rows_out_of_order_are_counted_and_are_no_milliseconds(plain, nominal):
    order = np.random.default_rng(3).permutation(len(plain["t"]))
    back = int(np.count_nonzero(np.diff(plain["t"][order]) < 0.0))
    for look in (lambda log: identify(log, load_nominal(nominal) if nominal else None), first):
        with pytest.raises(InputError, match=f"out of order: in {back} of 2000 rows") as caught:
            look(log_of({name: x[order] for name, x in plain.items()}))
        assert "seconds" not in str(caught.value)


def test_a_clock_that_is_reset_once_is_not_out_of_order(plain):
    columns = plain | {"t": np.concatenate([plain["t"][:1500], plain["t"][:500]])}
    assert kinds(columns) == [("stamps", "t")]


def test_an_origin_far_from_the_profile_s_is_said_and_strict_refuses_it():
    nominal = short("vega_like")
    log = flown_log(fly_whole(nominal, 1))
    assert faults(log, nominal) == ()
    epoch = log_of(log.measured() | {"t": log.t + 1.75e9})
    assert [(fault.kind, fault.channel) for fault in faults(epoch, nominal)] == [("origin", "t")]
    answer = identify(epoch, nominal, window=5.0)
    assert "subtract the time of lift-off" in answer.warnings[0]
    assert "subtract" in answer.report["next"] and "declare" not in answer.report["next"]
    with pytest.raises(InputError, match="lift-off"):
        identify(epoch, nominal, strict=True)
    assert faults(epoch, short("constant")) == ()  # of numbers that do not vary any origin is


# ---- all angles in degrees


@pytest.mark.parametrize("columns", [("theta", "theta_dot", "beta", "beta_cmd"),
                                     ("theta", "theta_dot", "beta", "beta_cmd", "theta_ref"), ("theta", "beta")])
@pytest.mark.parametrize(("name", "period"), [*zip(BUILT_IN, (0.01, 0.02, 0.02), strict=True)])
def test_all_angles_in_degrees_are_told_as_all(name, period, columns):
    nominal = short(name, period=period)
    log = flown_log(fly_whole(nominal, 2)).measured()
    said = faults(log_of({"t": log["t"], **{column: log[column] / DEGREE for column in columns}}), nominal)
    assert [(fault.kind, fault.channel) for fault in said] == [("unit", None)]
    assert said[0].message.startswith("all angles look like degrees")


@pytest.mark.parametrize("name", BUILT_IN)
def test_theta_alone_in_degrees_is_not_all(name):
    nominal = short(name)
    log = flown_log(fly_whole(nominal, 2)).measured()
    assert kinds(times({column: log[column] for column in ("t", "theta", "beta")}, theta=1.0 / DEGREE), nominal) == [
        ("unit", "theta")]


def test_advice_that_a_fault_makes_meaningless_is_not_given():
    nominal = short("constant", period=0.02)
    log = flown_log(fly_whole(nominal, 2)).measured()
    for factors in (dict.fromkeys(("theta", "theta_dot", "beta", "beta_cmd"), 1.0 / DEGREE), {"beta": -1.0}):
        foreign = log_of({name: log[name] * factors.get(name, 1.0) for name in ("t", "theta", "theta_dot", "beta")})
        answer = identify(foreign, nominal, window=10.0)
        assert answer.report["next"].startswith("correct the log first") and "[wind]" not in answer.summary()
    windy = dataclasses.replace(nominal, wind=Wind(walk=0.05, turbulence=0.05))
    assert "declare" in identify(flown_log(fly_whole(windy, 2)), nominal, window=10.0).report["next"]


# ---- a body that turns about its other axes


def rolling(rate: float, sweep: float = 0.06) -> Columns:
    """16 s of a body that pitches by +-`sweep` [rad] and rolls at `rate` [rad/s]; theta is the angle about its y axis
    that its quaternion gives, and its whole turns, theta_dot the rate about y."""
    fine, every = 0.001, 8
    t = np.arange(16000) * fine
    pitch = sweep * (1.3 * np.cos(1.3 * t) + 2.1 * np.cos(2.1 * t))
    q, rows = np.array([1.0, 0.0, 0.0, 0.0]), []
    for k in range(len(t)):
        rows.append(q)
        w, x, y, z = q
        q = q + 0.5 * fine * np.array([-x * rate - y * pitch[k], w * rate - z * pitch[k], z * rate + w * pitch[k],
                                       x * pitch[k] - y * rate])
        q = q / np.linalg.norm(q)
    turned = np.array(rows)[::every]
    noise = np.random.default_rng(1).normal(size=(3, len(turned)))
    beta = 0.05 * np.sin(1.7 * t[::every])
    return {"t": t[::every], "theta": np.unwrap(2.0 * np.arctan2(turned[:, 2], turned[:, 0])) + 2e-4 * noise[0],
            "theta_dot": pitch[::every] + 1e-3 * noise[1], "beta": beta + 1e-4 * noise[2]}


def of_two_devices(plain: Columns) -> Columns:
    """theta of one flight beside the gyro of another."""
    return plain | {"theta_dot": flights.fly(16.0, row=ROW, seed=9)["theta_dot"]}


@pytest.mark.parametrize("case", ["rolling", "two devices"])
def test_no_window_of_a_body_that_turns_about_other_axes_is_valid(plain, case):
    log = log_of(rolling(math.radians(40.0)) if case == "rolling" else of_two_devices(plain))
    answer = identify(log, window=4.0)
    assert {w["status"] for w in answer.report["windows"]} == {"MODEL"}
    assert "theta_dot is not the slope of theta" in answer.warnings[0]
    assert "theta_dot is not the slope of theta" in answer.report["next"]
    for refused in (lambda: identify(log, strict=True), lambda: first(log)):
        with pytest.raises(InputError, match="theta_dot is not the slope of theta"):
            refused()


GYROS = {"in one plane": lambda c: c["theta_dot"], "late": lambda c: np.interp(c["t"] - 0.06, c["t"], c["theta_dot"]),
         "noisy": lambda c: c["theta_dot"] + 0.1 * np.random.default_rng(5).normal(size=len(c["t"])),
         "coarse": lambda c: 0.02 * np.round(c["theta_dot"] / 0.02), "half": lambda c: 0.5 * c["theta_dot"],
         "biased": lambda c: c["theta_dot"] + 0.05 + 0.002 * c["t"],
         "only noise": lambda c: 3.0 * np.random.default_rng(6).normal(size=len(c["t"])),
         "none": lambda c: np.full(len(c["t"]), math.nan)}


@pytest.mark.parametrize("gyro", GYROS)
def test_a_bad_gyro_of_the_same_axis_is_no_other_motion(plain, gyro):
    columns = rolling(0.0) if gyro == "in one plane" else plain
    assert "motion" not in dict(kinds(columns | {"theta_dot": GYROS[gyro](columns)}))


def test_whole_turns_that_a_logger_took_off_are_no_other_motion():
    t = np.arange(2000) * ROW
    theta, rate = 4.0 * np.sin(0.7 * t) + 3.0, 2.8 * np.cos(0.7 * t)
    wrapped = (theta + np.pi) % (2.0 * np.pi) - np.pi
    noise = np.random.default_rng(2).normal(size=(3, len(t)))
    columns = {"t": t, "theta": wrapped + 1e-4 * noise[0], "theta_dot": rate + 1e-3 * noise[1], "beta": noise[2]}
    assert "motion" not in dict(kinds(columns))


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("period", [0.005, 0.01, 0.02, 0.05])
def test_clean_flights_raise_nothing(name, period):
    nominal = short(name)
    log = flown_log(fly_whole(nominal, 1, period=period))
    assert faults(log, nominal) == () and faults(log, None) == ()
    assert faults(log_of(log.measured() | {"t": log.t + 1.75e9}), None) == ()


# ---- true reasons


@pytest.mark.parametrize("nominal", [None, "constant"])
def test_a_log_in_which_nothing_moves_says_which_columns(nominal):
    t = np.arange(2000) * 0.01
    log = log_of({"t": t, "theta": np.zeros(2000), "theta_dot": np.zeros(2000), "beta": np.zeros(2000)})
    said = identify(log, load_nominal(nominal) if nominal else None, window=5.0).report["why"]
    assert "theta, beta, theta_dot never change in 2000 rows" in said or "theta, theta_dot, beta never change" in said


def test_a_servo_far_faster_than_a_row_flies(tmp_path):
    """The vehicle was LOST in its first row at 60,000 rad/s and steps of 1 ms."""
    nominal = short("constant", 1.0)
    assert nominal.actuator is not None
    fast = dataclasses.replace(nominal, actuator=dataclasses.replace(nominal.actuator, natural_frequency=60000.0))
    flown = simulate(fast, seed=1)
    assert not flown.flight.lost and np.max(np.abs(flown.flight.theta)) < 0.2


def test_an_effect_that_begins_after_the_flight_and_rows_that_are_too_far_apart_are_said():
    nominal = short("constant", 40.0)
    assert simulate(nominal, effects=["control_loss:fraction=0.3,time=20"]).warnings == ()
    said, = simulate(nominal, effects=["control_loss:fraction=0.3,time=60"]).warnings
    assert "control_loss" in said and "60 s" in said and "40 s" in said
    said, = simulate(short("constant", 40.0, period=20.0)).warnings
    assert "20 s apart" in said and "sensors.period" in said


# ---- fit-lft


def test_a_flight_is_fitted_once_and_few_say_so(tmp_path, capsys):
    nominal = short("constant", 40.0)
    logs: list[Log] = []
    for seed in (1, 2, 3):
        log = flown_log(fly_whole(nominal, seed, a6_factor=0.9 + 0.1 * seed))
        logs.append(log_of(log.measured(), f"{seed}.csv"))
    with pytest.raises(InputError, match=r"again\.csv: the same flight as 1\.csv"):
        fit_lft([*logs, log_of(logs[0].measured(), "again.csv")], nominal)
    for count in (1, 2, 3):
        head, *rest = fit_lft(logs[:count], nominal).summary().splitlines()
        assert ("so few tell no spread" in head) == (count < 3)
        assert any("flights inside" in line for line in rest) == (count == 3)


# ---- names of Python, digits of a first nominal


def test_a_first_nominal_has_the_digits_that_it_knows(plain, tmp_path, capsys):
    path, out = tmp_path / "log.csv", tmp_path / "n.toml"
    write_columns(path, {name: plain[name][:600] for name in ("t", "theta", "theta_dot", "beta")})
    assert main(["nominal", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    numbers = [line.partition(" +- ") for line in said.splitlines() if line.startswith(("offset", "noise", "delay"))]
    assert len(numbers) >= 4
    for value, _, std in numbers:
        assert len(value.split()[-1].partition(".")[2]) == len(std.split()[0].partition(".")[2])
    a6 = next(line for line in out.read_text().splitlines() if line.startswith("a6 = "))
    assert len(a6.split()[2].partition(".")[2]) <= 4 and "+- 0.0" in a6

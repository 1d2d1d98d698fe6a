"""The controller that flew, from the log: any linear law, what hides it, its margins; other gains."""

from dataclasses import replace

import control
import numpy as np
import pytest
from any_law import LAWS, STILL, Vehicle, fly, law, truth
from scipy.linalg import expm

import launchid
from launchid.controller.fit import FittedLaw, answered, fit_law
from launchid.controller.law import Law, law_of
from launchid.robustness.airframe import modes_at
from launchid.robustness.blocks import Mode, plants_of
from launchid.robustness.closed_loop import data_of, fit_closed_loop
from launchid.robustness.flown import choice
from launchid.robustness.loops import loops
from launchid.robustness.margin_spread import MARGIN_NAMES, crossings_of, margin_table
from launchid.sources import read_log
from sim.errors import UsageError
from sim.nominal import Section, constant_profile, load_nominal
from sim.sections import Bending, Slosh, constant

CONSTANT = load_nominal("constant")
PD = CONSTANT.controller
VEHICLE = Vehicle()
ROW = np.array([[*VEHICLE[:5]]])
NOMINAL = replace(CONSTANT, vehicle=constant_profile(VEHICLE.a6, VEHICLE.k1), actuator=replace(
    CONSTANT.actuator, natural_frequency=VEHICLE.frequency, damping_ratio=VEHICLE.damping, delay=VEHICLE.delay))
BRIEF = 20.0   # s of a flight


def fitted(columns: dict[str, np.ndarray], drop: tuple[str, ...] = ()) -> FittedLaw | str:
    ticks = answered(read_log({name: x for name, x in columns.items() if name not in drop}))
    assert not isinstance(ticks, str), ticks
    return fit_law(ticks)


@pytest.fixture(scope="module")
def flights() -> dict[str, dict[str, np.ndarray]]:
    """A flight of each law."""
    return {name: fly(law, seed=1, duration=BRIEF) for name, law in LAWS.items()}


# ---- the law


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("drop", [(), ("theta_ref",)], ids=["", "no reference"])
def test_any_linear_law_is_found_exactly(flights, name, drop):
    """Its response at all frequencies, from commands, attitude and rate; without a reference too."""
    found, (a, b, c, _, period) = fitted(flights[name], drop), LAWS[name]
    assert not isinstance(found, str), found
    omega = np.geomspace(1e-2, 0.99 * np.pi / period, 50)
    z = np.exp(1j * omega * period)
    for mine, top in zip(found.law.at(z - 1.0), (b, c), strict=True):
        theirs = np.polyval(top[::-1], 1.0 / z) / (1.0 - np.polyval(np.r_[a[::-1], 0.0], 1.0 / z))
        assert np.max(np.abs(mine - theirs)) < 1e-6 * (1.0 + np.max(np.abs(theirs)))


def test_gains_are_the_laws_at_low_frequency(flights):
    assert fitted(flights["pd"]).law.gains() == pytest.approx({"kp": 1.2, "kd": 0.5})
    assert fitted(flights["pd gyro"]).law.gains() == pytest.approx({"kp": 1.2, "kd": 0.45})
    assert fitted(flights["pid"]).law.gains() == pytest.approx({"kp": 1.2, "kd": 0.5, "ki": 0.5}, rel=1e-5)
    rate = law_of(replace(PD, law="rate", kp=0.5, ki=1.2, kd=0.0, derivative_time_constant=0.0))
    assert rate.gains() == pytest.approx({"kp": 0.5, "ki": 1.2})


@pytest.mark.parametrize("name", ["pd", "pid", "pd gyro"])
def test_scaled_gains_are_the_law_with_those_gains(flights, name):
    found = fitted(flights[name]).law.scaled(kp=0.8, kd=1.3).gains()
    own = fitted(flights[name]).law.gains()
    assert found == pytest.approx({gain: x * {"kp": 0.8, "ki": 0.8, "kd": 1.3}[gain] for gain, x in own.items()})


def test_rounded_columns_are_fitted_without_bias(flights):
    """Five decimals make noise of a hundredth of the sensors'; gains within four of their standard deviations."""
    rounded = {name: x if name == "t" else np.round(x, 5) for name, x in flights["pd"].items()}
    found = fitted(rounded)
    std = found.gains_std
    assert 0.0 < std["kp"] < 1e-2 and 0.0 < std["kd"] < 1e-2
    assert abs(found.law.gains()["kp"] - 1.2) < 4.0 * std["kp"] and abs(found.law.gains()["kd"] - 0.5) < 4.0 * std["kd"]


def test_commands_at_the_limit_are_left_out():
    columns = fly(LAWS["pd hot"], seed=2, duration=BRIEF, guidance=([0.0, 5.0, 5.1, 9.0, 9.1, 20.0],
                                                                    [0.0, 0.0, 0.15, 0.15, 0.0, 0.0]))
    assert np.mean(np.abs(columns["beta_cmd"]) >= 0.12) > 0.01
    assert fitted(columns).law.gains() == pytest.approx({"kp": 3.0, "kd": 1.1})


def test_a_log_faster_than_the_controller_tells_its_period(flights):
    slow = flights["pd 50 Hz"]
    twice = {name: np.repeat(x, 2) for name, x in slow.items()} | {"t": 0.01 * np.arange(2 * len(slow["t"]))}
    twice["theta"][1::2] += 1e-3   # what the law did not see
    found = fitted(twice)
    assert found.law.period == pytest.approx(0.02) and found.law.gains() == pytest.approx({"kp": 1.2, "kd": 0.5})


@pytest.mark.parametrize("kind", ["another sensor", "every second row", "dead band"])
def test_what_no_linear_law_explains_is_refused(kind):
    columns = fly(LAWS["pd"], seed=3, duration=BRIEF, copies=kind == "another sensor")
    if kind == "every second row":
        columns = {name: x[::2] for name, x in columns.items()}
    if kind == "dead band":
        columns["beta_cmd"] = np.where(np.abs(columns["beta_cmd"]) < 2e-3, 0.0, columns["beta_cmd"])
    assert isinstance(fitted(columns), str)


def test_a_log_without_commands_says_so(flights):
    found = answered(read_log({name: x for name, x in flights["pd"].items() if name != "beta_cmd"}))
    assert isinstance(found, str) and "beta_cmd" in found


# ---- its margins


@pytest.mark.parametrize("name", LAWS)
def test_the_margins_of_any_law_are_python_controls(flights, name):
    mine = margin_table(loops(plants_of(ROW), fitted(flights[name]).law))[0]
    assert mine == pytest.approx(truth(LAWS[name]), rel=3e-4, abs=2e-3)


@pytest.mark.parametrize("name", ["pid", "gyro low-pass"])
def test_intervals_of_a_fitted_controller_hold_the_truth(name):
    found = launchid.margins(fly(LAWS[name], seed=4, duration=BRIEF), NOMINAL, window=10.0)
    right = truth(LAWS[name])
    assert found.report["controller"]["source"] == "log"
    for window in found.windows:
        assert window.window.status == "OK"
        for x, margin in zip(right, (getattr(window.window.spread, each) for each in MARGIN_NAMES), strict=True):
            half = max(margin.high - margin.value, margin.value - margin.low, 2e-3)
            assert abs(x - margin.value) < 2.0 * half


@pytest.mark.parametrize(("name", "every"), [("pd", 1), ("pd gyro", 2)], ids=["another sensor", "every second row"])
def test_a_law_that_saw_other_values_is_told_by_the_closed_loop(name, every):
    """Columns of sensors beside the controller's; every second row of its own."""
    columns = fly(LAWS[name], seed=5, duration=BRIEF, copies=every == 1)
    believed = replace(NOMINAL, controller=replace(PD, kp=2.0))
    found = launchid.margins({key: x[::every] for key, x in columns.items()}, believed, window=10.0)
    assert found.report["controller"]["source"] == "log" and "by the likelihood of the closed loop" in found.summary()
    assert all(window.window.valid for window in found.windows) and held_within(found, truth(LAWS[name]), 2.0)


def test_a_law_that_changes_is_no_law_of_the_closed_loop():
    """Other gains in the second half, seen by other sensors: refused, and why is said."""
    parts = [fly(LAWS[name], seed=5, duration=BRIEF, copies=True) for name in ("pd", "pd soft")]
    columns = {key: np.concatenate([x, parts[1][key] + BRIEF * (key == "t")]) for key, x in parts[0].items()}
    ticks = answered(read_log(columns))
    plant = np.array([VEHICLE.a6, VEHICLE.k1, *np.log([VEHICLE.frequency, VEHICLE.damping]), VEHICLE.delay, 0.0])
    found = fit_closed_loop(data_of(ticks, 1), plant, np.diag(np.square([0.03, 0.1, 0.02, 0.02, 5e-4, 0.02])))
    assert isinstance(found, str) and "the law changes" in found


def test_gains_at_the_end_of_their_range_just_keep_what_is_required():
    columns = fly(LAWS["pd"], seed=6, duration=10.0)
    gains = launchid.margins(columns, NOMINAL).report["gains"]
    assert all(least < 1.0 < largest for least, largest in gains.values())
    for name, factor, inside in (("kp", gains["kp"][1], 0.99), ("kd", gains["kd"][0], 1.01)):
        kept, lost = (launchid.margins(columns, NOMINAL, scale=f"{name}={x}").report
                      for x in (factor * inside, factor / inside**3))
        assert not kept["below"] and not kept["may_be_below"]
        assert lost["below"] or lost["may_be_below"]


def test_given_numbers_are_judged_on_the_vehicle_that_flew():
    columns = fly(LAWS["pd soft"], seed=7, duration=BRIEF)
    found = launchid.margins(columns, NOMINAL, controller="kp=3.0,kd=1.1,derivative_time_constant=0.03")
    right, spread = truth(LAWS["pd hot"]), found.windows[1].window.spread
    assert found.report["controller"]["source"] == "given" and found.report["controller"]["kp"] == 3.0
    assert spread.phase_deg.value == pytest.approx(right[2], abs=2.0)
    assert spread.gain_high_db.low - 0.1 < right[1] < spread.gain_high_db.high + 0.1


@pytest.mark.parametrize("word", ["flown", "kp=a", "ka=2", "kp=inf"])
def test_a_controller_that_is_no_choice_is_refused_in_one_line(word):
    with pytest.raises(UsageError, match="--controller"):
        choice(word)


def test_filters_and_the_rate_law_are_judged_as_python_control_judges_them():
    """A PD with the filter y = 0.2 x + 0.8 y; and kp rate + ki sum, whose integral is an attitude."""
    den, num = (np.convolve([1.0, -0.05 / 0.06], [1.0, -0.8]),
                0.2 * (1.2 * np.array([1.0, -0.05 / 0.06]) + 0.5 / 0.06 * np.array([1.0, -1.0])))
    own = replace(PD, filters=(Section((0.2, 0.0, 0.0), (1.0, -0.8, 0.0)),))
    mine = margin_table(loops(plants_of(ROW), law_of(own)))[0]
    assert mine == pytest.approx(truth(law(den, num)), rel=3e-4, abs=2e-3)
    rate = replace(PD, law="rate", kp=0.5, ki=1.2, kd=0.0, derivative_time_constant=0.0)
    mine = margin_table(loops(plants_of(ROW), law_of(rate)))[0]
    theirs = truth(law([1.0, -1.0], [0.0], [0.5 + 0.012, -0.5]))
    assert mine == pytest.approx(theirs, rel=3e-4, abs=2e-3)


# ---- modes


MODES = (Mode("slosh1", 4.0, 0.01, 0.05), Mode("bending1", 24.0, 0.005, 0.05, 1.0, 1.4),
         Mode("slosh2", 5.5, 0.02, 0.03))


@pytest.mark.parametrize("gyro", [False, True])
def test_loops_with_modes_are_python_controls(gyro):
    """Two slosh masses and a bending mode at attitude and gyro: L at all frequencies, and the margins that follow."""
    a6, k1, w, zeta, delay, period = 2.0, -7.0, 50.0, 0.7, 0.004, 0.01
    a = np.zeros((11, 11))
    a[0, 1] = a[2, 3] = a[4, 5] = a[6, 7] = a[8, 9] = 1.0
    a[1, [0, 2, 4, 8]] = a6, k1, 0.05 * 4.0**2, 0.03 * 5.5**2
    a[3, [2, 3, 10]] = -w * w, -2.0 * zeta * w, w * w
    a[7, [6, 7, 2]] = -24.0**2, -2.0 * 0.005 * 24.0, 0.05 * 24.0**2
    for row, frequency, damping in ((5, 4.0, 0.01), (9, 5.5, 0.02)):
        a[row, [row - 1, row]] = -frequency**2, -2.0 * damping * frequency
        a[row] -= a[1]
    late, early, whole = (expm(a * h) for h in (period - delay, delay, period))
    of = Law(np.array([1.2]), np.array([0.2]), np.array([1.0]), period) if gyro else law_of(PD)
    omega = np.geomspace(0.05, 300.0, 3000)
    z = np.exp(1j * omega * period)
    total = 0.0
    for seen, own in zip(([0, 6], [1, 7]), of.at(z - 1.0), strict=True):
        row = np.zeros((1, 10))
        row[0, seen] = 1.0, 1.0 if seen[0] == 0 else 1.4
        moved = [control.ss(whole[:10, :10], x[:, None], row, 0.0, period)(z) for x in (
            late[:10, 10], late[:10, :10] @ early[:10, 10])]
        total = total - own * (moved[0] + moved[1] / z)
    rows = np.array([[a6, k1, w, zeta, delay, 0.0, *(x for mode in MODES for x in (mode.frequency, mode.size))]])
    mine = loops(plants_of(rows, False, MODES), of)
    assert np.max(np.abs(mine.gain(omega)[0] / total - 1.0)) < 1e-7
    _, phases, least, *_ = control.stability_margins(control.frd(total, omega), returnall=True)
    found = crossings_of(mine, MODES)
    told = [each.margin for each in found if each.kind == "phase"]
    assert len(told) == len(phases) and told == pytest.approx(phases, abs=0.5)
    assert {each.of for each in found} >= {"slosh1", "bending1"}
    if mine.stable()[0]:
        assert margin_table(mine)[0, 4] == pytest.approx(least.min(), rel=2e-2)


def test_a_nominals_modes_are_in_its_loop():
    nominal = replace(CONSTANT, slosh=(Slosh(constant(4.0), constant(0.05)),),
                      bending=(Bending(constant(24.0), constant(0.02), gyro_gain=constant(0.03), gain_sigma=0.5),))
    modes, std = modes_at(nominal, 3.0)
    assert [mode.name for mode in modes] == ["slosh1", "bending1"] and modes[1].at_rate == pytest.approx(1.5)
    assert std == [0.0, 0.0, 0.0, pytest.approx(0.01)]


# ---- what the nominal does not know


def held_within(found, right: np.ndarray, halves: float) -> bool:
    """Whether every window has margins, each within so many half-widths of the truth."""
    for window in found.windows:
        if window.window.spread is None:
            return False
        for x, margin in zip(right, (getattr(window.window.spread, each) for each in MARGIN_NAMES), strict=True):
            if abs(x - margin.value) > halves * max(margin.high - margin.value, margin.value - margin.low, 2e-3):
                return False
    return True


def test_damping_that_the_nominal_does_not_have_is_in_the_margins():
    vehicle = VEHICLE._replace(rate_damping=0.3)
    found = launchid.margins(fly(LAWS["pd"], vehicle, seed=3, duration=BRIEF), NOMINAL, window=10.0)
    damping = found.report["damping"]
    assert abs(damping["value"] - 0.3) < 4.0 * damping["std"] and "the airframe's damping is" in found.summary()
    assert held_within(found, truth(LAWS["pd"], vehicle), 2.0)


@pytest.mark.campaign
@pytest.mark.parametrize("alone", [False, True], ids=["with its nominal", "alone"])
def test_the_joint_covariance_is_that_of_many_flights(alone):
    """a6, k1 and damping of 24 flights: errors over their joint covariance are a chi square of three."""
    distances = []
    for seed in range(24):
        found = launchid.margins(fly(LAWS["pd"], seed=100 + seed), None if alone else NOMINAL, window=10.0)
        told = [window.window.known for window in found.windows if window.window.known is not None]
        off = [known.mean[[0, 1, 5]] - [VEHICLE.a6, VEHICLE.k1, 0.0] for known in told]
        distances.append(np.mean([x @ np.linalg.solve(known.covariance[np.ix_([0, 1, 5], [0, 1, 5])], x)
                                  for x, known in zip(off, told, strict=True)]))
    assert 1.5 < np.mean(distances) < 4.0


@pytest.mark.parametrize("column", ["missing", "the command"])
def test_a_servo_that_nobody_saw_is_estimated_from_the_motion(column):
    """Declared without delay, flown with 30 ms."""
    vehicle = VEHICLE._replace(delay=0.03)
    columns = fly(LAWS["pd"], vehicle, seed=3, duration=BRIEF)
    columns["beta"] = columns["beta_cmd"].copy()
    if column == "missing":
        del columns["beta"]
    found = launchid.margins(columns, CONSTANT, window=10.0)
    assert found.report["actuator"]["delay"]["std"] > 1e-3
    assert held_within(found, truth(LAWS["pd"], vehicle), 2.0)


# ---- without a nominal


def test_margins_out_of_a_log_alone_hold_the_truth():
    """Vehicle, servo and controller from one log."""
    found = launchid.margins(fly(LAWS["pid"], seed=8, duration=20.0), window=10.0)
    right = truth(LAWS["pid"])
    assert found.nominal is None and found.report["controller"]["source"] == "log"
    assert np.all(np.abs(found.servo.mean - [50.0, 0.7, 0.008]) < 4.0 * np.sqrt(np.diag(found.servo.covariance)))
    assert any(window.window.valid for window in found.windows)
    for window in found.windows:
        if window.window.spread is None:
            continue
        for x, margin in zip(right, (getattr(window.window.spread, each) for each in MARGIN_NAMES), strict=True):
            half = max(margin.high - margin.value, margin.value - margin.low, 2e-3)
            assert abs(x - margin.value) < 2.0 * half


def test_a_flight_that_does_not_move_says_which_manoeuvre_would_tell():
    """The reference stands: the low gain margin is undecided; with it moving, in one window of all, nothing is."""
    still = launchid.margins(fly(LAWS["pd"], seed=3, duration=15.0, guidance=STILL), NOMINAL)
    told = still.report["excitation"]
    assert told["undecided"] > 0 and 0.0 < told["accuracy"] < 1.0 and told["length"] > 5.0
    assert "launchid plan constant --accuracy" in still.summary()
    whole = launchid.margins(fly(LAWS["pd"], seed=3, duration=BRIEF), NOMINAL, window="all")
    assert len(whole.windows) == 1 and whole.report["excitation"] is None
    assert held_within(whole, truth(LAWS["pd"]), 2.0)


def test_several_flights_bear_the_same_gains():
    found = launchid.margins([fly(LAWS["pd"], seed=seed, duration=10.0) for seed in (9, 10)], NOMINAL)
    for name, (least, largest) in found.report["gains"].items():
        each = [flight.report["gains"][name] for flight in found.flights]
        assert least == max(low for low, _ in each) and largest == min(high for _, high in each)
    assert [flight["log"] for flight in found.report["flights"]] == [flight.log.path for flight in found.flights]

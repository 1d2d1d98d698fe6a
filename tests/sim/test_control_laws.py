"""The rate law, the controller's filters and the first-order servo, against plain Python, scipy and python-control."""

import dataclasses
import math

import control
import numpy as np
import pytest
import shortened
from every import every
from scipy.signal import bilinear, lfilter
from test_sim import refused
from unjitted import unjitted

from launchid.log.log import read_log
from launchid.main import main
from sim.effects import from_text
from sim.flight import SUITES, Flight, fly, fly_whole
from sim.nominal import Guidance, Multisine, Nominal, Section, load_nominal, write_nominal
from sim.sections import lowpass, notch
from sim.vehicle.controller import filtered
from sim.vehicle.record import SECTION

PERIOD = 0.01
RUNGE_KUTTA = 1e-9  # rad: its error over 0.01 rad at a time constant of 20 steps, 20^-4/120/e
NOTCH, LOWPASS = notch(PERIOD, 30.0, 0.05, 0.5), lowpass(PERIOD, 60.0, 0.7)
RATE = {"law": "rate", "kp": 0.9, "ki": 1.1, "kd": 0.0, "derivative_time_constant": 0.0}
LAG = {"natural_frequency": math.nan, "damping_ratio": math.nan, "time_constant": 0.04}
STILL = {"sensors": {"theta_std": 0.0, "theta_dot_std": 0.0, "beta_std": 0.0}, "actuator": {"command_noise_std": 0.0},
         "simulation": {"acceleration_noise_std": 0.0}, "controller": {"kp": 0.0, "kd": 0.0}}


def short(duration: float = 4.0, **sections) -> Nominal:
    """The constant nominal for some seconds, its manoeuvre at once, with values replaced."""
    return shortened.short(duration, **{"guidance": shortened.AT_ONCE} | sections)


def held_command(actuator: dict, duration: float = 0.5, angle: float = 0.01) -> Nominal:
    """Open loop, silent, under a constant command [rad]."""
    nominal = short(duration, **STILL | {"actuator": {**STILL["actuator"], **actuator}})
    return dataclasses.replace(nominal, test_input=Multisine(0.0, 99.0, (1e-9,), (angle,), (math.pi / 2,)))


def alike(nominal: Nominal, suite: str = "flight", effects: tuple = ()) -> Flight:
    """The flight, whole and one sample at a time the same bits."""
    flight = fly_whole(nominal, 3, suite, effects=effects)
    one_by_one = list(fly(nominal, 3, suite, effects=effects))
    assert np.array(list(flight.samples())).tobytes() == np.array(one_by_one).tobytes()
    return flight


# ---- the servo of first order


@pytest.mark.parametrize("time_constant", [0.02, 0.3])
def test_first_order_servo_is_the_exponential(time_constant):
    flight = fly_whole(held_command({**LAG, "time_constant": time_constant}), 0, "ideal")
    assert np.allclose(flight.beta, 0.01 * (1 - np.exp(-flight.t / time_constant)), rtol=0.0, atol=RUNGE_KUTTA)


@pytest.mark.parametrize(("scale", "lag"), [(0.5, 0.0), (2.0, 0.0), (0.5, 1.0), (0.4, 0.3)])
def test_bandwidth_scales_one_over_the_time_constant(scale, lag):
    """A ramp is as late with the lag's share before the servo, T/scale."""
    flight = fly_whole(held_command(LAG, 2.0), 0, "ideal",
                       effects=[from_text(f"actuator_bandwidth:scale={scale},lag={lag}")])
    late = np.trapezoid(0.01 - flight.beta, flight.t) / 0.01
    assert late == pytest.approx(0.04 / scale, rel=2e-3)
    if lag == 0.0:
        assert np.allclose(flight.beta, 0.01 * (1 - np.exp(-flight.t * scale / 0.04)), rtol=0.0, atol=RUNGE_KUTTA)


def test_rate_limit_clips_the_first_order_rate():
    flight = fly_whole(held_command(LAG, 2.0), 0, "ideal", effects=[from_text("actuator_rate_limit:rate=0.02")])
    rate = np.diff(flight.beta) / 0.001
    assert rate.max() == pytest.approx(0.02, rel=1e-9) and np.sum(rate > 0.0199) > 400
    assert flight.beta.max() <= 0.01 and flight.beta[-1] == pytest.approx(0.01, abs=1e-5)


# ---- the rate law


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("limit", [0.12, 0.02])
@pytest.mark.parametrize("effects", [(), ("gyro_bias:rate=0.01",)])
def test_logged_command_is_the_law_s_from_the_logged_rate(suite, limit, effects):
    """Plain Python on two columns of the log gives a third one back, bit for bit."""
    nominal = short(controller=RATE, actuator={"deflection_limit": limit},
                    sensors={"theta_dot_std": 5.2e-4 if suite == "flight" else 0.0})
    flight = alike(nominal, suite, tuple(map(from_text, effects)))
    every = round(PERIOD / flight.period)
    integral, commands, held = 0.0, [], 0
    for rate, reference in zip(flight.theta_dot[::every].tolist(), flight.rate_ref[::every].tolist(), strict=True):
        error = rate - reference
        command = 0.9 * error + 1.1 * (integral + PERIOD * error)
        if abs(command) <= limit:
            integral += PERIOD * error
        held += abs(command) > limit
        commands.append(min(max(command, -limit), limit))
    assert flight.beta_cmd[::every].tolist() == commands
    assert (held > 0) is (limit < 0.1)


def test_pi_law_against_python_control():
    """The error is the law's alone: open loop in effect, kp and ki so small that the plant does not feel them, scaled
    back."""
    tiny = 1e-9
    nominal = short(controller={**RATE, "kp": 0.9 * tiny, "ki": 1.1 * tiny}, actuator={"deflection_limit": 1.0})
    flight = fly_whole(nominal, 3)
    law = control.tf([0.9 + 1.1 * PERIOD, -0.9], [1, -1], PERIOD)
    _, expected = control.forced_response(law, np.arange(len(flight.t)) * PERIOD, flight.theta_dot - flight.rate_ref)
    assert np.allclose(flight.beta_cmd / tiny, expected, rtol=1e-9, atol=1e-12)


def test_integral_is_held_while_the_command_is_limited():
    """Gain 0 but the integral's, a constant rate error: the command rises to the limit and stays."""
    nominal = short(3.0, **STILL | {"controller": {**RATE, "kp": 0.0, "ki": 1.0}, "actuator": {
        "deflection_limit": 0.0105, "command_noise_std": 0.0}}, vehicle={"k1": np.zeros(1), "a6": np.zeros(1)})
    nominal = dataclasses.replace(nominal, guidance=Guidance((0.0,), (0.0,)))
    flight = fly_whole(nominal, 0, "ideal", 0.01, effects=[from_text("gyro_bias:rate=0.1")])
    assert np.allclose(flight.beta_cmd[:10], 0.001 * np.arange(1, 11))
    assert (flight.beta_cmd[10:] == 0.0105).all()


def test_rate_reference_is_its_list_or_the_slope_of_the_attitude_s():
    t = np.array([-1.0, 0.0, 0.49, 0.5, 1.0, 2.0, 3.0])
    slope = Guidance((0.0, 0.5, 2.0), (0.0, 0.0, -0.09))
    assert np.allclose(slope.rate_at(t), [0.0, 0.0, 0.0, -0.06, -0.06, 0.0, 0.0])
    assert Guidance((0.0,), (0.1,)).rate_at(t).tolist() == [0.0] * 7
    given = Guidance((0.0, 2.0), (0.0, 0.0), (0.1, 0.2))
    assert np.allclose(given.rate_at(t), [0.1, 0.1, 0.1245, 0.125, 0.15, 0.2, 0.2])
    flight = fly_whole(short(controller=RATE, guidance=dataclasses.asdict(given) | {"t": (0.0, 2.0)}))
    assert np.allclose(flight.rate_ref, 0.1 + 0.05 * np.minimum(flight.t, 2.0), rtol=0.0, atol=1e-15)
    assert np.isnan(fly_whole(short()).rate_ref).all()


# ---- PD with the gyro


@pytest.mark.parametrize("suite", SUITES)
def test_the_gyro_law_is_pd_of_what_is_measured(suite):
    """Of the navigation's attitude and the gyro's rate, less their references; the log's command, from its own rows."""
    gyro = {"law": "gyro", "kp": 1.2, "kd": 0.5, "derivative_time_constant": 0.0}
    flight = alike(short(controller=gyro, sensors={"theta_std": 0.0, "theta_dot_std": 0.0}), suite)
    every = round(PERIOD / flight.period)
    columns = ("theta", "theta_ref", "theta_dot", "rate_ref", "beta_cmd")
    seen = {name: getattr(flight, name)[::every] for name in columns}
    expected = 1.2 * (seen["theta"] - seen["theta_ref"]) + 0.5 * (seen["theta_dot"] - seen["rate_ref"])
    assert not flight.lost and np.allclose(seen["beta_cmd"], expected, rtol=0.0, atol=1e-15)


# ---- filters


@pytest.mark.parametrize("sections", [(NOTCH,), (LOWPASS,), (NOTCH, LOWPASS),
                                      (Section((0.5, 0.2, -0.1), (1.0, -0.6, 0.2)),)])
def test_filters_are_scipy_s(sections):
    x = np.random.default_rng(0).standard_normal(300)
    expected = x
    for section in sections:
        expected = lfilter(section.b, section.a, expected)
    rows = np.array([(*section.b, *section.a[1:], 0.0, 0.0) for section in sections], SECTION)
    assert np.allclose([unjitted(filtered)(rows, value) for value in x], expected, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("law", [{}, RATE])
def test_filtered_command_is_lfilter_of_the_law_s(law):
    """The filters come after the law, before test input and limit: the log's command, from its own measurement."""
    probe = Multisine(0.1, 9.0, (5.0,), (0.004,), (0.3,))
    nominal = dataclasses.replace(short(controller={**law, "filters": (NOTCH, LOWPASS)}), test_input=probe)
    flight = alike(nominal)
    if law:
        error = flight.theta_dot - flight.rate_ref
        output = 0.9 * error + 1.1 * PERIOD * np.cumsum(error)
    else:
        c = nominal.controller
        error, tau = flight.theta - flight.theta_ref, c.derivative_time_constant
        step = np.diff(error, prepend=error[0])
        output = c.kp * error + c.kd * lfilter([1 / (tau + PERIOD)], [1, -tau / (tau + PERIOD)], step)
    for section in (NOTCH, LOWPASS):
        output = lfilter(section.b, section.a, output)
    assert np.abs(flight.beta_cmd).max() < 0.12
    assert np.allclose(flight.beta_cmd, output + probe.at(flight.t), rtol=0.0, atol=1e-12)


def test_kinds_are_tustin_s_rule_prewarped():
    w = 40.0
    rate = w / math.tan(0.5 * w * PERIOD) / 2  # of scipy's s = 2 fs (z - 1)/(z + 1)
    for kind, damping, b in ((notch, (0.1, 0.6), [1, 0.2 * w, w * w]), (lowpass, (0.6,), [w * w])):
        section = kind(PERIOD, w, *damping)
        for ours, theirs in zip((section.b, section.a), bilinear(b, [1, 1.2 * w, w * w], rate), strict=True):
            assert np.allclose(ours, theirs, rtol=0.0, atol=1e-12), kind.__name__


# ---- files


def test_loops_read_back(tmp_path):
    path = tmp_path / "n.toml"
    rate = {"guidance": {"t": (0.0, 2.0), "theta_ref": (0.0, 0.0), "rate_ref": (0.1, 0.1 / 3)},
            "controller": {**RATE, "filters": (NOTCH, LOWPASS)}, "actuator": LAG}
    for nominal in (short(**rate), short(controller={"filters": (LOWPASS,)})):
        write_nominal(nominal, path)
        again = load_nominal(path)
        assert (again.controller, again.guidance) == (nominal.controller, nominal.guidance)
        assert repr(again.actuator) == repr(nominal.actuator)
    assert fly_whole(again, 1).theta.tobytes() == fly_whole(nominal, 1).theta.tobytes()


LAUNCHER = """[vehicle]
a6 = 2.0
k1 = -7.0
[sensors]
period = 0.01
theta_std = 0.0
theta_dot_std = 0.0
beta_std = 0.0
"""
PD = "[controller]\nkp = 1\nkd = 0.5\nderivative_time_constant = 0.05\nperiod = 0.01\n"
PI = '[controller]\nlaw = "rate"\nkp = 1\nperiod = 0.01\n'


def test_filters_by_kind_and_by_coefficients(tmp_path):
    (tmp_path / "n.toml").write_text(LAUNCHER + PI + """ki = 0.5
[[controller.filters]]
kind = "notch"
frequency = 30.0
depth_damping = 0.05
width_damping = 0.5
[[controller.filters]]
b = [0.5, 0, 0]
a = [1, -0.5, 0]
[[controller.filters]]
kind = "lowpass"
frequency = 60
damping_ratio = 0.7
""")
    controller = load_nominal(tmp_path / "n.toml").controller
    assert controller.filters == (NOTCH, Section((0.5, 0.0, 0.0), (1.0, -0.5, 0.0)), LOWPASS)
    assert (controller.ki, controller.kd, controller.is_rate_law) == (0.5, 0.0, True)


def test_attitude_reference_is_0_where_the_rate_law_has_its_own(tmp_path):
    (tmp_path / "n.toml").write_text(LAUNCHER + PI + "[guidance]\nt = [0, 1]\nrate_ref = [0.1, 0.2]\n")
    assert load_nominal(tmp_path / "n.toml").guidance == Guidance((0.0, 1.0), (0.0, 0.0), (0.1, 0.2))


def filter_of(text: str) -> str:
    return f"{PD}[[controller.filters]]\n{text}"


@every(("text", "expected"), [
    ("[actuator]\nnatural_frequency = 50", "key 'actuator.damping_ratio' is missing; expected natural_frequency and"),
    ("[actuator]\ndelay = 0", "is missing; expected natural_frequency and damping_ratio, or time_constant"),
    ("[actuator]\nnatural_frequency = 50\ntime_constant = 0.1", "[actuator] has time_constant and natural_frequency"),
    ("[actuator]\ndamping_ratio = 0.7\ntime_constant = 0.1", "[actuator] has time_constant and damping_ratio"),
    ("[actuator]\ntime_constant = 0", "actuator.time_constant = 0: expected a number above 0"),
    (PD + "ki = 1", "key 'controller.ki' is not of law \"attitude\""),
    (PI + "kd = 1", "key 'controller.kd' is not of law \"rate\""),
    (PI + "derivative_time_constant = 1", "key 'controller.derivative_time_constant' is not of law \"rate\""),
    (PD + 'law = "gyro"', "key 'controller.derivative_time_constant' is not of law \"gyro\""),
    (PD + 'law = "magic"', "controller.law = 'magic': expected \"attitude\" or \"rate\" or \"gyro\""),
    (PD + "law = 3", "controller.law = 3"), (PI + "ki = '1'", "controller.ki = '1'"),
    ("[controller]\nkp = 1\nperiod = 0.01", "key 'controller.derivative_time_constant' is missing"),
    (PI + "[guidance]\nt = [0, 1]", "key 'guidance.theta_ref' is missing"),
    (PD + "[guidance]\nt = [0, 1]\nrate_ref = [0, 1]", "key 'guidance.theta_ref' is missing"),
    (PI + "[guidance]\nt = [0, 1]\nrate_ref = [0, 1, 2]", "guidance.rate_ref 3"),
    (PD + "filters = 3", "controller.filters = 3: expected [[controller.filters]] tables"),
    (PD + "filters = [3]", "controller.filters[0] = 3"),
    (filter_of("b = [1, 0, 0]"), "'controller.filters[0].a' is missing"),
    (filter_of("b = [1, 0]\na = [1, 0, 0]"), "controller.filters[0].b = [1.0, 0.0]: expected three numbers"),
    (filter_of("b = [1, 0, 0]\na = [2, 0, 0]"), "controller.filters[0].a = [2.0, 0.0, 0.0]: expected 1 as the first"),
    (filter_of("b = [1, 0, '0']\na = [1, 0, 0]"), "controller.filters[0].b[2] = '0'"),
    (filter_of("b = [1, 0, 0]\na = [1, 0, 0]\ngain = 1"), "unknown key 'controller.filters[0].gain'"),
    (filter_of("kind = 'comb'"), "controller.filters[0].kind = 'comb': expected \"notch\" or \"lowpass\""),
    (filter_of("kind = 'lowpass'\nfrequency = 60"), "'controller.filters[0].damping_ratio' is missing"),
    (filter_of("kind = 'lowpass'\nfrequency = 400\ndamping_ratio = 1"), "controller.filters[0].frequency = 400"),
    (filter_of("kind = 'lowpass'\nfrequency = 0\ndamping_ratio = 1"), "controller.filters[0].frequency = 0"),
    (filter_of("kind = 'lowpass'\nfrequency = 60\ndamping_ratio = -1"), "controller.filters[0].damping_ratio = -1")])
def test_wrong_key_is_named(tmp_path, text, expected):
    assert expected in refused(tmp_path / "n.toml", f"{LAUNCHER}{text}\n")


# ---- commands


def test_simulate_writes_the_rate_reference(tmp_path):
    write_nominal(short(1.0, controller=RATE), tmp_path / "n.toml")
    assert main(["simulate", str(tmp_path / "n.toml"), "--out", str(tmp_path / "log.csv")]) == 0
    log, flight = read_log(tmp_path / "log.csv"), fly_whole(short(1.0, controller=RATE))
    assert "rate_ref" in log.columns and log.rate_ref.tobytes() == flight.rate_ref.tobytes()

"""The causes as extensions of the simulator: neutral to the bit, each by its equation or law, by file and by words."""

import dataclasses
import functools
import math
import tomllib

import numpy as np
import pytest
import shortened
from every import every
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from unjitted import unjitted

from launchid.main import main
from launchid_core import LIBRARIES
from launchid_core.algebra import library
from launchid_core.algebra.library import term_codes
from sim.effects import CATALOGUE, Effect, effect, from_table, from_text, pack, values
from sim.effects.plant import acceleration
from sim.effects.table import TERM
from sim.errors import InputError, UsageError
from sim.flight import SUITES, Flight, fly, fly_whole
from sim.nominal import BUILT_IN, Multisine, Nominal, Profile, built_in, load_nominal, write_nominal
from sim.plant import parameters
from sim.vehicle.record import FLIGHT

COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot", "theta_ddot", "a6", "k1")
REQUIRED = {"time": 2.0, "frequency": 20.0, "duration": 3.0, "term": "theta^3", "z_alpha": 0.0, "z_beta": 0.0}
CONTRACT = {  # sections 4 and 5: where, and parameters with their neutral value, default, or None
    "control_effectiveness": ("plant", {"scale": 1}), "control_loss": ("plant", {"fraction": 0, "time": None}),
    "aero_instability": ("plant", {"scale": 1}), "aero_damping": ("plant", {"coefficient": 0}),
    "aero_cubic": ("plant", {"coefficient": 0}), "friction": ("plant", {"coefficient": 0}),
    "thrust_misalignment": ("plant", {"angle": 0}),
    "slosh": ("plant", {"coupling": 0, "frequency": None, "damping_ratio": 0.02}),
    "bending": ("plant", {"gain": 0, "frequency": None, "damping_ratio": 0.03}),
    "missing_term": ("plant", {"term": None, "coefficient": 0}),
    "moment_step": ("plant", {"acceleration": 0, "time": None}), "nozzle_inertia": ("plant", {"coefficient": 0}),
    "control_slope": ("plant", {"slope": 0}), "lateral_drift": ("plant", {"z_alpha": None, "z_beta": None}),
    "turbulence": ("environment", {"level": 0, "time_constant": 1}), "wind_walk": ("environment", {"level": 0}),
    "gust": ("environment", {"angle": 0, "time": None, "duration": None}), "steady_wind": ("environment", {"angle": 0}),
    "periodic_disturbance": ("environment", {"amplitude": 0, "frequency": None, "phase": 0}),
    "actuator_delay": ("actuator", {"delay": 0}), "actuator_bandwidth": ("actuator", {"scale": 1}),
    "actuator_gain": ("actuator", {"scale": 1}), "actuator_rate_limit": ("actuator", {"rate": math.inf}),
    "actuator_backlash": ("actuator", {"half_width": 0}), "actuator_bias": ("actuator", {"angle": 0}),
    "input_washout": ("actuator", {"time_constant": math.inf}),
    "attitude_bias": ("sensor", {"angle": 0}), "attitude_delay": ("sensor", {"delay": 0}),
    "gyro_bias": ("sensor", {"rate": 0}), "gyro_scale": ("sensor", {"scale": 1}),
    "gyro_delay": ("sensor", {"delay": 0}), "nozzle_sensor_bias": ("sensor", {"angle": 0}),
    "controller_mismatch": ("controller", {"kp_scale": 1, "kd_scale": 1, "delay": 0})}
FORMS = {"actuator_bandwidth": {"lag": 0}, "actuator_rate_limit": {"wind_up": 0},
         "control_slope": {"middle": math.inf}}  # beside the contract's
STRONG = {
    "control_effectiveness:scale=0.8", "control_loss:fraction=0.3,time=1.5", "aero_instability:scale=1.3",
    "aero_damping:coefficient=0.4", "aero_cubic:coefficient=30", "friction:coefficient=0.01",
    "thrust_misalignment:angle=0.01", "slosh:coupling=0.4,frequency=3", "bending:gain=0.03,frequency=30",
    "missing_term:term=theta^2,coefficient=2", "moment_step:acceleration=0.02,time=1.5",
    "nozzle_inertia:coefficient=-0.004", "control_slope:slope=0.05", "lateral_drift:z_alpha=0.05,z_beta=0.03",
    "gust:angle=0.02,time=1,duration=2", "steady_wind:angle=0.02",
    "periodic_disturbance:amplitude=0.02,frequency=4", "turbulence:level=0.01", "wind_walk:level=0.01",
    "actuator_delay:delay=0.02", "actuator_bandwidth:scale=0.6",
    "actuator_gain:scale=0.9", "actuator_rate_limit:rate=0.02", "actuator_backlash:half_width=0.002",
    "actuator_bias:angle=0.01", "input_washout:time_constant=2",
    "attitude_bias:angle=0.01", "attitude_delay:delay=0.013", "gyro_bias:rate=0.01",
    "gyro_scale:scale=1.1", "gyro_delay:delay=0.0305", "nozzle_sensor_bias:angle=0.01",
    "controller_mismatch:kp_scale=1.2,delay=0.013"}


def short(duration: float = 4.0, **sections: dict[str, float]) -> Nominal:
    """The constant nominal, its manoeuvre at once, with values replaced: short(sensors={"theta_std": 0.0})."""
    return shortened.short(duration, guidance=shortened.AT_ONCE, **sections)


OPEN = {"controller": {"kp": 0.0, "kd": 0.0}, "actuator": {"command_noise_std": 0.0}}
PROBE = Multisine(0.1, 9.0, (5.0, 13.0), (0.004, 0.003), (0.3, 1.0))


def probed(duration: float = 3.0, **sections: dict[str, float]) -> Nominal:
    """Open loop, no noise, the nozzle led by the test input alone."""
    return dataclasses.replace(short(duration, **{**OPEN, **sections}), test_input=PROBE)


def bits(flight: Flight) -> bytes:
    return b"".join(getattr(flight, name).tobytes() for name in COLUMNS)


@functools.cache
def without_effects(suite: str) -> bytes:
    return bits(fly_whole(short(), 3, suite))


def neutral(name: str) -> Effect:
    """The effect at its neutral values; what has none at any."""
    return effect(name, **{p.name: REQUIRED[p.name] if p.neutral is None else p.neutral
                           for p in CATALOGUE[name].parameters if p.default is None})


# ---- the catalogue


def test_catalogue_is_the_contract_s_table():
    assert {name: (cause.where, {p.name: p.default if p.neutral is None else p.neutral for p in cause.parameters})
            for name, cause in CATALOGUE.items()} \
        == {name: (where, parameters | FORMS.get(name, {})) for name, (where, parameters) in CONTRACT.items()}
    assert {text.split(":")[0] for text in STRONG} == set(CONTRACT)


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("name", CATALOGUE)
def test_neutral_effect_changes_no_bit(name, suite):
    nominal, plain = short(), without_effects(suite)
    assert bits(fly_whole(nominal, 3, suite, effects=[neutral(name)])) == plain
    assert bits(fly_whole(dataclasses.replace(nominal, effects=(neutral(name),) * 2), 3, suite)) == plain


def test_all_neutral_effects_change_no_bit_of_a_varying_vehicle():
    nominal = load_nominal("vega_like")
    assert bits(fly_whole(nominal, 1, effects=map(neutral, CATALOGUE))) == bits(fly_whole(nominal, 1))


@pytest.mark.parametrize("text", sorted(STRONG))
def test_effect_shows_and_flies_alike_whole_and_one_by_one(text):
    flight = fly_whole(dataclasses.replace(short(), effects=(from_text(text),)), 3)
    assert bits(flight) != without_effects("flight")
    assert bits(flight) == bits(fly_whole(short(), 3, effects=[from_text(text)]))
    one_by_one = np.array(list(fly(short(), 3, effects=[from_text(text)])))
    assert one_by_one.tobytes() == np.array(list(flight.samples())).tobytes()


def test_order_in_which_effects_are_given_changes_no_bit():
    effects = [from_text(text) for text in sorted(STRONG)] + [from_text("gust:angle=-0.01,time=2,duration=1.5")]
    forward = fly_whole(short(), 3, effects=effects)
    assert bits(forward) == bits(fly_whole(short(), 3, effects=effects[::-1]))
    assert len(forward.t) > 150


# ---- plant and environment: the equation of motion, exactly, on the ideal log


EXTRA = {
    "aero_damping:coefficient=0.4": lambda f: -0.4 * f.theta_dot,
    "aero_cubic:coefficient=30": lambda f: 2.0 * 30.0 * f.theta**3,
    "friction:coefficient=0.01": lambda f: -0.01 * np.sign(f.theta_dot),
    "thrust_misalignment:angle=0.01": lambda f: f.k1 * 0.01,
    "missing_term:term=theta^2,coefficient=2": lambda f: 2.0 * f.theta**2,
    "missing_term:term=theta_dot*sin(theta),coefficient=-3": lambda f: -3.0 * f.theta_dot * np.sin(f.theta),
    "steady_wind:angle=0.02": lambda f: f.a6 * 0.02,
    "gust:angle=0.02,time=1,duration=2": lambda f: np.where(
        (f.t > 1) & (f.t < 3), f.a6 * 0.02 * (1 - np.cos(2 * np.pi * (f.t - 1) / 2)) / 2, 0.0),
    "periodic_disturbance:amplitude=0.02,frequency=4,phase=0.5": lambda f: 0.02 * np.sin(4.0 * f.t + 0.5),
    "control_effectiveness:scale=0.8": lambda f: 0.0, "aero_instability:scale=1.3": lambda f: 0.0,
    "control_loss:fraction=0.3,time=1.5": lambda f: 0.0, "control_slope:slope=0.1": lambda f: 0.0,
    "moment_step:acceleration=-0.02,time=1.5": lambda f: np.where(f.t >= 1.5, -0.02, 0.0),
    "turbulence:level=0.01": lambda f: f.a6 * f.wind, "wind_walk:level=0.01": lambda f: f.a6 * f.wind,
    "lateral_drift:z_alpha=0.05,z_beta=0.03": lambda f: -f.a6 * f.true_gamma}


@pytest.mark.parametrize("text", EXTRA)
def test_moment_is_the_contract_s(text):
    flight = fly_whole(short(), 3, "ideal", effects=[from_text(text)])
    assert not flight.lost
    assert np.allclose(flight.theta_ddot, flight.a6 * flight.theta + flight.k1 * flight.beta + EXTRA[text](flight),
                       rtol=0, atol=1e-15)
    rate = np.diff(flight.theta_dot) / flight.period  # and what is logged is what is flown
    middle = 0.5 * (flight.theta_ddot[1:] + flight.theta_ddot[:-1])
    moves = np.abs(flight.theta_dot[1:]) > 1e-3  # at rest friction changes sign within the step
    assert np.quantile(np.abs(rate - middle)[moves], 0.95) < 5e-5


def test_truth_has_the_effects_on_a6_and_k1():
    effects = [from_text(text) for text in ("control_effectiveness:scale=0.8", "control_loss:fraction=0.3,time=1.5",
                                            "control_loss:fraction=0.5,time=3", "aero_instability:scale=1.3")]
    nominal = dataclasses.replace(short(), effects=tuple(effects))
    flight = fly_whole(nominal, 0)
    assert np.array_equal(flight.a6, np.full(len(flight.t), 1.3 * 2.0))
    left = np.where(flight.t < 1.5, 1.0, 0.7) * np.where(flight.t < 3.0, 1.0, 0.5)
    assert np.allclose(flight.k1, 0.8 * -7.0 * left, rtol=1e-15)
    assert np.array_equal(parameters(nominal, flight.t)[1], flight.k1)
    assert np.array_equal(parameters(short(), flight.t, effects=effects)[1], flight.k1)


def test_slosh_is_its_equations_of_motion():
    c, w, z = 0.5, 6.0, 0.05
    flight = fly_whole(probed(), 0, "ideal", effects=[effect("slosh", coupling=c, frequency=w, damping_ratio=z)])
    beta = CubicSpline(flight.t, flight.beta)

    def slopes(t, x):
        theta, theta_dot, psi, psi_dot = x
        theta_ddot = 2.0 * theta - 7.0 * beta(t) + c * w**2 * psi
        return theta_dot, theta_ddot, psi_dot, -theta_ddot - 2 * z * w * psi_dot - w**2 * psi

    theta, theta_dot, psi, _ = solve_ivp(slopes, (0, 3), np.zeros(4), t_eval=flight.t, rtol=1e-9, atol=1e-12).y
    assert np.allclose(flight.theta, theta, atol=1e-7) and np.allclose(flight.theta_dot, theta_dot, atol=3e-7)
    assert np.allclose(flight.theta_ddot, 2 * theta - 7 * flight.beta + c * w**2 * psi, atol=1e-6)
    assert np.max(np.abs(theta)) > 1e-2 and np.max(np.abs(c * w**2 * psi)) > 0.02


def test_bending_adds_its_mode_to_what_is_measured_and_leaves_the_vehicle():
    g, w, z = 0.4, 25.0, 0.03
    rigid = fly_whole(probed(), 0, "ideal")
    bent = fly_whole(probed(), 0, "ideal", effects=[effect("bending", gain=g, frequency=w)])
    beta = CubicSpline(rigid.t, rigid.beta)
    eta, eta_dot = solve_ivp(lambda t, x: (x[1], g * w**2 * beta(t) - 2 * z * w * x[1] - w**2 * x[0]), (0, 3), [0, 0],
                             t_eval=rigid.t, rtol=1e-9, atol=1e-12).y
    assert np.allclose(bent.theta - rigid.theta, eta, atol=1e-7)
    assert np.allclose(bent.theta_dot - rigid.theta_dot, eta_dot, atol=2e-6)
    assert np.array_equal(bent.theta_ddot, rigid.theta_ddot) and np.max(np.abs(eta)) > 1e-3


@pytest.mark.parametrize("name", [*LIBRARIES["quadratic+sin"], "theta^3*cos(beta)", "sign(theta_dot)*beta^5"])
def test_missing_term_is_the_library_s_term(name):
    code, row = term_codes((name,))[0], np.zeros(1)
    terms = np.array(pack([effect("missing_term", term=name, coefficient=-2.5)], 0.001).terms, TERM)
    plain = np.zeros(1, FLIGHT)[0]
    for state in np.random.default_rng(0).uniform(-1, 1, (20, 3)):
        raw = np.array([*state, 0.0])
        unjitted(library.library_column)(code, raw.reshape(4, 1), raw[code[5]:code[5] + 1], 1, row)
        moment = unjitted(acceleration)(plain, None, terms, 0.0, 0.0, 0.0, *state)
        assert moment == pytest.approx(-2.5 * row[0], rel=1e-15)


# ---- actuator


@pytest.mark.parametrize("delay", [0.01, 0.023])
def test_actuator_delay_shifts_the_nozzle_and_adds_to_the_nominal_s(delay):
    prompt = fly_whole(short(2.0, controller=OPEN["controller"], actuator={"delay": 0.004}), 4, "ideal")
    late = fly_whole(short(2.0, controller=OPEN["controller"], actuator={"delay": 0.004}), 4, "ideal",
                     effects=[effect("actuator_delay", delay=delay)])
    n = round(delay / 0.001)
    assert np.allclose(late.beta[:n], 0.0, atol=1e-12)
    assert np.allclose(late.beta[n:], prompt.beta[:-n], atol=1e-11) and np.std(prompt.beta) > 1e-4


def test_gain_and_bias_are_those_of_the_nozzle_at_rest():
    still = short(2.0, **OPEN)
    flight = fly_whole(dataclasses.replace(still, test_input=Multisine(0.0, 9.0, (1e-9,), (0.01,), (math.pi / 2,))), 0,
                       "ideal", effects=[effect("actuator_gain", scale=0.8), effect("actuator_bias", angle=0.003)])
    assert flight.beta_cmd[-1] == pytest.approx(0.01) and flight.beta[-1] == pytest.approx(0.8 * 0.01 + 0.003, rel=1e-9)


def test_bandwidth_is_the_servo_s_natural_frequency():
    slow = fly_whole(probed(), 0, "ideal", effects=[effect("actuator_bandwidth", scale=0.5)])
    direct = fly_whole(probed(actuator={"command_noise_std": 0.0, "natural_frequency": 25.0}), 0, "ideal")
    assert bits(slow) == bits(direct)


@pytest.mark.parametrize("wind_up", [0.0, 0.5])
def test_rate_limit_is_the_saturated_servo(wind_up):
    """The reference is plain Python in steps twenty times as fine, and |b'| <= rate to the bit of a sum; the rate that
    is demanded for runs ahead of the limit by its wind-up."""
    rate, w, zeta, fine = 0.03, 50.0, 0.7, 20
    reach = (1.0 + wind_up) * rate
    flight = fly_whole(probed(), 0, "ideal", effects=[effect("actuator_rate_limit", rate=rate, wind_up=wind_up)])
    b, r, reference = 0.0, 0.0, []
    for u in flight.beta_cmd.tolist():
        reference.append(b)
        for _ in range(fine):
            slope = w * w * (u - b) - 2 * zeta * w * r
            r = min(max(r + slope * 0.001 / fine, -reach), reach)
            b += min(max(r, -rate), rate) * 0.001 / fine
    steps = np.abs(np.diff(flight.beta)) / 0.001
    assert np.max(steps) <= rate * (1 + 1e-9) and np.mean(steps > 0.999 * rate) > 0.2
    assert np.allclose(flight.beta, reference, atol=2e-5) and np.max(np.abs(flight.beta)) > 3e-3


@pytest.mark.parametrize(("of", "time", "washes"), [
    (effect("actuator_bandwidth", scale=0.5, lag=1.0), 2.0 * 0.7 / 50.0 * (1.0 / 0.5 - 1.0), False),
    (effect("input_washout", time_constant=0.4), 0.4, True)])
def test_lag_before_the_servo_and_input_that_washes_out(of, time, washes):
    """The oracle is plain Python in steps a hundred times as fine: T w' = u - w, T that of the slowing; w, or u - w of
    which a step is gone after some T, -> servo."""
    w, zeta, fine = 50.0, 0.7, 100
    flight = fly_whole(probed(), 0, "ideal", effects=[of])
    b, r, slow, reference, h = 0.0, 0.0, 0.0, [], 0.001 / fine
    for u in flight.beta_cmd.tolist():
        reference.append(b)
        for _ in range(fine):
            slow += h * (u - slow) / time
            r += h * (w * w * ((u - slow if washes else slow) - b) - 2 * zeta * w * r)
            b += h * r
    assert np.max(np.abs(flight.beta)) > 3e-3
    assert np.allclose(flight.beta, reference, atol=1e-5)


def test_backlash_drives_the_servo():
    h = 0.002
    flight = fly_whole(probed(), 0, "ideal", effects=[effect("actuator_backlash", half_width=h)])
    w, driven = 0.0, []
    for u in flight.beta_cmd.tolist():
        w = max(u - h, min(u + h, w))
        driven.append(w)

    def slopes(t, x):
        u = driven[min(int(t / 0.001 + 1e-6), len(driven) - 1)]
        return x[1], 2500.0 * (u - x[0]) - 70.0 * x[1]

    servo = solve_ivp(slopes, (0, flight.t[-1]), [0, 0], t_eval=flight.t, rtol=1e-8, atol=1e-11, max_step=5e-4)
    assert np.allclose(flight.beta, servo.y[0], atol=2e-6) and np.max(np.abs(driven)) > 2e-3


# ---- sensors and controller


def command_of(nominal: Nominal, flight: Flight, kp: float = 1.0, kd: float = 1.0) -> list[float]:
    """The controller in plain Python on the logged attitude, factors on its gains."""
    c, limit = nominal.controller, nominal.actuator.deflection_limit
    probe = nominal.test_input.at(flight.t) if nominal.test_input else np.full(len(flight.t), -0.0)
    derivative, previous, commands = 0.0, None, []
    for theta, reference, extra in zip(flight.theta.tolist(), flight.theta_ref.tolist(), probe.tolist(), strict=True):
        error = theta - reference
        derivative = ((c.derivative_time_constant * derivative + error - (error if previous is None else previous))
                      / (c.derivative_time_constant + c.period))
        previous = error
        commands.append(min(max(kp * c.kp * error + kd * c.kd * derivative + extra, -limit), limit))
    return commands


@pytest.mark.parametrize("text", sorted(t for t in STRONG if not t.startswith("controller")))
def test_logged_attitude_is_the_one_that_the_controller_used(text):
    flight = fly_whole(short(), 5, effects=[from_text(text)])
    assert flight.beta_cmd.tolist() == command_of(short(), flight)


def test_biases_offset_what_is_measured():
    plain = fly_whole(probed(), 2)
    for text, column in (("attitude_bias:angle=0.01", "theta"), ("gyro_bias:rate=0.01", "theta_dot"),
                         ("nozzle_sensor_bias:angle=0.01", "beta")):
        biased = fly_whole(probed(), 2, effects=[from_text(text)])
        for name in ("theta", "theta_dot", "beta"):
            offset = 0.01 if name == column else 0.0
            assert np.allclose(getattr(biased, name) - getattr(plain, name), offset, rtol=0, atol=1e-15), (text, name)


@pytest.mark.parametrize("name", ["gyro_bias:rate=0.01", "gyro_scale:scale=1.1", "gyro_delay:delay=0.02",
                                  "nozzle_sensor_bias:angle=0.01"])
def test_gyro_and_nozzle_sensor_are_in_the_log_only(name):
    plain, effected = fly_whole(short(), 2), fly_whole(short(), 2, effects=[from_text(name)])
    changed = {column for column in COLUMNS if getattr(plain, column).tobytes() != getattr(effected, column).tobytes()}
    assert changed == {"beta" if "nozzle" in name else "theta_dot"}


def test_gyro_is_late_scaled_and_biased_in_this_order():
    plain = fly_whole(short(), 2, "ideal")
    effects = [effect("gyro_bias", rate=0.01), effect("gyro_scale", scale=1.1), effect("gyro_delay", delay=0.0204)]
    read = fly_whole(short(), 2, "ideal", effects=effects).theta_dot
    late = np.interp(plain.t - 0.0204, plain.t, plain.theta_dot)
    assert np.allclose(read, 1.1 * late + 0.01, atol=1e-12)


@pytest.mark.parametrize("delay", [0.005, 0.0173])
def test_attitude_delay_shifts_what_is_measured(delay):
    plain = fly_whole(probed(), 2, "ideal")
    late = fly_whole(probed(), 2, "ideal", effects=[effect("attitude_delay", delay=delay)])
    assert np.allclose(late.theta, np.interp(plain.t - delay, plain.t, plain.theta), rtol=0, atol=1e-12)
    assert np.array_equal(late.theta_dot, plain.theta_dot)


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.013])
def test_mismatched_controller_issues_its_own_command_late(delay):
    flight = fly_whole(short(), 5, effects=[effect("controller_mismatch", kp_scale=1.2, kd_scale=0.7, delay=delay)])
    own = np.array([0.0, 0.0, 0.0, *command_of(short(), flight, 1.2, 0.7)])
    whole, share = divmod(delay / 0.01, 1.0)
    k = np.arange(3, len(own)) - int(whole)
    assert np.allclose(flight.beta_cmd, (1 - share) * own[k] + share * own[k - 1], rtol=0, atol=1e-15)


# ---- the test input


def test_input_is_in_the_logged_command_before_the_limit():
    probe = Multisine(1.0, 1.5, (7.0, 21.0), (0.02, 0.01), (0.0, 1.0))
    nominal = dataclasses.replace(short(actuator={"deflection_limit": 0.025}), test_input=probe)
    flight = fly_whole(nominal, 5)
    assert flight.beta_cmd.tolist() == command_of(nominal, flight)
    t = flight.t
    assert np.array_equal(probe.at(t) != 0.0, (t >= 1.0) & (t < 2.5))
    assert probe.at(np.array([1.25]))[0] == pytest.approx(0.02 * math.sin(7 * 0.25) + 0.01 * math.sin(21 * 0.25 + 1))
    assert np.max(np.abs(flight.beta_cmd)) == 0.025
    plain = fly_whole(dataclasses.replace(nominal, test_input=None), 5)
    assert np.array_equal(flight.theta[:100], plain.theta[:100]) and not np.array_equal(flight.theta, plain.theta)


# ---- words: the command, the file, the writer


def test_left_out_values_are_defaults_or_neutral():
    assert values(effect("slosh", frequency=3)) == {"coupling": 0.0, "frequency": 3.0, "damping_ratio": 0.02}
    assert values(from_text("controller_mismatch:kd_scale=0.5")) == {"kp_scale": 1.0, "kd_scale": 0.5, "delay": 0.0}
    assert values(from_text(" missing_term : term = sin(theta)*beta , coefficient = 1e-1 ")) == {
        "term": "beta*sin(theta)", "coefficient": 0.1}
    assert from_table({"name": "gust", "angle": 0, "time": 1, "duration": 2}) == from_text(
        "gust:duration=2,time=1,angle=0")
    assert from_text("actuator_rate_limit:rate=inf") == effect("actuator_rate_limit", rate=math.inf)


REFUSED = [
    ("weather:wind=3", "weather", "steady_wind"), ("", "unknown effect", "gust"), ("gust", "no parameter", "duration"),
    ("gust:", "no parameter", "angle"), ("gust:angle=0.1,time=2", "'duration' is missing", "above 0"),
    ("control_loss:fraction=0.1", "'time' is missing", "a number"), ("gust:angel=0.1", "'angel'", "angle"),
    ("missing_term:coefficient=1", "'term' is missing", "library term"), ("gyro_bias:rate", "PARAMETER=VALUE", "rate"),
    ("gyro_bias:rate=fast", "'fast'", "a number"), ("gyro_bias:rate=nan", "nan", "a number"),
    ("gyro_bias:rate=inf", "inf", "rad/s"), ("gyro_bias:rate=1,rate=2", "twice", "rate"),
    ("actuator_delay:delay=-0.01", "-0.01", "at least 0"), ("actuator_delay:delay=11", "11", "at most 10"),
    ("actuator_rate_limit:rate=0", "rate = 0", "above 0"), ("actuator_rate_limit:rate=-inf", "-inf", "above 0"),
    ("control_loss:fraction=1.5,time=1", "1.5", "at most 1"), ("gust:angle=1,time=1,duration=0", "duration", "above 0"),
    ("missing_term:term=zeta,coefficient=1", "'zeta'", "library term"),
    ("missing_term:term=tau*theta,coefficient=1", "tau", "library term"),
    ("control_slope:slope=inf", "slope = inf", "1/s"), ("control_slope:slope=0.1,middle=nan", "middle = nan", "[s]"),
    ("lateral_drift:z_alpha=0.1", "'z_beta' is missing", "a number"), ("turbulence:level=-1", "level", "at least 0"),
    ("turbulence:level=1,time_constant=0", "time_constant", "above 0"),
    ("friction:coefficient=-1", "coefficient", "at least 0"), ("actuator_bandwidth:scale=0", "scale", "above 0")]


@every(("text", "wrong", "allowed"), REFUSED)
def test_wrong_effect_is_refused_in_one_line(text, wrong, allowed, tmp_path, capsys):
    with pytest.raises(UsageError) as caught:
        from_text(text)
    message = str(caught.value)
    assert wrong in message and allowed in message and len(message.splitlines()) == 1
    assert main(["simulate", "constant", "--out", str(tmp_path / "log.csv"), "--effect", text]) == 2
    assert capsys.readouterr().err == f"launchid: {message}\n" and list(tmp_path.iterdir()) == []


def test_frequency_that_the_step_does_not_resolve_is_refused():
    with pytest.raises(UsageError, match=r"bending: frequency = 501\.0: expected at most 500 rad/s"):
        fly_whole(short(), effects=[effect("bending", gain=0.1, frequency=501)])


CONSTANT_TEXT = built_in("constant").read_text(encoding="utf-8").replace("duration = 70.0", "duration = 4.0")


def file_with(tmp_path, addition: str, text: str = CONSTANT_TEXT):
    path = tmp_path / "nominal.toml"
    path.write_text(text + "\n" + addition)
    return path


@pytest.mark.parametrize("text", [  # a number alone, two, one with a default, a term
    "gyro_bias:rate=0.01", "control_loss:fraction=0.3,time=1.5", "actuator_rate_limit:rate=0.02",
    "missing_term:term=theta^2,coefficient=2"])
def test_file_and_command_fly_the_same_bytes(text, tmp_path):
    plain = file_with(tmp_path, "")
    assert main(["simulate", str(plain), "--out", str(tmp_path / "a.csv"), "--seed", "2", "--effect", text]) == 0
    lines = [f"{key} = {value!r}" for key, value in values(from_text(text)).items()]
    path = file_with(tmp_path, "\n".join(["[[effects]]", f'name = "{text.split(":")[0]}"', *lines]))
    assert main(["simulate", str(path), "--out", str(tmp_path / "b.csv"), "--seed", "2"]) == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@every(("addition", "expected"), [
    ('[[effects]]\nname = "weather"\nwind = 1', "effects[0]: unknown effect 'weather'"),
    ('[[effects]]\nname = "gyro_bias"\nrate = 1\n[[effects]]\nname = "gust"\nangle = 1', "effects[1]: effect gust"),
    ('[[effects]]\nrate = 1', "effects[0]: name = None"), ('[[effects]]\nname = "gyro_bias"', "no parameter given"),
    ('[[effects]]\nname = "gyro_bias"\nrate = "1"', "rate = '1'"),
    ('[[effects]]\nname = "gyro_bias"\nrate = true', "True"),
    ('[effects]\nname = "gyro_bias"', "expected [[effects]] tables"),
    ("[test_input]\nstart = 1", "test_input.amplitude' is missing"),
    ("[test_input]\nstart=1\nduration=1\nfrequency=[1]\namplitude=[1, 2]\nphase=[1]", "as many"),
    ("[test_input]\nstart=1\nduration=1\nfrequency=[0]\namplitude=[1]\nphase=[1]", "test_input.frequency[0] = 0"),
    ("[test_input]\nstart=1\nduration=1\nfrequency=[1]\namplitude=[-1]\nphase=[1]", "test_input.amplitude[0] = -1"),
    ("[test_input]\nstart=1\nduration=0\nfrequency=[1]\namplitude=[1]\nphase=[1]", "test_input.duration = 0"),
    ("[test_input]\nstart=1\nduration=1\nfrequency=[]\namplitude=[]\nphase=[]", "a list of numbers")])
def test_wrong_section_names_file_and_place(tmp_path, addition, expected):
    path = file_with(tmp_path, addition)
    with pytest.raises(InputError) as caught:
        load_nominal(path)
    assert str(caught.value).startswith(str(path)) and expected in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def with_terms(tmp_path, terms: str):
    text = CONSTANT_TEXT.replace("a6 = 2.0 ", "terms = {" + terms + "} # ").replace("k1 = -7.0", "#")
    return file_with(tmp_path, "", text)


def test_plant_of_terms_flies_its_terms(tmp_path):
    nominal = load_nominal(with_terms(tmp_path, '"sin(theta)" = 2.0, beta = -7.0, "beta*theta" = 0.5'))
    assert nominal.terms == (("sin(theta)", 2.0), ("theta*beta", 0.5))
    flight = fly_whole(nominal, 0, "ideal")
    expected = -7.0 * flight.beta + 2.0 * np.sin(flight.theta) + 0.5 * flight.theta * flight.beta
    assert np.allclose(flight.theta_ddot, expected, rtol=0, atol=1e-15)


def test_plant_of_theta_and_beta_is_a6_and_k1_and_any_angle_may_be_flown(tmp_path):
    rigid = load_nominal(with_terms(tmp_path, "theta = 2.0, beta = -7.0"))
    assert bits(fly_whole(rigid, 1)) == bits(fly_whole(load_nominal(file_with(tmp_path, "")), 1))
    pendulum = load_nominal(with_terms(tmp_path, '"sin(theta)" = -9.0, beta = 60.0'))
    pendulum = dataclasses.replace(pendulum, test_input=Multisine(0.0, 9.0, (2.0,), (0.06,), (0.0,)))
    pendulum = dataclasses.replace(pendulum, controller=dataclasses.replace(pendulum.controller, kp=0.0, kd=0.0))
    flight = fly_whole(pendulum, 0)
    assert not flight.lost and np.max(np.abs(flight.theta)) > 1.0


@pytest.mark.parametrize(("terms", "expected"), [
    ("", "library terms"), ("zeta = 1.0", "'zeta'"), ('"tau*theta" = 1.0', "'tau*theta'"), ('theta = "1"', "a number"),
    ('"theta*beta" = 1.0, "beta*theta" = 2.0', "twice")])
def test_wrong_terms_are_named(tmp_path, terms, expected):
    with pytest.raises(InputError, match=r"vehicle.terms") as caught:
        load_nominal(with_terms(tmp_path, terms))
    assert expected in str(caught.value) and len(str(caught.value).splitlines()) == 1


def assert_same(a: Nominal, b: Nominal) -> None:
    for f in dataclasses.fields(Nominal):
        one, other = getattr(a, f.name), getattr(b, f.name)
        if isinstance(one, Profile):
            assert all(getattr(one, key).tobytes() == getattr(other, key).tobytes() for key in ("t", "a6", "k1"))
        elif f.name != "path":
            assert one == other, f.name


@pytest.mark.parametrize("name", BUILT_IN)
def test_written_nominal_reads_back_equal(name, tmp_path):
    nominal = dataclasses.replace(load_nominal(name), name='odd "name" \\ \x7f é', test_input=PROBE,
                                  effects=(*map(from_text, sorted(STRONG)), neutral("actuator_rate_limit")))
    write_nominal(nominal, tmp_path / "new.toml")
    assert_same(load_nominal(tmp_path / "new.toml"), nominal)
    assert {p.name for p in tmp_path.iterdir()} == {"new.toml"}  # a profile from a file is named, not copied
    assert bits(fly_whole(load_nominal(tmp_path / "new.toml"), 1)) == bits(fly_whole(nominal, 1))


def test_changed_profile_is_written_beside(tmp_path):
    nominal = load_nominal("vega_like")
    vehicle = dataclasses.replace(nominal.vehicle, a6=nominal.vehicle.a6 * 1.1)
    sigma = Profile(np.array([0.0, 10.0]), np.array([0.1, 1 / 3]), np.array([0.2, 0.3]))
    nominal = dataclasses.replace(nominal, vehicle=vehicle, uncertainty=sigma)
    write_nominal(nominal, tmp_path / "new.toml")
    assert {p.name for p in tmp_path.iterdir()} == {"new.toml", "new.vehicle.csv", "new.uncertainty.csv"}
    assert_same(load_nominal(tmp_path / "new.toml"), nominal)


def test_written_terms_and_absent_sections_read_back_equal(tmp_path):
    nominal = load_nominal(with_terms(tmp_path, '"sin(theta)" = -20.8, beta = 7.0'))
    nominal = dataclasses.replace(nominal, controller=None, guidance=None, uncertainty=None, simulation=None)
    write_nominal(nominal, tmp_path / "new.toml")
    assert_same(load_nominal(tmp_path / "new.toml"), nominal)
    assert tomllib.loads((tmp_path / "new.toml").read_text())["vehicle"]["terms"]["sin(theta)"] == -20.8
    both = dataclasses.replace(nominal, vehicle=load_nominal("vega_like").vehicle)
    with pytest.raises(UsageError, match="one or the other"):
        write_nominal(both, tmp_path / "both.toml")

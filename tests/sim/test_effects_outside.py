"""Effects of the world outside, and servos, by their laws.

Chance is as [wind] has it, drift as [drift]; nozzle inertia, and servos of any speed and either order, are compared
with matrix exponentials; a slope turns about its middle. A servo of 60 rad/s may be written with a second pole at 5,000
rad/s, and one that is none as one of 60,000 rad/s: it is the same vehicle. (Neutral to the bit and from text:
`test_effects`.)
"""

import dataclasses
import functools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from shortened import short
from test_diagnosis import log_of
from unjitted import unjitted

from launchid.bound.flights import flight_bound
from launchid.diagnosis.verdict import diagnose
from sim.disturbance_draws import drawn_wind
from sim.effects import effect, from_text, pack
from sim.flight import Flight, fly_whole
from sim.nominal import Drift, Multisine, Nominal, Wind
from sim.plant import parameters
from sim.vehicle.actuator import FIRST_ORDER_DAMPING, FREE_MOTION, POLE_STEP, fastest_pole, servo_motion
from sim.vehicle.record import FLIGHT

COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot", "theta_ddot", "true_gamma", "wind")
PROBE = Multisine(0.1, 9.0, (5.0, 13.0), (0.004, 0.003), (0.3, 1.0))
SERVO, DAMPING, PERIOD = 50.0, 0.7, 0.01   # rad/s, 1, s: of the constant nominal
LAG = {"natural_frequency": math.nan, "damping_ratio": math.nan, "time_constant": 0.04}
MODEL_A6, MODEL_K1 = 2.0, -7.0


def probed(duration: float = 3.0, **actuator) -> Nominal:
    """Open loop, no noise, the nozzle led by the test input alone."""
    of = short(duration, controller={"kp": 0.0, "kd": 0.0}, actuator={"command_noise_std": 0.0, **actuator})
    return dataclasses.replace(of, test_input=PROBE)


def bits(flight: Flight) -> bytes:
    return b"".join(getattr(flight, name).tobytes() for name in COLUMNS)


# ---- chance


@pytest.mark.parametrize(("text", "wind"), [
    ("turbulence:level=0.01", Wind(turbulence=0.01, initial=0.0)),
    ("turbulence:level=0.01,time_constant=0.3", Wind(turbulence=0.01, turbulence_time=0.3, initial=0.0)),
    ("wind_walk:level=0.02", Wind(walk=0.02, initial=0.0))])
@pytest.mark.parametrize("seed", [0, 5])
def test_a_level_as_an_effect_is_the_flight_of_that_level_in_the_nominal(text, wind, seed):
    assert bits(fly_whole(short(), seed, effects=[from_text(text)])) == bits(fly_whole(short(wind=wind), seed))


def test_chance_draws_from_streams_of_its_own():
    """The other noises stay, two of a kind differ from each other, and the nominal's wind is as it was."""
    rough = [from_text("turbulence:level=0.01"), from_text("wind_walk:level=0.02")]
    calm = fly_whole(short(1.0, controller={"kp": 0.0, "kd": 0.0}), 4)
    blown = fly_whole(short(1.0, controller={"kp": 0.0, "kd": 0.0}), 4, effects=rough)
    assert np.array_equal(calm.beta, blown.beta) and not np.array_equal(calm.theta, blown.theta)
    own, added, both = (fly_whole(short(wind=wind), 4, effects=effects).wind for wind, effects in (
        (Wind(turbulence=0.01, walk=0.02), []), (None, rough), (Wind(turbulence=0.01, walk=0.02), rough)))
    second = both - own
    assert np.std(second) > 0.003 and np.max(np.abs(second - added)) > 0.003
    fast = from_text("turbulence:level=0.01,time_constant=0.05")
    one, both = (drawn_wind(None, 4, 20_000, 0.01, pack([fast] * count, 0.001)) for count in (1, 2))
    assert abs(np.corrcoef(one, both - one)[0, 1]) < 5 / math.sqrt(2000)


# ---- drift


def constant_drift(z_alpha: float, z_beta: float) -> Drift:
    return Drift(np.zeros(1), np.array([z_alpha]), np.array([z_beta]))


def test_lateral_drift_is_the_nominal_s_drift_without_its_column():
    drift = effect("lateral_drift", z_alpha=0.05, z_beta=-0.03)
    rough = [from_text("gust:angle=0.02,time=1,duration=2"), from_text("thrust_misalignment:angle=0.01")]
    hidden = fly_whole(short(), 3, effects=[drift, *rough])
    known = fly_whole(short(drift=constant_drift(0.05, -0.03)), 3, effects=rough)
    assert bits(hidden) == bits(known) and np.max(np.abs(hidden.true_gamma)) > 1e-4
    assert np.isnan(hidden.gamma).all() and np.isfinite(known.gamma).all()   # what nobody knows is not logged


def test_lateral_drift_is_its_equations_of_motion():
    flight = fly_whole(probed(), 0, "ideal", effects=[effect("lateral_drift", z_alpha=0.4, z_beta=-0.3)])
    beta = CubicSpline(flight.t, flight.beta)

    def slopes(t, x):
        theta, theta_dot, gamma = x
        alpha = theta - gamma
        return theta_dot, MODEL_A6 * alpha + MODEL_K1 * beta(t), 0.4 * alpha - 0.3 * beta(t)

    theta, _, gamma = solve_ivp(slopes, (0, 3), np.zeros(3), t_eval=flight.t, rtol=1e-9, atol=1e-12).y
    assert np.allclose(flight.theta, theta, atol=1e-7) and np.allclose(flight.true_gamma, gamma, atol=1e-7)
    assert np.max(np.abs(gamma)) > 1e-3


# ---- nozzle inertia: exact over each period of the held command


def exact(move, commands, first: int) -> np.ndarray:
    """(n, m) states at each period's start of x' = a x whose state `first` is the command, from rest."""
    state, rows = np.zeros(len(move)), []
    for command in commands:
        state[first] = command
        rows.append(state.copy())
        state = move @ state
    return np.array(rows)


def test_nozzle_inertia_is_the_second_order_servo_s_acceleration():
    c = -0.02
    flight = fly_whole(probed(), 0, "ideal", effects=[effect("nozzle_inertia", coefficient=c)])
    a = np.zeros((5, 5))  # theta, theta_dot, beta, beta_dot, command
    a[0, 1] = a[2, 3] = 1.0
    a[3] = 0.0, 0.0, -SERVO**2, -2 * DAMPING * SERVO, SERVO**2
    a[1] = c * a[3] + np.array([MODEL_A6, 0.0, MODEL_K1, 0.0, 0.0])
    x = exact(expm(a * PERIOD), flight.beta_cmd[::10], 4)
    assert np.allclose(flight.beta[::10], x[:, 2], atol=1e-8) and np.allclose(flight.theta[::10], x[:, 0], atol=1e-7)
    assert np.allclose(flight.theta_dot[::10], x[:, 1], atol=1e-6)
    assert np.allclose(flight.theta_ddot[::10], x @ a[1], atol=1e-5)
    assert np.max(np.abs(c * x @ a[3])) > 0.05


def test_nozzle_inertia_of_a_first_order_servo_turns_the_vehicle_at_once_where_the_command_jumps():
    """Momentum theta_dot - c beta_dot goes on without a jump: its equation has no second derivative of beta."""
    c, tau = -0.02, LAG["time_constant"]
    flight = fly_whole(probed(**LAG), 0, "ideal", effects=[effect("nozzle_inertia", coefficient=c)])
    a = np.zeros((4, 4))  # theta, momentum, beta, command
    a[2, 2], a[2, 3] = -1.0 / tau, 1.0 / tau
    a[0, 1], a[0] = 1.0, np.array([0.0, 1.0, 0.0, 0.0]) + c * a[2]
    a[1] = MODEL_A6, 0.0, MODEL_K1, 0.0
    x = exact(expm(a * PERIOD), flight.beta_cmd[::10], 3)
    assert np.allclose(flight.beta[::10], x[:, 2], atol=1e-9) and np.allclose(flight.theta[::10], x[:, 0], atol=1e-8)
    before = np.concatenate([[0.0], flight.beta_cmd[:-10:10]])  # the rate is read before the new command moves anything
    assert np.allclose(flight.theta_dot[::10], x[:, 1] + c * (before - x[:, 2]) / tau, atol=1e-7)
    assert np.max(np.abs(np.diff(flight.theta_dot))) > 10 * np.median(np.abs(np.diff(flight.theta_dot)))


def test_a_jump_of_the_rate_is_felt_by_the_slosh():
    """psi'' = -theta_ddot - ...: psi_dot + theta_dot has no jump, so momentum in the place of theta_dot."""
    c, tau, pull, w, z = -0.02, LAG["time_constant"], 0.5, 6.0, 0.05
    effects = [effect("nozzle_inertia", coefficient=c), effect("slosh", coupling=pull, frequency=w, damping_ratio=z)]
    flight = fly_whole(probed(**LAG), 0, "ideal", effects=effects)
    a = np.zeros((6, 6))  # theta, p = theta_dot - c beta_dot, beta, psi, s = psi_dot + theta_dot, command
    beta_dot = np.array([0.0, 0.0, -1.0 / tau, 0.0, 0.0, 1.0 / tau])
    theta_dot = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]) + c * beta_dot
    psi_dot = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]) - theta_dot
    a[0], a[2], a[3] = theta_dot, beta_dot, psi_dot
    a[1] = MODEL_A6, 0.0, MODEL_K1, pull * w**2, 0.0, 0.0
    a[4] = -2.0 * z * w * psi_dot
    a[4, 3] -= w**2
    x = exact(expm(a * PERIOD), flight.beta_cmd[::10], 5)
    assert np.allclose(flight.theta[::10], x[:, 0], atol=1e-7) and np.max(np.abs(pull * w**2 * x[:, 3])) > 0.01


def test_nozzle_inertia_is_of_the_actual_nozzle_behind_its_rate_limit():
    """Nothing accelerates where the rate stands at its limit; theta_ddot is logged as it is flown."""
    limit = from_text("actuator_rate_limit:rate=0.03")
    flight = fly_whole(probed(), 0, "ideal", effects=[limit, effect("nozzle_inertia", coefficient=-0.02)])
    rest = flight.theta_ddot - MODEL_A6 * flight.theta - MODEL_K1 * flight.beta
    held = np.abs(np.abs(np.diff(flight.beta)) / 0.001 - 0.03) < 1e-9
    inside = held[1:] & held[:-1]
    assert np.mean(inside) > 0.2 and np.max(np.abs(rest[1:-1][inside])) < 1e-12
    assert np.max(np.abs(rest)) > 0.01
    rate = np.cumsum(flight.theta_ddot) * 0.001
    assert np.allclose(flight.theta_dot[1:], rate[:-1], atol=2e-3 * np.max(np.abs(flight.theta_dot)))


# ---- slope and step


def test_control_slope_turns_about_the_flight_s_centre_or_about_its_middle():
    flight = fly_whole(short(), 0, "ideal", effects=[effect("control_slope", slope=0.05)])
    assert np.allclose(flight.k1, MODEL_K1 * (1 + 0.05 * (flight.t - 2.0)), rtol=1e-14)
    of = dataclasses.replace(short(), effects=(effect("control_slope", slope=0.05, middle=1.0),))
    assert np.allclose(parameters(of, flight.t)[1], MODEL_K1 * (1 + 0.05 * (flight.t - 1.0)), rtol=1e-14)
    centred = fly_whole(short(), 0, "ideal", effects=[effect("control_slope", slope=0.05, middle=2.0)])
    assert bits(centred) == bits(flight)


def test_moment_step_is_the_parabola_of_a_free_vehicle():
    free = dataclasses.replace(probed(2.0), test_input=None)
    free = dataclasses.replace(free, vehicle=dataclasses.replace(free.vehicle, a6=np.zeros(1)))
    flight = fly_whole(free, 0, "ideal", effects=[effect("moment_step", acceleration=0.02, time=0.5)])
    since = np.maximum(flight.t - 0.5, 0.0)
    step = 0.02 * 0.001   # a Runge-Kutta step that ends with the onset feels a sixth of it
    assert np.allclose(flight.theta_dot, 0.02 * since, atol=step) and not flight.theta_dot[flight.t < 0.499].any()
    assert np.allclose(flight.theta, 0.01 * since**2, atol=step * 1.5)


NONE = math.inf  # rad/s, of a rate limit
POLES = st.floats(math.log(5.0), math.log(1.0e4)).map(math.exp)  # rad/s
DAMPINGS = st.floats(0.2, 0.99)
EXAMPLES = 1     # diagnoses of a second, beside the one that is named


def first_order(pole):
    return {"natural_frequency": math.nan, "damping_ratio": math.nan, "time_constant": 1.0 / pole}


def second_order(pole, other):
    """Real poles [rad/s]."""
    frequency = math.sqrt(pole * other)
    return {"natural_frequency": frequency, "damping_ratio": 0.5 * (pole + other) / frequency}


STIFF = second_order(60.0, 5000.0)   # natural_frequency 547.7, damping_ratio 4.619


def moved(frequency, damping, is_lag, h, start, rate=NONE):
    """(beta, beta_dot, integral, double integral) after `servo_motion` from start: command, beta [rad], beta_dot."""
    command, beta, beta_dot = start
    own = np.zeros(1, FLIGHT)[0]
    for name, value in (("frequency", frequency), ("damping", damping), ("pole", fastest_pole(frequency, damping)),
                        ("first_order", is_lag), ("rate_limit", rate), ("rate_reach", rate), ("beta", beta),
                        ("beta_dot", beta_dot)):
        setattr(own, name, value)
    integrals = unjitted(servo_motion)(own, np.full(1, math.nan, FREE_MOTION)[0], h, command)
    return own.beta, own.beta_dot, *integrals


@given(w=POLES, zeta=st.one_of(DAMPINGS, st.just(1.0), st.floats(1.0, 30.0)), is_lag=st.booleans(),
       h=st.floats(1e-4, 1e-2), start=st.tuples(*[st.floats(-0.1, 0.1)] * 2, st.floats(-1.0, 1.0)))
def test_under_a_held_command_it_moves_as_the_matrix_exponential_has_it(w, zeta, is_lag, h, start):
    """States: double integral, integral, beta, beta_dot/w, command."""
    command, beta, rate = start
    a = np.zeros((5, 5))
    a[0, 1] = a[1, 2] = 1.0
    if is_lag:
        zeta, rate = FIRST_ORDER_DAMPING, 0.0
        a[2, 2], a[2, 4] = -w, w
    else:
        a[2, 3] = w
        a[3] = 0.0, 0.0, -w, -2.0 * zeta * w, w
    x = expm(a * h) @ np.array([0.0, 0.0, beta, rate / w, command])
    end, end_rate, once, twice = moved(w, zeta, is_lag, h, (command, beta, rate))
    size = 0.1 + abs(rate) / w
    assert abs(end - x[2]) < 1e-11 * size and abs(once - x[1]) < 1e-10 * size * h
    if fastest_pole(w, zeta) * h > POLE_STEP:  # else it is not asked, and the double integral loses digits
        assert abs(twice - x[0]) < 1e-8 * size * h**2
    if not is_lag:
        assert abs(end_rate / w - x[3]) < 1e-10 * size


@pytest.mark.parametrize(("w", "zeta", "rate"), [(400.0, 0.7, 2.0), (547.7, 4.619, 20.0), (3000.0, 1.0, 0.05)])
def test_a_rate_limit_is_that_of_small_steps(w, zeta, rate):
    """The nozzle moves over ten steps of 2.5 ms, from rest to 0.05 rad: apart by what it moves in a part of a step,
    where it begins and where it ends."""
    def slopes(beta, beta_dot):
        beta_ddot = w * w * (0.05 - beta) - 2.0 * zeta * w * beta_dot
        held = abs(beta_dot) >= rate and beta_dot * beta_ddot > 0.0
        return np.array([min(max(beta_dot, -rate), rate), 0.0 if held else beta_ddot])

    h, parts = 0.0025, 2000
    ours, state = (0.0, 0.0), np.zeros(2)
    for _ in range(10):
        ours = moved(w, zeta, False, h, (0.05, *ours), rate)[:2]
        for _ in range(parts):
            middle = state + 0.5 * h / parts * slopes(*state)
            state = state + h / parts * slopes(*middle)
            state[1] = np.clip(state[1], -rate, rate)
        assert abs(ours[0] - state[0]) < 0.1 * rate * h + 1e-4 * 0.05


@pytest.mark.parametrize("servo", [STIFF, first_order(60_000.0), {"natural_frequency": 60_000.0, "damping_ratio": 0.7}],
                         ids=["60 and 5000", "60000, first order", "60000"])
def test_the_vehicle_turns_as_the_nozzle_and_its_inertia_have_it(servo):
    """The motion over a step of 1 ms is exact: at the start of each period of the held command, against the matrix
    exponential."""
    c, flying = -0.02, probed(**servo)
    flight = fly_whole(flying, 0, "ideal", effects=[effect("nozzle_inertia", coefficient=c)])
    w = flying.actuator.frequency
    a = np.zeros((5, 5))   # theta, p = theta_dot - c beta_dot, beta, beta_dot/w (0 of first order), command
    beta_dot = np.array([0.0, 0.0, 0.0, w, 0.0])
    if flying.actuator.is_first_order:
        beta_dot = np.array([0.0, 0.0, -w, 0.0, w])
    else:
        a[3] = 0.0, 0.0, -w, -2.0 * flying.actuator.damping_ratio * w, w
    a[0], a[1], a[2] = np.array([0.0, 1.0, 0.0, 0.0, 0.0]) + c * beta_dot, (MODEL_A6, 0.0, MODEL_K1, 0.0, 0.0), beta_dot
    x = exact(expm(a * PERIOD), flight.beta_cmd[::10], 4)
    assert np.allclose(flight.beta[::10], x[:, 2], atol=1e-9)
    assert np.allclose(flight.theta[::10], x[:, 0], atol=2e-8) and np.ptp(flight.theta) > 1e-3


@functools.cache
def flown(text, **servo):
    return fly_whole(short(20.0, actuator=servo), 1, effects=[from_text(text)] if text else [])


@pytest.mark.parametrize("text", ["", "actuator_rate_limit:rate=0.1", "actuator_rate_limit:rate=0.1,wind_up=0.5",
                                  "slosh:coupling=0.1,frequency=4", "actuator_bandwidth:scale=10"])
@pytest.mark.parametrize("servo", [second_order(60_000.0, 60_000.0), first_order(60_000.0),
                                   {"natural_frequency": 60_000.0, "damping_ratio": 0.01}],
                         ids=["overdamped", "first order", "underdamped"])
def test_no_servo_is_too_fast_to_fly(servo, text):
    """No vehicle is lost to the integrator: it flies as with one of 1,000 rad/s, to what that one's lag makes."""
    fast, plain = flown(text, **servo), flown(text, natural_frequency=1000.0)
    assert not fast.lost and len(fast.t) == len(plain.t)
    assert np.std(fast.theta - plain.theta) < 0.02 * np.std(plain.theta)


ANY = st.floats(math.log(20.0), math.log(6.0e4)).map(math.exp)  # rad/s: from 300 on it ends within a row of 100 Hz


@pytest.mark.filterwarnings("error")
@given(servo=st.one_of(ANY.map(first_order), st.builds(
    lambda w, zeta: {"natural_frequency": w, "damping_ratio": zeta}, ANY, st.floats(0.5, 0.99))),
    seed=st.integers(0, 1000))
@settings(max_examples=EXAMPLES)
@example(servo=first_order(1000.0), seed=1)
def test_a_clean_flight_is_consistent_whatever_its_servo(servo, seed):
    nominal = short(15.0, actuator=servo)
    made = diagnose(log_of(fly_whole(nominal, seed)), nominal)
    assert made.verdict == "consistent", made.named


def test_a_servo_in_two_forms_is_one_servo_to_the_bound():
    first, second, none = (flight_bound(short(10.0, actuator=servo), 5.0, 1).a6 for servo in
                           (first_order(60.0), STIFF, first_order(60_000.0)))
    assert first == pytest.approx(second, rel=2e-3) and np.all(np.isfinite(none))


def test_a_diagnosis_is_the_same_in_both_forms():
    found = []
    for servo in (first_order(60.0), STIFF):
        nominal = short(15.0, actuator=servo)
        flown = fly_whole(short(15.0, actuator=first_order(60.0)), 2,
                          effects=[from_text("actuator_bandwidth:scale=0.4")])
        found.append(diagnose(log_of(flown), nominal))
    assert [made.named[0].cause for made in found] == ["actuator_bandwidth"] * 2
    sizes = [next(iter(made.named[0].parameters.values()))[0] for made in found]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.02)

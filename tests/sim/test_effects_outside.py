"""The effects of the second stage by their laws: chance as the nominal's [wind] has it, drift as [drift], nozzle
inertia against matrix exponentials, a slope about its middle.  (Neutral to the bit and from text: `test_effects`.)"""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from shortened import short

from sim.disturbance_draws import drawn_wind
from sim.effects import effect, from_text, pack
from sim.flight import Flight, fly_whole, parameters
from sim.nominal import Drift, Multisine, Nominal, Wind

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


def test_an_effect_of_no_level_leaves_the_wind_calm():
    level = [from_text("turbulence:level=0"), from_text("wind_walk:level=0")]
    flight = fly_whole(short(wind=Wind(turbulence=0.01)), 2, effects=level)
    assert bits(flight) == bits(fly_whole(short(wind=Wind(turbulence=0.01)), 2))
    assert not fly_whole(short(), 2, effects=level).wind.any()


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


def test_lateral_drift_adds_to_the_nominal_s():
    third = effect("lateral_drift", z_alpha=0.025, z_beta=0.0125)
    parts = fly_whole(short(drift=constant_drift(0.05, 0.025)), 3, effects=[third, third])
    whole = fly_whole(short(drift=constant_drift(0.1, 0.05)), 3)
    assert bits(parts) == bits(whole) and np.isfinite(parts.gamma).all()
    none = effect("lateral_drift", z_alpha=0, z_beta=0)
    assert bits(fly_whole(short(drift=constant_drift(0.1, 0.05)), 3, effects=[none])) == bits(whole)


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

"""Servos of any speed and of either order: the exact step against the matrix exponential, flights, diagnosis, bound.

A servo of 60 rad/s may be written as one of second order with a second pole at 5,000 rad/s, and one that is none as one
of 60,000 rad/s: it is the same vehicle, whatever the step."""

import functools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from shortened import short
from test_diagnosis import log_of
from test_effects_outside import MODEL_A6, MODEL_K1, PERIOD, exact, probed
from unjitted import unjitted

from launchid.bound.flights import flight_bound
from launchid.diagnosis.verdict import diagnose
from sim.effects import effect, from_text
from sim.flight import fly_whole
from sim.vehicle.actuator import (
    FIRST_ORDER_DAMPING,
    FREE_MOTION,
    POLE_STEP,
    fastest_pole,
    servo_motion,
)
from sim.vehicle.record import FLIGHT

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

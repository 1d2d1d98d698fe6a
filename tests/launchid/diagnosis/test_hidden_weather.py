"""Wind of the hidden generator by its laws, its forms against each other, and calm flights left alone."""

import dataclasses
import math

import numpy as np
import pytest
from hidden import OTHER, QUIET, Spec, Weather, draw_spec, fly, hide
from hidden.build import Build
from hidden.weather import GRID, dryden, first_order

import launchid
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import Forecast, Wind, constant_profile, load_nominal

DRAWS = 1500
COLUMNS = ("theta_ref", "beta_cmd", "beta", "theta", "theta_dot")


def drawn(make, columns, steps):
    """(DRAWS, steps) of a process of unit level."""
    rng = np.random.default_rng(7)
    shape = (steps, columns) if columns else (steps,)
    return np.array([make(rng.standard_normal(shape)) for _ in range(DRAWS)])


@pytest.mark.parametrize(("make", "columns", "correlation"), [
    (lambda white: first_order(white, 0.4), 1, lambda s: math.exp(-s / 0.4)),
    (lambda white: dryden(white, 0.4), 2, lambda s: math.exp(-s / 0.8) * (1 - s / 1.6))])  # MIL-F-8785C, lateral
def test_turbulence_has_its_level_and_its_correlation_from_the_first_instant(make, columns, correlation):
    gusts = drawn(make, columns, 400)
    for k in (0, 80, 399):
        assert np.std(gusts[:, k]) == pytest.approx(1.0, rel=5 / math.sqrt(2 * DRAWS))
    for k in (20, 80, 320):
        assert np.mean(gusts[:, 0] * gusts[:, k]) == pytest.approx(correlation(k * GRID), abs=5 / math.sqrt(DRAWS))


# ---- the weather of a flight


def test_weather_leaves_every_draw_alone_and_a_calm_flight_its_bytes():
    calm, windy = (Build(Spec(seed=5, duration=5.0, wind=of)) for of in (Weather(), Weather(0.005, 0.002)))
    assert not calm.wind.any() and np.std(windy.wind) > 1e-3
    mine, theirs = calm.parts()[2], windy.parts()[2]
    for name in ("rattle", "command_noise", "attitude_add", "gyro_add", "pickup_add", "a6", "k1"):
        assert np.array_equal(getattr(mine, name), getattr(theirs, name))
    same = [fly(draw_spec(5, "gust", duration=5.0, **given))[0] for given in ({}, {"wind": Weather()})]
    assert all(np.array_equal(same[0][name], same[1][name]) for name in COLUMNS)
    assert draw_spec(5, "gust") == dataclasses.replace(draw_spec(5, "gust", wind=Weather(0.005)), wind=Weather())


def test_wind_turns_vehicle_and_flight_path_as_in_the_project():
    """The same forecast in both: a hidden drift in the weather's wind, flown as [wind] profile."""
    spec = Spec(noise=QUIET, duration=30.0, wind=Weather(0.01, 0.002, initial=0.01, variant=OTHER), seed=3,
                effects=(hide("lateral_drift", {"z_alpha": 0.1, "z_beta": 0.05}),))
    flown, _ = fly(spec)
    build = Build(spec)
    theirs = still(build.t, build.wind, 30.0)
    other = fly_whole(theirs, effects=[effect("lateral_drift", z_alpha=0.1, z_beta=0.05)], period=0.01)
    for name in COLUMNS[1:]:
        scale = float(np.sqrt(np.mean(flown[name]**2)))
        assert np.sqrt(np.mean((flown[name] - getattr(other, name))**2)) < 1e-4 * scale, name


def still(t=None, wind=None, duration=30.0, **actuator):
    """The constant nominal without noise, with a forecast."""
    of = load_nominal("constant")
    forecast = None if t is None else Wind(profile=Forecast(t, wind))
    return dataclasses.replace(
        of, actuator=dataclasses.replace(of.actuator, command_noise_std=0.0, **actuator), wind=forecast,
        sensors=dataclasses.replace(of.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0),
        simulation=dataclasses.replace(of.simulation, acceleration_noise_std=0.0, duration=duration))


@pytest.mark.parametrize("causes", [{}, {"nozzle_inertia": {"coefficient": -4e-3}},
                                    {"nozzle_inertia": {"coefficient": -4e-3},
                                     "slosh": {"coupling": 0.2, "frequency": 4.0, "damping_ratio": 0.02}}])
def test_a_first_order_servo_and_its_inertia_are_the_project_s(causes):
    spec = Spec(noise=QUIET, duration=20.0, first_order=True, effects=tuple(hide(*each) for each in causes.items()))
    flown, _ = fly(spec)
    lag = {"natural_frequency": math.nan, "damping_ratio": math.nan, "time_constant": 2.0 * 0.7 / 50.0}
    theirs = fly_whole(still(duration=20.0, **lag), effects=[effect(name, **of) for name, of in causes.items()],
                       period=0.01)
    for name in COLUMNS[1:]:
        scale = float(np.sqrt(np.mean(flown[name]**2)))
        assert np.sqrt(np.mean((flown[name] - getattr(theirs, name))**2)) < 1e-7 * scale, name


def test_a_calm_flight_with_little_noise_has_no_weather():
    """Its disturbance is far below what is taken to wander always: less of that is no wind (a walk of 0.7 mrad was)."""
    of = load_nominal("constant")
    of = dataclasses.replace(
        of, vehicle=constant_profile(0.9, -11.6),
        guidance=dataclasses.replace(of.guidance, t=(0.0, 5.0, 8.0, 20.0, 24.0, 40.0, 44.0, 60.0, 63.0, 90.0),
                                     theta_ref=(
                                         0.0, 0.0, -0.029, -0.044, 0.009, 0.053, 0.076, 0.097, 0.072, 0.051)),
        sensors=dataclasses.replace(of.sensors, period=0.02, theta_std=1.4e-4, theta_dot_std=1.3e-4, beta_std=2.1e-4),
        controller=dataclasses.replace(of.controller, period=0.02, kp=0.85, kd=0.41),
        simulation=dataclasses.replace(of.simulation, duration=90.0))
    made = launchid.diagnose(launchid.simulate(of, seed=0), of)
    assert made.verdict == "consistent" and not made.report["causes"]

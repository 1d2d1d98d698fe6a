"""A log identified with the nominal of another vehicle has no valid window; the right nominal is never refused."""

import dataclasses

import numpy as np
import pytest
from every import every

from launchid import identify, uncertainty
from launchid.log.log import flown_log
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import Nominal, Profile, built_in, constant_profile, load_nominal

pytestmark = pytest.mark.filterwarnings("ignore")


def nominal(name: str = "vega_like", duration: float = 25.0) -> Nominal:
    believed = load_nominal(built_in(name))
    return dataclasses.replace(believed, simulation=dataclasses.replace(believed.simulation, duration=duration))


def rocket() -> Nominal:
    """A model rocket of 1 kg: noisy, so that a launcher's log passes its windows."""
    own = nominal()
    return dataclasses.replace(
        own, name="rocket", path="rocket.toml", vehicle=constant_profile(5.0, -112.0),
        uncertainty=constant_profile(0.3, 0.3),
        sensors=dataclasses.replace(own.sensors, period=0.02, theta_std=1e-3, theta_dot_std=2e-3, beta_std=1e-3),
        actuator=dataclasses.replace(own.actuator, natural_frequency=66.7, damping_ratio=1.0, delay=0.025),
        controller=dataclasses.replace(own.controller, kp=0.35, kd=0.11, derivative_time_constant=0.02, period=0.02),
        simulation=dataclasses.replace(own.simulation, acceleration_noise_std=0.05))


def flown(seed: int, *effects: str, name: str = "vega_like"):
    return flown_log(fly_whole(nominal(name), seed, effects=[from_text(text) for text in effects]))


def test_another_vehicle_has_no_valid_window_and_the_line_says_which_number():
    log = flown(3)
    made = identify(log, rocket(), window=5.0, tracked=True)
    assert not any(e.valid or e.tracked.valid for e in made.estimates)
    (line,) = made.report["warnings"]
    assert "k1 is 0.0" in line and "every 0.01 s" in line and line in made.warnings
    level = uncertainty(log, rocket(), window=5.0)
    assert not any(window["valid"] for window in level.report["windows"]) and line in level.warnings
    right = identify(log, nominal(), window=5.0)
    assert all(e.valid for e in right.estimates) and "warnings" not in right.report


@every("text", ["control_effectiveness:scale=0.7", "aero_instability:scale=1.5",
                                  "control_loss:fraction=0.5,time=12", "actuator_bandwidth:scale=0.5",
                                  "actuator_delay:delay=0.03", "controller_mismatch:kp_scale=0.7",
                                  "steady_wind:angle=0.03", "bending:gain=0.1,frequency=15"])
def test_a_fault_of_this_vehicle_is_not_another_vehicle(text):
    made = identify(flown(4, text), nominal(), window=5.0)
    assert not any("another vehicle" in line for line in made.warnings)


def test_a_log_without_commands_and_a_nominal_without_range():
    log = flown(5)
    alone = dataclasses.replace(log, columns=tuple(x for x in log.columns if x != "beta_cmd"),
                                beta_cmd=np.full(len(log.t), np.nan))
    bare = dataclasses.replace(rocket(), uncertainty=None)
    assert any("another vehicle" in line for line in identify(alone, bare, window=5.0).warnings)
    own = dataclasses.replace(nominal(), uncertainty=None)
    assert all(e.valid for e in identify(alone, own, window=5.0).estimates)


def test_units_of_the_nominal_in_degrees():
    wrong = nominal()
    profile = wrong.vehicle
    scaled = dataclasses.replace(wrong, vehicle=Profile(profile.t, profile.a6, profile.k1 * np.pi / 180.0))
    made = identify(flown(6), scaled, window=5.0)
    assert not any(e.valid for e in made.estimates)


def test_the_advice_of_a_slow_servo_is_the_servo_and_not_the_wind():
    made = identify(flown(7, "actuator_bandwidth:scale=0.5"), nominal(), window=5.0)
    assert "MODEL" in {e.status.name for e in made.estimates}
    assert "natural_frequency_sigma" in made.report["next"] and "[wind]" not in made.report["next"]
    own = dataclasses.replace(nominal(), actuator=dataclasses.replace(
        nominal().actuator, natural_frequency_sigma=0.3, delay_sigma=0.02))
    declared = identify(flown(7, "actuator_bandwidth:scale=0.5"), own, window=5.0)
    assert sum(e.valid for e in declared.estimates) >= 3


def test_the_advice_in_undeclared_wind_is_the_wind():
    made = identify(flown(8, "gust:angle=0.15,time=15,duration=4"), nominal(), window=5.0)
    assert "[wind]" in made.report["next"]

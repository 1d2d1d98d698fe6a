"""What a nominal's effects say of a flight is used on board: a6 and k1 come out as they do without them."""

import dataclasses

import numpy as np
import pytest
from every import every
from hidden import draw_spec, fly

from launchid_core import Config, Estimator, Model
from sim.effects import CATALOGUE, effect, from_text
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import REFUSED, onboard_model

CONSTANT = load_nominal("constant")
A6, K1 = 0.9, 1.1  # of the nominal's

# sizes that refuse or mislead where the nominal does not have them
FLOWN = ("aero_cubic:coefficient=15", "missing_term:term=theta^2,coefficient=8", "nozzle_inertia:coefficient=-0.03",
         "actuator_rate_limit:rate=0.05",
         "moment_step:acceleration=0.05,time=13.3",
         "periodic_disturbance:amplitude=0.04,frequency=3,phase=0.4", "control_slope:slope=0.01,middle=10",
         "lateral_drift:z_alpha=0.05,z_beta=-0.1", "turbulence:level=0.01,time_constant=1.5", "wind_walk:level=0.005",
         "actuator_backlash:half_width=0.002", "input_washout:time_constant=20", "actuator_bandwidth:scale=0.6,lag=1",
         "controller_mismatch:kp_scale=1.2,delay=0.02")


def with_effects(*texts: str) -> Nominal:
    simulation = dataclasses.replace(CONSTANT.simulation, duration=25.0)
    return dataclasses.replace(CONSTANT, simulation=simulation, effects=tuple(map(from_text, texts)))


def errors(flown: Nominal, declared: Nominal, seed: int) -> np.ndarray:
    """Errors of a6 and k1 in standard deviations, by window; NaN where it was refused."""
    flight = fly_whole(flown, seed, a6_factor=A6, k1_factor=K1)
    config = Config(window=5.0, formulation="filtered", model=onboard_model(declared, flight.period))
    estimates = Estimator(config).replay(flight.rows())
    assert len(estimates) == 5
    at = [int(np.argmin(np.abs(flight.t - 0.5 * (e.t_start + e.t_end)))) for e in estimates]
    return np.array([((e.a6 - flight.a6[k]) / e.a6_std, (e.k1 - flight.k1[k]) / e.k1_std)
                     for k, e in zip(at, estimates, strict=True)])


@every("text", FLOWN)
def test_a_cause_that_the_nominal_has_misleads_no_window(text):
    nominal = with_effects(text)
    found = np.concatenate([errors(nominal, nominal, seed) for seed in (3, 4)])
    assert np.isfinite(found).all(), found
    assert np.abs(found).max() < 4.0 and np.sqrt(np.mean(found**2)) < 1.6, found


@every("text", FLOWN[:4])
def test_the_same_cause_undeclared_is_seen(text):
    """The positive control: the size is one that matters."""
    found = np.concatenate([errors(with_effects(text), with_effects(), seed) for seed in (3, 4)])
    assert np.isnan(found).any() or np.abs(found).max() > 5.0, found


@every("cause", ["slosh", "bending", "nozzle_inertia", "actuator_rate_limit", "moment_step", "periodic_disturbance"])
def test_flights_of_another_simulator_are_understood_by_the_same_words(cause):
    spec = draw_spec(41, cause, rate=100.0)
    columns, label = fly(spec)
    (told,) = label.causes
    nominal = dataclasses.replace(CONSTANT, effects=(effect(told["cause"], **told["parameters"]),))
    nothing = np.full(len(columns["t"]), np.nan)
    rows = np.column_stack([columns["t"], columns["theta"], columns["theta_dot"], columns["beta"], nothing,
                            columns["beta_cmd"], nothing])
    estimates = Estimator(Config(window=5.0, formulation="filtered", model=onboard_model(nominal, 0.01))).replay(rows)
    a6, k1 = 2.0 * (1.0 + spec.dispersion[0]), -7.0 * (1.0 + spec.dispersion[1])
    off = np.array([((e.a6 - a6) / e.a6_std, (e.k1 - k1) / e.k1_std) for e in estimates])
    assert np.isfinite(off).all() and np.abs(off).max() < 4.5 and np.sqrt(np.mean(off**2)) < 1.4, off


def test_what_is_refused_says_what_to_do():
    assert set(REFUSED) <= set(CATALOGUE)
    with pytest.raises(InputError, match="integral"):
        onboard_model(with_effects("friction:coefficient=0.02"))
    with pytest.raises(InputError, match="sign"):
        onboard_model(with_effects("missing_term:term=sign(theta_dot),coefficient=0.02"))


def test_without_effects_nothing_is_known():
    model = onboard_model(CONSTANT)
    assert model.known == (0, 0, 0, 0)
    with pytest.raises(ValueError, match="sines"):
        dataclasses.replace(model, sines=((1.0, 2.0, float("nan")),))
    with pytest.raises(ValueError, match="known_terms"):
        dataclasses.replace(model, known_terms=(("theta^2", 1.0),) * 9)
    assert isinstance(model, Model)

"""A servo that is not known, estimated on board beside a6 and k1."""

import dataclasses
import functools
import json
import math

import numpy as np
import pytest
from cut import cut_of, persisting
from unjitted import unjitted

import launchid
from launchid.bound.flights import flight_bound
from launchid_core import Config, Estimate, Estimator, Model, Sample
from launchid_core.filter import servo as sv
from launchid_core.order import entries
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model

CONSTANT = load_nominal("constant")
SIGMA = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}
PERIOD, SECONDS = 0.01, 25.0
NAN = math.nan
set_servo_step = unjitted(sv.set_servo_step)


def with_servo(nominal: Nominal = CONSTANT, **changes: float) -> Nominal:
    assert nominal.actuator is not None
    return dataclasses.replace(nominal, actuator=dataclasses.replace(nominal.actuator, **changes))


UNSURE = with_servo(**SIGMA)


def config(nominal: Nominal = UNSURE, **choices) -> Config:
    return Config(**{"window": 5.0, "sample_period": PERIOD, "formulation": "filtered",
                     "model": onboard_model(nominal)} | choices)


def drawn(seed: int) -> tuple[Nominal, float, float]:
    """A vehicle of which neither servo nor a6 nor k1 is the nominal's."""
    random = np.random.default_rng((42, seed))
    frequency, damping, a6, k1 = 1.0 + np.array([0.3, 0.3, 0.2, 0.2]) * random.uniform(-1.0, 1.0, 4)
    return with_servo(natural_frequency=50.0 * frequency, damping_ratio=0.7 * damping,
                      delay=float(random.uniform(0.0, 0.03))), float(a6), float(k1)


@functools.cache
def samples(seed: int) -> tuple[Sample, ...]:
    true, a6, k1 = drawn(seed)
    flight = fly_whole(true, seed, a6_factor=a6, k1_factor=k1)
    return tuple(sample for sample in flight.samples() if sample.t < SECONDS)


@functools.cache
def flown(seed: int) -> tuple[Estimate, ...]:
    return tuple(Estimator(config()).replay(samples(seed)))


def truth(seed: int) -> np.ndarray:
    servo = drawn(seed)[0].actuator
    assert servo is not None
    return np.array([servo.natural_frequency, servo.damping_ratio, servo.delay])


def told(e: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """An estimate's servo: values, standard deviations."""
    assert e.actuator is not None
    return np.array([each.value for each in e.actuator.values()]), np.array([each.std for each in e.actuator.values()])


# ---- the answer


SEEDS = range(10)


def test_the_servo_is_found_within_what_is_said_of_it():
    """Over servos 30 % off and delays up to 30 ms, nothing of which the nominal has."""
    errors = np.array([[(told(e)[0] - truth(seed)) / told(e)[1] for e in flown(seed)] for seed in SEEDS])
    assert np.abs(errors).max() < 4.5
    assert (np.abs(errors) < 1.96).mean() > 0.85
    last = np.sqrt((errors[:, -1]**2).mean(axis=0))
    assert (last > 0.5).all() and (last < 1.5).all()


def test_a6_and_k1_are_found_beside_it_within_what_is_said_of_them():
    """A vehicle that nobody knows the servo of: no window is refused."""
    errors = []
    for seed in SEEDS:
        _, a6, k1 = drawn(seed)
        for e in flown(seed):
            assert e.valid
            errors.append(((e.a6 - 2.0 * a6) / e.a6_std, (e.k1 + 7.0 * k1) / e.k1_std))
            assert e.tracked is not None and e.tracked.valid
            assert abs(e.tracked.a6 - 2.0 * a6) < 4.0 * e.tracked.a6_std
            assert abs(e.tracked.k1 + 7.0 * k1) < 4.0 * e.tracked.k1_std
    size = np.sqrt(np.square(errors).mean(axis=0))
    assert (size > 0.7).all() and (size < 1.3).all()


@pytest.mark.parametrize("seed", [0, 3])
def test_what_is_known_of_it_is_at_the_bound(seed):
    """Cramer-Rao, of one window as long as the flight so far."""
    true, a6, k1 = drawn(seed)
    bound = flight_bound(with_servo(true, **SIGMA), SECONDS, seed, a6_factor=a6, k1_factor=k1).servo[0]
    std = told(flown(seed)[-1])[1] / [*truth(seed)[:2], 1.0]
    assert std == pytest.approx(bound, rel=0.12)


def test_what_is_not_known_of_the_servo_alone_is_estimated():
    """The others are not doubted."""
    found = Estimator(config(with_servo(delay_sigma=0.02))).replay(list(samples(3)))[-1]
    frequency, damping, delay = found.actuator.values()
    assert (frequency.value, frequency.std, damping.value, damping.std) == (50.0, 0.0, 0.7, 0.0)
    assert 0.0 < delay.std < 0.001


def test_the_delay_of_a_first_order_servo_is_estimated():
    nominal = dataclasses.replace(CONSTANT, actuator=dataclasses.replace(
        CONSTANT.actuator, natural_frequency=NAN, damping_ratio=NAN, time_constant=0.02, delay=0.006))
    flight = [s for s in fly_whole(nominal, 1).samples() if s.t < 15.0]
    last = Estimator(config(with_servo(nominal, delay=0.0, delay_sigma=0.02))).replay(flight)[-1]
    delay = last.actuator["delay"]
    assert last.valid and abs(delay.value - 0.006) < 4.0 * delay.std < 0.004
    assert math.isnan(last.actuator["natural_frequency"].value)


# ---- laws


def test_of_a_known_servo_nothing_is_estimated_and_no_word_is_kept():
    """`tests/test_replay.py` holds its bits."""
    known = Estimator(config(CONSTANT))
    last = known.replay(list(samples(1)))[-1]
    assert last.actuator is None
    assert known._memory.size.servo == known._memory.size.responses == 0
    assert all(entry not in entries.entries_of(known.config, known._memory) for entry in entries.SERVO_ENTRIES)
    assert not any(array.any() for name, array in persisting(known).items() if "servo" in name)


def test_a_servo_that_is_all_but_known_is_as_a_known_one():
    """The first step is left out: where the delay is doubted the command before the first sample matters."""
    tiny = with_servo(natural_frequency_sigma=1e-9, damping_ratio_sigma=1e-9, delay_sigma=1e-11)
    flight = [s for s in fly_whole(CONSTANT, 4).samples() if s.t < SECONDS]
    one, two = (Estimator(config(nominal)).replay(flight) for nominal in (CONSTANT, tiny))
    for first, second in zip(one, two, strict=True):
        for known, unsure in ((first, second), (first.tracked, second.tracked)):
            assert unsure.a6 == pytest.approx(known.a6, abs=0.02 * known.a6_std)
            assert unsure.k1 == pytest.approx(known.k1, abs=0.02 * known.k1_std)
            assert (unsure.a6_std, unsure.k1_std) == pytest.approx((known.a6_std, known.k1_std), rel=0.01)
    value, std = told(two[-1])
    assert value == pytest.approx([50.0, 0.7, 0.0]) and std == pytest.approx([5e-8, 7e-10, 1e-11], rel=1e-3)


def responses(about: tuple[float, float, float], h: float = PERIOD) -> np.ndarray:
    """(4, 4, 4): the response of the servo with these deviations and its derivatives, over a step."""
    cut = cut_of(config())
    belief, fil = cut.fixed.belief, cut.state.filter
    fil.servo.about[:] = about
    unjitted(sv.believe_servo)(belief, fil)
    fil.servo.next_step = h
    set_servo_step((cut.memory.parts,))
    return fil.servo.response.copy()


def integrated(frequency: float, damping: float, delay: float, start: tuple[float, ...], h: float) -> np.ndarray:
    """(double integral, integral, beta, beta_dot) after h, by small steps of the equation; start: beta, beta_dot, the
    command, what it changes by when the held one is `delay` old."""
    beta, rate, once, twice, steps = start[0], start[1], 0.0, 0.0, 20000
    dt = h / steps
    for k in range(steps):
        u = start[2] + (start[3] if (k + 0.5) * dt >= delay % PERIOD else 0.0)
        middle = beta + 0.5 * dt * rate
        accelerated = frequency**2 * (u - middle) - 2.0 * damping * frequency * rate
        twice += dt * (once + 0.5 * dt * middle)
        once += dt * middle
        beta += dt * (rate + 0.5 * dt * accelerated)
        rate += dt * accelerated
    return np.array([twice, once, beta, rate])


@pytest.mark.parametrize("column", range(4))
def test_a_step_is_the_servos_equation_with_a_command_that_changes_within_it(column):
    about = (0.5, -0.4, 0.7)  # 57.5 rad/s, 0.616, 14 ms
    start = np.eye(4)[column]
    wanted = integrated(50.0 * 1.15, 0.7 * 0.88, 0.014, tuple(start), PERIOD)
    assert responses(about)[0, :, column] == pytest.approx(wanted, rel=2e-3, abs=1e-9)


@pytest.mark.parametrize("number", range(3))
def test_the_slopes_are_the_derivatives_of_the_response(number):
    about, step = np.array([0.5, -0.4, 0.7]), 1e-3 * np.eye(3)[number]
    wanted = (responses(tuple(about + step))[0] - responses(tuple(about - step))[0]) / 2e-3
    assert responses(tuple(about))[1 + number] == pytest.approx(wanted, rel=1e-4, abs=1e-7 * np.abs(wanted).max())


def test_an_estimator_that_is_saved_and_restored_goes_on_to_the_same_bits():
    one, two = Estimator(config()), Estimator(config())
    one.replay(samples(2)[:700])
    two.restore(one.save())
    for each in samples(2)[700:1200]:
        assert one.update(each) is two.update(each)
    assert one.save() == two.save() and repr(one.estimate()) == repr(two.estimate())


# ---- degenerate


def test_without_a_command_nothing_is_learned_of_it():
    last = Estimator(config()).replay([s._replace(beta_cmd=NAN) for s in samples(1)])[-1]
    value, std = told(last)
    assert value == pytest.approx([50.0, 0.7, 0.0]) and std == pytest.approx([15.0, 0.21, 0.02])
    assert last.valid


def test_samples_slower_than_the_controller_say_nothing_of_it():
    """The commands between are not known: a servo fitted to the others would be another one."""
    flight = list(fly_whole(CONSTANT, 2, period=0.02).samples())[:1000]
    last = Estimator(config(sample_period=0.02, model=onboard_model(UNSURE, 0.02))).replay(flight)[-1]
    assert told(last)[1] == pytest.approx([15.0, 0.21, 0.02])


def test_over_a_gap_what_was_learned_stays():
    gone = [s for s in samples(4) if not 12.0 <= s.t < 13.0]
    estimator = Estimator(config())
    estimator.replay([s for s in gone if s.t < 12.0])
    before = persisting(estimator)["filter.servo.r"].copy()
    for sample in (s for s in gone if s.t < 13.05):
        if sample.t > 12.0:
            estimator.update(sample)
    assert (persisting(estimator)["filter.servo.r"] == before).all()
    value, std = told(Estimator(config()).replay(gone)[-1])
    assert np.abs((value - truth(4)) / std).max() < 4.0


def test_a_servo_that_contradicts_the_model_is_not_said():
    """The nozzle stops moving: the model is wrong, and what it says of its servo too."""
    stuck = [s._replace(beta=s.beta if s.t < 12.0 else 0.02 + 1e-4 * (k % 7)) for k, s in enumerate(samples(1))]
    last = Estimator(config()).replay(stuck)[-1]
    assert last.status.name in ("MODEL", "STUCK") and np.isnan(told(last)[0]).all()


def test_a_wrong_sigma_is_refused():
    model = onboard_model(CONSTANT)
    with pytest.raises(ValueError, match=r"delay_sigma=-0.01: expected a finite number of at least 0"):
        dataclasses.replace(model, delay_sigma=-0.01)
    with pytest.raises(ValueError, match=r"time_constant=0.02: a first-order actuator has no natural_frequency"):
        dataclasses.replace(model, time_constant=0.02, damping_ratio_sigma=0.1)
    assert Model.servo_sigma.fget(model) == ()


# ---- what a user sees


@pytest.fixture(scope="module")
def log():
    return launchid.simulate("constant", seed=7, effects=["actuator_bandwidth:scale=0.8", "actuator_delay:delay=0.02"])


def test_identify_says_what_it_learned_of_the_servo(log):
    found = launchid.identify(log, UNSURE, window=5.0)
    said = json.loads(found.to_json())
    assert said["actuator"] == said["windows"][-1]["actuator"]
    for name, true in (("natural_frequency", 40.0), ("damping_ratio", 0.7), ("delay", 0.02)):
        assert abs(said["actuator"][name]["value"] - true) < 4.0 * said["actuator"][name]["std"]
    assert "servo as estimated: " in found.summary() and not found.warnings
    plain = json.loads(launchid.identify(log, "constant", window=5.0).to_json())
    assert "actuator" not in plain and all("actuator" not in window for window in plain["windows"])


@pytest.mark.parametrize(("lacking", "words"), [
    ({"beta_cmd": None}, "column beta_cmd is missing: without the command"),
    ({"beta": "beta_cmd"}, "column beta is the command itself: without a sensor of the nozzle")])
def test_identify_says_what_it_cannot_learn_of_the_servo(log, lacking, words):
    names = {name: name for name in ("t", "theta", "theta_dot", "beta", "beta_cmd")} | lacking
    columns = {name: getattr(log.flight, source) for name, source in names.items() if source is not None}
    with pytest.warns(launchid.DataWarning, match=f"{words} nothing is known of the servo's natural_frequency, "
                                                  "damping_ratio, delay but what"):
        launchid.identify(columns, UNSURE, window=5.0)

"""The filter behind the diagnosis knows the gyro's scale and how late its sensors are, and looks for what nobody
declared on the scale of the vehicle at hand."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_diagnosis_used import as_record
from test_diagnosis_world import NOMINAL, flown, on_grid, rows, without

from launchid.diagnosis.causes import RECORDS, SOUGHT, Cause
from launchid.diagnosis.data.record import THETA_DOT
from launchid.diagnosis.data.world import SLOW_MOMENT, TURBULENCE, sought
from launchid.diagnosis.judge.gain import Trained, _noise, on_another
from launchid.diagnosis.judge.named import BLURRED, _blurred, _rivals
from launchid.diagnosis.model.noise import (
    ACCELERATION,
    MOST,
    Refilter,
    _start,
    bounds,
    declared,
    dynamics,
    first_filter,
    largest,
    nothing_foreseen,
    run_filter,
)
from launchid.diagnosis.model.point import Point, innovations
from launchid.diagnosis.model.predictor import DEAF, made_good
from launchid.diagnosis.search import weather
from launchid.diagnosis.search.foresight import spans
from launchid.diagnosis.search.profile import TOLD_APART, as_simulated, profile
from launchid.diagnosis.search.selection import FURTHER, THRESHOLD, Ranked, Selection, Weather, select_from
from sim.effects import effect
from sim.nominal import Wind

TIMING = 4   # of the deviations


@pytest.fixture(scope="module")
def record():
    """`constant` at 100 Hz."""
    return as_record(0.01)


def scaled(record, scale):
    """The log of a gyro with a scale factor, and what is believed then."""
    z = record.z.copy()
    z[:, THETA_DOT] *= scale
    return dataclasses.replace(record, z=z), Point((effect("gyro_scale", scale=scale),))


# ---- a gyro with a scale factor


@given(scale=st.floats(DEAF, 5.0), sign=st.sampled_from([-1.0, 1.0]))
def test_a_known_scale_factor_changes_the_unit_of_the_rate_and_nothing_else(record, scale, sign):
    """The state goes through the log as without it, one of the other sign too; else a factor would make the filter
    slower or faster, and be liked for that.  The first row apart, where the state begins at what is read."""
    filt = first_filter(record, declared(record))
    e, states, _ = innovations(record, filt, Point())
    log, point = scaled(record, sign * scale)
    log.z[0, THETA_DOT] = record.z[0, THETA_DOT]
    ours, moved, stayed = innovations(log, filt, point)
    settled = slice(log.rows // 2, None)
    assert stayed and moved[settled] == pytest.approx(states[settled], abs=1e-6)
    assert ours[settled, THETA_DOT] == pytest.approx(sign * scale * e[settled, THETA_DOT], abs=1e-6 * scale)


@pytest.mark.parametrize("scale", [0.5, -1.0, 2.0])
def test_gains_of_a_scaled_gyro_are_those_of_a_good_one_with_its_noise(record, scale):
    """The gyro's noise, shown in rad/s, is the sensor's over the factor."""
    levels = declared(record)
    log, point = scaled(record, scale)
    dyn = dynamics(log, point)
    assert dyn.rate_scale == scale and dyn.c[THETA_DOT, 1] == scale
    ours = run_filter(log, dyn, levels, log.z)
    noisier = levels.copy()
    noisier[THETA_DOT] /= abs(scale)
    good = run_filter(record, dynamics(record, Point()), noisier, record.z)
    assert ours.gains == pytest.approx(good.gains, rel=1e-9, abs=1e-15)


def test_innovations_are_refiltered_from_what_the_scaled_gyro_made_of_them(record):
    """The likelihood is the same from any filter's innovations: that of the run itself."""
    log, point = scaled(record, 0.4)
    dyn, levels = dynamics(log, point), declared(log)
    other = levels.copy()
    other[ACCELERATION] *= 20.0
    filters = [first_filter(log, declared(log)), run_filter(log, dyn, other, log.z)]
    likely = [Refilter(log, dyn, innovations(log, each, point)[0], each).log_likelihood(levels) for each in filters]
    assert likely[0] == pytest.approx(likely[1], rel=1e-4)


def test_a_gyro_that_shows_next_to_nothing_corrects_next_to_nothing():
    assert [made_good(x) for x in (1.0, -0.5, 0.01, -0.01, 0.0)] == [1.0, -0.5, DEAF, -DEAF, DEAF]


# ---- sensors that are late


def test_what_a_late_gyro_shows_is_corrected_once(record):
    """Believed at a hundred times the declared acceleration, so that each innovation corrects nearly all of itself;
    with the past left as it was the same error is corrected again and again, and grows."""
    levels = declared(record)
    levels[ACCELERATION] *= 100.0
    point = Point((effect("gyro_delay", delay=0.1),))
    log = dataclasses.replace(record, z=late(record, THETA_DOT, 0.1))
    e, _, stayed = innovations(log, run_filter(log, dynamics(log, point), levels, log.z), point)
    own, _, _ = innovations(record, run_filter(record, dynamics(record, Point()), levels, record.z), Point())
    settled = slice(log.rows // 2, None)
    assert stayed and np.std(e[settled, THETA_DOT]) < 3.0 * np.std(own[settled, THETA_DOT])


def late(record, channel, delay):
    """The log with a channel this late [s]."""
    z, rows = record.z.copy(), round(delay / record.period)
    z[rows:, channel] = record.z[:-rows, channel]
    z[:rows, channel] = record.z[0, channel]
    return z


# ---- the vehicle's own scale


def test_disturbances_are_sought_up_to_what_moves_the_vehicle(record):
    """A launcher's range, or a rotor's, whose moments are a thousand times as large."""
    strong = dataclasses.replace(record, k1=1e3 * record.k1)
    assert [largest(record, place) for place in MOST] == list(MOST.values())
    assert largest(strong, "plant") == pytest.approx(np.std(record.commands) * 1e3 * np.sqrt(np.mean(record.k1**2)))
    assert largest(dataclasses.replace(record, commands=100.0 * record.commands), "actuator") == pytest.approx(
        100.0 * np.std(record.commands))


def test_a_moment_that_is_sought_is_no_stronger_than_what_moves_the_vehicle(record):
    source = sought(SLOW_MOMENT, record.nominal, 0.001, 1.0, most=0.3)
    weathered = dataclasses.replace(record, world=record.world.with_weather(source))
    at = 5 + [each.name for each in weathered.world.levels].index(SLOW_MOMENT)
    assert bounds(weathered)[1][at] * declared(weathered)[at] == pytest.approx(0.3)
    assert source.is_sought and not any(each.is_sought for each in record.world.sources)


# ---- beside what nobody declared


def test_predictions_in_undeclared_weather_are_no_longer_than_it_lasts(record):
    def over(time_constant):
        source = sought(TURBULENCE, record.nominal, 0.001, time_constant)
        return spans(dataclasses.replace(record, world=record.world.with_weather(source)))

    assert over(0.3)[-1] == 0.3 and over(10.0) == spans(record)


def test_a_moment_that_nothing_names_is_no_noise(record):
    """The error that it makes of a prediction counts, but for the slow moment that is nobody's fault."""
    source = sought(SLOW_MOMENT, record.nominal, 0.001, 1.0, most=0.3)
    log = dataclasses.replace(record, world=record.world.with_weather(source))
    levels = declared(log)
    levels[-1] = 0.1
    trained = Trained(Point(), first_filter(log, levels))
    named, unnamed = (np.nanmax(_noise(log, trained, 1.0, is_named)) for is_named in (True, False))
    levels[-1] = 0.001
    floor = np.nanmax(_noise(log, Trained(Point(), first_filter(log, levels)), 1.0))
    assert unnamed == pytest.approx(floor) and named > 10.0 * unnamed


def test_rivals_are_told_apart_less_well_beside_what_nothing_names():
    def beside(is_wind):
        return SimpleNamespace(weather=SimpleNamespace(is_wind=is_wind))

    assert _blurred(SimpleNamespace(weather=None)) == _blurred(beside(True)) == 0.0
    assert _blurred(beside(False)) == BLURRED

    def rivals(behind, blurred):
        first, second = (Cause(each, (0.1,)) for each in SOUGHT if each.label in ("actuator_delay", "gyro_delay"))
        ranking = [Ranked(first, 600.0), Ranked(second, 600.0 - behind)]
        return _rivals(first.hypothesis.cause, ranking, blurred, (0.0, 45.0))

    assert rivals(0.9 * TOLD_APART, 0.0) and not rivals(1.1 * TOLD_APART, 0.0)
    assert rivals(0.9 * BLURRED * 600.0, BLURRED) and not rivals(1.1 * BLURRED * 600.0, BLURRED)


def test_where_no_sensor_tells_the_nozzle_it_may_begin_anywhere_it_is_sent_to():
    """A servo that needs half a second to where the log begins was taken for a gust, and its rate limit for more."""
    slow = dataclasses.replace(NOMINAL, actuator=dataclasses.replace(
        NOMINAL.actuator, natural_frequency=math.nan, damping_ratio=math.nan, time_constant=0.5))
    whole = without(flown(slow), "beta")
    begun = int(np.argmax(np.abs(whole.beta_cmd[50:150]))) + 50   # where the command is far from where the nozzle is
    log = on_grid(rows(whole, slice(begun, begun + 1500)), slow)
    e, _, _ = innovations(log, first_filter(log, declared(log)), Point())
    first = first_filter(log, declared(log)).whiten(e)[:20, :2]
    assert np.sqrt(np.mean(first**2)) < 1.5
    assert _start(log, declared(log), dynamics(log, Point()))[2, 2] >= np.var(log.commands)


# ---- how weather is found


def test_a_wind_from_abeam_is_the_end_of_what_is_searched():
    """A vehicle does not fly more than a radian off the nose: whatever it stands for, it is not this cause."""
    for name, rest in (("steady_wind", ()), ("gust", (5.0, 2.0))):
        assert [Cause(RECORDS[name], (angle, *rest)).is_at_an_end for angle in (-1.0, -0.9, 0.9, 1.0)] == [
            True, False, False, True]


@pytest.mark.parametrize(("factor", "seen"), [(10.0, True), (1.0, False)])
def test_a_first_look_sees_what_the_acceleration_noise_has_taken_in(record, monkeypatch, factor, seen):
    """A disturbance that gains only where that noise is near the declared, in a model that has it at ten times."""
    own = declared(record)
    levels = own.copy()
    levels[ACCELERATION] *= factor
    monkeypatch.setattr(weather, "Refilter", lambda *given: SimpleNamespace(
        log_likelihood=lambda levels: 0.0, with_sizes=lambda tried, *rest: np.array(
            [100.0 if own[ACCELERATION] < tried[ACCELERATION] < 2.0 * own[ACCELERATION] else 0.0])))
    fitted = SimpleNamespace(record=record, filter=SimpleNamespace(levels=levels), innovations=None)
    assert (weather._first_look(SimpleNamespace(fit=fitted, dynamics=None)) is not None) == seen


@pytest.mark.parametrize(("noise", "name", "factor", "disagree"), [
    ("bounded", "gyro_delay", 3.0, True), ("bounded", "gyro_delay", 2.5, False),
    ("bounded", "aero_damping", 3.0, False),
    ("declared", "gyro_delay", 1.0, False), ("free", "gyro_delay", 3.0, False)])
def test_a_gyro_as_noisy_as_it_may_be_beside_a_cause_of_a_sensor_does_not_fit(record, monkeypatch, noise, name, factor,
                                                                              disagree):
    """A rate that a device has filtered is like that: a delay is the nearest, and no cause can be named from what is
    left."""
    log = dataclasses.replace(record, noise=noise)
    levels = declared(log)
    levels[THETA_DOT] *= factor
    monkeypatch.setattr(weather, "Refilter", lambda *given: SimpleNamespace(log_likelihood=lambda *given: 0.0))
    fitted = SimpleNamespace(record=log, filter=SimpleNamespace(levels=levels), innovations=np.zeros((5, 3)))
    model = SimpleNamespace(fit=fitted, dynamics=None, causes=(Cause(RECORDS[name], (0.02,)),))
    assert weather.sensors_disagree(model) == disagree


@pytest.mark.parametrize(("second", "early"), [(0.9, True), (1.1, False)])
def test_weather_beside_the_first_cause_comes_before_a_second_that_explains_less_than_half_of_it(
        monkeypatch, second, early):
    nominal, one, two = (SimpleNamespace(causes=(1,) * k, log_likelihood=gain, fit=SimpleNamespace(
        record=SimpleNamespace(channels=("theta",)))) for k, gain in (
            (0, 0.0), (1, 900.0), (2, 900.0 + 50.0 * second)))
    beside = SimpleNamespace(gain=100.0, model=one)
    found = SimpleNamespace(model=one, rankings=[[]])
    for name, answer in (("as_simulated", nominal), ("swinging", ()), ("sensors_disagree", False), ("_first_look", 1.0),
                         ("_noisy", 1.0),
                         ("_weathered", beside), ("_in_weather", "in weather"), ("select_from", found)):
        monkeypatch.setattr(weather, name, lambda *given, answer=answer: answer)
    asked = []
    monkeypatch.setattr(weather, "grown", lambda of, *given: asked.append(setattr(of, "model", two)) or True)
    searched = []
    monkeypatch.setattr(weather, "select_from", lambda *given: searched.append(given[3]) or found)
    made = weather.select(SimpleNamespace(), 12.0, (), lambda text: None)
    assert made == "in weather" and len(asked) == 1
    assert searched == ([1] if early else [1, weather.MOST_CAUSES])


@pytest.mark.parametrize(("single", "noisy", "channels", "in_weather"), [
    (150.0, 60.0, ("theta", "beta"), True), (210.0, 60.0, ("theta", "beta"), False),
    (150.0, 2.0, ("theta", "beta"), False), (150.0, 60.0, ("theta", "theta_dot"), False)])
def test_weather_that_alone_leaves_the_declared_noise_comes_before_a_gain_that_does_not(
        monkeypatch, single, noisy, channels, in_weather):
    """Feedback of what is not modelled looks like another gain, beside which nothing is left for the weather."""
    nominal, one, windy = (SimpleNamespace(causes=(1,) * k, log_likelihood=gain, fit=SimpleNamespace(
        record=SimpleNamespace(channels=channels))) for k, gain in ((0, 0.0), (1, single), (0, 100.0)))
    found = SimpleNamespace(model=one, rankings=[[]])
    for name, answer in (("as_simulated", nominal), ("swinging", ()), ("sensors_disagree", False),
                         ("_first_look", None), ("_in_weather", "in weather"), ("select_from", found)):
        monkeypatch.setattr(weather, name, lambda *given, answer=answer: answer)
    monkeypatch.setattr(weather, "_noisy", lambda of: noisy if of is one else 1.0)
    monkeypatch.setattr(weather, "_weathered", lambda of: SimpleNamespace(gain=100.0, model=windy) if of is nominal
                        else None)
    made = weather.select(SimpleNamespace(), 12.0, (), lambda text: None)
    assert (made == "in weather") == in_weather


@pytest.mark.parametrize("turbulence", [0.0, 0.004])
def test_weather_stays_beside_what_else_is_found_only_where_that_needs_it(turbulence):
    """A step of the moment, found where weather stood in for it: the weather's gain of then is no longer its own."""
    blown = Wind(turbulence=turbulence, turbulence_time=1.0, initial=0.0) if turbulence else None
    log = flown(dataclasses.replace(NOMINAL, wind=blown), "moment_step:acceleration=0.03,time=12")
    calm = as_simulated(on_grid(log, NOMINAL))
    first = weather._weathered(calm)
    of = Selection(first.model, first.model, weather=Weather(first.source, 1.0, 1.0, first.gain), calm=calm)
    step = next(each for each in SOUGHT if each.label == "moment_step")
    found = select_from(of.nominal, (step,), THRESHOLD, 1, lambda text: None)
    made = weather.in_its_weather(of, found, THRESHOLD, lambda text: None)
    assert [each.hypothesis.label for each in made.model.causes] == ["moment_step"]
    assert made.model.causes[0].values[0] == pytest.approx(0.03, rel=0.2)
    if turbulence:
        assert made.nominal is of.nominal and FURTHER < made.weather.gain < first.gain
    else:
        assert made.nominal is calm and made.weather is None


def test_a_second_log_is_judged_in_the_weather_of_the_first(record):
    source = sought(TURBULENCE, record.nominal, 0.001)
    log = dataclasses.replace(record, world=record.world.with_weather(source))
    model = as_simulated(log)
    gain = on_another(record, model, model)
    assert gain.nats == 0.0 and gain.source == "a second log"
    assert gain.squared["theta"][0] == gain.squared["theta"][1] > 0.0


def test_no_model_is_less_likely_than_one_that_foresees_nothing():
    """299999992233 nats were said of a nominal that lost the log: no log tells more than where in its range each value
    is."""
    log = on_grid(flown(NOMINAL), NOMINAL)
    span = np.ptp(log.z, axis=0)
    assert nothing_foreseen(log) == pytest.approx(-log.rows * float(np.sum(np.log(span))))
    half = np.arange(log.rows) % 2 == 0
    assert nothing_foreseen(log, half) == pytest.approx(0.5 * nothing_foreseen(log), rel=0.01)
    near, torn = (profile(each, (), np.zeros(5), first_filter(each, declared(each))) for each in (
        log, dataclasses.replace(log, noise="declared", z=log.z + np.where(half, 0.0, 0.3)[:, None])))
    assert near.log_likelihood > nothing_foreseen(log)
    assert torn.log_likelihood == nothing_foreseen(torn.fit.record)

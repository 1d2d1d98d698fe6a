"""The use of the causes' records: limits, look-alikes, forms, words, what a flight computer takes off."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from every import every

from launchid.diagnosis.causes import RECORDS, SOUGHT, Cause, other_form, pinned, what_decides, what_is_like
from launchid.diagnosis.judge import limits as limits_module
from launchid.diagnosis.judge.absorbed import Absorbing
from launchid.diagnosis.judge.named import Named
from launchid.diagnosis.judge.user_gain import samples
from launchid.diagnosis.report.words import look_alikes, sentence, would_decide
from sim.effects import CATALOGUE, effect
from sim.sections import Actuator

RECORD = SimpleNamespace(
    t=np.arange(0.0, 40.0, 0.01), period=0.01, resolution=0.01, step=0.0025, tick=4, rows=4000, command_is_known=True,
    path_is_known=False, channels=("theta", "theta_dot", "beta"), commands=np.sin(np.arange(0.0, 40.0, 0.01)),
    actuator=Actuator(natural_frequency=50.0, damping_ratio=0.7, deflection_limit=0.2), a6=np.full(3, 2.0),
    k1=np.full(3, -7.0))


@every("cause", [each.cause for each in SOUGHT])
def test_where_a_search_starts_and_a_limit_is_given_is_an_effect_within_its_ranges(cause):
    record = RECORDS[cause]
    own = record.sizes(RECORD) if record.sizes is not None else [record.neutral + record.free[0].step]
    if not record.is_line and record.limit_at(RECORD) and not record.shapes(RECORD)[0]:
        starts = [record.limit_at(RECORD)]   # found by a search of its own
    else:
        starts = record.shapes(RECORD) if not record.is_line else [record.limit_at(RECORD)]
    assert own and starts and len(record.limit_at(RECORD)) in (0, len(record.free) - 1)
    for values in ((size, *shape) for size in own for shape in starts):
        assert record.effect(values).name == cause
        assert all(free.low <= value <= free.high for free, value in zip(record.free, values, strict=True))


def test_a_limit_of_what_begins_at_some_time_is_of_one_that_begins_within_the_log():
    """The log's clock may begin anywhere."""
    for first in (0.0, 100.0, -60.0):
        log = SimpleNamespace(**vars(RECORD) | {"t": RECORD.t + first})
        timed = [(name, dict(zip([free.name for free in record.free[1:]], record.limit_at(log), strict=True)))
                 for name, record in RECORDS.items() if any(free.name == "time" for free in record.free[1:])
                 and record.limit_at(log)]
        assert {"control_loss", "gust"} <= {name for name, _ in timed}
        for name, at in timed:
            assert log.t[0] < at["time"] < log.t[-1] - at.get("duration", 0.0), name


@pytest.mark.parametrize(("name", "channels", "known"), [
    ("gyro_bias", ("theta", "beta"), True), ("gyro_scale", ("theta", "beta"), True),
    ("gyro_delay", ("theta", "beta"), True), ("nozzle_sensor_bias", ("theta", "theta_dot"), True),
    ("nozzle_sensor_bias", ("theta", "theta_dot", "beta"), False),
    *((each, ("theta", "theta_dot", "beta"), False) for each in CATALOGUE if each.startswith("actuator_"))])
def test_what_the_columns_cannot_show_is_not_sought(name, channels, known):
    assert RECORDS[name].visible(RECORD)
    assert not RECORDS[name].visible(SimpleNamespace(channels=channels, command_is_known=known))


# ---- limits


def calm():
    """A model without wind, which has nothing to absorb an effect with."""
    made = object.__new__(Absorbing)
    made.levels, made.costs = np.zeros((0, 5)), np.zeros(0)
    return made


def smallest(monkeypatch, name, energy, needed=8.0, grows=lambda size: size):
    """The limit of one cause whose response has this energy per unit of its size, or of what it grows as."""
    unit = np.array([math.sqrt(energy)])
    monkeypatch.setattr(limits_module, "SOUGHT", (RECORDS[name],))
    monkeypatch.setattr(limits_module, "penalty", lambda record, hypothesis: 0.0)
    monkeypatch.setattr(limits_module, "Problem", lambda *given: SimpleNamespace(
        residual=lambda size: grows(size) * unit))
    monkeypatch.setattr(limits_module, "Projector", lambda *given, **kept: SimpleNamespace(
        residual=0.0 * unit, out=lambda vector: vector))
    monkeypatch.setattr(limits_module, "Absorbing", lambda model: calm())
    monkeypatch.setattr(limits_module, "response", lambda *given: unit)
    monkeypatch.setattr(limits_module, "with_effect", lambda fit, cause: abs(cause.values[0] - RECORDS[name].neutral))
    found, _ = limits_module.limits(RECORD, SimpleNamespace(fit=SimpleNamespace(filter=None)), needed)
    return found[0].size


def test_the_smallest_size_pays_what_is_needed_and_no_more_than_all_of_k1_is_lost(monkeypatch):
    assert smallest(monkeypatch, "aero_damping", 100.0) == pytest.approx(0.4)   # 1/2 100 0.4^2 = 8
    assert smallest(monkeypatch, "aero_damping", 1.0) == pytest.approx(4.0)
    assert smallest(monkeypatch, "control_loss", 100.0) == pytest.approx(0.4)
    assert smallest(monkeypatch, "control_loss", 15.9) is None
    assert smallest(monkeypatch, "aero_damping", 0.0) is None


@pytest.mark.parametrize(("name", "most"), [
    ("attitude_bias", 7.0 / 2.0), ("steady_wind", 7.0 / 2.0), ("thrust_misalignment", 1.0)])
def test_what_the_nozzle_cannot_hold_is_no_size(monkeypatch, name, most):
    """a6 theta = -k1 beta at the nozzle's limit: where that is small, the vehicle does not survive what is larger."""
    limit = RECORD.actuator.deflection_limit
    assert limit < 0.25  # rad: so that none is a wind from more than a radian aside
    assert smallest(monkeypatch, name, 16.0 / (0.99 * most * limit)**2) == pytest.approx(0.99 * most * limit)
    assert smallest(monkeypatch, name, 16.0 / (1.01 * most * limit)**2) is None


def test_the_size_of_a_response_that_saturates_is_what_gains_enough(monkeypatch):
    """|c|^2 grows as the size, not as its square: 1/2 100 x 0.001 = 0.05 at 0.001; 8 at 0.16, not at 0.4."""
    size = smallest(monkeypatch, "aero_damping", 100.0, grows=math.sqrt)
    assert size == pytest.approx(0.16, rel=0.06)
    assert smallest(monkeypatch, "lateral_drift", 1.0, grows=lambda size: min(size, 0.5)) is None


@pytest.mark.parametrize(("name", "true"), [("actuator_backlash", 2e-3), ("actuator_rate_limit", 0.02)])
def test_a_size_that_is_not_proportional_is_bisected_from_its_own_side(monkeypatch, name, true):
    """A larger play shows, a lower rate limit does."""
    shows = (lambda size: size >= true) if name == "actuator_backlash" else (lambda size: size <= true)
    monkeypatch.setattr(limits_module, "with_effect", lambda fit, cause: cause.values[0])
    problem = SimpleNamespace(record=RECORD, residual=lambda size: np.array([10.0 if shows(size) else 0.1]))
    project = SimpleNamespace(residual=0.0, out=lambda vector: vector)
    size, change = limits_module._bisected(problem, SimpleNamespace(fit=None), project, calm(), RECORDS[name],
                                           8.0)
    assert size == pytest.approx(true, rel=limits_module.PRECISE - 1.0) and len(change) == 1
    blind = SimpleNamespace(record=RECORD, residual=lambda size: np.array([0.1]))
    found = limits_module._bisected(blind, SimpleNamespace(fit=None), project, calm(), RECORDS[name], 8.0)
    assert found == (None, None)


# ---- look-alikes, forms and words


def test_what_would_decide_is_said_from_either_side_and_once():
    for record in RECORDS.values():
        for other, what in record.decides:
            assert what in what_decides(record.cause, [other]) and what in what_decides(other, [record.cause])
    both = what_decides("steady_wind", ("thrust_misalignment", "attitude_bias"))
    assert len(both) == 2 and "attitude reference" in both[0] and "a6 and k1" in both[1]
    assert len(what_decides("actuator_bias", ("thrust_misalignment", "steady_wind", "attitude_bias"))) == 1
    assert what_decides("steady_wind", ("slosh",)) == what_decides("steady_wind", ()) == []
    named = Named("steady_wind", {}, {}, {}, ("attitude_bias",), 50.0, None)
    assert would_decide(named) == what_decides("steady_wind", ("attitude_bias",))


def test_in_which_form_a_rival_is_alike_is_said_from_either_side():
    for one, other in (("actuator_delay", "actuator_bandwidth"), ("actuator_bandwidth", "actuator_delay")):
        assert "lag" in what_is_like(one, other)
        assert look_alikes(Named(one, {}, {}, {}, (other, "gust"), 9.0, None)) == \
            f"{other} ({what_is_like(one, other)}), gust"
    assert what_is_like("actuator_delay", "gyro_delay") is None


def test_a_form_is_offered_where_all_that_it_resembles_are_known_and_starts_alike():
    delay = Cause(RECORDS["actuator_delay"], (0.01,))
    lag = other_form(RECORD, delay, SOUGHT)
    assert lag.hypothesis.cause == "actuator_bandwidth" and dict(lag.hypothesis.fixed) == {"lag": 1.0}
    scale, = lag.values   # as late: 2 zeta/(scale w) - 2 zeta/w = delay
    assert 2.0 * 0.7 / 50.0 * (1.0 / scale - 1.0) == pytest.approx(0.01)
    assert other_form(RECORD, Cause(RECORDS["actuator_bandwidth"], (3.0,)), SOUGHT).values == (1.0,)
    for missing in ("actuator_delay", "actuator_bandwidth"):
        assert other_form(RECORD, delay, [each for each in SOUGHT if each.cause != missing]) is None
    assert other_form(RECORD, lag, SOUGHT) is None and other_form(RECORD, Cause(RECORDS["gust"], ()), SOUGHT) is None
    limit = other_form(RECORD, Cause(RECORDS["actuator_rate_limit"], (0.13,)), [RECORDS["actuator_rate_limit"]])
    assert limit.values == pytest.approx((0.1, 0.3))
    assert limit.hypothesis.effect(limit.values).name == "actuator_rate_limit"
    assert other_form(RECORD, limit, SOUGHT) is None


@every("cause", RECORDS)
def test_every_cause_has_a_sentence_with_its_size(cause):
    record = RECORDS[cause]
    values = {each.name: "theta^2" if each.is_term else 0.25 for each in CATALOGUE[cause].parameters}
    values = {name: value for name, value in values.items() if name not in ("lag", "wind_up")}
    said = sentence(Named(cause, values, {}, {}, (), 50.0, None))
    assert "0.25" in said and "{" not in said
    if record.form is not None and record.form.hypothesis.cause == cause:
        other = sentence(Named(cause, values | {record.form.parameter: 1.0}, {}, {}, (), 50.0, None))
        assert other != said and "{" not in other
        assert sentence(Named(cause, values | {record.form.parameter: 0.0}, {}, {}, (), 50.0, None)) == said


def test_times_are_pinned_where_they_are():
    hypothesis, values = pinned(RECORDS["gust"], (0.1, 20.0, 4.0))
    assert values == (0.1,) and [free.name for free in hypothesis.free] == ["angle"]
    assert hypothesis.effect((0.2,)) == effect("gust", angle=0.2, time=20.0, duration=4.0)


# ---- what a flight computer takes off


def test_known_effects_of_sensors_and_command_are_taken_off_in_the_order_they_came():
    """A gyro that scales and adds its bias, a servo that amplifies and then is off: both undone, in either order."""
    rng = np.random.default_rng(1)
    true = {name: rng.standard_normal(5) for name in ("theta", "theta_dot", "beta", "beta_cmd")}
    given = [effect("gyro_scale", scale=0.9), effect("gyro_bias", rate=0.01), effect("actuator_bias", angle=0.02),
             effect("actuator_gain", scale=1.1), effect("attitude_bias", angle=0.03),
             effect("nozzle_sensor_bias", angle=0.04), effect("controller_mismatch", kp_scale=1.2)]
    flight = SimpleNamespace(t=np.arange(5.0), theta=true["theta"] + 0.03, theta_dot=0.9 * true["theta_dot"] + 0.01,
                             beta=true["beta"] + 0.04, theta_ddot=np.zeros(5), beta_cmd=true["beta_cmd"])
    seen = {name: getattr(flight, name).copy() for name in true}
    for effects in (given, given[::-1]):
        made = list(samples(flight, SimpleNamespace(effects=tuple(effects))))
        for name in ("theta", "theta_dot", "beta"):
            assert [getattr(each, name) for each in made] == pytest.approx(list(true[name]))
        assert [each.beta_cmd for each in made] == pytest.approx(list(1.1 * true["beta_cmd"] + 0.02))
        assert all(np.array_equal(getattr(flight, name), seen[name]) for name in true)   # the flight's own stay


def test_a_log_that_shows_nothing_has_limits_and_no_look_alikes(monkeypatch):
    assert smallest(monkeypatch, "control_effectiveness", 0.0) is None

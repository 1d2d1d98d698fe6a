"""Every gate between what the search found and what the verdict says (test_diagnosis_verdict.py), one by one, on
constructed findings: what is just inside passes, what is just outside does not."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from launchid.diagnosis.causes import RECORDS, Cause, missing_term
from launchid.diagnosis.data.world import CALM, MOMENT, SLOW_MOMENT, TURBULENCE, WIND, Source
from launchid.diagnosis.judge import measure
from launchid.diagnosis.judge.constancy import CONSTANCY_LIMIT, SEGMENTS, Constancy
from launchid.diagnosis.judge.gain import LEAST_EXCESS, Gain
from launchid.diagnosis.judge.leftover import Leftover
from launchid.diagnosis.judge.measure import DOMINANT, EXPLAINED, PER_ROW
from launchid.diagnosis.judge.named import Named, _rivals, together, undetermined
from launchid.diagnosis.model.noise import Disturbance
from launchid.diagnosis.search import selection
from launchid.diagnosis.search.foresight import CHANCE, spans
from launchid.diagnosis.search.profile import TOLD_APART
from launchid.diagnosis.search.selection import Weather

BEGAN, ENDED = 0.0, 45.0   # s
SPAN = BEGAN, ENDED
INSIDE, OUTSIDE = 0.99, 1.01   # of a bound


def varying(share, chi_squared=CONSTANCY_LIMIT + 1.0, mean=1.0, std=1e-6):
    """A size over the log that goes up and down by this share of itself."""
    sizes = tuple(mean * (1.0 + share * (-1.0)**k) for k in range(SEGMENTS))
    return Constancy(chi_squared, (0.0,) * (SEGMENTS + 1), sizes, (std,) * SEGMENTS)


def cause(name="slosh", evidence=100.0, varies=0.0, **given):
    values = {"frequency": evidence} if RECORDS[name].is_mode else {}   # two of them are far apart
    return Named(name, values, dict.fromkeys(values, 1e-3), {}, (), evidence, varying(varies), **given)


def left(gain, place="plant", shape="", at_mode=False):
    return Leftover(Disturbance(place, 1.0, 1.0), gain, shape, at_mode)


def doubts(*named, left=(), bounds=EXPLAINED, rows=0, same_place=True):
    return measure.doubts(named, left, PER_ROW * rows, SPAN, bounds, same_place)


# ---- a size that changes


@pytest.mark.parametrize("bounds", [EXPLAINED, DOMINANT])
def test_a_size_that_is_not_the_same_all_along_is_doubted(bounds):
    assert doubts(cause(varies=INSIDE * bounds.variation), bounds=bounds) == []
    said, = doubts(cause(varies=OUTSIDE * bounds.variation), bounds=bounds)
    assert said.startswith("slosh: its size is not the same") and f"at most {100 * bounds.variation:.0f} %" in said
    assert len(doubts(cause(varies=0.9), cause("gust", varies=0.9), bounds=bounds)) == 2
    assert doubts(replace(cause(), constancy=None), bounds=bounds) == []  # the controller's is exact


def test_a_size_varies_only_beyond_chance():
    assert measure.variation(varying(0.9, CONSTANCY_LIMIT), 0.0) == 0.0
    assert measure.variation(varying(0.9, CONSTANCY_LIMIT + 1e-9), 0.0) == pytest.approx(0.9)
    # what the standard deviations alone give is taken off: (0.3^2 - 7/8 0.2^2)^1/2
    assert measure.variation(varying(0.3, std=0.2), 0.0) == pytest.approx(math.sqrt(0.09 - 0.875 * 0.04))
    assert measure.variation(varying(0.1, std=0.2), 0.0) == 0.0
    assert measure.variation(None, 0.0) == 0.0


def test_a_size_varies_beside_its_distance_from_what_changes_nothing():
    one = varying(0.05, mean=0.8)   # a scale of 0.76 to 0.84 is 0.2 +- 0.04 away from 1
    assert measure.variation(one, 1.0) == pytest.approx(0.2)
    assert measure.variation(one, math.inf) == pytest.approx(0.05)   # a rate limit: none is infinitely high
    assert measure.variation(varying(0.1, mean=1.0), 1.0) > 100.0 * DOMINANT.variation   # there is no cause at all


# ---- what is left

KINDS = [("", False), ("theta^2", False), ("u*time", False), ("sin(3 t)", False), ("sin(3 t)", True)]


@pytest.mark.parametrize("bounds", [EXPLAINED, DOMINANT])
@pytest.mark.parametrize(("shape", "at_mode"), KINDS)
def test_more_than_may_be_left_is_doubted(shape, at_mode, bounds):
    limit = left(0.0, shape=shape, at_mode=at_mode).limit
    assert doubts(left=(left(limit, shape=shape, at_mode=at_mode),), bounds=bounds) == []
    said, = doubts(left=(left(limit + 0.1, shape=shape, at_mode=at_mode),), bounds=bounds)
    assert "explains" in said and (shape or "unknown shape") in said


@pytest.mark.parametrize("bounds", [EXPLAINED, DOMINANT])
@pytest.mark.parametrize("shape", ["", "theta^2", "sin(3 t)"])
def test_a_share_of_what_a_place_s_causes_explain_may_be_left_there(shape, bounds):
    large, most = cause(evidence=20000.0), 20000.0 * bounds.left
    assert doubts(large, left=(left(INSIDE * most, shape=shape),), bounds=bounds) == []
    assert doubts(large, left=(left(OUTSIDE * most, shape=shape),), bounds=bounds)
    both = large, cause("bending", evidence=10000.0)
    assert doubts(*both, left=(left(1.5 * INSIDE * most, shape=shape),), bounds=bounds) == []
    foreign = cause("gyro_bias", evidence=20000.0)   # another place, which what is left in the plant moves too
    assert doubts(foreign, left=(left(INSIDE * most, shape=shape),), bounds=bounds)
    assert doubts(foreign, left=(left(INSIDE * most, "theta", shape),), bounds=bounds) == []  # any sensor's is theirs
    assert doubts(foreign, left=(left(INSIDE * most, shape=shape),), bounds=bounds, same_place=False) == []


def test_what_disturbs_a_sensor_moves_no_vehicle():
    """A measured roll was sampled by a clock that jittered, and its damping withheld for 1130 nats left there."""
    damping, bias = cause("aero_damping", evidence=200.0), cause("gyro_bias", evidence=500.0)
    at_theta = left(1000.0, "theta")
    assert doubts(damping, left=(at_theta,), bounds=DOMINANT, same_place=False) == []
    assert len(doubts(damping, left=(at_theta,))) == 1   # it remains: not all is explained
    said, = doubts(damping, bias, left=(at_theta,), bounds=DOMINANT, same_place=False)
    assert measure.accused(said) == ["gyro_bias"]       # alone: the damping is judged without it
    said, = doubts(damping, bias, left=(left(1000.0),), bounds=DOMINANT, same_place=False)
    assert not set(measure.accused(said)) & {"aero_damping", "gyro_bias"}   # what moves the vehicle is against all


def test_a_cause_that_leaves_a_line_of_an_eighth_is_not_even_dominant():
    """The line's share is of what the cause explains; one of a fifteenth may stay beside it."""
    for share, doubted in ((1.0 / 15.0, 0), (1.0 / 8.0, 1)):
        assert len(doubts(cause(evidence=20000.0), left=(left(share * 20000.0, shape="sin(3 t)"),),
                          bounds=DOMINANT)) == doubted


@pytest.mark.parametrize(("a6", "terms", "frequency", "doubted"), [
    (-64.0, (), 7.84, 1), (0.0, (("sin(theta)", -64.0),), 7.84, 1), (-64.0, (), 12.0, 0), (2.0, (), 1.4, 0)])
def test_what_a_body_does_by_itself_is_no_mode_of_it(a6, terms, frequency, doubted):
    """A pendulum's friction was named at half its size, and slosh at the pendulum's own frequency for the rest."""
    record = SimpleNamespace(a6=np.full(3, a6), nominal=SimpleNamespace(terms=terms), rows=1360, period=0.01)
    assert len(measure.own_oscillation(cause("slosh", evidence=frequency), record)) == doubted
    assert measure.own_oscillation(cause("gyro_bias"), record) == []


def test_what_a_row_gains_is_too_little_to_explain():
    """A long log shows what no model has: a limit in nats would fail every one."""
    rows, many = 100_000, PER_ROW * 100_000
    for kind in KINDS:
        assert doubts(left=(left(INSIDE * many, "plant", *kind),), rows=rows) == []
        assert doubts(left=(left(OUTSIDE * many, "plant", *kind),), rows=rows)
        assert doubts(left=(left(INSIDE * many, "plant", *kind),), rows=rows // 2)


def test_only_the_first_that_is_too_much_is_said():
    assert len(doubts(left=(left(9.0), left(30.0, "beta"), left(20.0)))) == 1


def test_what_explains_passes_all_that_dominates():
    for name in ("variation", "left", "share"):
        assert 0.0 < getattr(EXPLAINED, name) < getattr(DOMINANT, name) < 1.0


# ---- what it gains


def gained(nats=50.0, share=0.05, noise=1.0, excess=10.0, horizons=math.inf):
    """Held-out errors: the nominal's exceed what noise gives by `excess` of it, of which this share stays."""
    squared = {"theta": (noise * (1.0 + excess), noise * (1.0 + share * excess), noise)}
    return Gain((0.0, 0.0), nats, {1.0: {}}, squared, None, "here", {"theta": horizons})


@pytest.mark.parametrize("bounds", [EXPLAINED, DOMINANT])
def test_errors_that_remain_on_data_left_out_are_doubted(bounds):
    assert measure.of_gain(gained(share=INSIDE * bounds.share), bounds) == []
    said, = measure.of_gain(gained(share=OUTSIDE * bounds.share), bounds)
    assert f"at most {100 * bounds.share:.0f} %" in said and "data left out" in said
    for nats in (0.0, -3.0, math.nan, -math.inf):
        said, = measure.of_gain(gained(nats, 0.0), bounds)
        assert "lose" in said or "nan" in said
    assert measure.of_gain(gained(0.1), bounds) == []


def test_the_share_is_of_what_is_beyond_noise_and_of_nothing_there_is_none():
    assert gained(share=0.3, noise=7.0).share == pytest.approx(0.3)
    assert gained(share=2.0).share == 1.0
    assert gained(share=-0.05).share == 0.0   # better than noise gives is no error left
    assert gained(excess=OUTSIDE * LEAST_EXCESS).share is not None
    assert gained(excess=INSIDE * LEAST_EXCESS).share is None
    assert measure.of_gain(gained(excess=INSIDE * LEAST_EXCESS, share=0.9), EXPLAINED) == []
    chance = CHANCE * math.sqrt(2.0 / 50.0)   # of 50 horizons: less is no error to take away
    assert gained(excess=OUTSIDE * chance, horizons=50.0).share is not None
    assert gained(excess=INSIDE * chance, horizons=50.0).share is None
    two = replace(gained(), squared={"theta": (11.0, 1.0, 1.0), "theta_dot": (31.0, 11.0, 1.0)})
    assert two.excess == (40.0, 10.0) and two.share == 0.25


def test_causes_beside_which_something_remains_must_predict_better_even_where_noise_may_make_all_error():
    """A bending that made the predictions of a cart worse, within noise, was dominant."""
    for left_over, is_part, said in ((INSIDE, True, 0), (OUTSIDE, True, 1), (OUTSIDE, False, 0)):
        hidden = replace(gained(), squared={"theta": (1.0, left_over, 2.0)})
        assert hidden.share is None and len(measure.of_gain(hidden, DOMINANT, is_part)) == said


@pytest.mark.parametrize(("a6", "longest"), [(2.0, 1.0), (9.0, 1.0), (90.0, 0.32), (-64.0, 1.0), (0.0, 1.0)])
def test_nobody_predicts_an_unstable_vehicle_for_more_than_three_of_its_times(a6, longest):
    """A balancing robot's own time is 0.1 s: over 1 s the error of its state grows 13,000-fold and hides all else."""
    over = spans(SimpleNamespace(a6=np.full(3, a6), world=CALM))
    assert over == pytest.approx((0.1 * longest, 0.5 * longest, longest))


def test_errors_remain_only_beyond_chance():
    """A mean square of 50 horizons side by side is off by a fifth, one sigma."""
    chance = CHANCE * math.sqrt(2.0 / 50.0)
    for excess, said in ((INSIDE * chance, 0), (OUTSIDE * chance, 1)):
        assert len(measure.of_gain(gained(share=excess / 2.0, excess=2.0, horizons=50.0), EXPLAINED)) == said
    assert measure.of_gain(gained(share=INSIDE * chance / 2.0, excess=2.0), EXPLAINED)   # of more of them


@pytest.mark.parametrize(("nats", "numbers", "squared", "lost"), [
    (-4.0, 1, {}, False), (-5.0, 1, {}, True), (-4.0, 0, {}, True), (-1e-9, 1, {"theta": (1.0, 0.5, 1.0)}, True),
    (math.nan, 1, {}, True)])
def test_a_log_too_short_for_predictions_may_lose_by_chance(nats, numbers, squared, lost):
    """1 + 1.645 5^1/2 nats of one number."""
    gain = Gain((0.0, 0.0), nats, {1.0: {}}, squared, None, "", numbers=numbers)
    assert bool(measure.of_gain(gain, DOMINANT)) == lost


def test_a_number_told_by_nothing_costs_a_nat_with_a_variance_of_five():
    """The log is two halves: fitted to the one, judged on the other, and the other way round."""
    z = np.random.default_rng(3).standard_normal((2, 200_000))
    gained = 2.0 * z[0] * z[1] - 0.5 * (z**2).sum(axis=0)
    assert np.mean(gained) == pytest.approx(-1.0, abs=0.03) and np.var(gained) == pytest.approx(5.0, rel=0.03)


def test_a_scale_that_is_nothing_is_no_cause():
    said = [undetermined(replace(cause("actuator_gain"), values={"scale": 0.0125}, std={"scale": std}), BEGAN)
            for std in (0.018, 0.002)]
    assert "does not follow that input" in said[0][0] and said[1] == []


# ---- noise


def test_a_level_far_above_the_declared_hides_what_is_not_modelled():
    def said(factor, beyond):
        return measure.too_noisy({"theta": {"factor": 0.01, "beyond": False},
                                  "acceleration": {"factor": factor, "beyond": beyond}})

    assert said(99.0, beyond=False) is None
    assert "noise of acceleration at 3.1 times" in said(3.1, beyond=True)


# ---- weather that nobody declared


def weather(gain=50.0, name=TURBULENCE, rivals=()):
    entry = WIND if name == TURBULENCE else MOMENT
    return Weather(Source(name, entry, 0.005, 0.005, 1.0), 0.005, 0.001, gain, rivals)


@pytest.mark.parametrize(("name", "said"), [(TURBULENCE, "turbulence of 0.005 rad that changes within 1 s (50 nats)"),
                                            (SLOW_MOMENT, "a moment of 0.005 rad/s^2 that changes within 1 s")])
def test_weather_is_said_with_its_unit_and_time(name, said):
    assert measure.weather_words(SimpleNamespace(weather=weather(name=name))).startswith(said)


# ---- what remains


def test_what_remains_is_said_by_the_strongest_of_what_there_is():
    def remains(left=(), where=None, noisy=None, sky=None, gain=None):
        return measure.remainder(gain, tuple(left), SimpleNamespace(weather=sky), where, noisy)

    one = remains([left(20.0, "beta"), left(40.0, "actuator", "u*time")], gain=gained(share=0.3))
    assert (one.share, one.where) == (pytest.approx(0.3), "actuator") and "u*time" in one.words and "40" in one.words
    assert remains([left(9.0)], noisy="noise of theta").words == "noise of theta"   # below its limit there is nothing
    assert remains().share == 0.0 and remains(gain=gained(excess=0.0)).share == 0.0
    assert remains([left(40.0)], "controller").where == "controller"
    assert remains([left(40.0)], sky=weather(50.0)).where == "environment"
    assert remains([left(60.0, "beta")], sky=weather(50.0)).where == "sensor"
    assert remains(sky=weather(name=SLOW_MOMENT)).where == "plant"


# ---- what the log does not determine


def untold(name, at_an_end=False, **values):
    """Doubts about a cause with these (value, std)."""
    each = Named(name, {key: value for key, (value, _) in values.items()}, {key: std for key, (_, std) in
                                                                           values.items()}, {}, (), 100.0, None,
                 at_an_end)
    return undetermined(each, BEGAN)


@pytest.mark.parametrize(("inside", "outside", "said"), [
    (("control_loss", {"time": (0.61, 0.2)}), ("control_loss", {"time": (0.59, 0.2)}), "its onset"),
    (("moment_step", {"time": (0.61, 0.2)}), ("moment_step", {"time": (0.59, 0.2)}), "its onset"),
    (("gust", {"time": (0.1, 0.2)}), ("gust", {"time": (0.1, 0.2), "at_an_end": True}), "end of the range")])
def test_what_the_log_does_not_tell_is_doubted(inside, outside, said):
    assert untold(inside[0], **inside[1]) == []
    doubt, = untold(outside[0], **outside[1])
    assert said in doubt and doubt.startswith(f"{outside[0]}: ")


def test_an_onset_is_judged_from_the_log_s_own_beginning():
    each = Named("control_loss", {"time": 20000.5}, {"time": 0.2}, {}, (), 100.0, None)
    assert undetermined(each, 20000.0) and not undetermined(each, 19999.0)


# ---- look-alikes and steps


def ranked(*pairs):
    return [selection.Ranked(Cause(RECORDS[name], (0.0,) * len(RECORDS[name].free)), evidence)
            for name, evidence in pairs]


def test_look_alikes_are_those_that_explain_the_log_as_well():
    ranking = ranked(("gust", 50.0), ("slosh", 50.0 - TOLD_APART + 0.1), ("friction", 50.0),
                     ("bending", 50.0 - TOLD_APART - 0.1), ("slosh", 49.0))
    assert _rivals("gust", ranking, 0.0, SPAN) == ("slosh", "friction")
    assert _rivals("aero_damping", ranked(("gust", 54.1), ("slosh", 50.0)), 0.0, SPAN) == ("gust",)  # from the best
    three = ranked(("aero_damping", 50.0), ("gust", 51.0), ("slosh", 56.0))
    assert _rivals("aero_damping", three, 0.0, SPAN) == ("slosh",)
    assert _rivals("gust", [], 0.0, SPAN) == ()


@pytest.mark.parametrize(("time", "duration", "seen"), [
    (-9.0, 60.0, False), (-9.0, 20.0, True), (20.0, 60.0, True), (50.0, 5.0, False), (-9.0, 5.0, False)])
def test_a_gust_that_neither_begins_nor_ends_in_the_log_is_nobody_s_rival(time, duration, seen):
    gust = selection.Ranked(Cause(RECORDS["gust"], (0.1, time, duration)), 50.0)
    assert _rivals("steady_wind", [gust], 0.0, SPAN) == (("gust",) if seen else ())


def test_losses_that_come_soon_after_one_another_and_the_same_way_are_one():
    def grouped(*values):
        losses = [Cause(RECORDS["control_loss"], value) for value in values]
        return list(together(SimpleNamespace(causes=[*losses, Cause(RECORDS["gust"], (0.1, 20.0, 1.0))])))

    near = RECORDS["control_loss"].steps.near
    assert grouped((0.1, 20.0), (0.1, 20.0 + near)) == [[0, 1], [2]]
    assert grouped((0.1, 20.0 + near), (0.1, 20.0)) == [[1, 0], [2]]
    assert grouped((0.1, 20.0), (0.1, 20.1 + near)) == [[0], [1], [2]]
    assert grouped((0.1, 20.0), (-0.1, 21.0)) == [[0], [1], [2]]
    assert grouped((0.1, 20.0), (0.1, 22.0), (0.1, 24.0)) == [[0, 1, 2], [3]]   # from step to step
    other = replace(RECORDS["gust"], steps=RECORDS["control_loss"].steps)
    two = (Cause(RECORDS["control_loss"], (0.1, 20.0)), Cause(other, (0.1, 20.5)))
    assert list(together(SimpleNamespace(causes=two))) == [[0], [1]]   # another cause that may be gradual


def test_a_further_cause_needs_more_than_the_first_and_never_less_than_the_threshold():
    assert [selection.needed(12.0, causes) for causes in (0, 1, 2)] == [12.0, selection.FURTHER, selection.FURTHER]
    assert selection.needed(40.0, 0) == selection.needed(40.0, 1) == 40.0


def test_what_may_join_which_causes():
    known = tuple(RECORDS[name] for name in ("gust", "gyro_bias", "actuator_delay", "actuator_bandwidth"))

    measured, commanded = (SimpleNamespace(channels=("theta", *more)) for more in (("beta",), ()))

    def joining(*present):
        return [each.cause for each in selection._allowed(measured, known, present)]

    delay, lag = RECORDS["actuator_delay"], RECORDS["actuator_delay"].form.hypothesis
    assert joining(Cause(RECORDS["gust"], ()), Cause(RECORDS["gyro_bias"], ())) == \
        ["gust", "actuator_delay", "actuator_bandwidth"]
    assert joining(Cause(delay, ())) == ["gust", "gyro_bias", "actuator_bandwidth"]
    assert joining(Cause(lag, ())) == ["gust", "gyro_bias", "actuator_delay"]   # in whichever form
    terms = (missing_term("theta^2"), missing_term("theta^3"))
    assert selection._allowed(measured, terms, (Cause(terms[0], ()),)) == [terms[1]]
    scales = tuple(RECORDS[name] for name in ("control_effectiveness", "actuator_gain"))
    for one in (0, 1):   # where no sensor tells the nozzle, one is the other
        joins = [selection._allowed(r, scales, (Cause(scales[one], (0.8,)),)) for r in (measured, commanded)]
        assert joins == [[scales[1 - one]], []]

"""The verdict on constructed findings: explained, dominant with what remains, unexplained, consistent, bad data."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_gates import INSIDE, OUTSIDE, cause, gained, left, varying, weather

from launchid.diagnosis import verdict
from launchid.diagnosis.causes import RECORDS, Cause, missing_term
from launchid.diagnosis.controller.kind import DELAY, FILTER, GAIN, NONE, UNKNOWN, ControllerCheck
from launchid.diagnosis.data.work import Work
from launchid.diagnosis.data.world import SLOW_MOMENT
from launchid.diagnosis.judge.diagnosis import Diagnosis
from launchid.diagnosis.judge.leftover import Leftover
from launchid.diagnosis.judge.measure import DOMINANT, EXPLAINED
from launchid.diagnosis.judge.named import Named
from launchid.diagnosis.model.noise import Disturbance
from launchid.diagnosis.search import selection
from launchid.log.fault import Fault
from sim import sections
from sim.errors import InputError

BEGAN, ENDED = 0.0, 45.0   # s
ROWS = 4500
LOG = SimpleNamespace(t=np.arange(10.0))
PLAIN = SimpleNamespace(diagnosis=sections.Diagnosis())


class Found:
    """A selection whose parts are given: the causes it names, what is left beside them, what they gain.

    shares  of the error that each cause takes away, and whether the causes are told;  fewer  what is found of fewer
    rival   words for what explains more than the strongest;  others  the same with one cause replaced
    ratio   of the squared errors with the causes to those without, where noise may make all (share None)
    """

    def __init__(self, *named, left=(), nats=50.0, share=0.05, log_likelihood=0.0, noise=None, weather=None,
                 shares=(), fewer=None, is_told=False, rival=None, instead=None, others=(), ratio=0.5):
        self.ratio = ratio
        self.named, self.nats, self.share, self.noise = named, nats, share, noise or {}
        self.weather, self.calm, self.fewer = weather, None, fewer
        self.shares, self.is_told = shares or (1.0,) * len(named), is_told
        self.evidence = [each.evidence for each in named]
        self.rival, self.instead, self.others = rival, instead, others
        beside = tuple(left) or (left_at("plant", 1.0),)   # every place is looked at, whatever it gains
        fitted = SimpleNamespace(record=None)
        causes = tuple(SimpleNamespace(cause=each.cause, hypothesis=each.record, values=(0.0, 0.0)) for each in named)
        self.nominal = SimpleNamespace(causes=(), log_likelihood=0.0, of=self, fit=fitted,
                                       left=(left_at("plant", 5.0),) if named else beside)
        self.model = SimpleNamespace(causes=causes, log_likelihood=log_likelihood, of=self, fit=fitted, left=beside) \
            if named else self.nominal


def left_at(place, gain):
    return Leftover(Disturbance(place, 1.0, 1.0), gain)


@pytest.fixture
def judged(monkeypatch):
    """The verdict on a `Found`, and of how many selections the gain was measured."""
    monkeypatch.setattr(verdict, "named_causes", lambda found: found.named)
    monkeypatch.setattr(verdict, "leftovers", lambda model: list(model.left))
    monkeypatch.setattr(verdict, "outdone", lambda found, left: found.rival)
    monkeypatch.setattr(verdict, "noise_of", lambda model: model.of.noise)
    monkeypatch.setattr(verdict, "removed", lambda model, gain: model.of.shares)
    monkeypatch.setattr(verdict, "with_removed", lambda named, model, shares: tuple(
        replace(each, removed=share) for each, share in zip(named, shares, strict=True))
        if model.of.is_told else named)
    monkeypatch.setattr(verdict, "fewer", lambda found, kept: found.fewer or Found(*(found.named[k] for k in kept)))
    monkeypatch.setattr(verdict, "instead_of_each", lambda found: iter(found.others))
    monkeypatch.setattr(selection, "in_a_block", lambda causes, k: False)
    monkeypatch.setattr(verdict, "extended", lambda *given: "extended")
    monkeypatch.setattr(verdict, "user_gain", lambda *given: None)

    def judge(found, controller=None, terms=None, catalogue=True, slow=False, shift=0.0, unsure=0.0,
              channels=("theta", "theta_dot", "beta"), period=1.0, a6=2.0):
        asked, measured = [], []
        monkeypatch.setattr(verdict, "propose", lambda *given: asked.append(1) or terms)
        made = Diagnosis(LOG, None, SimpleNamespace(usable=slice(None)), catalogue=catalogue, controller=controller,
                         selection=found)
        made.record = SimpleNamespace(t=np.array([BEGAN, ENDED]), shift=shift, age=0.0, every=2 if slow else 1,
                                      tick=1, rows=ROWS, centre=0.5 * ENDED, fine=1, input="beta_cmd",
                                      thinned=1, unsure=unsure, command_is_known=True, channels=channels,
                                      a6=np.full(2, a6), period=ENDED / ROWS,
                                      nominal=SimpleNamespace(controller=True, terms=(), diagnosis=sections.Diagnosis(),
                                                              sensors=SimpleNamespace(period=period)))

        def measure(of):
            measured.append(of)
            hidden = {} if of.share is not None else {"squared": {"theta": (1.0, of.ratio, 2.0)}}   # all may be noise
            return replace(gained(of.nats, of.share or 0.0), **hidden)

        verdict._judge(made, measure, lambda text: None)
        return SimpleNamespace(made=made, asked=len(asked), measured=measured)

    return judge


def test_an_onset_is_judged_from_the_log_s_own_beginning(judged):
    each = Named("control_loss", {"time": 20000.5}, {"time": 0.2}, {}, (), 100.0, None)
    assert judged(Found(each), shift=20000.0).made.doubts and not judged(Found(each), shift=19999.0).made.doubts


def test_nothing_found_and_nothing_left_is_consistent(judged):
    each = judged(Found())
    assert (each.made.verdict, each.made.where, each.made.causes, each.made.gain) == ("consistent", None, (), None)
    assert each.measured == [] and each.made.extension is None


def test_causes_that_pass_every_test_explain_the_strongest_first(judged):
    weak, strong = cause("gyro_bias", 30.0), cause("slosh", 90.0)
    each = judged(Found(weak, strong))
    assert (each.made.verdict, each.made.where, each.made.causes) == ("explained", "plant", (strong, weak))
    assert each.made.nearest == () and each.made.extension == "extended" and len(each.measured) == 1
    assert each.made.remaining == () and each.made.remainder is None


@pytest.mark.parametrize("found", [
    Found(cause("gyro_bias", varies=OUTSIDE * EXPLAINED.variation)),
    Found(cause("gyro_bias", 1000.0), left=[left(11.0, "theta")]),
    Found(cause("gyro_bias"), share=OUTSIDE * EXPLAINED.share),
    Found(cause("gyro_bias"), noise={"theta": {"factor": 3.1, "beyond": True}}),
    Found(cause("gyro_bias"), weather=weather()),
    Found(cause("gyro_bias"), weather=weather(name=SLOW_MOMENT))])
def test_what_forbids_explained_alone_is_dominant_and_says_what_remains(judged, found):
    """The gain, extension and size are there as for explained."""
    made = judged(found).made
    named = [each.cause for each in made.causes if not each.is_weather]
    if found.weather is not None and found.weather.is_wind:   # wind that passes is itself a cause
        assert (made.verdict, {each.cause for each in made.causes}) == ("explained", {"gyro_bias", "turbulence"})
        return
    assert (made.verdict, made.where, named) == ("dominant", "sensor", ["gyro_bias"])
    assert len(made.remaining) == 1 and made.remainder.share == pytest.approx(found.share)
    assert made.extension == "extended" and made.gain is not None and made.doubts == () and made.nearest == ()


def test_a_cause_that_a_shape_outdoes_is_not_believed(judged):
    """The better answer is then one that is not listed; no gain is measured before."""
    words = "gyro_bias: a disturbance proportional to theta_dot^3 at the theta_dot alone explains 99 nats, it 50"
    each = judged(Found(cause("gyro_bias"), rival=words))
    assert each.made.verdict == "unexplained" and [near.cause for near in each.made.nearest] == ["gyro_bias"]
    assert each.made.doubts == (words,)


@pytest.mark.parametrize("nats", [0.0, -3.0, math.nan, -math.inf])
def test_causes_that_gain_nothing_on_data_left_out_are_not_believed(judged, nats):
    each = judged(Found(cause("gyro_bias"), nats=nats))
    assert (each.made.verdict, each.made.causes) == ("unexplained", ()) and each.made.extension is None
    assert len(each.made.doubts) == 1 and "data left out" in each.made.doubts[0]
    assert [near.cause for near in each.made.nearest] == ["gyro_bias"] and len(each.measured) == 1
    assert judged(Found(cause("gyro_bias"), nats=0.1)).made.verdict == "explained"


@pytest.mark.parametrize("found", [
    Found(cause("gyro_bias", varies=OUTSIDE * DOMINANT.variation)),
    Found(cause("gyro_bias"), left=[left(51.0)]),
    Found(cause("gyro_bias"), left=[left(51.0, "theta")]),
    Found(cause("gyro_bias"), left=[left(51.0, shape="theta^2")]),
    Found(cause("gyro_bias"), left=[left(18.0, shape="sin(3 t)")]),
    Found(cause("gyro_bias"), share=OUTSIDE * DOMINANT.share),
    Found(cause("gyro_bias", is_at_an_end=True)),
    Found(left=[left(11.0, "theta")]),
    Found(noise={"theta": {"factor": 3.1, "beyond": True}}),
    Found(weather=weather(name=SLOW_MOMENT))])
def test_any_doubt_makes_it_unexplained_and_keeps_what_comes_nearest(judged, found):
    each = judged(found)
    assert each.made.verdict == "unexplained" and len(each.made.doubts) == 1 and each.made.causes == ()
    assert each.made.nearest == found.named and each.made.remainder is None
    assert len(each.measured) == len(found.named)   # the nearest's gain is shown all the same


def test_a_doubt_is_not_said_again_by_the_gain(judged):
    assert len(judged(Found(cause("gyro_bias", varies=0.9), nats=-1.0)).made.doubts) == 1


@pytest.mark.parametrize(("left_over", "verdict"), [(INSIDE, "dominant"), (OUTSIDE, "unexplained")])
def test_what_is_left_may_be_a_tenth_of_what_is_explained(judged, left_over, verdict):
    for place in ("plant", "theta"):   # wherever it is
        found = Found(cause("gyro_bias", 1000.0), left=[left_at(place, left_over * DOMINANT.left * 1000.0)])
        assert judged(found).made.verdict == verdict


def test_what_unknown_commands_feign_need_not_be_explained(judged):
    most = 0.02 * ROWS
    for gain, verdict_of in ((INSIDE * most, "consistent"), (OUTSIDE * most, "unexplained")):
        assert judged(Found(left=[left_at("actuator", gain)]), unsure=0.02).made.verdict == verdict_of
    assert judged(Found(left=[left_at("actuator", INSIDE * most)])).made.verdict == "unexplained"


def test_noise_of_the_acceleration_stands_for_commands_that_neither_log_nor_nozzle_tells(judged):
    loud = {"factor": 9.0, "beyond": True}
    found, other = Found(noise={"acceleration": loud}), Found(noise={"theta": loud})
    assert judged(found, unsure=0.02, channels=("theta",)).made.verdict == "consistent"
    for given in ({"unsure": 0.02}, {"channels": ("theta",)}):   # the nozzle tells, or every command is known
        assert judged(found, **given).made.verdict == "unexplained"
    assert judged(other, unsure=0.02, channels=("theta",)).made.verdict == "unexplained"


# ---- weather


def test_wind_that_nobody_declared_is_a_cause_of_its_own(judged):
    made = judged(Found(weather=weather(rivals=("wind_walk",)))).made
    only, = made.causes
    assert (made.verdict, made.where, only.cause, only.rivals) == ("explained", "environment", "turbulence",
                                                                   ("wind_walk",))
    assert (only.values, only.std["level"]) == ({"level": 0.005, "time_constant": 1.0}, 0.001)
    assert only.is_weather and not cause().is_weather and only.evidence == 50.0


def test_weather_beside_which_something_is_left_does_not_name_itself(judged):
    made = judged(Found(weather=weather(), left=[left(11.0, "beta")])).made
    assert (made.verdict, made.causes) == ("unexplained", ()) and any("turbulence" in said for said in made.doubts)


def test_weather_of_a_level_that_is_not_told_from_none_is_none_that_has_a_name(judged):
    """0.0001 +- 0.0001 rad beside an engine out, whose search had ended early."""
    for level, verdict_of in ((1.9, "dominant"), (2.1, "explained")):
        sky = replace(weather(), level=level * weather().std)
        assert judged(Found(cause(), weather=sky)).made.verdict == verdict_of


@pytest.mark.parametrize(("sky", "expected"),
                         [(None, True), (weather(357.0), True), (weather(357.0, SLOW_MOMENT), False)])
def test_what_a_moment_that_nothing_names_makes_counts_as_error(monkeypatch, sky, expected):
    """A hobby rocket's late command, in weather that took the delay in: a bending mode of 54 nats beside a moment of
    357, which hid all that was left.  Wind has a name, so that its part is told."""
    asked = []
    monkeypatch.setattr(verdict, "held_out", lambda model, nominal, controller, is_named: asked.append(is_named))
    verdict._measure(Diagnosis(None, None, None), None)(Found(cause(), weather=sky))
    assert asked == [expected]


# ---- fewer causes


def test_the_strongest_stays_with_what_makes_sense_with_it_only():
    """A sine in the place of theta is two terms."""
    labels = ("gust", "missing_term", "missing_term")
    causes = tuple(Cause(missing_term(term) if name == "missing_term" else RECORDS[name], (1.0,))
                   for name, term in zip(labels, ("", "theta", "sin(theta)"), strict=True))
    of = SimpleNamespace(model=SimpleNamespace(causes=causes), evidence=[30.0, 90.0, 40.0])
    assert selection.only_strongest(of) == (False, True, True)
    of.evidence[0] = 100.0
    assert selection.only_strongest(of) == (True, False, False)


def test_causes_that_do_next_to_nothing_go_where_something_remains(judged):
    strong, idle = cause("slosh", 90.0), cause("gyro_bias", 30.0)
    found = Found(strong, idle, share=0.3, shares=(0.6, OUTSIDE * verdict.LEAST_REMOVED))
    assert judged(found).made.causes == (strong, idle)
    found.shares = (0.6, INSIDE * verdict.LEAST_REMOVED)
    assert judged(found).made.causes == (strong,)
    found.fewer, found.shares = None, (0.0, 0.0)   # each stands in for the other: the likelier is judged alone
    assert judged(found).made.causes == (strong,)


def test_a_cause_that_rides_along_is_not_named_where_all_is_explained(judged):
    """A delay, right, and a nozzle's inertia of 54 nats beside it that took nothing of the error away."""
    late, rider = cause("actuator_delay", 1100.0), cause("nozzle_inertia", 54.0)
    for share, names in ((INSIDE, (late,)), (OUTSIDE, (late, rider))):
        made = judged(Found(late, rider, shares=(0.9, share * verdict.LEAST_NAMED))).made
        assert (made.verdict, made.causes) == ("explained", names)


def test_a_cause_that_stays_for_the_others_sake_is_not_named_for_it(judged):
    """A delay leaves too much without a rate limit that takes 2 % of the error away."""
    late, limit = cause("actuator_delay", 1100.0), cause("actuator_bias", 54.0)
    needs = Found(late, left=[left(500.0)])
    for share, names in ((INSIDE, ["actuator_delay"]), (OUTSIDE, ["actuator_delay", "actuator_bias"])):
        made = judged(Found(late, limit, shares=(0.9, share * verdict.LEAST_NAMED), fewer=needs, is_told=True)).made
        assert (made.verdict, [each.cause for each in made.causes]) == ("explained", names)


def test_what_is_left_at_a_sensor_leaves_the_vehicles_cause(judged):
    """An aircraft's roll was sampled by a jittering clock: its damping stands without what two sensors seemed to have,
    though these are stronger."""
    damping, scale, late = cause("aero_damping", 200.0), cause("gyro_bias", 500.0), cause("gyro_delay", 400.0)
    made = judged(Found(damping, scale, late, left=[left(1000.0, "theta")])).made
    assert (made.verdict, made.causes) == ("explained", (damping,))
    made = judged(Found(damping, left=[left(1000.0, "theta")])).made
    assert (made.verdict, made.causes, made.remainder.where) == ("dominant", (damping,), "sensor")


def test_a_mode_at_the_vehicles_own_frequency_gives_way(judged):
    friction, mode = cause("friction", 98.0), cause("slosh", 8.0)    # its frequency, too
    assert judged(Found(friction, mode), a6=-64.0).made.causes == (friction,)
    assert judged(Found(friction, mode), a6=2.0).made.causes == (friction, mode)


@pytest.mark.parametrize(("ratio", "verdict_is"), [(INSIDE, "dominant"), (OUTSIDE, "unexplained")])
def test_a_part_must_predict_better_where_noise_may_make_all_error(judged, ratio, verdict_is):
    part = Found(cause("bending", 900.0), left=[left(30.0, "theta")], share=None, ratio=ratio)
    assert judged(part).made.verdict == verdict_is
    assert judged(Found(cause("bending", 900.0), share=None, ratio=ratio)).made.verdict == "explained"


def test_a_cause_in_doubt_does_not_sink_those_beside_it(judged):
    """A delay of 573 nats was withheld for a bending mode of 900 that did not last."""
    bending, late, bias = cause("bending", 900.0, varies=OUTSIDE * DOMINANT.variation), \
        cause("actuator_delay", 573.0), cause("gyro_bias", 90.0)
    made = judged(Found(bending, late, bias)).made
    assert (made.verdict, made.causes) == ("explained", (late, bias))


def test_a_cause_in_doubt_gives_way_to_one_that_explains_as_well_and_is_in_none(judged):
    """A robot's trim: as a misaligned thrust its size changed by 54 % along the log, as an angle not at all."""
    doubtful, other, worse = cause("thrust_misalignment", varies=OUTSIDE * DOMINANT.variation), cause("steady_wind"), \
        cause("gyro_bias", varies=OUTSIDE * DOMINANT.variation)
    made = judged(Found(doubtful, others=(Found(worse), Found(other)))).made
    assert (made.verdict, made.causes) == ("explained", (other,))
    assert judged(Found(doubtful, others=(Found(worse),))).made.nearest == (doubtful,)
    assert judged(Found(other, others=(Found(worse),))).made.causes == (other,)


def test_causes_come_in_the_order_of_the_error_they_remove(judged):
    """The order is not that of their evidence, unless the error is not known for all of them."""
    strong, weak = cause("slosh", 90.0), cause("gyro_bias", 30.0)
    said = judged(Found(strong, weak, shares=(0.2, 0.6), is_told=True)).made.causes
    assert [(each.cause, each.removed) for each in said] == [("gyro_bias", 0.6), ("slosh", 0.2)]
    said = judged(Found(weak, strong, shares=(0.6, 0.2))).made.causes
    assert [(each.cause, each.removed) for each in said] == [("slosh", None), ("gyro_bias", None)]


def test_what_the_nominal_leaves_open_is_no_cause(judged):
    """A delay of the gyro within `[diagnosis] timing` is said, and nothing is explained by it."""
    late = [replace(cause("gyro_delay", 90.0), values={"delay": size}) for size in (0.9e-3, 1.1e-3)]
    floor, believed = late[0].record.floor, SimpleNamespace(diagnosis=sections.Diagnosis())
    assert floor(SimpleNamespace(command_is_known=True, period=0.005, nominal=believed)) == 1e-3
    assert floor(SimpleNamespace(command_is_known=False, period=0.005, nominal=believed)) == 5e-3
    made = judged(Found(late[0])).made
    assert (made.verdict, made.causes, made.open) == ("consistent", (), (late[0],))
    made = judged(Found(late[1])).made
    assert (made.verdict, made.causes, made.open) == ("explained", (late[1],), ())


def test_the_strongest_alone_stands_where_several_together_are_in_doubt(judged):
    strong, weak = cause("gyro_bias", 90.0), cause("gyro_scale", 30.0, varies=0.9)
    made = judged(Found(weak, strong)).made
    assert (made.verdict, made.causes) == ("explained", (strong,)) and made.doubts == ()
    made = judged(Found(weak, strong, fewer=Found(strong, nats=-1.0))).made
    assert (made.verdict, made.nearest) == ("unexplained", (weak, strong)) and "gyro_scale" in made.doubts[0]


def test_what_makes_sense_together_only_stands_together_where_a_further_cause_is_in_doubt(judged, monkeypatch):
    """A pendulum's sine in the place of theta is two terms, and its friction a third cause that a shape makes as
    well."""
    sine, linear = cause("missing_term", 90.0), cause("missing_term", 80.0)
    doubtful = cause("friction", 30.0, varies=0.9)
    monkeypatch.setattr(selection, "in_a_block", lambda causes, k: causes[k].cause == "missing_term")
    made = judged(Found(linear, sine, doubtful)).made
    assert (made.verdict, made.causes) == ("explained", (sine, linear))
    found = Found(linear, sine, nats=-1.0)   # nothing is beside the block: none is taken from it
    assert len(judged(found).measured) == 1 and judged(found).made.nearest == (linear, sine)


def test_weather_alone_that_is_in_doubt_ends_nothing(judged):
    """A search that found weather alone has no strongest cause."""
    made = judged(Found(weather=weather(), nats=-1.0)).made
    assert (made.verdict, made.causes) == ("unexplained", ())


def test_weather_alone_stands_where_causes_in_it_explain_hardly_more(judged):
    """A shear was a drift in turbulence.  A sensor's cause is told from weather, and stays."""
    sky = Found(weather=weather(430.0))
    drift, bias = cause("lateral_drift", 71.0), cause("gyro_bias", 71.0)
    made = judged(Found(drift, weather=weather(28.0), instead=sky)).made
    assert (made.verdict, [each.cause for each in made.causes]) == ("explained", ["turbulence"])
    made = judged(Found(drift, weather=weather(28.0), instead=Found(weather=weather(430.0), left=[left(99.0)]))).made
    assert (made.verdict, made.nearest) == ("unexplained", (drift,)) and "weather alone" in made.doubts[0]
    made = judged(Found(bias, weather=weather(28.0), instead=sky)).made
    assert made.verdict == "explained" and bias in made.causes


def test_a_cause_in_weather_that_takes_nothing_away_is_not_named(judged):
    """1 % of the error, where all else is said to be weather and nothing remains."""
    sky = Found(weather=weather(430.0))
    for share, names in ((0.01, ["turbulence"]), (0.5, ["turbulence", "actuator_delay"])):
        made = judged(Found(cause("actuator_delay", 71.0), weather=weather(430.0), shares=(share,), fewer=sky)).made
        assert (made.verdict, [each.cause for each in made.causes]) == ("explained", names)


# ---- where it is


def test_the_place_is_where_a_disturbance_helps_the_nominal_most_or_the_nearest_cause_more(judged):
    found = Found(cause("gyro_bias", 30.0, 0.9))
    for gains, place in (({"beta": 31.0, "actuator": 20.0}, "sensor"), ({"actuator": 31.0, "beta": 20.0}, "actuator"),
                         ({"actuator": 29.0}, "sensor")):
        found.nominal.left = tuple(left_at(*each) for each in gains.items())
        assert judged(found).made.where == place
    found.nominal.left = (left(99.0, shape="sin(3 t)"), left_at("actuator", 31.0))   # a line tells no place
    assert judged(found).made.where == "actuator"


# ---- the controller


def controlled(kind, evidence=200.0, **given):
    return ControllerCheck(kind, 1e-3, 1e-5, evidence=evidence, **given)


@pytest.mark.parametrize("kind", [UNKNOWN, FILTER])
def test_a_foreign_controller_alone_is_unexplained(judged, kind):
    each = judged(Found(), controlled(kind, time_constant=0.08 if kind == FILTER else None))
    assert (each.made.verdict, each.made.where, each.made.causes) == ("unexplained", "controller", ())
    assert "not the nominal controller's" in each.made.doubts[-1]
    assert ("0.08 s" in each.made.doubts[-1]) == (kind == FILTER)
    assert each.asked == 0   # no term of the plant is sought for it


@pytest.mark.parametrize("kind", [UNKNOWN, FILTER])
def test_a_foreign_controller_beside_causes_is_what_remains(judged, kind):
    made = judged(Found(cause("gyro_bias")), controlled(kind)).made
    assert (made.verdict, made.where, [each.cause for each in made.causes]) == ("dominant", "sensor", ["gyro_bias"])
    assert made.remainder.where == "controller" and "not the nominal controller's" in made.remainder.words
    doubted = judged(Found(cause("slosh", varies=0.9)), controlled(kind))
    assert (doubted.made.verdict, doubted.made.where, doubted.asked) == ("unexplained", "controller", 0)


@pytest.mark.parametrize("kind", [GAIN, DELAY, f"{GAIN} and {DELAY} and {FILTER}"])
def test_other_gains_and_computing_time_are_a_cause_beside_the_others(judged, kind):
    each = judged(Found(cause("gyro_bias")), controlled(kind, kp_scale=1.1))
    assert [(every.cause, every.where) for every in each.made.causes] == [
        ("controller_mismatch", "controller"), ("gyro_bias", "sensor")]
    assert each.made.where == "controller" and len(each.measured) == 1
    alone = judged(Found(), controlled(kind))
    assert alone.made.verdict == "explained" and len(alone.measured) == 1 and alone.made.causes[0].constancy is None


def test_the_nominal_s_own_controller_is_no_cause(judged):
    assert judged(Found(), controlled(NONE)).made.verdict == "consistent"


def test_a_slow_log_lacks_an_unknown_controller_s_commands_which_seems_the_actuator_s_fault(judged):
    found = Found()
    for evidence, place, slow, where in (
            (200.0, "plant", True, "controller"), (50.0, "plant", True, "plant"),
            (50.0, "actuator", True, "controller"), (50.0, "plant", False, "controller")):
        found.nominal.left = (left_at(place, 90.0),)
        each = judged(found, controlled(UNKNOWN, evidence), slow=slow)
        assert (each.made.where, each.asked) == (where, 0)   # and no term of the plant is sought beside it


# ---- missing terms


def term(nats=40.0, log_likelihood=0.0, varies=0.0, **given):
    each = Named("missing_term", {"term": "theta^2"}, {}, {}, (), 60.0, varying(varies))
    proposal = SimpleNamespace(equation="missing: +1 theta^2")
    return proposal, Found(each, nats=nats, log_likelihood=log_likelihood, **given)


DOUBTED = Found(cause("slosh", varies=0.9))


def test_missing_terms_that_pass_every_test_stand_for_doubted_causes(judged):
    each = judged(DOUBTED, terms=term())
    assert (each.made.verdict, each.made.causes[0].label) == ("explained", "missing_term theta^2")
    assert each.made.selection is not DOUBTED and each.made.gain.nats == 40.0


@pytest.mark.parametrize("terms", [
    None, term(nats=-1.0), term(varies=0.9), term(left=[left(31.0)]), term(weather=weather()),
    term(log_likelihood=-15.0)])
def test_missing_terms_with_a_doubt_of_their_own_or_far_behind_are_no_cause(judged, terms):
    each = judged(DOUBTED, terms=terms)
    assert (each.made.verdict, each.made.nearest, each.asked) == ("unexplained", DOUBTED.named, 1)
    assert each.made.selection is DOUBTED and "its size" in each.made.doubts[0]
    assert each.made.left == DOUBTED.model.left and each.made.gain.nats == DOUBTED.nats


@pytest.mark.parametrize(("nats", "said"), [(0.3, "explained"), (-0.3, "unexplained")])
def test_missing_terms_that_a_short_log_may_lose_by_chance_are_none(judged, monkeypatch, nats, said):
    """A vehicle that a trim overturned within a second: "a constant", of -0.3 nats on rows left out."""
    monkeypatch.setattr(verdict, "of_gain", lambda gain, bounds, is_part=False: [])
    made = judged(DOUBTED, terms=term(nats=nats)).made
    assert made.verdict == said and (made.proposal is None) == (said == "unexplained")


def test_missing_terms_may_be_a_little_behind(judged):
    assert judged(DOUBTED, terms=term(log_likelihood=-5.0)).made.verdict == "explained"


def test_missing_terms_are_sought_for_doubts_in_plant_or_environment_and_with_the_whole_catalogue(judged):
    assert judged(Found(cause("gust", varies=0.9)), terms=term()).asked == 1
    assert judged(Found(cause("gyro_bias", varies=0.9)), terms=term()).asked == 0
    assert judged(DOUBTED, terms=term(), catalogue=False).asked == 0
    assert judged(Found(cause()), terms=term()).asked == 0


# ---- the attitude alone


@pytest.mark.parametrize(("said", "left", "verdict_is"), [
    ("explained", 0.1, "dominant"), ("explained", 0.4, "unexplained"), ("dominant", 0.1, "dominant"),
    ("unexplained", 0.1, "unexplained"), ("explained", math.inf, "unexplained")])
def test_without_the_gyro_causes_are_dominant_where_they_predict_the_attitude_and_else_nothing_is_said(
        monkeypatch, said, left, verdict_is):
    """A tenth of the squared error may stay, two fifths may not: the attitude itself may be wrong then."""
    def searched(made, *given):
        assert np.isnan(made.record.z[:, 1]).all() and np.isfinite(made.record.z[:, [0, 2]]).all()
        made.verdict, made.gain = said, gained(share=0.0) if math.isfinite(left) else None
        if made.gain is not None:
            made.gain = replace(made.gain, squared={"theta": (1.0, left, 1e-3)})
        return made

    monkeypatch.setattr(verdict, "replace", lambda r, **changes: SimpleNamespace(**vars(r) | changes))
    monkeypatch.setattr(verdict, "_searched", searched)
    before = Diagnosis(LOG, None, SimpleNamespace(usable=slice(None)), verdict="unexplained",
                       record=SimpleNamespace(z=np.zeros((5, 3))))
    made = verdict._without_gyro(before, None, None, lambda text: None)
    assert made.verdict == verdict_is and (made is before) == (verdict_is == "unexplained")
    if made is not before:
        assert made.remaining[0] == "theta_dot does not fit theta and was left out" and made.remainder.where == "sensor"
    assert not np.isnan(before.record.z).any()


# ---- before and after


@pytest.fixture
def checked(monkeypatch):
    """`diagnose` behind the data check: with these faults, so many of 1000 rows usable, and a log on its grid or none;
    what came of it, and whether it was examined."""
    def diagnosed(kinds, usable=1000, grid=True):
        faults = tuple(Fault(kind, "theta", 0.0, 1.0, 1, kind) for kind in kinds)
        data = SimpleNamespace(is_bad=len(faults) > 0, faults=faults, usable=np.arange(1000) < usable)
        nominal, examined = SimpleNamespace(), []

        def recorded(*given):
            if not grid:
                raise InputError("no grid holds it")
            return SimpleNamespace()

        monkeypatch.setattr(verdict, "unwrapped", lambda log: (log, ()))
        monkeypatch.setattr(verdict, "check", lambda *given: data)
        monkeypatch.setattr(verdict, "record", recorded)
        monkeypatch.setattr(verdict, "replace", lambda r, **changes: SimpleNamespace(**changes))
        monkeypatch.setattr(verdict, "sparser", lambda data, *given: data)
        monkeypatch.setattr(verdict, "_examined", lambda made, *given: examined.append(made) or made)
        made = verdict.diagnose(SimpleNamespace(t=np.arange(1000.0)), nominal)
        return made, len(examined) == 1

    return diagnosed


@pytest.mark.parametrize(("kinds", "rest"), [(("spike",), True), (("stamps", "range", "stale", "dropout"), True),
                                             (("unit",), False), (("spike", "sign"), False), (("swapped",), False)])
def test_faults_of_rows_are_masked_and_faults_of_columns_are_not(checked, kinds, rest):
    made, examined = checked(kinds)
    assert examined == rest and made.data.faults
    assert rest or (made.verdict, made.where, made.causes) == ("bad-data", "data", ())


def test_too_few_rows_left_are_bad_data(checked):
    """Two of five usable rows are too few; three of five are enough."""
    for usable, examined in ((600, True), (400, False)):
        made, reached = checked(("stamps",), usable)
        assert reached == examined and (examined or (made.verdict, made.where) == ("bad-data", "data"))
    assert checked((), 400)[1]   # without a fault rows may be few
    assert checked(("spike",), grid=False)[0].verdict == "bad-data"
    with pytest.raises(InputError):
        checked((), grid=False)   # a log without faults that no grid holds is refused


def test_how_far_noise_may_be_from_the_declared_is_the_record_s(checked):
    made, _ = checked(())
    assert made.record.noise == "bounded"


def test_too_few_rows_are_not_searched(monkeypatch):
    for rows, searched in ((verdict.FEWEST_ROWS - 1, False), (verdict.FEWEST_ROWS, True)):
        record = SimpleNamespace(rows=rows, work=Work(), unsure=0.0)
        found: list[int] = []
        monkeypatch.setattr(verdict, "with_commands", lambda r, model: (r, None))
        monkeypatch.setattr(verdict, "used", lambda r, t: (r, None))
        monkeypatch.setattr(verdict, "lost", lambda r: "")
        monkeypatch.setattr(verdict, "select", lambda *given, found=found: found.append(1) or Found())
        monkeypatch.setattr(verdict, "_judge", lambda *given: None)
        monkeypatch.setattr(verdict, "limits", lambda *given: ([], None))
        monkeypatch.setattr(verdict, "noise_of", lambda model: {})
        given = Diagnosis(LOG, PLAIN, SimpleNamespace(usable=slice(None)), record=record)
        made = verdict._examined(given, None, 0, None, lambda text: None)
        assert (len(found) == 1) == searched
        assert searched or (made.verdict == "consistent" and {each.size for each in made.limits} == {None})


def test_a_measured_threshold_is_the_one_of_search_and_limits(monkeypatch):
    taken = []
    record = SimpleNamespace(rows=verdict.FEWEST_ROWS, work=Work(), unsure=0.0)
    monkeypatch.setattr(verdict, "with_commands", lambda r, model: (r, None))
    monkeypatch.setattr(verdict, "used", lambda r, t: (r, None))
    monkeypatch.setattr(verdict, "lost", lambda r: "")
    monkeypatch.setattr(verdict, "measured_threshold", lambda r, flights, say: 9.0 + flights)
    monkeypatch.setattr(verdict, "select", lambda r, threshold, *given: taken.append(threshold) or Found())
    monkeypatch.setattr(verdict, "_judge", lambda *given: None)
    monkeypatch.setattr(verdict, "limits", lambda r, model, threshold: taken.append(threshold) or ([], None))
    monkeypatch.setattr(verdict, "noise_of", lambda model: {})
    for bootstrap, threshold in ((0, 12.0), (1, 10.0)):
        given = Diagnosis(LOG, PLAIN, SimpleNamespace(usable=slice(None)), record=record)
        made = verdict._examined(given, None, bootstrap, None, lambda text: None)
        assert made.threshold == threshold and taken[-2:] == [threshold] * 2


def test_a_second_log_is_read_once_and_when_it_is_asked_for(monkeypatch):
    read = []
    monkeypatch.setattr(verdict, "unwrapped", lambda log: (log, ()))
    monkeypatch.setattr(verdict, "check", lambda log, nominal: read.append(log))
    monkeypatch.setattr(verdict, "record", lambda *given: "record")
    monkeypatch.setattr(verdict, "with_commands", lambda r, model: (r, None))
    monkeypatch.setattr(verdict, "sparser", lambda data, *given: data)
    monkeypatch.setattr(verdict, "shortened", lambda r: r)
    monkeypatch.setattr(verdict, "used", lambda r, t: (r, None))
    monkeypatch.setattr(verdict, "lost", lambda r: "")
    monkeypatch.setattr(verdict, "on_another", lambda r, model, nominal, controller, is_named: r)
    measure = verdict._measure(Diagnosis(None, None, None), LOG)
    assert read == []
    assert [measure(Found()) for _ in range(3)] == ["record"] * 3 and read == [LOG]

"""The gates of the diagnosis: whether a size is the same all along the log, what is left beside the causes, which noise
is not the declared."""

import dataclasses
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden import draw_spec, fly
from hidden.catalogue import hide
from test_diagnosis import log_of
from test_diagnosis_gates import left
from test_diagnosis_world import NOMINAL, flown, on_grid

from launchid.diagnosis.causes import RECORDS, Cause
from launchid.diagnosis.data.record import THETA_DOT
from launchid.diagnosis.data.world import CALM, WEATHER, WIND, Source, World
from launchid.diagnosis.judge import leftover as leftover_module
from launchid.diagnosis.judge import levels
from launchid.diagnosis.judge.constancy import CONSTANCY_LIMIT, SEGMENTS, constancy
from launchid.diagnosis.judge.leftover import Leftover, is_harmonic, leftovers
from launchid.diagnosis.judge.measure import DOMINANT, doubts
from launchid.diagnosis.judge.named import Named
from launchid.diagnosis.judge.outdone import outdone
from launchid.diagnosis.judge.shapes import _shapes
from launchid.diagnosis.model.noise import LEVELS, Disturbance
from launchid.diagnosis.model.point import DEVIATIONS
from launchid.diagnosis.search.profile import as_simulated
from launchid.diagnosis.search.scan import TOP
from launchid.diagnosis.search.selection import THRESHOLD, select_from
from launchid.diagnosis.verdict import diagnose
from sim.effects import from_text
from sim.flight import fly_whole

# ---- what explains more than a cause


def gyro_of(seen):
    """A selection of the gyro's scale, of a log whose gyro shows this of a rate, and what it leaves."""
    log = on_grid(flown(NOMINAL), NOMINAL)
    z = log.z.copy()
    z[:, THETA_DOT] = seen(z[:, THETA_DOT])
    log = replace(log, z=z)
    nominal = as_simulated(log)
    found = select_from(nominal, (RECORDS["gyro_scale"],), THRESHOLD, 1, lambda text: None)
    assert len(found.model.causes) == 1
    return found, tuple(each for each in leftovers(found.model) if each.shape)


def test_a_true_scale_factor_is_outdone_by_no_shape():
    assert outdone(*gyro_of(lambda rate: 0.7 * rate)) is None


@pytest.mark.parametrize("ceiling", [0.5, 0.7])
def test_a_gyro_that_saturates_is_no_scale_factor(ceiling):
    """The rate's cube, or a kink, explains more than any factor, or as much and something beside it."""
    top = []

    def saturated(rate):
        top.append(ceiling * np.max(np.abs(rate)))
        return np.clip(rate, -top[0], top[0])

    found, left = gyro_of(saturated)
    words = outdone(found, left)
    assert words is not None and words.startswith("gyro_scale: ")


@pytest.mark.parametrize(("hidden", "told"), [
    ({"cause": "attitude_walk"}, True), ({"effects": (hide("gyro_bias", {"rate": 1e-4}),)}, False)])
def test_an_attitude_reference_that_drifts_is_no_bias_of_the_gyro(hidden, told):
    """The two differ by a6 times the drift only: in calm air that is enough."""
    columns, _ = fly(draw_spec(9700, nominal="constant", factor=2.0, rate=100.0, **hidden))
    log = on_grid(log_of(SimpleNamespace(**columns)), NOMINAL)
    found = select_from(as_simulated(log), (RECORDS["gyro_bias"],), THRESHOLD, 1, lambda text: None)
    assert len(found.model.causes) == 1
    words = outdone(found, ())
    assert (words is not None and "proportional to time at the theta " in words) == told


@pytest.mark.parametrize(("apart", "told"), [(0.1, True), (1.0, False)])
@pytest.mark.parametrize(("cause", "sizes"), [
    ("periodic_disturbance", {"amplitude": 0.01, "phase": 0.0}), ("slosh", {"coupling": 0.8, "damping_ratio": 0.03})])
def test_two_oscillations_that_a_log_does_not_resolve_are_one_that_changes(cause, sizes, apart, told):
    """Two sloshing masses of opposite couplings among them: a6 that swung by 1 % was called so."""
    stds = dict.fromkeys((*sizes, "frequency"), 1e-3)
    lines = tuple(Named(cause, sizes | {"frequency": w}, stds, {}, (), 50.0, None) for w in (5.0 + apart, 5.0))
    found = doubts(lines, (), 10.5, (0.0, 70.0), DOMINANT, same_place=False)
    assert [each for each in found if "two oscillations, of 5 and 5.1" in each] == (found if told else [])
    assert bool(found) == told


# ---- a size that changes


def sized(*parts, seed=0, logarithmic=False, settled=True, rows=slice(None), deviation=None):
    """A model of 1600 rows with two causes much alike.  The second's size is off by `parts` in parts of the log of
    equal length; settled: the fit is at its minimum;  rows: that alone tell it;  deviation: what the nominal leaves
    open of a number with the second's very response."""
    rng, n = np.random.default_rng(seed), 1600
    slopes = rng.standard_normal((3 * n, 3))
    slopes[:, 1] += 0.7 * slopes[:, 0]
    kept = np.zeros((n, 3))
    kept[rows] = slopes[:, 1].reshape(n, 3)[rows]
    slopes[:, 1] = kept.ravel()
    off = np.repeat(np.repeat(np.array(parts, float), n // len(parts)), 3)
    rest = rng.standard_normal(3 * n) - slopes[:, 1] * off
    if settled:   # what is fitted leaves nothing along its own slopes
        basis, _ = np.linalg.qr(slopes)
        rest -= basis @ (basis.T @ rest)
    record = RECORDS["slosh" if not logarithmic else "actuator_rate_limit"]
    causes = (Cause(RECORDS["aero_damping"], (0.3,)), Cause(replace(record, free=record.free[:1]), (0.5,)))
    whole = np.hstack([slopes[:, :2], np.zeros((3 * n, DEVIATIONS))])
    whole[:, -DEVIATIONS] = slopes[:, 2] if deviation is None else slopes[:, 1]
    return SimpleNamespace(fit=SimpleNamespace(
        slopes=whole, whitened=rest.reshape(n, 3), causes=causes, delta=np.zeros(DEVIATIONS), filter=None,
        record=SimpleNamespace(t=0.01 * np.arange(n), nominal=SimpleNamespace(
            diagnosis=SimpleNamespace(tolerance=0.05 if deviation is None else deviation, timing=0.0)))))


def test_constancy_of_a_true_size_is_a_chi_squared_of_seven():
    found = [constancy(sized(0.0, seed=seed), 1).chi_squared for seed in range(60)]
    assert np.mean(found) == pytest.approx(SEGMENTS - 1, abs=1.5) and max(found) < CONSTANCY_LIMIT


def test_constancy_sees_a_size_that_changes_and_in_which_part():
    made = constancy(sized(-0.2, 0.2), 1)
    assert made.chi_squared > CONSTANCY_LIMIT
    assert np.mean(made.size[4:]) - np.mean(made.size[:4]) == pytest.approx(0.4, abs=0.1)
    assert len(made.t) == SEGMENTS + 1 and len(made.size) == len(made.std) == SEGMENTS
    assert made.std == pytest.approx([1.0 / math.sqrt(3 * 1600 / SEGMENTS)] * SEGMENTS, rel=0.2)
    assert constancy(sized(-0.2, 0.2), 0).chi_squared < CONSTANCY_LIMIT   # the other cause's is the same
    assert constancy(sized(0.4, settled=False), 1).chi_squared < CONSTANCY_LIMIT   # wrong, but the same all along


@pytest.mark.parametrize("tolerance", [0.01, 0.25])
def test_a_size_that_the_tolerance_could_make_as_a_whole_is_seen_to_change(tolerance):
    """k1's error and the control's effectiveness: the log tells their sum only, but tells it in every part."""
    made = constancy(sized(-0.2, 0.2, deviation=tolerance), 1)
    assert made.chi_squared > CONSTANCY_LIMIT
    assert np.mean(made.size[4:]) - np.mean(made.size[:4]) == pytest.approx(0.4, abs=0.1)
    assert made.std == pytest.approx([1.0 / math.sqrt(3 * 1600 / SEGMENTS)] * SEGMENTS, rel=0.2)
    found = [constancy(sized(0.0, seed=seed, deviation=tolerance), 1).chi_squared for seed in range(60)]
    assert np.mean(found) == pytest.approx(SEGMENTS - 1, abs=1.5) and max(found) < CONSTANCY_LIMIT


def test_a_cause_that_one_row_tells_has_no_size_elsewhere_and_nothing_to_say_against_it():
    made = constancy(sized(0.0, rows=slice(800, 801)), 1)
    assert made.chi_squared < CONSTANCY_LIMIT and np.all(np.isfinite((made.size, made.std)))


def test_a_size_searched_as_a_logarithm_is_shown_as_it_is():
    made, plain = constancy(sized(-0.2, 0.2, logarithmic=True), 1), constancy(sized(-0.2, 0.2), 1)
    assert made.chi_squared == pytest.approx(plain.chi_squared)
    assert made.size == pytest.approx([0.5 * math.exp(size - 0.5) for size in plain.size])
    assert made.std == pytest.approx([0.5 * std for std in plain.std])


def test_the_constants_of_constancy_go_with_its_parts():
    """A chi-squared of so many parts less one passes the limit in fewer than one of 1e5 true causes."""
    stats = pytest.importorskip("scipy.stats")
    assert stats.chi2.sf(CONSTANCY_LIMIT, SEGMENTS - 1) < 1e-5


# ---- what is left


def test_what_may_be_left_is_as_rare_in_noise_for_a_shape_a_line_and_a_line_at_a_mode():
    """The rarity is once in 1e4 logs: of white noise one free number gains half a chi-squared of 1, a line half of one
    of 2."""
    shapes = len(list(_shapes(dict.fromkeys(
        ("theta", "theta_dot", "beta", "beta_dot", "u", "time", "seen theta", "seen theta_dot", "seen beta"),
        np.ones(2)))))
    rows = 7000
    chance = {"shape": shapes * math.erfc(math.sqrt(left(0.0, shape="theta^2").limit)),
              "line": 0.5 * rows * TOP * math.exp(-left(0.0, shape="sin(3 t)").limit),
              "line at a mode": 2 * leftover_module.OWN_BINS * math.exp(-left(0.0, "plant", "sin(3 t)", True).limit)}
    for kind, often in chance.items():
        assert 0.5e-4 < often < 2e-4, kind


def test_a_shape_that_grows_with_time_may_leave_more_than_others_and_less_than_a_line():
    stochastic, shape, creep, line = (left(0.0, "beta", kind).limit for kind in ("", "theta^2", "time", "sin(3 t)"))
    assert stochastic <= shape < creep < line and left(0.0, shape="theta*time").limit == creep


def leftovers_with(monkeypatch, found_lines, causes=(), shapes=()):
    """The result of `_shaped` for these lines and shapes beside these causes, 0.1 rad/s resolved."""
    record = SimpleNamespace(rows=1000, period=2.0 * math.pi / 100.0)
    fit = SimpleNamespace(record=record, filter=None)
    monkeypatch.setattr(leftover_module, "Problem", lambda *given: None)
    monkeypatch.setattr(leftover_module, "shape_gains", lambda *given: list(shapes))
    monkeypatch.setattr(leftover_module, "lines", lambda *given: [((1.0, w, 0.0), gain) for w, gain in found_lines])
    return leftover_module._shaped(SimpleNamespace(fit=fit, causes=causes))


def test_harmonics_of_a_named_line_are_its_own_and_nothing_else_is(monkeypatch):
    line = Cause(RECORDS["periodic_disturbance"], (0.1, 5.0, 0.0))
    assert leftovers_with(monkeypatch, [(10.05, 30.0)], (line,)) == []
    for frequency in (10.15, 7.5, 5.02):
        assert len(leftovers_with(monkeypatch, [(frequency, 30.0)], (line,))) == 1, frequency
    for others in ((), (Cause(RECORDS["slosh"], (0.1, 5.0, 0.02)), Cause(RECORDS["control_loss"], (0.1, 5.0)))):
        assert len(leftovers_with(monkeypatch, [(10.05, 30.0)], others)) == 1
    assert is_harmonic(15.0, 5.0, 0.1) and not is_harmonic(5.0, 5.0, 0.1)


def test_a_line_at_a_named_mode_may_leave_less(monkeypatch):
    for name in ("slosh", "bending"):
        mode = Cause(RECORDS[name], (0.1, 5.0, 0.02))
        assert [leftovers_with(monkeypatch, [(w, 12.0)], (mode,))[0].at_mode for w in (5.25, 5.35)] == [True, False]
    loss = Cause(RECORDS["control_loss"], (0.1, 5.0))
    assert not leftovers_with(monkeypatch, [(5.0, 12.0)], (loss,))[0].at_mode


def test_of_lines_the_one_that_passes_its_limit_by_most_and_of_shapes_the_best_of_each_place(monkeypatch):
    mode = Cause(RECORDS["slosh"], (0.1, 5.0, 0.02))
    found = leftovers_with(monkeypatch, [(9.0, 14.0), (5.0, 12.0)], (mode,),
                           [("plant", "a", -2.0, 9.0), ("theta", "b", 1.0, 8.0), ("plant", "c", 1.0, 7.0)])
    assert [(each.shape, each.gain) for each in found] == [("a", 9.0), ("b", 8.0), ("sin(5 t)", 12.0)]
    assert found[0].disturbance.std == 2.0 and found[2].disturbance.std == pytest.approx(math.sqrt(0.5))


def sizes_searched(monkeypatch, gain):
    """`_best_size` of a log whose disturbance of log-size x gains this much."""
    refilter = SimpleNamespace(log_likelihood=lambda levels: 0.0, with_sizes=lambda levels, place, sizes, tau: np.array(
        [gain(math.log(size)) for size in sizes]))
    monkeypatch.setattr(leftover_module, "_refilter", lambda *given: refilter)
    monkeypatch.setattr(leftover_module, "largest", lambda record, place: 0.3)
    monkeypatch.setattr(leftover_module, "nothing_foreseen", lambda record: -math.inf)
    model = SimpleNamespace(fit=SimpleNamespace(filter=SimpleNamespace(levels=None)))
    return leftover_module._best_size(None, model, "plant", 2.0)


def test_the_size_of_a_disturbance_is_sought_where_it_gains_anything(monkeypatch):
    true = math.log(4e-3)
    found = sizes_searched(monkeypatch, lambda x: 20.0 - 3.0 * (x - true)**2)
    assert found.gain > 19.9 and math.log(found.disturbance.std) == pytest.approx(true, abs=0.3)
    assert found.disturbance.time_constant == 2.0
    least, most = 0.3 * leftover_module.SMALLEST, 0.3
    assert sizes_searched(monkeypatch, lambda x: 20.0 if x > math.log(0.99 * most) else 1.0).gain == 20.0
    assert sizes_searched(monkeypatch, lambda x: 20.0 if x < math.log(1.01 * least) else 1.0).gain == 20.0
    asked = []
    sizes_searched(monkeypatch, lambda x: asked.append(x) or 0.4)
    assert len(asked) == leftover_module.LANES
    assert sizes_searched(monkeypatch, lambda x: -5.0).gain == 0.0


def test_every_place_that_the_log_shows_is_looked_at_and_what_gains_is_weighed_against_the_noise(monkeypatch):
    gains = {"plant": 1.9, "actuator": 2.1, "theta": 0.0, "beta": 30.0}
    monkeypatch.setattr(leftover_module, "_best_size",
                        lambda record, model, place, tau: Leftover(Disturbance(place, 1.0, tau), gains[place] / tau))
    monkeypatch.setattr(leftover_module, "_shaped", lambda model: [left(5.0, shape="theta^2")])
    monkeypatch.setattr(leftover_module, "_relevelled",
                        lambda record, model, each: replace(each, gain=each.gain + 100.0))
    monkeypatch.setattr(leftover_module, "TIME_CONSTANTS", (1.0, 2.0))
    for known in (True, False):
        record = SimpleNamespace(command_is_known=known, channels=("theta", "beta"))
        found = leftover_module.leftovers(SimpleNamespace(fit=SimpleNamespace(record=record)))
        expected = [("beta", 130.0), ("actuator", 102.1), ("plant", 5.0), ("plant", 1.9), ("theta", 0.0)]
        assert [(each.disturbance.place, each.gain) for each in found] == [
            each for each in expected if known or each[0] != "actuator"]
        assert all(each.disturbance.time_constant == 1.0 for each in found)


def test_what_is_left_gains_at_least_what_it_did_under_the_old_noise(monkeypatch):
    filt = SimpleNamespace(levels=None, log_likelihood=7.0)
    monkeypatch.setattr(leftover_module, "fit_levels", lambda *given: filt)
    monkeypatch.setattr(leftover_module, "_refilter", lambda *given: SimpleNamespace(log_likelihood=lambda levels: 4.0))
    model = SimpleNamespace(fit=SimpleNamespace(innovations=None, filter=filt), dynamics=None)
    for nothing, gains in ((-math.inf, [3.0, 3.5]), (4.2, [2.8, 3.5])):   # and no more than beside a log of nothing
        monkeypatch.setattr(leftover_module, "nothing_foreseen", lambda record, nothing=nothing: nothing)
        assert [leftover_module._relevelled(None, model, left(gain)).gain for gain in (2.5, 3.5)] == \
            pytest.approx(gains)


# ---- noise


@pytest.mark.parametrize(("factor", "curvature", "beyond"), [
    (2.9, 1e4, False),       # not NOISE times as much, however well it is known
    (6.35, 10.0, False),     # 2.8 nats better than NOISE times: chance
    (6.35, 20.0, True),      # 5.6 nats
])
def test_a_level_is_beyond_its_limit_by_likelihood_ratio(monkeypatch, factor, curvature, beyond):
    record = SimpleNamespace(channels=("theta",), command_is_known=False, world=CALM)
    fitted = SimpleNamespace(record=record, innovations=None,
                             filter=SimpleNamespace(levels=np.array([1.0, 1.0, 1.0, 1.0, factor])))
    monkeypatch.setattr(levels, "declared", lambda record: np.ones(5))
    at = np.log(fitted.filter.levels)
    monkeypatch.setattr(levels, "Refilter", lambda *given: SimpleNamespace(
        log_likelihoods=lambda x: -0.5 * curvature * np.sum((np.log(x) - at)**2, axis=1)))
    assert levels.noise_of(SimpleNamespace(fit=fitted, dynamics=None))["acceleration"]["beyond"] is beyond


def test_a_noise_level_differs_if_it_does_beyond_doubt(monkeypatch):
    """Likelihoods with a curvature of 100: a standard deviation of 0.1 of the logarithm."""
    record = SimpleNamespace(channels=("theta", "theta_dot", "beta"), command_is_known=True, world=CALM)
    fitted = SimpleNamespace(record=record, innovations=None,
                             filter=SimpleNamespace(levels=np.exp([0.0, 0.29, -0.29, 0.31, -0.31])))
    monkeypatch.setattr(levels, "declared", lambda record: np.ones(5))
    at = np.log(fitted.filter.levels)
    monkeypatch.setattr(levels, "Refilter", lambda *given: SimpleNamespace(
        log_likelihoods=lambda x: -50.0 * np.sum((np.log(x) - at)**2, axis=1)))
    found = levels.noise_of(SimpleNamespace(fit=fitted, dynamics=None))
    assert [found[name]["significant"] for name in LEVELS] == [False, False, False, True, True]
    assert [found[name]["std"] / found[name]["factor"] for name in LEVELS] == pytest.approx([0.1] * 5)
    record.channels, record.command_is_known = ("theta",), False
    assert set(levels.noise_of(SimpleNamespace(fit=fitted, dynamics=None))) == {"theta", "acceleration"}


def test_of_the_world_s_levels_the_declared_are_reported(monkeypatch):
    """The levels that nobody declared, the slow moment below the limits and weather that is sought, are no noise of the
    nominal."""
    sources = (Source("a moment", 2, 0.1, 0.1, 20.0), Source("declared", WIND, 0.2, 0.2, 1.0, WEATHER),
               Source("sought", WIND, 0.3, 0.3, 1.0, (1e-3, 40.0)), Source("a constant", WIND, 0.0, 0.1))
    record = SimpleNamespace(channels=("theta",), command_is_known=False, world=World(sources))
    fitted = SimpleNamespace(record=record, innovations=None, filter=SimpleNamespace(levels=np.full(8, 2.0)))
    monkeypatch.setattr(levels, "declared", lambda record: np.ones(8))
    monkeypatch.setattr(levels, "Refilter", lambda *given: SimpleNamespace(
        log_likelihoods=lambda x: -50.0 * np.sum(np.log(x / 2.0)**2, axis=1)))
    found = levels.noise_of(SimpleNamespace(fit=fitted, dynamics=None))
    assert set(found) == {"theta", "acceleration", "declared"} and found["declared"]["factor"] == 2.0


# ---- an onset that the log is silent about


@pytest.mark.parametrize(("time", "least", "most"), [(3.0, 0.3, 6.0), (8.0, 0.0, 0.2)])
def test_an_onset_is_as_uncertain_as_the_log_is_silent_about_it(time, least, most):
    """A third of the control lost before the first turn, and in it: whatever the curvature at the best says."""
    whole = dataclasses.replace(NOMINAL, simulation=dataclasses.replace(NOMINAL.simulation, duration=25.0))
    log = log_of(fly_whole(whole, 1, effects=[from_text(f"control_loss:fraction=0.3,time={time}")]))
    cause, = diagnose(log, whole, hypotheses=(RECORDS["control_loss"],)).causes
    assert least < cause.std["time"] < most and abs(cause.values["time"] - time) < 3.0 * cause.std["time"]

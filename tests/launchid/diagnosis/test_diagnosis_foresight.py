"""Predictions decide which cause may stand where noise stands for what is not modelled, and nowhere else."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_world import NOMINAL, flown, on_grid

from launchid.diagnosis.causes import RECORDS, Cause
from launchid.diagnosis.data.world import SLOW_MOMENT, WALK
from launchid.diagnosis.model.noise import ACCELERATION
from launchid.diagnosis.search import foresight, selection
from launchid.diagnosis.search.foresight import CHANCE, LEAST_REMOVED, STRAINED, foreseen, is_idle, is_strained, spans
from launchid.diagnosis.search.profile import as_simulated, profile

HORIZONS = 50.0
CLEARLY = 1.01 * CHANCE * math.sqrt(2.0 / HORIZONS)   # worse, relative, than chance makes a mean of 50 squares


@pytest.fixture
def seen(monkeypatch):
    """Models are the mean squares of their predictions, over one horizon or several; all are strained."""
    monkeypatch.setattr(foresight, "_errors", lambda errors: (
        np.reshape(errors, (-1, 1)).astype(float), np.full((np.size(errors), 1), HORIZONS)))
    monkeypatch.setattr(foresight, "is_strained", lambda model: True)


def test_of_two_the_one_that_predicts_worse_may_not_stand_however_likely(seen):
    assert foreseen(1.0, [0.8, 0.1]) == [False, True]
    assert foreseen(1.0, [0.1, 0.8]) == [True, True]     # what is less likely may predict as it likes: it is behind


def test_within_chance_the_likelier_stands(seen):
    assert foreseen(1.0, [0.1 * (1.0 + 0.9 * CLEARLY), 0.1]) == [True, True]
    assert foreseen(1.0, [0.1 * (1.0 + CLEARLY), 0.1]) == [False, True]


def test_nothing_that_predicts_worse_than_what_it_is_added_to_may_stand(seen):
    assert foreseen(0.1, [0.8]) == [False]
    assert foreseen(0.1, [0.1 * (1.0 + 0.9 * CLEARLY)]) == [True]


def test_no_model_is_asked_where_there_is_none(seen):
    assert foreseen(1.0, []) == []


def test_a_further_cause_must_take_a_twentieth_of_the_nominal_s_error_away(seen):
    assert is_idle(1.0, 0.5, 0.5 - 0.9 * LEAST_REMOVED) and not is_idle(1.0, 0.5, 0.5 - 1.1 * LEAST_REMOVED)


def test_what_is_worse_or_takes_nothing_away_over_one_horizon_may_do_so_over_another(seen):
    """A delay beside a moment that nobody declared: over a second the loop's commands answer what that did."""
    both, late = (1.0, 1.0), (0.1, 1.2)
    assert foreseen(both, [late]) == [True] and not is_idle(both, both, late)
    assert foreseen(both, [(1.8, 1.8)]) == [False] and is_idle(both, both, (1.0, 0.99))
    assert foreseen(both, [(0.8, 1.2), late]) == [True, True] and foreseen(both, [(0.8, 2.0), late]) == [False, True]


def test_where_no_model_is_strained_the_likelihood_alone_counts(seen, monkeypatch):
    monkeypatch.setattr(foresight, "is_strained", lambda model: False)
    assert foreseen(1.0, [2.0, 0.1]) == [True, True] and not is_idle(1.0, 0.5, 0.5)


@pytest.mark.parametrize(("times", "name", "strained"), [
    (0.99 * STRAINED, "", False), (1.01 * STRAINED, "", True), (1.0, SLOW_MOMENT, True), (1.0, WALK, False)])
def test_noise_far_from_the_declared_or_a_moment_without_a_name_is_strain(monkeypatch, times, name, strained):
    monkeypatch.setattr(foresight, "declared", lambda record: np.ones(5))
    levels = np.ones(5)
    levels[ACCELERATION] *= times
    sky = SimpleNamespace(sources=(SimpleNamespace(name=name, is_sought=True),) if name else ())
    fitted = SimpleNamespace(record=SimpleNamespace(world=sky), filter=SimpleNamespace(levels=levels))
    assert is_strained(SimpleNamespace(fit=fitted)) == strained


def test_the_true_cause_predicts_best_and_its_error_is_the_noise_s():
    """A servo 60 ms late: of the true cause the error over a second is less than a third of the nominal's."""
    nominal = as_simulated(on_grid(flown(NOMINAL, "actuator_delay:delay=0.06"), NOMINAL))
    record = nominal.fit.record
    late = profile(record, (Cause(RECORDS["actuator_delay"], (0.06,)),), nominal.fit.delta, nominal.fit.filter)
    (before, count), (after, same) = foresight._errors(nominal), foresight._errors(late)
    assert np.all(3.0 * after < before) and np.array_equal(count, same)
    seconds = record.rows * record.period
    assert count[0, 0] == pytest.approx((seconds - foresight.SETTLED - spans(record)[-1]) / spans(record)[-1], abs=1.0)
    assert foreseen(nominal, [late]) == [True] and not is_idle(nominal, nominal, late)


def test_a_model_that_leaves_the_log_predicts_worst_and_is_compared_in_every_channel(monkeypatch):
    """A cubic term whose predictions overflow: they are not left out of the mean."""
    nominal = as_simulated(on_grid(flown(NOMINAL), NOMINAL))
    squares, count = foresight._errors(nominal)
    plain = foresight.prediction_errors
    for wrong in (np.nan, np.inf, 1e200):
        monkeypatch.setattr(foresight, "prediction_errors", lambda *given, of=wrong: np.full_like(plain(*given), of))
        far, same = foresight._errors(nominal)
        assert far.shape == squares.shape and np.all(far > 1e50) and np.array_equal(same, count)


def test_a_ranking_leaves_out_what_one_of_less_evidence_outdoes(monkeypatch):
    """Two causes explain a trim alike: the one that predictions speak for stays."""
    nominal = as_simulated(on_grid(flown(NOMINAL, "steady_wind:angle=0.03"), NOMINAL))
    record, allowed = nominal.fit.record, [RECORDS["steady_wind"], RECORDS["attitude_bias"]]

    def ranked():
        return [model.causes[-1].hypothesis.cause for model, _ in selection._ranking(record, nominal, allowed)]

    first, second = ranked()
    monkeypatch.setattr(selection, "foreseen", lambda base, models: [
        model.causes[-1].hypothesis.cause != first for model in models])
    assert ranked() == [second]


def test_what_was_best_in_calm_air_is_tried_in_weather_whatever_a_scan_promises():
    """A scan under weather that follows the sensors closely promised a late command nothing."""
    nominal = as_simulated(on_grid(flown(NOMINAL, "gyro_bias:rate=0.002"), NOMINAL))
    record, delay = nominal.fit.record, Cause(RECORDS["actuator_delay"], (0.01,))
    tried = [model.causes[-1].hypothesis.cause
             for model, _ in selection._ranking(record, nominal, [RECORDS["gyro_bias"]], also=[delay])]
    assert tried[0] == "gyro_bias" and "actuator_delay" in tried
    assert selection.select_from(nominal, (), 1e9, 1, lambda text: None, also=[delay]).also == (delay,)


def test_no_cause_joins_that_predictions_do_not_miss(monkeypatch):
    nominal = as_simulated(on_grid(flown(NOMINAL, "gyro_bias:rate=0.002", "actuator_delay:delay=0.06"), NOMINAL))
    known = (RECORDS["gyro_bias"], RECORDS["actuator_delay"])

    def found():
        return {cause.hypothesis.cause for cause in selection.select_from(
            nominal, known, selection.THRESHOLD, 2, lambda text: None).model.causes}

    assert found() == {"gyro_bias", "actuator_delay"}
    monkeypatch.setattr(selection, "is_idle", lambda nominal, base, other: True)   # of a first one it is not asked
    assert len(found()) == 1

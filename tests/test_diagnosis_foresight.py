"""Predictions decide which cause may join where noise stands for what is not modelled, and nowhere else."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_world import NOMINAL, flown, on_grid

from sim.diagnosis.causes import RECORDS, Cause
from sim.diagnosis.data.world import SLOW_MOMENT, WALK
from sim.diagnosis.model.noise import ACCELERATION
from sim.diagnosis.search import foresight, selection
from sim.diagnosis.search.foresight import (
    LEAST_REMOVED,
    STRAINED,
    is_idle,
    is_strained,
)
from sim.diagnosis.search.profile import as_simulated, profile


@pytest.fixture
def seen(monkeypatch):
    """Models are the mean squares of their predictions, over one horizon or several; all are strained."""
    monkeypatch.setattr(foresight, "_errors", lambda errors: np.reshape(errors, (-1, 1)).astype(float))
    monkeypatch.setattr(foresight, "is_strained", lambda model: True)


def test_a_further_cause_must_take_a_twentieth_of_the_nominal_s_error_away(seen):
    assert is_idle(1.0, 0.5, 0.5 - 0.9 * LEAST_REMOVED) and not is_idle(1.0, 0.5, 0.5 - 1.1 * LEAST_REMOVED)


def test_what_takes_nothing_away_over_one_horizon_may_do_so_over_another(seen):
    """A delay beside a moment that nobody declared: over a second the loop's commands answer what that did."""
    both, late = (1.0, 1.0), (0.1, 1.2)
    assert not is_idle(both, both, late) and is_idle(both, both, (1.0, 0.99))


def test_where_no_model_is_strained_the_likelihood_alone_counts(seen, monkeypatch):
    monkeypatch.setattr(foresight, "is_strained", lambda model: False)
    assert not is_idle(1.0, 0.5, 0.5)


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
    assert np.all(3.0 * foresight._errors(late) < foresight._errors(nominal))
    assert not is_idle(nominal, nominal, late)


def test_a_model_that_leaves_the_log_predicts_worst_and_is_compared_in_every_channel(monkeypatch):
    """A cubic term whose predictions overflow: they are not left out of the mean."""
    nominal = as_simulated(on_grid(flown(NOMINAL), NOMINAL))
    squares = foresight._errors(nominal)
    plain = foresight.prediction_errors
    for wrong in (np.nan, np.inf, 1e200):
        monkeypatch.setattr(foresight, "prediction_errors", lambda *given, of=wrong: np.full_like(plain(*given), of))
        far = foresight._errors(nominal)
        assert far.shape == squares.shape and np.all(far > 1e50)


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

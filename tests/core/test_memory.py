"""The one memory: fixed maxima, as much of it in use as a configuration needs, and nothing compiled for another."""

import dataclasses

import numba
import numpy as np
import pytest
from numba.core import event
from shortened import CALM, WINDY

from launchid.robustness.level import ranged_model
from launchid_core import Config, Estimator
from launchid_core.algebra.library import MAX_TERMS, polynomial
from launchid_core.order import entries, memory, table
from launchid_core.order.memory import size_of
from launchid_core.order.table import LARGEST_SIZE, WORK
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model
from sim.sections import Wind

UNSURE = dataclasses.replace(CALM, actuator=dataclasses.replace(
    CALM.actuator, natural_frequency_sigma=0.3, damping_ratio_sigma=0.3, delay_sigma=0.02))
TURBULENT = dataclasses.replace(CALM, wind=Wind(turbulence=0.005))


def filtered(nominal=CALM, **choices) -> Config:
    return Config(**{"window": 0.5, "formulation": "filtered", "model": onboard_model(nominal)} | choices)


CHOICES = ("theta", "beta", "integral", "solver", "by_share", "structured", "ranged", "known",
           "shaped", "swept", "shows")  # of `Size`: no extents
CONFIGS = {
    "integral": Config(window=0.5, library="quadratic", compression=2),
    "measured": Config(window=0.5, formulation="measured", solver="lasso", threshold=0.1),
    "calm": filtered(),
    "range": filtered(model=ranged_model(CALM)),
    "terms": filtered(library="quadratic"),
    "wind": filtered(WINDY),
    "servo": filtered(UNSURE),
}


def flown(config: Config, samples: int = 230) -> Estimator:
    estimator = Estimator(config)
    for sample in list(fly_whole(CALM, 5).samples())[1900:1900 + samples]:
        estimator.update(sample._replace(theta_ddot=2.0 * sample.theta - 7.0 * sample.beta))
    return estimator


# ---- the extents in use


def test_the_extents_in_use_never_exceed_the_largest():
    """The largest library, every nuisance, every level."""
    largest = filtered(dataclasses.replace(WINDY, actuator=UNSURE.actuator), library=polynomial(5)[:MAX_TERMS])
    for config in (largest, *CONFIGS.values()):
        for name, number in size_of(config)._asdict().items():
            assert number <= getattr(LARGEST_SIZE, name) or name in CHOICES, name
    assert size_of(largest).terms == LARGEST_SIZE.terms and size_of(largest).sensitivities == LARGEST_SIZE.sensitivities


# ---- nothing is compiled for another configuration


def signatures(config: Config) -> list[int]:
    estimator = Estimator(config)
    return [len(entry.signatures) for entry in entries.entries_of(config, estimator._memory)]


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize(("first", "others"), [
    (filtered(), [filtered(window=2.0), filtered(load_nominal("vega_like")), filtered(WINDY), filtered(TURBULENT),
                  filtered(sample_period=0.0025, model=onboard_model(CALM, 0.0025)), filtered(noise="declared")]),
    (filtered(library="quadratic"), [filtered(library="linear"),
                                     filtered(WINDY, library="theta,beta,theta_dot^2", window=3.0)]),
    (Config(library="linear"), [Config(library="quadratic", window=3.0),
                                Config(library="linear", compression=3, sample_period=0.001),
                                Config(library=("theta", "beta", "sin(theta)"), theta_saturation=1.0)])],
    ids=["filtered", "terms", "integral"])
def test_another_window_rate_nominal_library_and_set_of_nuisances_compiles_nothing(first, others):
    before = signatures(first)
    with event.install_recorder("numba:compile") as recorder:
        for other in others:
            assert signatures(other) == before
            flown(other, 60)
    assert [each.data["dispatcher"].py_func.__name__ for _, each in recorder.buffer] == []


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_the_recorder_sees_what_is_compiled():
    with event.install_recorder("numba:compile") as recorder:
        numba.njit(lambda x: x + 1.0)(1.0)
    assert len(recorder.buffer) >= 1


# ---- scratch


def spoil(estimator: Estimator) -> None:
    """Every number of the scratch becomes none, every integer one that is no place."""
    held = estimator._memory
    apart = [held.apart[name] for name, part, *_ in table.SEPARATE_ARRAYS[held.struct.name] if part == WORK]
    for array in (*(array for _, array in memory.named_arrays(held.parts.work)), *apart):
        array[...] = np.nan if array.dtype == np.float64 else -(2**40)


@pytest.mark.parametrize("name", CONFIGS)
def test_scratch_may_be_anything_between_samples(name):
    """Nothing is carried in it: it is not saved, nor sealed, and in C not set by a restore."""
    samples = list(fly_whole(CALM, 5).samples())[1900:2060]
    one, two = Estimator(CONFIGS[name]), Estimator(CONFIGS[name])
    for sample in samples:
        given = sample._replace(theta_ddot=2.0 * sample.theta - 7.0 * sample.beta)
        spoil(two)
        assert one.update(given) is two.update(given)
    assert one.counts["WINDOW_COMPLETE"] >= 3 and one.save() == two.save()
    assert repr(one.estimate()) == repr(two.estimate()) and one.changes() == two.changes()

"""The one memory: fixed maxima, as much of it in use as a configuration needs, and nothing compiled for another."""

import dataclasses

import numba
import numpy as np
import pytest
from cut import flip
from numba.core import event
from shortened import CALM, WINDY

from launchid.identification.windows import onboard_model
from launchid.robustness.level import ranged_model
from launchid_core import Config, Estimator, Status
from launchid_core.algebra.library import MAX_TERMS, polynomial
from launchid_core.order import entries, memory, table
from launchid_core.order.memory import size_of
from launchid_core.order.table import LARGEST_SIZE, WORK
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.sections import Wind

UNSURE = dataclasses.replace(CALM, actuator=dataclasses.replace(
    CALM.actuator, natural_frequency_sigma=0.3, damping_ratio_sigma=0.3, delay_sigma=0.02))
TURBULENT = dataclasses.replace(CALM, wind=Wind(turbulence=0.005))


def filtered(nominal=CALM, **choices) -> Config:
    return Config(**{"window": 0.5, "formulation": "filtered", "model": onboard_model(nominal)} | choices)


CHOICES = ("theta", "beta", "integral", "solver", "by_share", "structured", "ranged", "known",
           "shaped")  # of `Size`: no extents
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


def carried_in_use(config: Config) -> np.ndarray:
    """A mask of the words that are carried on and sealed: those that belong to the extents in use."""
    held = Estimator(config)._memory
    held.words[:] = 0
    for _, array in memory.named_arrays(held.parts):
        array.view(np.int64)[...] = -1
    return held.words != 0


# ---- the extents in use


@pytest.mark.parametrize("name", CONFIGS)
def test_after_a_flight_every_word_that_is_sealed_and_outside_the_extents_in_use_is_zero(name):
    """The seal of the whole is therefore that of C, which has these extents alone."""
    estimator = flown(CONFIGS[name])
    words, used = estimator._memory.words, carried_in_use(CONFIGS[name])
    assert estimator.counts["WINDOW_COMPLETE"] >= 4 and words[used].any()
    assert not words[~used].any()


@pytest.mark.parametrize("name", CONFIGS)
def test_a_word_outside_the_extents_in_use_that_flips_is_seen_and_forgotten(name):
    """The word is zero again in an estimator begun anew: what is saved then goes on anywhere else."""
    estimator, other = flown(CONFIGS[name], 205), Estimator(CONFIGS[name])
    saved, words = estimator.save(), estimator._memory.words
    spare = np.flatnonzero(~carried_in_use(CONFIGS[name])).tolist()
    samples = list(fly_whole(CALM, 5).samples())[2105:2160]
    for turn, place in enumerate(spare[::max(1, len(spare) // 5)]):
        flip(words, place, 7 * turn % 63)
        assert [estimator.update(sample) for sample in samples].count(Status.RECOVERED) == 1, place
        assert words[place] == 0, place
        other.restore(estimator.save())
        for each in (estimator, other):
            assert Status.RECOVERED not in [each.update(s._replace(t=s.t + 1.0)) for s in samples], place
        flip(words, place, 7 * turn % 63)
        estimator.restore(saved)
        assert words[place] == 0, place
    assert bool(spare) == (CONFIGS[name].formulation == "filtered")


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

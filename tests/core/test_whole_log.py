"""`Estimator.replay`: a whole log in one call gives the bits of sample by sample."""

import math

import numpy as np
import pytest
from cut import fed
from hypothesis import given
from hypothesis import strategies as st
from ported import hostile
from replay.make import VECTORS, read, samples_of

from launchid_core import Config, Estimator, Status
from launchid_core.gate import ring as rb

PERIOD = 0.01


@pytest.mark.parametrize("name", ["integral", "integral-faults", "filtered-faults", "wind"])
def test_a_whole_log_in_one_call_gives_the_same_bits(name):
    samples = samples_of(read(name))
    one, two = Estimator(VECTORS[name].config), Estimator(VECTORS[name].config)
    estimates = [one.estimate() for sample in samples if one.update(sample) is Status.WINDOW_COMPLETE]
    whole = two.replay(np.array(samples))
    assert two.save() == one.save()
    assert [repr((e.t_start, e.status, e.a6, e.k1, e.tracked)) for e in whole] == \
        [repr((e.t_start, e.status, e.a6, e.k1, e.tracked)) for e in estimates]
    assert two.replay(samples[:0]) == [] and two.save() == one.save()


def test_in_parts_and_as_samples_too():
    samples = samples_of(read("integral-faults"))
    one, two = Estimator(VECTORS["integral-faults"].config), Estimator(VECTORS["integral-faults"].config)
    estimates = one.replay(iter(samples))
    parts = two.replay(samples[:77]) + two.replay(samples[77:300]) + two.replay(samples[300:])
    assert one.save() == two.save() and len(parts) == len(estimates)


def set_back(memory):
    memory.parts.state.clock.first -= 1.0


def set_forward(memory):
    memory.parts.state.clock.first += 1.0


def late(memory):
    memory.parts.state.clock.last += 1.0


def unbegun(memory):
    memory.parts.state.counts.started = 0


def row(memory):
    memory.apart["ring"][memory.parts.state.counts.head - 3, rb.THETA] += 1.0


@pytest.mark.parametrize("damage", [set_back, set_forward, late, unbegun, row])
def test_memory_that_is_damaged_begins_anew_in_the_same_way(damage):
    """The damage is seen by the loop, by the step of the sample that closes, or by the close."""
    samples = samples_of(read("integral"))
    one, two = (Estimator(VECTORS["integral"].config) for _ in range(2))
    for estimator in (one, two):
        fed(estimator, samples[:120])
        damage(estimator._memory)
    estimates = [one.estimate() for sample in samples[120:] if one.update(sample) is Status.WINDOW_COMPLETE]
    assert len(two.replay(samples[120:])) == len(estimates)
    assert one.save() == two.save() and two.counts["RECOVERED"] == 1


@given(st.integers(0, 2**31), st.sampled_from(("integral", "difference", "measured")), st.sampled_from((0.07, 0.5)))
def test_hostile_samples_give_the_same_bits(seed, formulation, window):
    """Gaps, clocks set back, stamps repeated, infinities; windows of a few rows and of many."""
    config = Config(window=window, sample_period=PERIOD, formulation=formulation)
    samples = hostile(seed, 300)
    one, two = Estimator(config), Estimator(config)
    closed = sum(one.update(sample) is Status.WINDOW_COMPLETE for sample in samples)
    assert len(two.replay(samples)) == closed and two.save() == one.save()


@pytest.mark.parametrize("samples", [np.zeros((5, 6)), np.zeros(7), [(1.0, 2.0)], np.zeros((2, 7, 1))])
def test_another_shape_is_refused(samples):
    with pytest.raises(ValueError, match=r"expected \(n, 7\)"):
        Estimator(VECTORS["integral"].config).replay(samples)


@pytest.mark.campaign
def test_a_hundred_million_samples_end_as_they_began():
    """28 hours at 1 kHz of one window again and again: the last is the first to the bit (stamps are dyadic)."""
    rows, period, windows = 1024, 2.0**-10, 97_657
    t = np.arange(rows) * period
    theta, rate = 0.05 * np.sin(2.0 * t) + 0.02 * np.sin(9.0 * t), 0.1 * np.cos(2.0 * t) + 0.18 * np.cos(9.0 * t)
    beta = (-0.2 * np.sin(2.0 * t) - 1.62 * np.sin(9.0 * t) - 2.0 * theta) / -7.0
    table = np.full((rows, 7), math.nan)
    table[:, 1], table[:, 2], table[:, 3] = theta, rate, beta
    estimator = Estimator(Config(window=1.0, sample_period=period))
    first = last = None
    for k in range(windows):
        table[:, 0] = k * 1.0 + t
        last = estimator.replay(table)[0]
        first = first or last
    assert sum(estimator.counts[status.name] for status in Status) == windows * rows > 1e8
    assert (last.a6, last.k1, last.a6_std, last.condition) == (first.a6, first.k1, first.a6_std, first.condition)

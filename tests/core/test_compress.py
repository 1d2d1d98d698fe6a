"""Random rows: exactly as many as asked, in order, uniform, and the same for the same seed."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from unjitted import unjitted

from launchid_core.algebra import compress
from launchid_core.algebra.compress import MODULUS, MULTIPLIER, first_state

choose_rows = unjitted(compress.choose_rows)

seeds = st.integers(0, 2**40)


def chosen(usable, p, state, n=None):
    """(kept rows, generator state after) of one draw."""
    usable = np.array(usable, dtype=np.int64)
    random, kept = SimpleNamespace(random=state), np.full(max(p, 0) + 1, -1)
    count = choose_rows(usable, usable.size if n is None else n, p, random, kept)
    assert np.all(kept[count:] == -1)
    return kept[:count].tolist(), int(random.random)


# ---------------------------------------------------------------- laws


@given(st.lists(st.integers(0, 1), max_size=60), st.integers(0, 70), seeds)
def test_keeps_as_many_usable_rows_as_asked_in_order(usable, p, seed):
    kept, state = chosen(usable, p, first_state(seed))
    assert len(kept) == min(p, sum(usable))
    assert kept == sorted(set(kept))
    assert all(usable[i] == 1 for i in kept)
    assert 1 <= state < MODULUS


@given(st.lists(st.integers(0, 1), max_size=30), st.lists(st.integers(0, 1), max_size=9), st.integers(0, 30), seeds)
def test_rows_beyond_n_do_not_count(usable, beyond, p, seed):
    state = first_state(seed)
    assert chosen(usable + beyond, p, state, len(usable)) == chosen(usable, p, state)


@given(st.integers(0, 300), seeds)
def test_where_all_rows_are_kept_the_generator_goes_on_as_if_each_was_drawn(n, seed):
    kept, state = chosen([1] * n, n, first_state(seed))
    assert kept == list(range(n))
    assert state == first_state(seed) * pow(MULTIPLIER, n, MODULUS) % MODULUS


@given(seeds)
def test_state_of_any_seed_is_one_of_the_generator(seed):
    assert 1 <= first_state(seed) < MODULUS


@given(seeds)
def test_neighbouring_seeds_differ(seed):
    assert first_state(seed) != first_state(seed + 1)
    everything = [1] * 100
    assert chosen(everything, 50, first_state(seed))[0] != chosen(everything, 50, first_state(seed + 1))[0]


def inclusion_statistic(draws, n, p):
    """Pearson's statistic of the rows' counts, freed of the correlation of sampling without replacement."""
    counts = np.bincount(np.concatenate(draws), minlength=n)
    mean = len(draws) * p / n
    return (n - 1) / n * float(np.sum((counts - mean)**2)) / (mean * (1 - p / n))


@pytest.mark.parametrize("source", ["one stream", "neighbouring seeds"])
def test_every_row_is_kept_equally_often(source):
    """Chi-squared with 39 degrees of freedom: 99.8 % of all samples lie within 17.26..72.05."""
    n, p, state, draws = 40, 10, first_state(1), []
    for seed in range(2000):
        if source == "neighbouring seeds":
            state = first_state(seed)
        rows, state = chosen([1] * n, p, state)
        draws.append(rows)
    assert 17.26 < inclusion_statistic(draws, n, p) < 72.05


# ---------------------------------------------------------------- degenerate cases


@pytest.mark.parametrize(("usable", "p", "rows"), [
    pytest.param([], 3, [], id="no rows"), pytest.param([1, 1, 1], 0, [], id="nothing wanted"),
    pytest.param([0, 0, 0], 2, [], id="nothing usable"), pytest.param([1, 0, 1, 1], 3, [0, 2, 3], id="all wanted"),
    pytest.param([1, 0, 1, 1], 99, [0, 2, 3], id="more wanted than there are")])
def test_rows_of_a_degenerate_draw(usable, p, rows):
    kept, state = chosen(usable, p, 5)
    assert kept == rows
    assert state == 5 or sum(usable) > 0, "nothing is drawn where nothing is usable"


# ---------------------------------------------------------------- textbook numbers


def test_ten_thousandth_number_of_the_minimal_standard():
    """State 1 and multiplier 48271 give 399268537 (ISO C++, [rand.predef], minstd_rand)."""
    assert (MULTIPLIER, MODULUS) == (48271, 2**31 - 1)
    assert chosen([1] * 10000, 5000, 1)[1] == 399268537

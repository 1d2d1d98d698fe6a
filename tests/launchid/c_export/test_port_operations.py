"""Operations of the exported C, counted by numbers that count: what the documentation states is what is done."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from ported import filtered, regression

from benchmarks.port_operations import AT_MOST, COUNTED, CXX, FORMULAS, KERNELS, kernel_operations, operations, value
from sim.flight import fly
from sim.nominal import load_nominal

pytestmark = pytest.mark.skipif(shutil.which(CXX) is None, reason="no C++ compiler here")
RESULTS = Path(__file__).parents[3] / "docs" / "results.md"
STATED = [k for k, name in enumerate(COUNTED) if name != "stores"]
SIZES = [(m, q) for q in (1, 2, 3, 6, 10) for m in (10, 17, 100)]
CONFIGS = {"measured": regression("measured"), "filtered": filtered()}
BETWEEN = (39, 8, 7, 0, 0)  # loads, sums, products, quotients, roots of a sample that closes nothing: at most


@pytest.mark.parametrize("formulation", KERNELS)
def test_a_kernel_does_what_its_formulas_say(formulation):
    for name, counted in kernel_operations(formulation, CONFIGS[formulation], SIZES).items():
        for (m, q), row in zip(SIZES, counted[:, STATED].tolist(), strict=True):
            said = [value(formula, m, q) for formula in FORMULAS[name]]
            if name in AT_MOST:
                assert all(0.6 * most <= found <= most for most, found in zip(said, row, strict=True)), (name, m, q)
            else:
                assert said == row, (name, m, q)


@pytest.mark.parametrize("name", FORMULAS)
def test_the_documentation_states_these_formulas(name):
    assert f"| `{name}` | {' | '.join(FORMULAS[name])} |" in RESULTS.read_text(encoding="utf-8")


@pytest.mark.parametrize(("formulation", "library", "window"), [
    ("filtered", "theta,beta", 1.0), *(
        pytest.param(*each, marks=pytest.mark.campaign) for each in (
            ("measured", "quadratic", 1.0), ("integral", "theta,beta", 0.5), ("filtered", "quadratic", 0.5)))])
def test_a_sample_between_closes_costs_the_same_whatever_the_window_and_the_terms(formulation, library, window):
    of = filtered if formulation == "filtered" else lambda **more: regression(formulation, **more)
    flight = list(fly(load_nominal("constant"), seed=1, suite="ideal" if formulation == "measured" else "flight"))[:250]
    status, counts = operations(of(library=library, window=window), flight)
    counts = counts[:, STATED]
    least = np.unique(counts[status == 0], axis=0)  # of the filtered form, every fifth sample works off a block
    plain = least[(least <= BETWEEN).all(axis=1)]
    assert plain.max(axis=0).tolist() == list(BETWEEN)
    share = (counts <= BETWEEN).all(axis=1).mean()
    assert share > (0.75 if formulation == "filtered" else 0.95)

"""The sweep: a fault at every sample of three windows, in every field, of every kind; a bit flip anywhere in memory.

Each is refused, or flagged, or forgotten bit for bit, or moves a6 and k1 by little; which, and within how many windows,
is counted and held.  `python tests/test_faults_sweep.py` prints the tables of docs/faults.md.
"""

import dataclasses
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from cut import flip, persisting

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from launchid_core import Config, Estimate, Estimator, Sample, Status
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model

NAN, INF = math.nan, math.inf
PERIOD = 0.02        # s: rows of a window are few, so that the sweep is over in minutes
WINDOW = 1.0
ROWS = 50
BEFORE = 20          # windows flown before the three
THREE = 3 * ROWS
FIRST = BEFORE * ROWS
CHECKED = 3          # windows flown after the three
SMALL = 0.1          # standard deviations of a6 or k1
A_BAD_SAMPLE = 4.0   # standard deviations that one sample may move them
CONSTANT = load_nominal("constant")
FIELDS = Sample._fields
BITS = 20_000        # flips of a campaign; `main` takes as many as fit into its time

# what becomes of a fault
REFUSED, ANEW, FLAGGED = "refused", "found: begun anew (RECOVERED)", "used, and flagged"
FORGOTTEN, LITTLE, MORE = "forgotten bit for bit within {} windows", "moves less than 0.1 std", "moves more"

# kinds of faults: what becomes of a field's value
KINDS: dict[str, Callable[[float, float], float]] = {
    "nan": lambda x, sigma: NAN, "inf": lambda x, sigma: INF, "-inf": lambda x, sigma: -INF,
    "zero": lambda x, sigma: 0.0, "sign": lambda x, sigma: -x, "denormal": lambda x, sigma: 5e-324,
    **{f"{n:g} sigma": lambda x, sigma, n=n: x + n * sigma for n in (3, 8, 30, 1e3)},
    **{f"{value:g}": lambda x, sigma, value=value: value for value in (50.0, -1e9, 1e77, 1e154, -1e308)},
}
SIGMA = {"t": 1e-3, "theta": 2e-4, "theta_dot": 2e-4, "beta": 2e-4, "theta_ddot": 1.0, "beta_cmd": 2e-4, "gamma": 1e-3}


def config(formulation: str) -> Config:
    model = onboard_model(CONSTANT, PERIOD) if formulation == "filtered" else None
    return Config(window=WINDOW, sample_period=PERIOD, formulation=formulation, model=model)


def flight() -> list[Sample]:
    return list(fly_whole(CONSTANT, 5).samples())[::round(PERIOD / 0.01)]


def words(estimate: Estimate) -> tuple[object, ...]:
    """The values that leave with a window, to be compared to the bit."""
    return tuple(repr(getattr(estimate, f.name).tolist() if isinstance(getattr(estimate, f.name), np.ndarray)
                      else getattr(estimate, f.name)) for f in dataclasses.fields(estimate))


@dataclasses.dataclass
class Course:
    """The flight without a fault."""

    samples: list[Sample]
    states: dict[int, tuple[np.ndarray, ...]]  # memory before each sample of the three windows
    windows: dict[int, Estimate]               # by the row that closed it


def buffers(estimator: Estimator) -> tuple[np.ndarray, ...]:
    return estimator._memory.block.view(np.int64), *estimator._memory.apart.values()


def memory(estimator: Estimator) -> tuple[np.ndarray, ...]:
    return tuple(buffer.copy() for buffer in buffers(estimator))


def put_back(estimator: Estimator, state: tuple[np.ndarray, ...]) -> None:
    for buffer, kept in zip(buffers(estimator), state, strict=True):
        buffer[:] = kept


def course(formulation: str) -> Course:
    samples, estimator = flight()[:(BEFORE + 3 + CHECKED) * ROWS], Estimator(config(formulation))
    states, windows = {}, {}
    for k, sample in enumerate(samples):
        if FIRST <= k < FIRST + THREE:
            states[k] = memory(estimator)
        if estimator.update(sample) is Status.WINDOW_COMPLETE:
            windows[k] = estimator.estimate()
    return Course(samples, states, windows)


def moved(now: Estimate, was: Estimate) -> float:
    """Standard deviations by which the numbers of a window, and the tracked ones, moved."""
    pairs = [(now, was)] + ([] if now.tracked is None or was.tracked is None else [(now.tracked, was.tracked)])
    return max((max(abs(one.a6 - two.a6) / two.a6_std, abs(one.k1 - two.k1) / two.k1_std) for one, two in pairs
                if one.valid and two.valid), default=0.0)


def noted(estimator: Estimator) -> int:
    """The number of notes that the estimator has given beside estimates."""
    return sum(estimator.counts.get(name, 0) for name in ("OUTLIER", "RESTART", "STUCK", "WRAP"))


def judged(of: Course, estimator: Estimator, first: int, status: Status | None) -> tuple[str, float]:
    """The outcome of a fault before row `first`, whose sample was answered by `status`: (words, how far it moved)."""
    if status is not None and status < 0:
        return REFUSED, 0.0
    before, flagged = noted(estimator), status not in (None, Status.ACCEPTED, Status.WINDOW_COMPLETE)
    most, seen = 0.0, 0
    for k in range(first, len(of.samples)):
        answer = estimator.update(of.samples[k])
        if answer is Status.RECOVERED:
            return ANEW, most
        flagged = flagged or answer not in (Status.ACCEPTED, Status.WINDOW_COMPLETE)
        if answer is not Status.WINDOW_COMPLETE:
            continue
        seen += 1
        now, was = estimator.estimate(), of.windows.get(k)
        flagged = flagged or was is None or (was.valid and not now.valid)
        most = max(most, moved(now, was) if was is not None else 0.0)
        if was is not None and words(now) == words(was):
            return FORGOTTEN.format(seen), most
    flagged = flagged or noted(estimator) > before
    return FLAGGED if flagged else LITTLE if most < SMALL else MORE, most


def faults(of: Course) -> Iterator[tuple[str, str, int, Sample]]:
    """(field, kind, row, the sample) of every fault in the three windows."""
    for k in of.states:
        sample = of.samples[k]
        for field in FIELDS:
            for kind, change in KINDS.items():
                yield field, kind, k, sample._replace(**{field: change(getattr(sample, field), SIGMA[field])})


Found = Counter[tuple[str, str, str]]  # (field or part, kind, what became of it)


def sweep(formulation: str, every: int = 1) -> tuple[Found, dict[str, float]]:
    """The outcome of every fault, or of one of so many, and by how much each kind moved a6 or k1 at most."""
    of, estimator, found, most = course(formulation), Estimator(config(formulation)), Counter(), {}
    for number, (field, kind, k, sample) in enumerate(faults(of)):
        if number % every == 0:
            put_back(estimator, of.states[k])
            what, far = judged(of, estimator, k + 1, estimator.update(sample))
            found[field, kind, what] += 1
            if what in (LITTLE, MORE):
                most[kind] = max(most.get(kind, 0.0), far)
    return found, most


def flips(formulation: str, number: int, seed: int = 0, seconds: float = math.inf) -> Found:
    """The outcome of so many flipped bits (or as many as fit into the time), anywhere in the state, at any sample."""
    of, estimator, found = course(formulation), Estimator(config(formulation)), Counter()
    parts = list(persisting(estimator).items())
    ends = np.cumsum([own.size for _, own in parts])
    random, start = np.random.default_rng(seed), time.monotonic()
    for turn in range(number):
        if turn % 1000 == 0 and time.monotonic() - start > seconds:
            break
        k, at, bit = FIRST + int(random.integers(THREE)), int(random.integers(ends[-1])), random.integers(64)
        put_back(estimator, of.states[k])
        part = int(np.searchsorted(ends, at, "right"))
        name, own = parts[part]
        flip(own, int(at - (ends[part - 1] if part else 0)), int(bit))
        if name.startswith("outcome"):
            assert isinstance(estimator.estimate(), Estimate)
        what, _ = judged(of, estimator, k, None)
        found[name.split(".")[0], "flip", what] += 1
    return found


def share_of(found: Found, what: str) -> float:
    return sum(n for (_, _, w), n in found.items() if w == what) / sum(found.values())


@pytest.mark.campaign
def test_a_fault_at_every_sample_field_and_kind_of_a_regression_is_refused_or_forgotten_within_two_windows():
    found, _ = sweep("integral")
    assert {what for _, _, what in found} <= {REFUSED, FLAGGED, FORGOTTEN.format(1), FORGOTTEN.format(2)}, table(found)


@pytest.mark.campaign
def test_a_fault_at_every_sample_field_and_kind_of_the_filter_is_refused_flagged_forgotten_or_a_measurement():
    """A fault that is none of these moves a6 and k1 as far as one sample may."""
    found, most = sweep("filtered", 4)
    assert {field for field, _, what in found if what == MORE} <= {"t", "theta", "theta_dot", "beta", "beta_cmd"}
    assert share_of(found, MORE) < 0.15
    assert max(most.values()) < A_BAD_SAMPLE, most


@pytest.mark.campaign
@pytest.mark.parametrize("formulation", ["integral", "filtered"])
def test_a_flipped_bit_anywhere_is_flagged_or_forgotten(formulation):
    found = flips(formulation, BITS)
    assert share_of(found, MORE) == share_of(found, LITTLE) == 0.0, table(found)


def test_some_faults_and_flips_of_the_sweep():
    found, _ = sweep("integral", 97)
    assert share_of(found, MORE) == share_of(found, LITTLE) == 0.0, table(found)
    for formulation in ("integral", "filtered"):
        found = flips(formulation, 300)
        assert share_of(found, MORE) == share_of(found, LITTLE) == 0.0, table(found)


def table(found: Found) -> str:
    whats = {what: sum(n for (_, _, w), n in found.items() if w == what) for _, _, what in sorted(found)}
    return "\n".join(["", *(f"{what:60}{n:9d}" for what, n in whats.items()), f"{'all':60}{sum(found.values()):9d}"])


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 150.0
    for formulation in ("integral", "filtered"):
        start = time.monotonic()
        found, most = sweep(formulation, 1 if formulation == "integral" else 4)
        print(f"== {formulation}: faults, {time.monotonic() - start:.0f} s{table(found)}")
        print("moved at most [std]:", {kind: round(far, 2) for kind, far in most.items()})
        print("more by kind:", Counter({kind: sum(n for (_, k, w), n in found.items() if k == kind and w == MORE)
                                        for _, kind, _ in found}), flush=True)
        print(f"== {formulation}: flipped bits{table(flips(formulation, 10**9, seconds=seconds))}", flush=True)


if __name__ == "__main__":
    main()

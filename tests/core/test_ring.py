"""The gate and the ring: every status and every window against a plain Python model of the contract.

Stamps are whole numbers of 1/1024 s, so the model's integer arithmetic is exact.
"""

import itertools
import math

import numpy as np
import pytest
from cut import fed, persisting, scratch
from every import every
from hypothesis import given, settings
from hypothesis import strategies as hs
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from unjitted import unjitted

from launchid_core import Config, Estimator, Sample, Status
from launchid_core.gate import ring as rb
from launchid_core.order import table
from launchid_core.order.memory import named_arrays

TICK = 1.0 / 1024.0
PERIOD = 16              # ticks
MAX_GAP = 24             # ticks: 1.5 periods, the default
RESET_COUNT = 5
NAN, INF = math.nan, math.inf
CHANNELS = ("t", "theta", "theta_dot", "beta")
LIMITS = {"t": 1e10, "theta": 100.0, "theta_dot": 1000.0, "beta": 1000.0, "theta_ddot": 1e5, "beta_cmd": 1000.0,
          "gamma": 100.0}


def small_config(window: int = 6 * PERIOD, **more) -> Config:
    return Config(window=window * TICK, sample_period=PERIOD * TICK, **more)


def values(k: int) -> dict[str, float]:
    """Something to measure, different at every sample."""
    return {"theta": math.sin(0.7 * k), "theta_dot": math.cos(0.3 * k), "beta": math.sin(1.9 * k + 1.0),
            "theta_ddot": math.cos(1.1 * k), "beta_cmd": math.sin(2.3 * k),
            "gamma": math.sin(0.7 * k)}


def arrays(estimator: Estimator) -> dict[str, np.ndarray]:
    """Everything that an estimator remembers from one sample to the next."""
    return persisting(estimator)


def snapshot(estimator: Estimator) -> dict[str, np.ndarray]:
    return {name: array.copy() for name, array in arrays(estimator).items()}


def addresses(estimator: Estimator) -> list[int]:
    memory = estimator._memory
    every = (*(a for _, a in named_arrays(memory.parts)), *memory.apart.values())
    return [a.__array_interface__["data"][0] for a in every]


def assert_changed_nothing_but_a_counter(before: dict[str, np.ndarray], estimator: Estimator, status: Status) -> None:
    """Byte for byte; an earlier stamp is also followed by count.candidates and clock.candidate."""
    before = {name: array.copy() for name, array in before.items()}
    before["counts.answers"][status - Status.BUSY] += 1
    if status == Status.DT_NEGATIVE:
        for name in ("counts.candidates", "clock.candidate", "guard.control"):
            before[name] = arrays(estimator)[name]
    for name, array in arrays(estimator).items():
        assert array.tobytes() == before[name].tobytes(), name


def closed_rows(estimator: Estimator) -> np.ndarray:
    """(rows, 6) of the window that just closed, read out of the ring."""
    signal = np.full((rb.N_COLUMNS, estimator.config.rows), np.nan)
    ring, counts = estimator._memory.apart["ring"], estimator._parts.state.counts
    n, left_out = unjitted(rb.copy_window)(ring, counts, np.full(rb.N_COLUMNS, INF), signal)
    assert left_out == 0
    return signal[:, :n].T


class Model:
    """The contract's windows and clock in integer ticks, with lists instead of rings."""

    def __init__(self, window: int, rows: int) -> None:
        self.window, self.rows = window, rows
        self.first = self.last = None
        self.index = 0
        self.open: list[Sample] = []
        self.candidates: list[int] = []
        self.calls = dict.fromkeys(Status, 0)
        self.closed: tuple[int, list[Sample]] | None = None

    def update(self, tick: int | None, sample: Sample) -> Status:
        status = self.judge(tick, sample)
        self.calls[status] += 1
        return status

    def judge(self, tick: int | None, sample: Sample) -> Status:
        if tick is None or not all(map(math.isfinite, (sample.theta, sample.beta))) or any(map(math.isinf, sample)):
            return Status.NONFINITE
        if any(abs(x) > LIMITS[name] for name, x in sample._asdict().items()):
            return Status.RANGE
        status = Status.ACCEPTED
        if self.last is not None:
            step = tick - self.last
            if step == 0:
                return Status.DT_ZERO
            if step < 0:
                follows = bool(self.candidates) and 0 < tick - self.candidates[-1] <= MAX_GAP
                self.candidates = [*self.candidates, tick] if follows else [tick]
                if len(self.candidates) < RESET_COUNT:
                    return Status.DT_NEGATIVE
                status = Status.CLOCK_RESET
            elif step > MAX_GAP:
                status = Status.AFTER_GAP
        if self.last is None or status == Status.CLOCK_RESET:
            self.first, self.index, self.open = tick, 0, []
        self.candidates = []
        self.last = tick
        return Status.WINDOW_COMPLETE if self.take(tick, sample) else status

    def take(self, tick: int, sample: Sample) -> bool:
        """Put an accepted sample into its window; True if that closes one."""
        number = (tick - self.first) // self.window
        complete = number > self.index and bool(self.open)
        if complete:
            self.close()
        self.index = max(self.index, number)
        if number == self.index:
            self.open.append(sample)
        end = self.first + (self.index + 1) * self.window
        if not complete and self.open and 2 * tick + 3 * PERIOD > 2 * end:
            self.close()
            self.index += 1
            complete = True
        return complete

    def close(self) -> None:
        self.closed = (self.first + self.index * self.window, self.open[-self.rows:])
        self.open = []


class RingMachine(RuleBasedStateMachine):
    """Any mixture of good, jittered, missing, repeated, backward, absurd and broken samples."""

    window = 6 * PERIOD

    @initialize(start=hs.sampled_from([0, 5, -3000, 1_700_000_000 * 1024]))
    def build(self, start: int) -> None:
        self.estimator = Estimator(small_config(self.window))
        self.nbytes, self.addresses = self.estimator.nbytes, addresses(self.estimator)
        self.model = Model(self.window, self.estimator.config.rows)
        self.start, self.k = start, 0
        self.feed(start)

    def feed(self, tick: int | None, **replaced: float) -> None:
        self.k += 1
        sample = Sample(**{"t": NAN if tick is None else tick * TICK, **values(self.k), **replaced})
        before = snapshot(self.estimator)
        expected = self.model.update(tick if math.isfinite(sample.t) else None, sample)
        status = self.estimator.update(sample)
        assert status is expected
        if status < 0:
            assert_changed_nothing_but_a_counter(before, self.estimator, status)
        if status == Status.WINDOW_COMPLETE:
            t_start, rows = self.model.closed
            estimate = self.estimator.estimate()
            assert (estimate.t_start, estimate.t_end) == (t_start * TICK, (t_start + self.window) * TICK)
            assert np.array_equal(closed_rows(self.estimator), np.array(rows), equal_nan=True)

    @rule(n=hs.integers(1, 20))
    def steady(self, n: int) -> None:
        for _ in range(n):
            self.feed(self.model.last + PERIOD)

    @rule(steps=hs.lists(hs.integers(1, MAX_GAP), min_size=1, max_size=8))
    def jittered(self, steps: list[int]) -> None:
        for step in steps:
            self.feed(self.model.last + step)

    @rule(step=hs.integers(MAX_GAP - 1, 40 * PERIOD))
    def gap(self, step: int) -> None:
        self.feed(self.model.last + step)

    @rule(name=hs.sampled_from(Sample._fields), value=hs.sampled_from([NAN, INF, -INF]))
    def broken(self, name: str, value: float) -> None:
        self.feed(self.model.last + PERIOD, **{name: value})

    @rule(name=hs.sampled_from(Sample._fields), value=hs.sampled_from([1.001e10, -1e77, 1e300]))
    def absurd(self, name: str, value: float) -> None:
        self.feed(self.model.last + PERIOD, **{name: value})

    @rule()
    def repeated(self) -> None:
        self.feed(self.model.last)

    @rule(back=hs.integers(1, 100 * PERIOD))
    def backward(self, back: int) -> None:
        self.feed(self.model.last - back)

    @rule(back=hs.integers(10 * PERIOD, 10**6), steps=hs.lists(hs.integers(1, MAX_GAP + 2), min_size=3, max_size=7))
    def clock_set_back(self, back: int, steps: list[int]) -> None:
        tick = self.model.last - back
        for step in steps:
            tick += step
            self.feed(tick)

    @invariant()
    def counts_add_up(self) -> None:
        if hasattr(self, "model"):
            counts = {status: self.estimator.counts[status.name] for status in Status}
            assert counts == self.model.calls and sum(counts.values()) == self.k

    @invariant()
    def memory_stays(self) -> None:
        if hasattr(self, "model"):
            assert self.estimator.nbytes == self.nbytes
            assert addresses(self.estimator) == self.addresses


class OddRingMachine(RingMachine):
    """A window that is no whole number of periods: 6.25."""

    window = 100


TestRing = RingMachine.TestCase
TestOddRing = OddRingMachine.TestCase
TestRing.settings = TestOddRing.settings = settings(stateful_step_count=25)


def push_all(stamps: np.ndarray, window: float, period: float) -> list[int]:
    """Statuses of samples at these stamps from the kernel alone (no estimate is computed)."""
    limits, clock, count = scratch(table.LIMITS, 2), scratch(table.CLOCK, 2), scratch(table.COUNTS, 2)
    limits.period, limits.window, limits.max_gap = period, window, 1.5 * period
    limits.largest[:] = 1e12
    ring = np.zeros((round(window / period) + 1, rb.N_COLUMNS))
    push = unjitted(rb.push)
    return [push(limits, clock, count, ring, t, 0.1, 0.2, 0.3, NAN, NAN, NAN) for t in stamps.tolist()]


# ---- windows


def test_seventy_seconds_at_1_khz_give_70_windows():
    statuses = push_all(np.arange(70_000) * 0.001, 1.0, 0.001)
    complete = [k for k, status in enumerate(statuses) if status == Status.WINDOW_COMPLETE]
    assert complete == list(range(999, 70_000, 1000))
    assert set(statuses) == {Status.ACCEPTED, Status.WINDOW_COMPLETE}


@given(first=hs.floats(-1e9, 1e9), rows=hs.integers(4, 50), period=hs.sampled_from([1e-3, 0.01, 1 / 3, 0.1, 2.0]),
       windows=hs.integers(1, 4), extra=hs.integers(0, 3))
def test_rounded_stamps_close_every_full_window_with_its_last_sample(first, rows, period, windows, extra):
    statuses = push_all(first + np.arange(rows * windows + extra) * period, rows * period, period)
    complete = [k for k, status in enumerate(statuses) if status == Status.WINDOW_COMPLETE]
    assert complete == [rows * (w + 1) - 1 for w in range(windows)]


def test_missing_last_sample_closes_the_window_with_the_first_one_after():
    estimator = Estimator(small_config())
    ticks = [k * PERIOD for k in range(9) if k != 5]
    statuses = [estimator.update(Sample(tick * TICK, **values(k))) for k, tick in enumerate(ticks)]
    assert statuses[:5] == [Status.ACCEPTED] * 5
    assert statuses[5] is Status.WINDOW_COMPLETE
    assert statuses[6:] == [Status.ACCEPTED] * 2
    assert estimator.estimate().t_start == 0.0


@pytest.mark.parametrize("windows", [1, 2, 3, 7, 8])
def test_ring_wraps_and_holds_the_newest_window(windows):
    """The ring has 7 places for windows of 6: every phase of the wrap comes by."""
    estimator = Estimator(small_config())
    samples = [Sample(k * PERIOD * TICK, **values(k)) for k in range(6 * windows)]
    fed(estimator, samples)
    assert np.array_equal(closed_rows(estimator), np.array(samples[-6:]))


def test_windows_without_a_sample_are_passed_over():
    estimator = Estimator(small_config())
    for k, tick in enumerate([*range(0, 96, 16), *range(960, 1056, 16)]):
        estimator.update(Sample(tick * TICK, **values(k)))
    assert estimator.counts["WINDOW_COMPLETE"] == 2
    assert estimator.estimate().t_start == 960 * TICK


# ---- what is rejected


@every("period", [1e-3, 0.01, 1.0])
def test_stamps_a_millionth_of_a_period_apart_are_one_instant(period):
    """The rounding of k*period in a clock since 1970 is far below; a jitter that can be meant is above."""
    for share, status in ((0.0, Status.DT_ZERO), (0.9e-6, Status.DT_ZERO), (-0.9e-6, Status.DT_ZERO),
                          (1.2e-6, Status.ACCEPTED), (-1.2e-6, Status.DT_NEGATIVE)):
        estimator = Estimator(Config(window=100.0 * period, sample_period=period))
        estimator.update(Sample(0.0, 0.1, 0.2, 0.3))
        assert estimator.update(Sample(share * period, 0.1, 0.2, 0.3)) is status, share


@every("value", [NAN, INF, -INF])
@every("broken", [names for n in range(1, 5) for names in itertools.combinations(CHANNELS, n)])
def test_nonfinite_channels(broken, value):
    """All 15 combinations; a NaN in theta_dot alone is a rate that was not measured."""
    estimator = Estimator(small_config())
    for k in range(8):
        estimator.update(Sample(k * PERIOD * TICK, **values(k)))
    sample = Sample(8 * PERIOD * TICK, **values(8))
    before = snapshot(estimator)
    status = estimator.update(sample._replace(**dict.fromkeys(broken, value)))
    if broken == ("theta_dot",) and math.isnan(value):
        assert status is Status.ACCEPTED
    else:
        assert status is Status.NONFINITE
        assert_changed_nothing_but_a_counter(before, estimator, status)
        assert estimator.update(sample) is Status.ACCEPTED


@pytest.mark.parametrize("name", Sample._fields)
def test_range_ends_at_the_limit(name):
    estimator = Estimator(small_config(max_gap=1e10))
    estimator.update(Sample(0.0, **values(0)))
    beyond = math.nextafter(LIMITS[name], INF)
    for value in (beyond, -beyond):
        before = snapshot(estimator)
        assert estimator.update(Sample(PERIOD * TICK, **values(1))._replace(**{name: value})) is Status.RANGE
        assert_changed_nothing_but_a_counter(before, estimator, Status.RANGE)
    assert estimator.update(Sample(PERIOD * TICK, **values(1))._replace(**{name: LIMITS[name]})) >= 0


# ---- the clock


def test_one_good_stamp_ends_the_suspicion_of_a_reset():
    stamps = np.array([1.0, *(0.01 * k for k in range(4)), 1.01, *(0.01 * k for k in range(4))])
    statuses = push_all(stamps, 1.0, 0.01)
    assert statuses == [0, *[Status.DT_NEGATIVE] * 4, 0, *[Status.DT_NEGATIVE] * 4]


def test_earlier_stamps_that_disagree_never_reset_the_clock():
    stamps = np.array([1.0, *(0.5 - 0.02 * k for k in range(20)), *(0.03 * k for k in range(20))])
    assert push_all(stamps, 1.0, 0.01)[1:] == [Status.DT_NEGATIVE] * 40


# ---- re-entrancy


def test_busy_estimator_changes_nothing_but_a_counter():
    estimator = Estimator(small_config())
    estimator.update(Sample(0.0, **values(0)))
    before = snapshot(estimator)
    estimator._busy = True
    assert estimator.update(Sample(PERIOD * TICK, **values(1))) is Status.BUSY
    assert_changed_nothing_but_a_counter(before, estimator, Status.BUSY)
    estimator._busy = False
    assert estimator.update(Sample(PERIOD * TICK, **values(1))) is Status.ACCEPTED


def test_update_from_within_update_is_busy():
    estimator = Estimator(small_config())
    inner = []

    class Nested:
        def __iter__(self):
            inner.append(estimator.update(Sample(5.0, **values(5))))
            return iter(Sample(0.0, **values(0)))

    assert estimator.update(Nested()) is Status.ACCEPTED
    assert inner == [Status.BUSY]
    assert estimator.counts["BUSY"] == 1
    assert sum(estimator.counts.values()) == 2
    assert estimator._memory.apart["ring"][0, rb.T] == 0.0


@pytest.mark.parametrize("wrong", [("0", *(0.1,) * 6), (0.0, None, *(0.1,) * 5), (0.0, 0.1, 0.1), (0.0,) * 8,
                                   None, 5, "a", (1.0, 2.0), (0.0, "a", None, 1.0, 1.0, 1.0, 1.0)])
def test_what_is_no_sample_raises_before_any_change_and_leaves_no_busy_flag(wrong):
    estimator = Estimator(small_config())
    estimator.update(Sample(0.0, **values(0)))
    before = snapshot(estimator)
    plain = r"^update: expected a Sample, 7 floats \(t, theta, .*\); got [A-Za-z]+( of \d)?$"
    with pytest.raises(TypeError, match=plain):
        estimator.update(wrong)
    assert all(array.tobytes() == before[name].tobytes() for name, array in arrays(estimator).items())
    assert estimator.update(Sample(PERIOD * TICK, **values(1))) is Status.ACCEPTED

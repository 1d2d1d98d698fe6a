"""The proof by flights: the numbers of the literature, a confidence that holds under stopping, its words."""

import functools
import math

import numpy as np
import pytest
from every import every
from scipy.stats import beta, binom

from launchid.cli.main import main
from launchid.monte_carlo.requirement.flight import METRICS
from launchid.monte_carlo.requirement.grammar import requirement
from launchid.monte_carlo.requirement.sequential import Planned, Sequential, wilks_rank
from launchid.monte_carlo.requirement.watch import Count, Watch

PROBABILITY, CONFIDENCE = 0.00135, 0.9   # of Hanson & Beard: 99.865 % with 10 % consumer's risk


# ---- a planned number of flights


@pytest.mark.parametrize(("share", "confidence", "flights"), [
    (0.99865, 0.9, [1705, 2880]),   # Hanson & Beard, NASA/TP-2010-216447
    (0.95, 0.95, [59, 93, 124]),    # Wilks 1941; Guba, Makai & Pal, Reliability Engineering & System Safety 80, 2003
    (0.95, 0.9, [45, 77]),          # success runs, tables of zero- and one-failure demonstration tests
    (0.9, 0.9, [22, 38])])
def test_plans_of_the_literature(share, confidence, flights):
    rule = Planned(1.0 - share, confidence)
    assert [rule.flights_needed(failures) for failures in range(len(flights))] == flights
    for failures, n in enumerate(flights):
        assert rule.is_met(n, failures) and not rule.is_met(n - 1, failures) and not rule.is_met(n, failures + 1)
        assert wilks_rank(n, share, confidence) == failures + 1 and rule.allowed(n) == failures


@pytest.mark.parametrize(("n", "failures"), [(1, 0), (1, 1), (10, 0), (10, 4), (10, 10), (1705, 0), (5000, 12)])
def test_its_bounds_are_clopper_and_pearsons(n, failures):
    low, high = Planned(0.1, 0.9).bounds(n, failures)
    assert high == (pytest.approx(beta.ppf(0.9, failures + 1, n - failures), rel=1e-9) if failures < n else 1.0)
    assert low == (pytest.approx(beta.ppf(0.1, failures, n - failures + 1), rel=1e-9) if failures > 0 else 0.0)
    for probability in (0.5 * low, 1.5 * low, 0.99 * high, min(1.01 * high, 0.999)):
        if 0.0 < probability < 1.0:
            rule = Planned(probability, 0.9)
            assert rule.is_met(n, failures) == (probability > high)
            assert rule.is_refuted(n, failures) == (probability < low)


# ---- a rule that may stop


@functools.cache
def needed(failures: int) -> int:
    return Sequential(PROBABILITY, CONFIDENCE).flights_needed(failures)


def stopped(p: float, most: int, rng: np.random.Generator) -> tuple[str, int, int]:
    """(verdict, flights, failures) of a campaign of at most so many flights that fail with p, drawn as waits."""
    rule, n = Sequential(PROBABILITY, CONFIDENCE), 0
    for failures in range(most):
        fails_at = n + int(rng.geometric(p))
        if min(fails_at - 1, most) >= needed(failures):
            return "met", max(needed(failures), n), failures
        if fails_at > most:
            return "undecided", most, failures
        n = fails_at
        if rule.is_refuted(n, failures + 1):
            return "not met", n, failures + 1
    raise AssertionError


@pytest.mark.parametrize("p", [0.25, 0.5, 1.0, 2.0, 4.0])
def test_thousand_campaigns_that_stop_say_what_is_wrong_no_more_often_than_they_may(p):
    """Verdicts, and both bounds at the flight where it stopped: each wrong in at most 10 % of 1,000 campaigns."""
    true, rng = p * PROBABILITY, np.random.default_rng(16)
    ends = [stopped(true, 20_000, rng) for _ in range(1000)]
    wrong = {"met": 1.0 <= p, "not met": p <= 1.0}
    for verdict, is_wrong in wrong.items():
        if is_wrong:
            assert sum(end[0] == verdict for end in ends) <= 100, verdict
    at_truth = Sequential(true, CONFIDENCE)
    assert sum(at_truth.is_met(n, failures) for _, n, failures in ends) <= 100, "upper bounds below the truth"
    assert sum(at_truth.is_refuted(n, failures) for _, n, failures in ends) <= 100, "lower bounds above the truth"
    decided = np.mean([end[0] != "undecided" for end in ends])
    assert decided > {0.25: 0.98, 0.5: 0.7, 1.0: 0.0, 2.0: 0.7, 4.0: 0.98}[p], "and it does decide"


def exact_wrong(boundary: list[int], most: int) -> float:
    """Probability that a campaign of vehicles at the asked probability ever has k failures or fewer at boundary[k]."""
    at = np.array([1.0])    # of 0, 1, ... failures and no verdict, just after the last look
    wrong, n = 0.0, 0
    for allowed, look in enumerate(boundary):
        if look > most:
            break
        new = np.convolve(at, np.exp(binom.logpmf(np.arange(400), look - n, PROBABILITY)))
        wrong += float(np.sum(new[:allowed + 1]))
        new[:allowed + 1] = 0.0
        at, n = new, look
    return wrong


def test_the_risk_of_a_wrong_met_is_what_it_may_be_exactly():
    """The whole path, not a sample of it; and what looking without the right to look would risk."""
    honest = exact_wrong([needed(k) for k in range(60)], 50_000)
    assert 0.07 < honest <= 0.1
    plan = Planned(PROBABILITY, CONFIDENCE)
    assert exact_wrong([plan.flights_needed(k) for k in range(60)], 50_000) > 0.3, "a plan looked at all the time"
    assert exact_wrong([1705], 1705) == pytest.approx(0.1, rel=1e-2)


@every("confidence", [0.5, 0.9, 0.99])
@every(("n", "failures"), [(1, 0), (1, 1), (10, 3), (300, 0), (300, 1), (300, 299), (20_000, 40)])
def test_bounds_and_verdicts_are_one(n, failures, confidence):
    """The upper bound is below p when, and only when, p is proved; the lower likewise."""
    low, high = Sequential(0.1, confidence).bounds(n, failures)
    assert 0.0 <= low <= failures / n <= high <= 1.0
    for probability in np.geomspace(1e-9, 0.999, 40).tolist():
        rule = Sequential(probability, confidence)
        assert rule.is_met(n, failures) == (probability >= high)
        assert rule.is_refuted(n, failures) == (probability <= low)
    plan_low, plan_high = Planned(0.1, confidence).bounds(n, failures)
    assert low <= plan_low and high >= plan_high, "looking is not free"


# ---- counting


ROW = {"lost": 0, **dict.fromkeys(METRICS, 0.1), "end": 1.0}
LOST = {**ROW, "lost": 1}


def test_watching_in_any_order_is_counting_in_the_order_of_the_seeds():
    rng = np.random.default_rng(3)
    for p in (0.0, 0.02, 0.05, 0.3):
        outcomes = [LOST if rng.random() < p else ROW for _ in range(3000)]
        asked = [requirement("lost<0.05@0.9"), requirement("max_beta<0.2:0.97@0.8")]
        straight = Watch(asked, planned=False)
        n = next((n for k, outcome in enumerate(outcomes) if (n := straight(k, outcome)) is not None), None)
        mixed = Watch(asked, planned=False)
        found = None
        for start in range(0, 3000, 50):
            for k in (start + rng.permutation(50)).tolist() * 2:  # each comes twice
                if found is None:
                    found = mixed(k, outcomes[k])
        assert found == n
        assert [c.verdict for c in straight.counts] == [c.verdict for c in mixed.counts]


def test_a_flight_without_a_result_speaks_for_nobody():
    def verdict(error: str | None, others: object, n: int) -> str:
        count = Count(requirement("lost<0.1@0.9"), Planned(0.1, 0.9))
        for outcome in [*[error] * (error is not None), *[others] * n]:
            count.take(outcome)
        count.look()
        return count.verdict
    assert verdict(None, ROW, 22) == "met" and verdict("KeyError: x", ROW, 22) == "undecided"
    assert verdict("KeyError: x", ROW, 37) == "met", "as if it had failed: 38 flights with one failure"
    assert verdict(None, LOST, 1) == "not met"
    assert verdict("KeyError: x", ROW, 0) == "undecided", "and not as if it had failed"


def test_a_flight_that_is_lost_or_no_number_fails_whatever_is_asked():
    asked = requirement("max_alpha<0.2:0.99@0.9")
    assert not asked.fails(ROW) and asked.fails(LOST)
    assert asked.fails({**ROW, "max_alpha": 0.2}) and asked.fails({**ROW, "max_alpha": math.nan})


# ---- words


def test_a_requirement_as_text():
    asked = requirement(" max_beta_rate < 3e-1 : 0.99865 @ .9 ")
    assert (asked.metric, asked.limit, asked.probability, asked.confidence) == ("max_beta_rate", 0.3, 0.00135, 0.9)
    assert requirement("lost<0.00135@0.9").probability == 0.00135
    assert {"lost", *METRICS} == {"lost", "max_theta_error", "max_theta_dot", "max_alpha", "max_beta", "max_beta_rate"}


@every(("text", "said"), [
    ("", "expected lost<PROBABILITY@CONFIDENCE"), ("lost", "expected"), ("lost>0.1@0.9", "expected"),
    ("lost<0.1", "expected"), ("lost<0.1:0.9@0.9", "expected"),
    ("max_beta<0.1@0.9", "METRIC<VALUE:SHARE@CONFIDENCE"), ("max_gamma<0.1:0.9@0.9", "max_gamma is not measured"),
    ("lost<1@0.9", "the probability 1: expected between 0 and 1"), ("lost<0@0.9", "the probability 0"),
    ("lost<0.1@1.0", "the confidence 1.0"), ("lost<-0.1@0.9", "the probability -0.1"),
    ("max_beta<0.1:1.5@0.9", "the share 1.5"), ("max_beta<-1:0.5@0.9", "above 0 rad"), ("lost<nan@0.9", "expected"),
    ("lost<0.1@0.9\nlost", "expected"), ("x" * 5000, "..."), ("lost<1e-400@0.9", "the probability 1e-400"),
    ("max_beta<1e999:0.5@0.9", "above 0 rad"), ("lost<0.٣@0.9", "expected")])
def test_a_wrong_text_is_one_line(tmp_path, capsys, text, said):
    out = tmp_path / "out"
    assert main(["campaign", "constant", "--flights", "10", "--out", str(out), f"--requirement={text}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and "--requirement" in line and len(line) < 400
    assert not out.exists()


@pytest.mark.parametrize(("words", "status", "said"), [
    ([], 2, "expected --flights N, or --merge"), (["--flights", "0"], 2, "--flights 0"),
    (["--flights", "5", "--seed", "-1"], 2, "--seed -1"), (["--flights", "5", "--workers", "0"], 2, "--workers 0"),
    (["--flights", "5", "--executor", "slurm"], 2, "expected local, or dask:ADDRESS"),
    (["--flights", "5", "--executor", "dask:"], 2, "dask:ADDRESS"),
    (["--flights", "5", "--merge", "x"], 2, "one of them"), (["--merge", "nowhere"], 3, "nowhere/campaign.json")])
def test_wrong_words_are_one_line(tmp_path, capsys, words, status, said):
    out = tmp_path / "out"
    assert main(["campaign", "constant", "--out", str(out), *words]) == status
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and not out.exists()

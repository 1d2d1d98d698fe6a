"""What a campaign's flights prove of a probability of failure: a number that was planned, or as many as it takes.

A planned number: of n independent flights that fail with probability p the number of failures is binomial.  k failures
of n prove that the probability is below p with confidence C if k or fewer would come with a probability of at most
1 - C if it were p.  Then, too, the (k + 1)-th largest of n values is above their quantile of order 1 - p with
confidence C (Wilks, Annals of Mathematical Statistics 12, 1941; Hanson & Beard, NASA/TP-2010-216447: 99.865 % with
confidence 90 % takes 1,705 flights without a failure, 2,880 with one).  The bounds are those of Clopper & Pearson,
Biometrika 26, 1934, one-sided.  It holds for a number of flights that was fixed before the first.

A campaign that is looked at after every flight and stops when it knows: a test that stays true whenever it stops.

Against a probability of failure p the evidence of n flights with k failures is the likelihood ratio of other
probabilities to p, averaged over them with weights that were fixed before:

    E_n(p) = mean_j (p_j/p)^k ((1 - p_j)/(1 - p))^(n - k)

It is what a player of stake 1 has who bets at fair odds that flights fail with p_j rather than p.  If they fail with p
(or more, all p_j being below; or less, all being above) E_n is a supermartingale, and the probability that it ever
reaches 1/(1 - C), at whatever flight, is at most 1 - C (Ville 1939; Robbins, Annals of Mathematical Statistics 41,
1970; Howard, Ramdas, McAuliffe & Sekhon, Annals of Statistics 49, 2021; Ramdas, Gruenwald, Vovk & Shafer, Statistical
Science 38, 2023).  So a campaign may stop at any flight, for any reason, and go on afterwards: what it said with
confidence C is wrong in at most 1 - C of all campaigns.

What it costs, for 99.865 % with 90 %: 2,210 flights without a failure where a plan takes 1,705, 4,257 with one where it
takes 2,880.  What it buys: such a vehicle is known after 2,210 flights of however many were allowed.

The weights.  Below p: p_j = p q_j^2, q_j evenly spread in 0..1 (Jeffreys' Beta(1/2, .) on so short a stretch), which
bets most on a vehicle far better than asked and still learns from failures.  Above: p_j = p^(q_j), even in log p.

`Watch` counts a campaign's flights in the order of their seeds, and says when its requirements are decided.

Flights end in any order on many workers; what is said depends on the first n by their numbers alone, so it is the same
whoever flew them.  A flight without a result (an error) counts against the verdict that is asked: as failed where the
requirement would be met, as flown well where it would be refuted.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..journal import Outcome
from .grammar import Requirement


def cumulative(most: int, flights: int, probability: float) -> np.ndarray:
    """Return (most + 1,) the binomial probabilities of at most 0, 1, ... `most` failures in `flights` flights, each
    failing with `probability`."""
    j = np.arange(1, most + 1)
    ratios = np.log((flights - j + 1) / j) + (math.log(probability) - math.log1p(-probability))
    first = flights * math.log1p(-probability)
    return np.cumsum(np.exp(np.concatenate([[first], first + np.cumsum(ratios)])))


def wilks_rank(n: int, share: float, confidence: float) -> int:
    """Return the largest r such that the r-th largest of n values bounds `share` of all with `confidence`; 0: too
    few."""
    return 0 if n == 0 else int(np.sum(cumulative(n - 1, n, 1.0 - share) <= 1.0 - confidence))


@dataclass(frozen=True)
class Planned:
    """Test of a planned number n of flights, judged once all are flown: is the probability of failure below or above
    `probability`, with `confidence`."""

    probability: float
    confidence: float

    def allowed(self, n: int) -> int:
        """Return the most failures of n flights that prove a probability below `probability`; -1: n are too few."""
        return wilks_rank(n, 1.0 - self.probability, self.confidence) - 1

    def is_met(self, n: int, failures: int) -> bool:
        return failures <= self.allowed(n)

    def is_refuted(self, n: int, failures: int) -> bool:
        """Whether the failures of n flights prove a probability of failure above `probability`."""
        return failures > 0 and self._at_least(n, failures, self.probability) <= 1.0 - self.confidence

    def flights_needed(self, failures: int) -> int:
        """Return the least number of flights that, with so many failures, proves a probability below `probability`."""
        high = failures + 1
        while not self._proves(high, failures, self.probability):
            high *= 2
        low = failures
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._proves(middle, failures, self.probability) else (middle, high)
        return high

    def bounds(self, n: int, failures: int) -> tuple[float, float]:
        """Return (lower, upper) bound of the probability of failure, each one-sided with `confidence`."""
        upper = 1.0 if failures == n else halved(
            failures / n, 1.0, lambda p: self._proves(n, failures, p))
        lower = 0.0 if failures == 0 else halved(
            failures / n, 0.0, lambda p: self._at_least(n, failures, p) <= 1.0 - self.confidence)
        return lower, upper

    def _proves(self, n: int, failures: int, probability: float) -> bool:
        return failures < n and float(cumulative(failures, n, probability)[-1]) <= 1.0 - self.confidence

    @staticmethod
    def _at_least(n: int, failures: int, probability: float) -> float:
        """Return the probability of so many failures or more: of as few successes."""
        return float(cumulative(n - failures, n, 1.0 - probability)[-1])


def halved(inside: float, outside: float, holds: Callable[[float], bool]) -> float:
    """Return by bisection where `holds`, False at `inside`, turns True towards `outside` (which is not evaluated)."""
    for _ in range(60):  # to the last bits of a double
        middle = 0.5 * (inside + outside)
        inside, outside = (inside, middle) if holds(middle) else (middle, outside)
    return outside


BETS = 64                # more change no boundary by a hundredth
SPREAD = (np.arange(BETS) + 0.5) / BETS
MIN_PROBABILITY = 1e-15  # a probability that no campaign can tell from 0


def log_evidence(n: int, failures: int, probability: float, others: np.ndarray) -> float:
    """Return log E_n: the evidence of n flights against `probability` for `others` (m,), weighted equally."""
    ratio = failures * np.log(others / probability) + (n - failures) * (np.log1p(-others) - math.log1p(-probability))
    largest = float(np.max(ratio))
    return largest + math.log(float(np.mean(np.exp(ratio - largest))))


def below(probability: float) -> np.ndarray:
    """Return alternatives (BETS,) below `probability`: where flights favour them, they speak against `probability` and
    any larger one."""
    return probability * SPREAD**2


def above(probability: float) -> np.ndarray:
    """Return alternatives (BETS,) above `probability`: where flights favour them, they speak against `probability` and
    any smaller one."""
    return probability**SPREAD


@dataclass(frozen=True)
class Sequential:
    """Test as `Planned`, but valid after any number of flights, whenever the campaign stops (see the module)."""

    probability: float
    confidence: float

    def is_met(self, n: int, failures: int) -> bool:
        """Whether the failures of n flights prove a probability of failure below `probability`."""
        return self._convinces(n, failures, self.probability, below)

    def is_refuted(self, n: int, failures: int) -> bool:
        """Whether the failures of n flights prove a probability of failure above `probability`."""
        return self._convinces(n, failures, self.probability, above)

    def allowed(self, n: int) -> int:
        """Return the most failures of n flights that prove a probability below `probability`; -1: n are too few."""
        return _largest(lambda k: k < 0 or self.is_met(n, k), -1, n)

    def flights_needed(self, failures: int) -> int:
        """Return the least number of flights that, with so many failures, proves a probability below `probability`."""
        high = failures + 1
        while not self.is_met(high, failures):
            high *= 2
        return _largest(lambda n: not self.is_met(n, failures), failures, high) + 1

    def bounds(self, n: int, failures: int) -> tuple[float, float]:
        """Return (lower, upper) bound of the probability of failure, each with `confidence` at all n together."""
        if n == 0:
            return 0.0, 1.0
        share = failures / n
        upper = 1.0 if failures == n else halved(share, 1.0, lambda p: self._convinces(n, failures, p, below))
        lower = 0.0 if failures == 0 else math.exp(halved(
            math.log(share), math.log(MIN_PROBABILITY), lambda x: self._convinces(n, failures, math.exp(x), above)))
        return lower if lower > MIN_PROBABILITY else 0.0, upper

    def _convinces(self, n: int, failures: int, probability: float, others: Callable[[float], np.ndarray]) -> bool:
        if not 0.0 < probability < 1.0:
            return False
        return log_evidence(n, failures, probability, others(probability)) >= -math.log1p(-self.confidence)


def _largest(holds: Callable[[int], bool], low: int, high: int) -> int:
    """Return the largest integer low <= x < high + 1 for which `holds` is True, as it is at low and up to some x."""
    high += 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


MET, NOT_MET, UNDECIDED = "met", "not met", "undecided"
Rule = Planned | Sequential


class Count:
    """One requirement's flights, failures and errors so far, its verdict, and after how many flights it was decided."""

    def __init__(self, requirement: Requirement, rule: Rule) -> None:
        self.requirement, self.rule = requirement, rule
        self.flights = self.failures = self.errors = 0
        self.verdict = UNDECIDED
        self.decided_at: int | None = None   # flights
        self.flights_needed = rule.flights_needed(0)  # in all, if no further one fails
        self._refuting = False               # has a failure come since the last look: nothing else can refute

    def take(self, outcome: Outcome) -> None:
        """Count the next flight: a failure, an error (a text) or neither."""
        self.flights += 1
        if isinstance(outcome, str):
            self.errors += 1
        elif self.requirement.fails(outcome):
            self.failures += 1
            self._refuting = True
        else:
            return
        self.flights_needed = self.rule.flights_needed(self.failures + self.errors)

    def look(self) -> None:
        """Set the verdict if the flights so far decide it; a verdict once set stays."""
        if self.verdict != UNDECIDED:
            return
        if self.flights >= self.flights_needed:
            self.verdict, self.decided_at = MET, self.flights
        elif self._refuting and self.rule.is_refuted(self.flights, self.failures):
            self.verdict, self.decided_at = NOT_MET, self.flights
        self._refuting = False


class Watch:
    """Counts flights in the order of their numbers, in whatever order they end, until all requirements are decided.

    planned  judge once, in `end`, after all flights; else after each
    """

    def __init__(self, requirements: Sequence[Requirement], planned: bool) -> None:
        rule = Planned if planned else Sequential
        self.counts = [Count(each, rule(each.probability, each.confidence)) for each in requirements]
        self.planned = planned
        self.flights = 0
        self._ahead: dict[int, Outcome] = {}

    def __call__(self, number: int, outcome: Outcome) -> int | None:
        """Take the outcome of flight `number`; return how many flights, from the first, decide, None while none do."""
        if number >= self.flights:
            self._ahead.setdefault(number, outcome)
        while self.flights in self._ahead:
            outcome = self._ahead.pop(self.flights)
            self.flights += 1
            for count in self.counts:
                count.take(outcome)
                if not self.planned:
                    count.look()
            if self.is_decided:
                return self.flights
        return None

    def end(self) -> None:
        """Judge the flights counted so far; call it when no further flight comes."""
        for count in self.counts:
            count.look()

    @property
    def is_decided(self) -> bool:
        return bool(self.counts) and all(count.verdict != UNDECIDED for count in self.counts)

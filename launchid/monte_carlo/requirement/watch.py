"""The count of a campaign's flights in the order of their seeds, and says when its requirements are decided.

Flights end in any order on many workers; what is said depends on the first n by their numbers alone, so it is the same
whoever flew them.  A flight without a result (an error) counts against the verdict that is asked: as failed where the
requirement would be met, as flown well where it would be refuted.
"""

from collections.abc import Sequence

from ..journal import Outcome
from .grammar import Requirement
from .sequential import Planned, Sequential

MET, NOT_MET, UNDECIDED = "met", "not met", "undecided"
Rule = Planned | Sequential


class Count:
    """One requirement: flights, failures and errors so far, and what they decide."""

    def __init__(self, requirement: Requirement, rule: Rule) -> None:
        self.requirement, self.rule = requirement, rule
        self.flights = self.failures = self.errors = 0
        self.verdict = UNDECIDED
        self.decided_at: int | None = None   # flights
        self.flights_needed = rule.flights_needed(0)  # in all, if no further one fails
        self._refuting = False               # has a failure come since the last look: nothing else can refute

    def take(self, outcome: Outcome) -> None:
        """The next flight."""
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
        """Set the verdict, if these flights decide it and no earlier ones did."""
        if self.verdict != UNDECIDED:
            return
        if self.flights >= self.flights_needed:
            self.verdict, self.decided_at = MET, self.flights
        elif self._refuting and self.rule.is_refuted(self.flights, self.failures):
            self.verdict, self.decided_at = NOT_MET, self.flights
        self._refuting = False


class Watch:
    """Outcomes by their numbers, in any order -> the number of flights that decided everything, or None.

    planned  all flights are flown, and judged once, at the end; else after each
    """

    def __init__(self, requirements: Sequence[Requirement], planned: bool) -> None:
        rule = Planned if planned else Sequential
        self.counts = [Count(each, rule(each.probability, each.confidence)) for each in requirements]
        self.planned = planned
        self.flights = 0
        self._ahead: dict[int, Outcome] = {}

    def __call__(self, number: int, outcome: Outcome) -> int | None:
        """Take a flight's outcome; returns how many flights, from the first, are enough, None while none are."""
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
        """No further flight comes."""
        for count in self.counts:
            count.look()

    @property
    def is_decided(self) -> bool:
        return bool(self.counts) and all(count.verdict != UNDECIDED for count in self.counts)

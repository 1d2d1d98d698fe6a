"""The work that a diagnosis may do: steps of integration, counted, which depend on its log alone; and an emergency
brake.

The brake is the only clock of the diagnosis, and is read here only: what is answered without it is the same on every
machine, under any load.
"""

import math
import time
from dataclasses import dataclass

STEPS = 4e8  # of integration at an effort of 1: five times what the longest diagnosis of the logs at hand takes


class Stopped(Exception):
    """The brake: what was going on is ended, and nothing is concluded from it."""


@dataclass(eq=False)
class Work:
    """The work done on a record and on all that are made of it.

    steps  of integration, so far;  most  of them, after which a search begins nothing further
    brake  [s] of the monotonic clock, after which nothing is integrated
    """

    steps: int = 0
    most: float = math.inf
    brake: float = math.inf

    def limit(self, effort: float, seconds: float) -> None:
        """Begin to count anew, for searches of that effort (1: the ordinary), which are stopped after so many
        seconds."""
        self.steps, self.most, self.brake = 0, effort * STEPS, time.monotonic() + seconds

    @property
    def is_spent(self) -> bool:
        """A search begins nothing further."""
        return self.steps >= self.most

    def count(self, steps: int) -> None:
        """Count so many steps more; Stopped when the time is over."""
        self.steps += steps
        if time.monotonic() > self.brake:
            raise Stopped

    def release(self) -> None:
        """Take the brake off, for what is drawn later."""
        self.brake = math.inf

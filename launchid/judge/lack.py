"""Name what the fitted terms lack to describe a log."""

import math
from dataclasses import dataclass

from ..weakform.modes import FAST_THETA, FRICTION

LIBRARY = ("1", "theta_dot", "sin(theta)", FRICTION, "beta^2")  # terms that a library may have
LACKING = ("1", "theta_dot", "gamma", FAST_THETA, "sin(theta)", FRICTION, "beta^2",
           "beta_ddot")  # terms that an answer may lack, the simpler first
AT_REST = "beta at rest"


@dataclass(frozen=True)
class Lack:
    """Something that the fitted terms lack to describe a log, or for which no numbers of it can be right.

    what     a term, or delay, clock, placebo, driving, interpolated, beta at rest, unexplained, coefficients
    before, after   share of the weighted squares that is explained without and with it
    size     coefficient of the term [its units], delay [s], frequency [rad/s]; None for the others
    std      its standard deviation;  is_most  with it half of the error of held-out rows is gone
    """

    what: str
    before: float = math.nan
    after: float = math.nan
    size: float | None = None
    std: float = math.nan
    is_most: bool = False

    @property
    def shares(self) -> str:
        """Shares of the changes of theta_dot that are explained with what is lacking and without it, in words."""
        return (f"with it {100.0 * self.after:.3g} % of the changes of theta_dot are explained, without "
                f"{100.0 * self.before:.3g} %")


def is_passive(lack: Lack) -> bool:
    """Whether a term that is lacking is one that a vehicle may have: a damping or a friction brakes."""
    return lack.what not in ("theta_dot", FRICTION) or (lack.size or 0.0) < 0.0

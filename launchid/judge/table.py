"""The tests for which an answer is refused: one line each.

A test that could not be made refuses too (`UNCHECKED`). What is fitted beside a6 and k1 (a constant, a damping, a
friction, a lag of beta, wind and offsets that a nominal declares) is not tested for its absence.
"""

from typing import NamedTuple


class Test(NamedTuple):
    """One test.

    assumes    what an answer rests on, and the test asks;  statistic  that is computed;  limit  beyond which the answer
    is refused;  unit  of the limit;  source  of the statistic, or of the limit
    """

    assumes: str
    statistic: str
    limit: float
    unit: str
    source: str


TESTS = {
    # of a log and its nominal (`nominal`)
    "a6 and k1 of the nominal": Test(
        "the nominal is of this vehicle",
        "norm of what a6 and k1 of windows before a change differ by, over [uncertainty], less 3 deviations", 3.0,
        "declared ranges", "right flights with every fault of the catalogue: none beyond (benchmarks/regimes.py)"),
    "period of the nominal": Test(
        "the commands are its controller's", "period at which beta_cmd changes over the controller's", 1.5,
        "times, either way", "a period is never half as long or twice by a fault"),
    "commands of the nominal": Test(
        "the commands are its controller's", "gain of beta_cmd on the law's answer to theta", 3.0, "times, either way",
        "gains of faults are 0.4 to 2.5"),
    "no undeclared line": Test(
        "the nominal has every mode and tone of the log",
        "periodogram of what it leaves of theta_dot over its surroundings", 1e-5, "chance of a false line in a log",
        "Welch 1967; chi square of the mean of periodograms"),
    "servo of the nominal": Test(
        "the servo is the nominal's", "speed at which it explains the nozzle best", 3.0, "times, either way",
        "servos of faults are 0.5 to 2 times as fast"),
}

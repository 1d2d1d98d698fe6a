"""The tests for which an answer is refused: one line each.

A test that could not be made refuses too (`UNCHECKED`). What is fitted beside a6 and k1 (a constant, a damping, a
friction, a lag of beta, wind and offsets that a nominal declares) is not tested for its absence.
"""

from typing import NamedTuple

from ..log.rates import FEWEST_SLOPES
from ..weakform.late import SHIFT
from ..weakform.pieces import PER_COEFFICIENT


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
    # of the whole log, once (`question`, `input`, `terms`)
    "stretches without a gap": Test(
        "a late beta, and what is slow, would show", "typical length of a stretch without a gap", 1.0, "s",
        "three of the slowest delays that are tried"),
    "rows enough": Test(
        "an answer can be tested", "modes for each coefficient", PER_COEFFICIENT, "modes",
        "of fewer the rest's spectrum is not known"),
    "rows faster than the damping": Test(
        "a rate that is made of theta is known within a row", "rate damping times the period", 1.0 / 3.0, "",
        "three rows a time constant: the cubic through four rows is then 1 % off"),
    "beta at every row": Test(
        "beta acts as it is logged between its own values", "corners of lines, regular rows apart, with many slopes",
        FEWEST_SLOPES, "slopes", "a triangular or rate-limited motion has two or three"),
    "beta acts when it is logged": Test(
        "no delay between beta's row and its effect", "shift of beta that leaves least, over its deviation", SHIFT,
        "standard deviations", "parabola through the weighted squares (Ljung, System Identification, 1999)"),
    "one clock": Test(
        "beta and theta are stamped by one clock", "growth of that shift over the log, over its deviation", SHIFT,
        "standard deviations", "line through the pieces' shifts, deviation by their scatter"),
    "no placebo": Test(
        "beta makes the motion", "likelihood that beta of another time gains, over what beta gains", 0.5, "share",
        "circular shifts of the input, each with its own noise"),
    "no further term": Test(
        "the terms are all that act", "coefficient of a further term, with the noise fitted beside it", 5.0,
        "standard deviations", "likelihood ratio (Wilks 1938); eight terms in sixty pieces"),
    "rows left out are predicted": Test(
        "the terms are all that act", "error of rows left out that remains with a further term", 0.5, "share",
        "three parts of the log, each by the coefficients of the others"),
    # of a window (`window`)
    "what is lacking moves little": Test(
        "the window's numbers do not rest on what the log lacks", "what a further term or delay moves a coefficient by",
        0.02, "relative, and above the deviation", "[diagnosis] tolerance"),
    "white rest": Test(
        "noise is as white as it was assumed", "likelihood ratio of one variance a band against one in all", 1.0e-6,
        "p-value", "Bartlett 1937"),
    "damping of a right sign": Test(
        "beta moves the vehicle, not the vehicle beta", "rate damping that nobody asked for, over its deviation", 2.0,
        "standard deviations", "no vehicle drives itself"),
    "a6 and k1 apart": Test(
        "theta and beta move by themselves", "|correlation| of a6 and k1 where both are vague", 0.99, "",
        "one direction is then a hundred times as uncertain as the other"),
    "numbers above noise": Test(
        "the motion tells the numbers", "deviation of a6's or k1's term over the largest term", 0.5, "share",
        "a number of which nothing is known is no answer"),
    "agreement with the weak form": Test(
        "another formulation's numbers are not drawn off by noise",
        "their difference from those of the log's own noise", 2.0, "standard deviations", "Hausman 1978"),
    # of the filter's windows; those of each window stand on board (`launchid_core.filter.whiteness`)
    "no contradiction after": Test(
        "what contradicts the model later was not there yet", "time to the next window that contradicts the model",
        20.0, "s", "as long as the estimator takes to forget one"),
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
    "no undeclared slosh": Test(
        "the nominal has every slosh of a log that contradicts it",
        "size of a slosh with which nothing contradicts the model any more", 5.0, "standard deviations",
        "a filter that has the slosh is not contradicted by it"),
    "servo of the nominal": Test(
        "the servo is the nominal's", "speed at which it explains the nozzle best", 3.0, "times, either way",
        "servos of faults are 0.5 to 2 times as fast"),
}

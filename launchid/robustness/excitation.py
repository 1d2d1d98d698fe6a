"""What a flight does not tell of its margins, and which manoeuvre would.

A window is blind where a6 and k1 cannot be told at all (LOW_INFORMATION, SEPARATION), undecided where the interval of a
required margin reaches across the requirement.  There a6 and k1 must be known better by the ratio of the margin's
distance from the requirement to its half-width.  `launchid plan` makes the smallest test input of such an accuracy;
longer windows of the same motion have it too, since deviations fall with the root of the length.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sim.sections import Required

from .margin_spread import MARGINS

if TYPE_CHECKING:
    from .flight_margins import WindowMargins

BLIND = ("LOW_INFORMATION", "SEPARATION")
BLIND_ACCURACY = 0.05    # relative, of a6 and k1: makes a high gain margin known to 0.4 dB, one sigma
LEAST_RATIO = 0.1        # of distance to half-width: a margin at its requirement is decided by no manoeuvre
LEAST_ACCURACY = 0.002   # relative


def excitation(windows: Sequence["WindowMargins"], required: Required, length: float,
               nominal: str | None) -> dict[str, Any] | None:
    """Return as JSON how many windows are blind and undecided, the accuracy that decides, the length of a window of the
    same motion that has it [s], and what to do in words; None if every window is decided.

    length  of a window [s];  nominal  as a user names it, None: there is none
    """
    blind = sum(each.window.status in BLIND for each in windows)
    ratios, accuracies = [], []
    for judged in (each.window for each in windows):
        if judged.spread is None or judged.known is None:
            continue
        for name in (name for name, is_certain in judged.spread.below(required).items() if not is_certain):
            sign, demand = MARGINS[name].sign, getattr(required, MARGINS[name].required)
            value, (least, most) = sign * getattr(judged.spread, name).value, judged.spread.ends(name)
            half = value - least if value >= demand else most - value
            ratio = max(abs(value - demand) / half, LEAST_RATIO) if 0.0 < half < math.inf else LEAST_RATIO
            ratios.append(min(ratio, 1.0))
            k = 0 if name == "gain_low_db" else 1   # the number that the margin hangs on
            accuracies.append(min(math.sqrt(judged.known.covariance[k, k]) / abs(judged.known.mean[k]), 1.0))
            break
    if not blind and not ratios:
        return None
    accuracy, longer = BLIND_ACCURACY, None
    if ratios:
        middle = sorted(range(len(ratios)), key=lambda k: ratios[k] * accuracies[k])[len(ratios) // 2]
        accuracy = max(ratios[middle] * accuracies[middle], LEAST_ACCURACY)
        longer = float(f"{length / ratios[middle]**2:.2g}")
    accuracy = float(f"{accuracy:.1g}")
    said = [f"{blind} tell{'s' * (blind == 1)} neither a6 nor k1"] * bool(blind) + \
        [f"{len(ratios)} do{'es' * (len(ratios) == 1)} not tell whether the loop keeps what is required"] * bool(ratios)
    plan = f"launchid plan {nominal or 'first.toml'} --accuracy {accuracy:g} --window {length:g} --out excited.toml"
    first = "" if nominal else " of `launchid nominal`"
    words = (f"of {len(windows)} windows {' and '.join(said)}: fly the test input of `{plan}`{first}"
             + (f", or as much as has moved here for {longer:g} s in one window" if longer else ""))
    return {"blind": blind, "undecided": len(ratios), "accuracy": accuracy, "length": longer, "words": words}

"""Give k1 between two scales of beta: nobody knows whether the sensor of the nozzle or the servo has it."""

import math
from dataclasses import replace

from launchid_core import Estimate


def between_scales(e: Estimate, scale: float) -> Estimate:
    """Return an estimate with k1 in the middle of what it is if the nozzle's sensor has a scale, and if the servo has.

    e      of beta divided by the scale: right if it is the sensor's; k1 is `scale` times as large if it is the servo's
    scale  of beta over what the servo makes of the command
    The standard deviation is wider by half of the difference.
    """
    if not e.valid and not (e.tracked is not None and e.tracked.valid):
        return e
    factor, doubt = 1.0 / math.sqrt(scale), 0.5 * abs(math.log(scale))

    def widened(value: float, std: float) -> tuple[float, float]:
        return value * factor, math.hypot(std, value * doubt) * factor

    k1, k1_std = widened(e.k1, e.k1_std)
    share = e.k1_std * factor / k1_std if k1_std > 0.0 else 1.0
    xi, stds = e.xi.copy(), dict(e.terms_std)
    for k, term in enumerate(e.terms):
        if term in ("beta", "tau*beta"):
            xi[k] *= factor
            if term in stds:
                stds[term] = widened(float(e.xi[k, 1]), stds[term])[1]
    xi.flags.writeable = False
    tracked = e.tracked
    if tracked is not None and tracked.valid:
        value, std = widened(tracked.k1, tracked.k1_std)
        tracked = tracked._replace(k1=value, k1_std=std, a6_k1_corr=tracked.a6_k1_corr * tracked.k1_std * factor / std)
    return replace(e, k1=k1, k1_std=k1_std, a6_k1_corr=e.a6_k1_corr * share, k1_dot=e.k1_dot * factor,
                   k1_bound=e.k1_bound * factor, xi=xi, terms_std=stds, tracked=tracked)

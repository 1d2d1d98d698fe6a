"""The measurement of a true value: noise and quantisation."""

import math

from .kernels import kernel


@kernel
def measure(truth, noise, step):
    """truth + noise, rounded to multiples of `step` (0: not quantised)."""
    value = truth + noise
    return step * math.floor(value / step + 0.5) if step > 0.0 else value

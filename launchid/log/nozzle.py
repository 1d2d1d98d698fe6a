"""Fit the scale of the nozzle's sensor against what the nominal's servo makes of the command."""

import math

import numpy as np

from sim.nominal import Nominal

from ..sums import along, combined, products, square
from .relations import answered
from .slope import Columns, block_means

GAIN_BLOCK = 0.1       # s: longer than a servo's own time, so that noise is averaged
FEWEST_GAIN_BLOCKS = 60
SEGMENTS = 20          # of the rows, whose scatter gives the standard deviation, if that is more than white noise's


def nozzle_gain(columns: Columns, period: float, nominal: Nominal) -> tuple[float, float]:
    """Return (gain of the nozzle on the servo's answer to the command, its standard deviation); NaN if not known.

    A lag of the servo beside the nominal's is free: beta = gain answer + lag answer' + constant.
    """
    rows = max(1, round(GAIN_BLOCK / period))
    if nominal.actuator is None or not {"beta", "beta_cmd"} <= set(columns) \
            or len(columns["beta"]) < FEWEST_GAIN_BLOCKS * rows or np.array_equal(columns["beta"], columns["beta_cmd"]):
        return math.nan, math.nan
    answer = answered(columns["beta_cmd"], period, nominal)
    y, *parts = (block_means(x, rows) for x in (columns["beta"], answer, np.gradient(answer, period)))
    design = np.column_stack([*(x - x.mean() for x in parts), np.ones(len(y))])
    inverse = np.linalg.pinv(products(design, design), 1e-12, hermitian=True)
    x = combined(inverse, along(design, y))
    rest = y - combined(design, x)
    scores = np.array([along(a, b) for a, b in zip(np.array_split(design, SEGMENTS), np.array_split(rest, SEGMENTS),
                                                   strict=True)])
    scattered = inverse @ products(scores, scores) @ inverse
    return float(x[0]), math.sqrt(max(float(inverse[0, 0]) * square(rest) / len(rest), float(scattered[0, 0])))

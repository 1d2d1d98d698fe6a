"""The uncertainty level: where in its range sigma each parameter is, and whether it has left it.

delta = d/sigma(t), as in a = a0 (1 + sigma delta), d being the tracked relative deviation; bands of |delta| have the
probabilities of a normal of its mean and standard deviation.  The alarm, looked at after every block, wants one side
decided: |delta| > 1 is also probable where nothing is known.  See docs/method.md, "The uncertainty level".

Assumption: the tracker's posterior is normal; looking again and again is paid for by RAISE and by the tracker's
random walk, which over-covers a constant delta (measured: benchmarks/uncertainty.py).
"""

import math

import numpy as np

from ..algebra.elementary import erfc_of
from ..filter import states as sx
from ..kernels import inner
from . import changes as ch

BANDS = ("0-30", "30-60", "60-100", "out")  # per cent of |sigma|
UNDECIDED = "undecided"
EDGES = (0.3, 0.6, 1.0)  # upper ends of all bands but the last, |delta|
OUT = len(EDGES)
DECIDED = 0.95
RAISE = 0.9999           # at 0.999 one of 900 flights inside raised falsely; delta = 1.6 is found 0.4 s later (mean)
CLEAR = 0.5
NO_BAND = -1


@inner
def restart_gauge(gauge):
    """Reset both parameters' places in their range: nothing is known before the first sample."""
    gauge.delta[:] = np.nan
    gauge.delta_std[:] = np.nan
    gauge.probability[:, :] = np.nan
    gauge.since[:] = np.nan
    gauge.band[:] = NO_BAND


@inner
def below(edge, mean, std):
    """Probability that a normal is below `edge`."""
    return 0.5 * erfc_of((mean - edge) / (std * math.sqrt(2.0)))


@inner
def inside(edge, mean, std):
    """Probability that a normal is within +-edge."""
    return below(edge, mean, std) - below(-edge, mean, std)


@inner
def judge(gauge, p, mean, std, t, t_first, onset):
    """Raise or clear the sequential alarm of parameter p.

    mean, std  of delta at t [s];  t_first [s]: the first sample;  onset [s]: of a sudden change in this block, or inf
    """
    within = inside(EDGES[OUT - 1], mean, std)
    if within >= DECIDED:
        gauge.known_inside[p] = 1
    if gauge.raised[p] == 1:
        if 1.0 - within < CLEAR:
            gauge.raised[p] = 0
            gauge.since[p] = np.nan
        return
    if abs(mean) <= EDGES[OUT - 1]:
        gauge.since[p] = np.nan
        return
    if np.isnan(gauge.since[p]):
        gauge.since[p] = t if gauge.known_inside[p] == 1 else t_first
    gauge.since[p] = min(gauge.since[p], onset)
    if below(-EDGES[OUT - 1], -abs(mean), std) > RAISE:
        gauge.raised[p] = 1


@inner
def watch_range(sigma, gauge, total, now, t_first, counts, event):
    """Look at the tracked belief `total` at `now` [s]: the alarm of both parameters.  t_first [s]: the first sample"""
    if not np.isfinite(total.mean_a6 + total.mean_k1):
        return
    onset = np.inf
    if counts.events > gauge.events:
        onset = event.time[(counts.events - 1) % ch.MAX_EVENTS]
    gauge.events = counts.events
    sigma_a6, sigma_k1 = sx.profile_at(sigma, now)
    judge(gauge, sx.A6, total.mean_a6 / sigma_a6, math.sqrt(total.var_a6) / sigma_a6, now, t_first, onset)
    judge(gauge, sx.K1, total.mean_k1 / sigma_k1, math.sqrt(total.var_k1) / sigma_k1, now, t_first, onset)


@inner
def weigh_bands(gauge, p, mean, std):
    """Probabilities of the bands of parameter p, and the band if one is decided; `out` also wants the alarm."""
    gauge.delta[p], gauge.delta_std[p] = mean, std
    probability = gauge.probability[p]
    before = 0.0
    for k in range(OUT):
        up_to = inside(EDGES[k], mean, std)
        probability[k] = up_to - before
        before = up_to
    probability[OUT] = 1.0 - before
    gauge.band[p] = NO_BAND
    for k in range(OUT):
        if probability[k] >= DECIDED:
            gauge.band[p] = k
    if probability[OUT] >= DECIDED and gauge.raised[p] == 1:
        gauge.band[p] = OUT


@inner
def close_range(sigma, gauge, total, t_end):
    """Report the uncertainty level of both parameters for the window that closed at t_end [s].  Arguments as of
    `watch_range`."""
    sigma_a6, sigma_k1 = sx.profile_at(sigma, t_end)
    weigh_bands(gauge, sx.A6, total.mean_a6 / sigma_a6, math.sqrt(total.var_a6) / sigma_a6)
    weigh_bands(gauge, sx.K1, total.mean_k1 / sigma_k1, math.sqrt(total.var_k1) / sigma_k1)

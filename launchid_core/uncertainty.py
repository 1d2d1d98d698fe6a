"""The uncertainty level: where in its range sigma each parameter is, and whether it has left it.

From the tracked relative deviation d with variance v: delta = d/sigma(t), as in a = a0 (1 + sigma delta), and the
probabilities of the bands of |delta| under a normal of that mean and standard deviation.

The alarm is sequential: looked at after every block, raised when delta is beyond +1, or beyond -1, with a posterior
of RAISE.  One side must be decided: |delta| > 1 is also probable where nothing is known (the prior's FIRST_STD may be
many sigma), but neither side is.  It clears when |delta| > 1 is less probable than CLEAR, which wants data as well.

When it began: the block in which delta's mean crossed 1 for the last time, or the onset that `changes` found if that
is earlier; if the parameter had never been known inside, the first sample, since nothing says that it ever was.

Assumption: the tracker's posterior is normal; looking again and again is paid for by RAISE and by the tracker's
random walk, which over-covers a constant delta (measured: benchmarks/uncertainty.py).
"""

import math
from typing import NamedTuple

import numpy as np

from .belief import profile_at
from .changes import E_TIME, EVENTS, MAX_EVENTS
from .kernels import kernel
from .memory import take, take2

BANDS = ("0-30", "30-60", "60-100", "out")  # per cent of |sigma|
UNDECIDED = "undecided"
EDGES = (0.3, 0.6, 1.0)  # upper ends of all bands but the last, |delta|
OUT = len(EDGES)
DECIDED = 0.95
RAISE = 0.9999           # at 0.999 one of 900 flights inside raised falsely; delta = 1.6 is found 0.4 s later (mean)
CLEAR = 0.5
NO_BAND = -1

# flag (i8)
RAISED, KNOWN_INSIDE = range(2)
N_FLAGS = 2


class Gauge(NamedTuple):
    """State; rows and pairs are (a6, k1).  `time`, `a6`, `k1` are sigma's profile, fixed at construction."""

    time: np.ndarray         # (n,) s
    a6: np.ndarray           # (n,)
    k1: np.ndarray           # (n,)
    delta: np.ndarray        # (2,)
    delta_std: np.ndarray    # (2,)
    probability: np.ndarray  # (2, 4) of BANDS
    since: np.ndarray        # (2,) s, when delta's mean left the range; NaN if inside
    band: np.ndarray         # (2,) int64 place in BANDS, or NO_BAND
    flag: np.ndarray         # (2, N_FLAGS) int64
    events: np.ndarray       # (1,) int64 sudden changes seen
    cell: np.ndarray         # (1,) int64 of the profile


@kernel
def view_gauge(f, i, n):
    """Cut it from floats f and integers i for n nodes of sigma's profile; returns (it, floats, integers)."""
    time, at = take(f, 0, n)
    a6, at = take(f, at, n)
    k1, at = take(f, at, n)
    delta, at = take(f, at, 2)
    delta_std, at = take(f, at, 2)
    probability, at = take2(f, at, 2, OUT + 1)
    since, at = take(f, at, 2)
    band, m = take(i, 0, 2)
    flag, m = take2(i, m, 2, N_FLAGS)
    events, m = take(i, m, 1)
    cell, m = take(i, m, 1)
    return Gauge(time, a6, k1, delta, delta_std, probability, since, band, flag, events, cell), at, m


class GaugeStore(NamedTuple):
    """The memory of a gauge, as it crosses into compiled code."""

    floats: np.ndarray
    integers: np.ndarray
    nodes: int


def new_gauge(time: tuple[float, ...], a6: tuple[float, ...], k1: tuple[float, ...]) -> tuple[GaugeStore, Gauge]:
    """Allocate for sigma's profile (time [s]); returns the memory and its named parts."""
    n = len(time)
    _, at, m = view_gauge(np.zeros(3 * n + 32), np.zeros(32, np.int64), n)
    store = GaugeStore(np.zeros(at), np.zeros(m, np.int64), n)
    gauge, _, _ = view_gauge(*store)
    gauge.time[:], gauge.a6[:], gauge.k1[:] = time, a6, k1
    restart_gauge(*store)
    return store, gauge


@kernel
def restart_gauge(f, i, n):
    """Forget the flight; sigma stays."""
    gauge, _, _ = view_gauge(f, i, n)
    gauge.delta[:] = np.nan
    gauge.delta_std[:] = np.nan
    gauge.probability[:, :] = np.nan
    gauge.since[:] = np.nan
    gauge.band[:] = NO_BAND
    gauge.flag[:, :] = 0
    gauge.events[0] = 0
    gauge.cell[0] = 0


@kernel
def below(edge, mean, std):
    """Probability that a normal is below `edge`."""
    return 0.5 * math.erfc((mean - edge) / (std * math.sqrt(2.0)))


@kernel
def inside(edge, mean, std):
    """Probability that a normal is within +-edge."""
    return below(edge, mean, std) - below(-edge, mean, std)


@kernel
def judge(gauge, p, mean, std, t, t_first, onset):
    """The sequential alarm of parameter p.

    mean, std  of delta at t [s];  t_first [s]: the first sample;  onset [s]: of a sudden change in this block, or inf
    """
    flag = gauge.flag[p]
    within = inside(EDGES[OUT - 1], mean, std)
    if within >= DECIDED:
        flag[KNOWN_INSIDE] = 1
    if flag[RAISED] == 1:
        if 1.0 - within < CLEAR:
            flag[RAISED] = 0
            gauge.since[p] = np.nan
        return
    if abs(mean) <= EDGES[OUT - 1]:
        gauge.since[p] = np.nan
        return
    if np.isnan(gauge.since[p]):
        gauge.since[p] = t if flag[KNOWN_INSIDE] == 1 else t_first
    gauge.since[p] = min(gauge.since[p], onset)
    if below(-EDGES[OUT - 1], -abs(mean), std) > RAISE:
        flag[RAISED] = 1


@kernel
def watch_range(f, i, n, total, now, t_first, counts, event):
    """Look at the tracked estimate: the alarm of both parameters.

    f, i, n       inout  memory of the gauge
    total (5,)    in     tracked a6, k1 (relative deviations), variances and covariance aa, ak, kk
    now (>=1,)    in     [s] time of the tracked estimate first
    t_first       in     [s] the first sample
    counts, event in     of `changes.Watch`
    """
    gauge, _, _ = view_gauge(f, i, n)
    if not np.isfinite(total[0] + total[1]):
        return
    onset = np.inf
    if counts[EVENTS] > gauge.events[0]:
        onset = event[(counts[EVENTS] - 1) % MAX_EVENTS, E_TIME]
    gauge.events[0] = counts[EVENTS]
    sigma_a6, sigma_k1 = profile_at(gauge, gauge.cell, now[0])
    judge(gauge, 0, total[0] / sigma_a6, math.sqrt(total[2]) / sigma_a6, now[0], t_first, onset)
    judge(gauge, 1, total[1] / sigma_k1, math.sqrt(total[4]) / sigma_k1, now[0], t_first, onset)


@kernel
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
    if probability[OUT] >= DECIDED and gauge.flag[p, RAISED] == 1:
        gauge.band[p] = OUT


@kernel
def close_range(f, i, n, total, t_end):
    """A window closed at t_end [s]: the uncertainty level of both parameters.  Arguments as of `watch_range`."""
    gauge, _, _ = view_gauge(f, i, n)
    sigma_a6, sigma_k1 = profile_at(gauge, gauge.cell, t_end)
    weigh_bands(gauge, 0, total[0] / sigma_a6, math.sqrt(total[2]) / sigma_a6)
    weigh_bands(gauge, 1, total[1] / sigma_k1, math.sqrt(total[4]) / sigma_k1)

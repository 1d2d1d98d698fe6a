"""The gate and the ring buffer: one sample in, one status out, never an allocation.

A window is [t_start, t_start + window); windows lie end to end from the first sample on.  One closes with its last
expected sample (t + 1.5 sample_period > t_end) or, if that is missing, with the first one after.  The ring keeps the
newest m + 1 samples: a full window and the one that may come after it.
"""

import math

import numpy as np

from ..kernels import inner
from ..status import Status

# columns of the ring
T, THETA, THETA_DOT, BETA, THETA_DDOT, BETA_CMD, GAMMA = range(7)
N_COLUMNS = 7
ATTACK = GAMMA  # of a copied window: `rows.fill_attack` leaves the angle of attack where gamma was

N_STATUS = len(Status)

(ACCEPTED, WINDOW_COMPLETE, AFTER_GAP, CLOCK_RESET, RECOVERED, NONFINITE, RANGE, DT_ZERO, DT_NEGATIVE,
 BUSY) = map(int, Status)

LAST_SAMPLE = 1.5       # periods: nearer than this to the end, a sample is its window's last
SAME_INSTANT = 1.0e-6   # periods: stamps closer than this are one instant (rounding of k*period)
SEAM = 0.5              # rad: a theta that jumps from so near +-pi to so near the other crossed it (50 rad/s at 100 Hz)
DUE = 64                # beside a status: what waits in the ring is to be used
HALF_TURN = math.pi
TURN = 2.0 * math.pi
RESET_COUNT = 5         # consecutive stamps that agree on an earlier clock before it is believed


@inner
def gate(limits, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """ACCEPTED, NONFINITE or RANGE for the values of one sample (NaN passes in the optional channels)."""
    if not (np.isfinite(t) and np.isfinite(theta) and np.isfinite(beta)):
        return NONFINITE
    if np.isinf(theta_dot) or np.isinf(theta_ddot) or np.isinf(beta_cmd) or np.isinf(gamma):
        return NONFINITE
    if not (abs(t) <= limits.largest[T] and abs(theta) <= limits.largest[THETA]
            and abs(beta) <= limits.largest[BETA]):
        return RANGE
    if (abs(theta_dot) > limits.largest[THETA_DOT] or abs(theta_ddot) > limits.largest[THETA_DDOT]
            or abs(beta_cmd) > limits.largest[BETA_CMD] or abs(gamma) > limits.largest[GAMMA]):
        return RANGE
    return ACCEPTED


@inner
def judge_time(limits, clock, count, t):
    """ACCEPTED, AFTER_GAP, CLOCK_RESET, DT_ZERO or DT_NEGATIVE for a stamp; follows an earlier clock's stamps."""
    if count.started == 0:
        return ACCEPTED
    dt = t - clock.last
    if abs(dt) <= SAME_INSTANT * limits.period:
        return DT_ZERO
    if dt > 0.0:
        count.candidates = 0
        return AFTER_GAP if dt > limits.max_gap else ACCEPTED
    step = t - clock.candidate
    agrees = count.candidates > 0 and 0.0 < step <= limits.max_gap
    count.candidates = count.candidates + 1 if agrees else 1
    clock.candidate = t
    return CLOCK_RESET if count.candidates >= RESET_COUNT else DT_NEGATIVE


@inner
def close_window(limits, clock, count, back):
    """Mark the rows of the current window as closed; `back` of the newest ring rows are not its own."""
    clock.closed = clock.first + count.index * limits.window
    count.closed_rows = count.rows
    count.closed_back = back
    count.rows = 0


@inner
def centre_of(fixed, state):
    """The closed window's centre [s]."""
    return state.clock.closed + 0.5 * fixed.limits.window


@inner
def seek_window(limits, clock, count, t):
    """Close the current window if t lies past its end, and move to the window that holds t; True if one closed."""
    slack = SAME_INSTANT * limits.period
    if t < clock.first + (count.index + 1) * limits.window - slack:
        return False
    closed = count.rows > 0
    if closed:
        close_window(limits, clock, count, 1)
    count.index = int(np.floor((t - clock.first + slack) / limits.window))
    return closed


@inner
def unwrap(clock, count, theta, anew):
    """theta [rad] with the whole turns that a jump across +-pi hides; `anew`: turns before a gap are not known."""
    before = clock.before
    clock.before = theta
    if anew:
        clock.turned = 0.0
    elif before * theta < 0.0 and abs(abs(before) - HALF_TURN) < SEAM and abs(abs(theta) - HALF_TURN) < SEAM:
        clock.turned += TURN if before > 0.0 else -TURN
        count.wraps += 1
    return theta if clock.turned == 0.0 else theta + clock.turned


@inner
def push(limits, clock, count, ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.

    After WINDOW_COMPLETE the closed window's rows are the count.closed_rows newest in the ring but for the newest
    count.closed_back.
    """
    code = gate(limits, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code == ACCEPTED:
        code = judge_time(limits, clock, count, t)
    if code < 0:
        count.answers[code - BUSY] += 1
        return code
    first = count.started == 0
    if first or code == CLOCK_RESET:
        clock.first, count.started = t, 1  # window 0 begins
        count.index, count.rows, count.candidates = 0, 0, 0
    complete = seek_window(limits, clock, count, t)

    head = count.head
    row = ring[head]
    row[T] = t
    row[THETA] = unwrap(clock, count, theta, code != ACCEPTED or first)
    row[THETA_DOT] = theta_dot
    row[BETA] = beta
    row[THETA_DDOT] = theta_ddot
    row[BETA_CMD] = beta_cmd
    row[GAMMA] = gamma
    count.head = head + 1 if head + 1 < ring.shape[0] else 0
    count.waiting += 1
    clock.last = t

    slack = SAME_INSTANT * limits.period
    t_start = clock.first + count.index * limits.window
    if t >= t_start - slack:  # else it came after its window had closed
        count.rows = min(count.rows + 1, ring.shape[0] - 1)
    if not complete and t + LAST_SAMPLE * limits.period > t_start + limits.window:
        close_window(limits, clock, count, 0)
        count.index += 1
        complete = True
    if complete:
        code = WINDOW_COMPLETE
    count.answers[code - BUSY] += 1
    return code


@inner
def place_of_row(count, ring, k):
    """The place of row k of the closed window in the ring."""
    at = count.head - count.closed_back - count.closed_rows + k
    return at if at >= 0 else at + ring.shape[0]


@inner
def copy_window(ring, count, saturation, signal):
    """Copy the closed window's samples, oldest first, leaving out those at a sensor's end stop.

    saturation (7,) in  end stop of each column, inf: none;  signal (7, m) out  one row a column of the ring
    Returns how many were copied and how many left out.
    """
    n, left_out = count.closed_rows, 0
    for row in range(n):
        source = ring[place_of_row(count, ring, row)]
        saturated = False
        for k in range(THETA, N_COLUMNS):
            if saturation[k] < np.inf and abs(source[k]) >= saturation[k]:
                saturated = True
        if saturated:
            left_out += 1
        else:
            for k in range(N_COLUMNS):
                signal[k, np.uint64(row - left_out)] = source[k]
    return n - left_out, left_out

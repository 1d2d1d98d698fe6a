"""Constants of a time step: the servo's transition with its integrals, the rate's and the turbulence's decay."""

from ..algebra.elementary import exp_of
from ..kernels import inner
from .belief import AERO_DAMPING, MISSING, TIME_CONSTANT, TURBULENCE_TIME

SERVO_ORDER = 12
SCALED = 0.25                   # norm of the matrix whose exponential is summed; the remainder is below 1e-17
MAX_SQUARINGS = 24
SAME_STEP = 1.0e-6              # relative difference of two time steps that share their constants

# step (f8): constants of one time step
STEP_PLACE = 0
PHI = 1    # 2x2 transition of the nozzle
PATH_PLACE = 5  # 2 effect of the command on it
J1 = 7     # 3: integral of beta over the step, damped as the rate is, from beta, beta_dot, command
J2 = 10    # 3: double integral
KEEP_PLACE = 13  # what is left of the turbulence
FADE = 14  # what known damping leaves of a rate
ANGLE_OF_RATE = 15  # s: the angle that a rate of 1 makes over the step
N_STEP = 16


@inner
def servo_matrix(constant, frequency, damping, h, m):
    """Generator times h of (double integral, integral, beta, beta_dot / w, u), the servo's own.  m (5, 5) out.

    beta_dot is divided by w, so that the entries are of one size; of a first-order servo, which has none, it is 0.
    """
    m[:, :] = 0.0
    m[0, 1] = h
    m[1, 1] = 0.0 - h * constant[AERO_DAMPING]
    m[1, 2] = h
    if constant[TIME_CONSTANT] > 0.0:
        m[2, 2], m[2, 4] = -h / constant[TIME_CONSTANT], h / constant[TIME_CONSTANT]
        return
    w = frequency * h
    m[2, 3] = w
    m[3, 2], m[3, 3], m[3, 4] = -w, -2.0 * damping * w, w


@inner
def multiply(a, b, out):
    """out (5, 5) = a b."""
    for i in range(5):
        for j in range(5):
            value = 0.0
            for k in range(5):
                value += a[i, k] * b[k, j]
            out[i, j] = value


@inner
def exponential(m, total, term, spare):
    """total (5, 5) out: exp(m) by scaling and squaring (Higham, SIAM J. Matrix Anal. 26, 2005); m is overwritten."""
    norm = 0.0
    for i in range(5):
        row = 0.0
        for j in range(5):
            row += abs(m[i, j])
        norm = max(norm, row)
    squarings, scale = 0, 1.0
    for _ in range(MAX_SQUARINGS):
        if norm * scale <= SCALED:
            break
        scale *= 0.5
        squarings += 1
    for i in range(5):
        for j in range(5):
            m[i, j] *= scale
            term[i, j] = 1.0 if i == j else 0.0
            total[i, j] = term[i, j]
    for order in range(1, SERVO_ORDER + 1):
        multiply(m, term, spare)
        for i in range(5):
            for j in range(5):
                term[i, j] = spare[i, j] / order
                total[i, j] += term[i, j]
    for _ in range(squarings):
        multiply(total, total, spare)
        for i in range(5):
            for j in range(5):
                total[i, j] = spare[i, j]


@inner
def set_step(constant, frequency, damping, h, work, step):
    """Constants of a time step h [s]: exp of a servo's generator over it, and the turbulence's decay.

    frequency [rad/s], damping  of a second-order servo
    """
    m, total, term, spare = work.taylor[0], work.taylor[1], work.taylor[2], work.taylor[3]
    servo_matrix(constant, frequency, damping, h, m)
    exponential(m, total, term, spare)
    w = 1.0 if constant[TIME_CONSTANT] > 0.0 else frequency
    step[STEP_PLACE] = h
    step[PHI] = total[2, 2]
    step[PHI + 1] = total[2, 3] / w
    step[PHI + 2] = total[3, 2] * w
    step[PHI + 3] = total[3, 3] if constant[TIME_CONSTANT] == 0.0 else 0.0
    step[PATH_PLACE] = total[2, 4]
    step[PATH_PLACE + 1] = total[3, 4] * w
    for j in range(3):
        scale = 1.0 / w if j == 1 else 1.0
        step[J1 + j] = total[1, 2 + j] * scale
        step[J2 + j] = total[0, 2 + j] * scale
    step[FADE], step[ANGLE_OF_RATE] = total[1, 1], total[0, 1]
    step[KEEP_PLACE] = exp_of(-h / constant[TURBULENCE_TIME])


@inner
def set_steps(belief, fil, work, frequency, damping, h):
    """Constants of a time step h [s], and of its last part, in which a command acts that no sample holds."""
    set_step(belief.constant, frequency, damping, h, work, fil.step)
    if belief.constant[MISSING] > 0.0:
        set_step(belief.constant, frequency, damping, belief.constant[MISSING] * h, work, fil.missed)

"""A step of the state, its covariance and its sensitivities, and what each term and each noise does over it."""

from ..algebra.library import library_column
from ..kernels import inner
from ..model import TURBULENCE
from .belief import AT_BETA, AT_THETA, LEAN
from .servo import ANGLE_OF_RATE, FADE, J1, J2, KEEP_PLACE, PATH_PLACE, PHI, STEP_PLACE
from .states import ACCELERATION_NOISE, COMMAND_NOISE, MOMENT_TEST, N_STATES, N_TESTS, SLOPE_A6, SLOPE_K1


@inner
def drive_terms(belief, fil, work, a6, k1, u, air):
    """Effect of a unit of each term's coefficient on theta and theta_dot over the step.

    For theta and beta the unit is the nominal's own a6, k1 (a relative deviation); they multiply the angle of attack,
    whose part `air` [rad] is known, and the deflection with the lean that is known.
    """
    h, reach = fil.step[STEP_PLACE], fil.step[ANGLE_OF_RATE]
    x = fil.x
    work.raw[0, 0], work.raw[1, 0], work.raw[2, 0] = x[0] + 0.5 * h * x[1], x[1], x[2] + 0.5 * h * x[3]
    for j in range(belief.size.terms):
        library_column(belief.codes[j], work.raw[:], work.raw[belief.codes[j, 5]], 1, work.value[:])
        work.drive[0, j] = 0.5 * h * reach * work.value[0]
        work.drive[1, j] = reach * work.value[0]
    theta, beta = belief.term[AT_THETA], belief.term[AT_BETA]
    y0 = x[0] + air
    work.drive[0, theta] = a6 * h * reach * (0.5 * y0 + h / 6.0 * x[1])
    work.drive[1, theta] = a6 * reach * (y0 + 0.5 * h * x[1])
    lean = belief.constant[LEAN]
    work.drive[0, beta] = k1 * (fil.step[J2] * x[2] + fil.step[J2 + 1] * x[3] + fil.step[J2 + 2] * u
                                + 0.5 * h * reach * lean)
    work.drive[1, beta] = k1 * (fil.step[J1] * x[2] + fil.step[J1 + 1] * x[3] + fil.step[J1 + 2] * u + reach * lean)


@inner
def fill_transition(belief, fil, f, a6, k1, push):
    """Transition matrix of the step.  Left out: a6 h^2/6 of the nozzle's effect on the attitude, 3e-5 of k1 here; of
    known damping d what it does to the effect of a6 within a step, a6 d h^3/6.
    """
    h, reach = fil.step[STEP_PLACE], fil.step[ANGLE_OF_RATE]
    c = 1.0 + 0.5 * a6 * h * h
    s = reach + a6 * h * h * h / 6.0
    f[0, 0], f[0, 1] = c, s
    f[1, 0], f[1, 1] = a6 * s, c * fil.step[FADE]
    f[0, 2], f[0, 3] = k1 * fil.step[J2], k1 * fil.step[J2 + 1]
    f[1, 2], f[1, 3] = k1 * fil.step[J1], k1 * fil.step[J1 + 1]
    f[2, 2], f[2, 3] = fil.step[PHI], fil.step[PHI + 1]
    f[3, 2], f[3, 3] = fil.step[PHI + 2], fil.step[PHI + 3]
    for j in range(belief.size.nuisances):
        f[0, N_STATES + j], f[1, N_STATES + j] = 0.5 * h * reach * push[j], reach * push[j]
        f[N_STATES + j, N_STATES + j] = fil.step[KEEP_PLACE] if belief.role[j] == TURBULENCE else 1.0


@inner
def propagate_covariance(f, n, p, work):
    """p <- F p F' for the first n rows and columns of a symmetric p; F is block upper
    triangular, diagonal in the nuisances."""
    m = work
    for j in range(n):
        m[0, j] = f[0, 0] * p[0, j] + f[0, 1] * p[1, j] + f[0, 2] * p[2, j] + f[0, 3] * p[3, j]
        m[1, j] = f[1, 0] * p[0, j] + f[1, 1] * p[1, j] + f[1, 2] * p[2, j] + f[1, 3] * p[3, j]
        m[2, j] = f[2, 2] * p[2, j] + f[2, 3] * p[3, j]
        m[3, j] = f[3, 2] * p[2, j] + f[3, 3] * p[3, j]
    for k in range(N_STATES, n):
        for j in range(n):
            m[0, j] += f[0, k] * p[k, j]
            m[1, j] += f[1, k] * p[k, j]
            m[k, j] = f[k, k] * p[k, j]
    for i in range(n):  # the lower triangle, mirrored: what is not symmetric would grow as the vehicle does
        p[i, 0] = m[i, 0] * f[0, 0] + m[i, 1] * f[0, 1] + m[i, 2] * f[0, 2] + m[i, 3] * f[0, 3]
        p[i, 1] = m[i, 0] * f[1, 0] + m[i, 1] * f[1, 1] + m[i, 2] * f[1, 2] + m[i, 3] * f[1, 3]
        p[i, 2] = m[i, 2] * f[2, 2] + m[i, 3] * f[2, 3]
        p[i, 3] = m[i, 2] * f[3, 2] + m[i, 3] * f[3, 3]
        for k in range(N_STATES, n):
            p[i, 0] += m[i, k] * f[0, k]
            p[i, 1] += m[i, k] * f[1, k]
        for k in range(N_STATES, i + 1):
            p[i, k] = m[i, k] * f[k, k]
    for i in range(1, n):
        for j in range(i):
            p[j, i] = p[i, j]


@inner
def propagate_sensitivities(f, n, s, columns):
    """s <- F s for the first n rows and so many columns of s inout."""
    for j in range(columns):
        y0, y1, y2, y3 = s[0, j], s[1, j], s[2, j], s[3, j]
        s[0, j] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3
        s[1, j] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3
        s[2, j] = f[2, 2] * y2 + f[2, 3] * y3
        s[3, j] = f[3, 2] * y2 + f[3, 3] * y3
    for k in range(N_STATES, n):
        for j in range(columns):
            s[0, j] += f[0, k] * s[k, j]
            s[1, j] += f[1, k] * s[k, j]
            s[k, j] *= f[k, k]


@inner
def drive_tests(belief, fil, work, age):
    """Effect of the tests' units on theta and theta_dot over the step, `age` [s] after the first sample."""
    h, reach, first = fil.step[STEP_PLACE], fil.step[ANGLE_OF_RATE], belief.size.sensitivities - N_TESTS
    theta, beta = belief.term[AT_THETA], belief.term[AT_BETA]
    for i in range(2):
        fil.s[i, first + SLOPE_A6] += age * work.drive[i, theta]
        fil.s[i, first + SLOPE_K1] += age * work.drive[i, beta]
    fil.s[0, first + MOMENT_TEST] += 0.5 * h * reach
    fil.s[1, first + MOMENT_TEST] += reach


@inner
def advance_state(belief, fil, f, k1, u, known):
    """x over the step.  u [rad] command, `known` [rad/s^2] acceleration, both held."""
    x, h, reach = fil.x, fil.step[STEP_PLACE], fil.step[ANGLE_OF_RATE]
    y0, y1, y2, y3 = x[0], x[1], x[2], x[3]
    b0, b1 = k1 * fil.step[J2 + 2], k1 * fil.step[J1 + 2]
    x[0] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3 + b0 * u
    x[1] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3 + b1 * u
    x[2] = f[2, 2] * y2 + f[2, 3] * y3 + fil.step[PATH_PLACE] * u
    x[3] = f[3, 2] * y2 + f[3, 3] * y3 + fil.step[PATH_PLACE + 1] * u
    x[0] += 0.5 * h * reach * known
    x[1] += reach * known
    for k in range(N_STATES, belief.size.states):
        x[0] += f[0, k] * x[k]
        x[1] += f[1, k] * x[k]
        x[k] *= f[k, k]


@inner
def add_held_noise(step, k1, variance, p):
    """Process noise of a command that is held over a step, into a covariance."""
    b = (k1 * step[J2 + 2], k1 * step[J1 + 2], step[PATH_PLACE], step[PATH_PLACE + 1])
    for i in range(N_STATES):
        for j in range(N_STATES):
            p[i, j] += b[i] * b[j] * variance


@inner
def add_process_noise(fil, k1, command_variance, acceleration_variance):
    """Process noise of one step into the covariance and its derivative for the two process levels."""
    h, reach = fil.step[STEP_PLACE], fil.step[ANGLE_OF_RATE]
    add_held_noise(fil.step, k1, command_variance, fil.p[:])
    add_held_noise(fil.step, k1, 2.0 * command_variance, fil.sp[COMMAND_NOISE])
    w = (0.5 * h * reach, reach)
    for i in range(2):
        for j in range(2):
            q = w[i] * w[j] * acceleration_variance
            fil.p[i, j] += q
            fil.sp[ACCELERATION_NOISE, i, j] += 2.0 * q

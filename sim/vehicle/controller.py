"""The laws: PD of the attitude error with a discrete pseudo-derivative, PI of the rate error; and discrete sections."""

from .kernels import inner, kernel

# columns of a section (n, N_SECTION): its coefficients, and what it remembers
B0, B1, B2, A1, A2, FIRST, SECOND = range(7)
N_SECTION = 7


@kernel
def pseudo_derivative(time_constant, period, error, previous_error, derivative):
    """Backward-Euler filtered derivative: d <- (tau d + e - e_previous)/(tau + period)."""
    return (time_constant * derivative + error - previous_error) / (time_constant + period)


@kernel
def pd_law(kp, kd, error, derivative):
    """kp e + kd d [rad]."""
    return kp * error + kd * derivative


@kernel
def pi_law(kp, ki, error, integral):
    """kp e + ki integral(e) [rad], e a rate's error [rad/s]."""
    return kp * error + ki * integral


@kernel
def limited(limit, command):
    """command within +-limit [rad]."""
    return min(max(command, -limit), limit)


@inner
def filtered(sections, x):
    """x [rad] through the sections (n, N_SECTION) inout in their order: transposed direct form II (Oppenheim and
    Schafer, Discrete-Time Signal Processing, 3rd ed., ch. 6.3)."""
    for e in range(sections.shape[0]):
        y = sections[e, B0] * x + sections[e, FIRST]
        sections[e, FIRST] = sections[e, B1] * x - sections[e, A1] * y + sections[e, SECOND]
        sections[e, SECOND] = sections[e, B2] * x - sections[e, A2] * y
        x = y
    return x

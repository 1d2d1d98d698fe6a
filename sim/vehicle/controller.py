"""PD control of the attitude error with a discrete pseudo-derivative filter."""

from .kernels import kernel


@kernel
def pseudo_derivative(time_constant, period, error, previous_error, derivative):
    """Backward-Euler filtered derivative: d <- (tau d + e - e_previous)/(tau + period)."""
    return (time_constant * derivative + error - previous_error) / (time_constant + period)


@kernel
def pd_command(kp, kd, limit, error, derivative, excitation=-0.0):
    """kp e + kd d + excitation, limited to +-limit [rad].  -0.0, no test input, changes no bit of any sum."""
    return min(max(kp * error + kd * derivative + excitation, -limit), limit)

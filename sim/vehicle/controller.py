"""Kernels of a control law: discrete pseudo-derivative, deflection limit, filters."""

from ..kernels import inner
from ..sections import LAWS

RATE_LAW, GYRO_LAW = LAWS.index("rate"), LAWS.index("gyro")  # numbers of laws in a record


@inner
def pseudo_derivative(time_constant, period, error, previous_error, derivative):
    """Return the backward-Euler filtered derivative: d <- (tau d + e - e_previous)/(tau + period); times in s."""
    return (time_constant * derivative + error - previous_error) / (time_constant + period)


@inner
def limited(limit, x):
    """Return x cut to +-limit."""
    return -limit if x < -limit else (limit if x > limit else x)


@inner
def filtered(filters, x):
    """Return x [rad] filtered by the sections (n,) SECTION, inout, in order: transposed direct form II (Oppenheim and
    Schafer, Discrete-Time Signal Processing, 3rd ed., ch. 6.3)."""
    for section in filters:
        y = section.b0 * x + section.first
        section.first = section.b1 * x - section.a1 * y + section.second
        section.second = section.b2 * x - section.a2 * y
        x = y
    return x

"""Rotation of the rigid launcher, and its drift off the reference flight path.

Assumptions: small angles, one plane, wind as an angle, no flexible modes.
Without wind and drift alpha is theta, to the bit: wind is then -0.0 and gamma 0.0, which change no bit of a sum.
"""

from .kernels import kernel


@kernel
def angle_of_attack(theta, gamma, wind):
    """alpha = theta - gamma + wind, all [rad]."""
    return theta - gamma + wind


@kernel
def angular_acceleration(a6, k1, alpha, beta, disturbance):
    """theta_ddot [rad/s^2] = a6 alpha + k1 beta + disturbance (Navarro-Tapia et al., eq. 8)."""
    return a6 * alpha + k1 * beta + disturbance


@kernel
def drift_rate(z_alpha, z_beta, alpha, beta):
    """gamma_dot [rad/s] = z_alpha alpha + z_beta beta: lift and thrust across the path, over mass times speed."""
    return z_alpha * alpha + z_beta * beta

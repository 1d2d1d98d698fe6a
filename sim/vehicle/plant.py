"""Rotation of the rigid launcher.

Assumptions: small angles, one plane, wind as an angle, no flexible modes.
"""

from .kernels import kernel


@kernel
def angular_acceleration(a6, k1, theta, beta, disturbance):
    """theta_ddot [rad/s^2] = a6 theta + k1 beta + disturbance (Navarro-Tapia et al., eq. 8)."""
    return a6 * theta + k1 * beta + disturbance

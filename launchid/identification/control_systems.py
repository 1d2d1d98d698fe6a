"""Return what was identified as systems of python-control."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from launchid_core import Estimate
from sim.errors import InputError, UsageError, extra_needed

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction

LINEAR_PLANT_TERMS = {"theta", "theta_dot", "beta", "1"}  # terms of a linear plant; a constant moves where it rests


class ControlPlant(NamedTuple):
    """The airframe as identified in one window, frozen at its centre.

    state_space        theta_ddot = a6 theta + d theta_dot + k1 beta: input beta [rad], states and outputs theta [rad],
                       theta_dot [rad/s]; beta is the input as it acts: a delay or a lag that `identify` found (`late`)
                       is no part of the plant
    transfer_function  from beta to theta: k1/(s^2 - d s - a6)
    covariance         (2, 2) of a6 and k1 [1/s^4]
    t                  [s] the window's centre
    """

    state_space: "StateSpace"
    transfer_function: "TransferFunction"
    covariance: np.ndarray
    t: float


def control_plant(estimates: Sequence[Estimate], path: str, t: float | None) -> ControlPlant:
    """Return the plant of the valid window that holds t [s] (None: of the last valid one).  InputError if there is
    none, UsageError if its terms are not those of a linear plant; path: of the log, for messages."""
    try:
        import control
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None
    valid = [e for e in estimates if e.valid and (t is None or e.t_start <= t < e.t_end)]
    if not valid:
        raise InputError(f"{path}: no window is valid" + (f" at {t:g} s" if t is not None else ""))
    e = valid[-1]
    active = {term: float(e.xi[k, 1]) for k, term in enumerate(e.terms) if e.support[k, 1]}
    if others := sorted(set(active) - LINEAR_PLANT_TERMS):
        raise UsageError(f"to_control: the term {others[0]} is of no linear plant; expected theta, theta_dot, beta, 1: "
                         "identify with library='theta,beta,theta_dot,1'")
    if not math.isfinite(e.a6 + e.k1):
        raise UsageError("to_control: the library has no theta or no beta; expected both")
    damping = active.get("theta_dot", 0.0)
    names = {"inputs": ["beta"], "outputs": ["theta", "theta_dot"], "states": ["theta", "theta_dot"]}
    state_space = control.ss([[0.0, 1.0], [e.a6, damping]], [[0.0], [e.k1]], np.eye(2), np.zeros((2, 1)), **names)
    transfer_function = control.tf([e.k1], [1.0, -damping, -e.a6], inputs=["beta"], outputs=["theta"])
    std = np.array([e.a6_std, e.k1_std])
    return ControlPlant(state_space, transfer_function,
                        np.outer(std, std) * np.array([[1.0, e.a6_k1_corr], [e.a6_k1_corr, 1.0]]),
                        0.5 * (e.t_start + e.t_end))

"""The likelihood as a pure function: parameters in, innovations and their variances out; nothing stays between calls.

A run holds the parameters that it was made with, so whoever has the run has everything that it depends on: `follow`
asks how the innovations change with other numbers while its gains hold, `respond` how they change with a small forcing,
`predict` what it foresees.
"""

from typing import NamedTuple

import numpy as np

from . import kernel

LEVELS = ("theta", "theta_dot", "beta", "acceleration", "command", "walk", "turbulence")   # the order of noise levels


class Parameters(NamedTuple):
    """All that a run reads; nobody writes to its arrays.

    t        (n + 1,) [s] of the rows and of the end of the last
    z        (n, 3) theta [rad], theta_dot [rad/s], beta [rad], NaN where not measured
    u        (n, steps) [rad] commands over the equal steps between two rows, each the mean over its step
    rows     (n,) of kernel.ROW: coefficients of the acceleration over each row
    numbers  (1,) of kernel.NUMBERS: sensors, curves, servo, air, noise, what is known before the first row
    modes    (n, m) of kernel.MODE: slosh and bending over each row, m of them at all rows
    """

    t: np.ndarray
    z: np.ndarray
    u: np.ndarray
    rows: np.ndarray
    numbers: np.ndarray
    modes: np.ndarray


class Run(NamedTuple):
    """The filter's run over a log; states are kernel.TH, OM, M, G, B, V and two of each mode.

    E, S  (n, 3) innovations, 0 where nothing was measured, and their variances, NaN there;  K (n, 3, states) gains
    X     (n, states) filtered states;  A (n, 3) slopes of omega' in theta, omega, beta;  C (n, states, states)
          covariances of X, (0, states, states) if they were not asked for
    """

    parameters: Parameters
    E: np.ndarray
    S: np.ndarray
    K: np.ndarray
    X: np.ndarray
    A: np.ndarray
    C: np.ndarray


def no_modes(rows: int) -> np.ndarray:
    """Return `Parameters.modes` of a rigid vehicle."""
    return np.zeros((rows, 0), kernel.MODE)


def run(parameters: Parameters, covariances: bool = False) -> Run:
    """Filter a log with these parameters; covariances: also return those of the states."""
    n, states = len(parameters.z), kernel.CORE + 2 * parameters.modes.shape[1]
    E, S = np.empty((n, 3)), np.empty((n, 3))
    K, X, A = np.zeros((n, 3, states)), np.empty((n, states)), np.zeros((n, 3))
    C = np.empty((n if covariances else 0, states, states))
    kernel.run(*_of(parameters), False, E, S, K, X, A, C)
    return Run(parameters, E, S, K, X, A, C)


def follow(base: Run, parameters: Parameters) -> np.ndarray:
    """Return the innovations (n, 3) with other parameters, the gains of `base` held."""
    E = np.empty_like(base.E)
    kernel.run(*_of(parameters), True, E, base.S, base.K, base.X, base.A, base.C)
    return E


def whitened(E: np.ndarray, S: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, float]:
    """Return innovations over their standard deviation (r,), shortened beyond 8, and the sum of the log variances.

    E, S  (n, 3);  at (r,) which of them, as an index into all
    """
    out = np.empty(len(at))
    return out, kernel.whiten(E.ravel(), S.ravel(), at, out)


def respond(base: Run, force: np.ndarray, command: np.ndarray, shift: np.ndarray, sub: int) -> np.ndarray:
    """Return the change (n, 3) of the innovations by a small force (n,) [rad/s^2], command (n,) [rad] and shift (n, 3)
    of the measurements, about the path of `base`, in `sub` steps a row."""
    p, E = base.parameters, np.empty_like(base.E)
    kernel.respond(p.t, p.z, p.rows, p.modes, p.numbers, sub, base.K, base.A, force, command, shift, E)
    return E


def predict(base: Run, starts: np.ndarray, spans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and variances (starts, spans, 3) of open-loop predictions from the rows `starts`, `spans`
    (increasing) rows ahead; variances are NaN without covariances in `base`."""
    errors, variances = np.empty((2, len(starts), len(spans), 3))
    kernel.ahead(*_of(base.parameters), base.X, base.C, starts, spans, errors, variances)
    return errors, variances


def nozzle_path(base: Run, step: float) -> np.ndarray:
    """Return the nozzle (n steps,) [rad] at the start of each step of `step` [s]."""
    return kernel.nozzle_path(base.X, base.parameters.u, base.parameters.numbers, step)


def _of(p: Parameters) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return p.t, p.z, p.u, p.rows, p.modes, p.numbers

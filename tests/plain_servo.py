"""The on-board filter's regression with a servo that is not known, in plain numpy: what its kernels have to say.

The step is the core's (`launchid_core.servo`, `transition`): the generator of (double integral of beta, its integral,
beta, beta_dot/w, u) over h, and the vehicle that those move.  Each innovation, over its standard deviation, is a row of
a linear regression on the offset at the window's start, a6, k1, natural frequency, damping ratio and delay; the gain is
held.

A delay ends inside a step: until then the older command acts, then the newer.  With G(h) the effect of a held command
over h, r the time of the switch, x+ = F x + G(h) u_old + G(h - r) (u_new - u_old), and a later switch takes from it

    d x+/d delay = -G'(h - r) (u_new - u_old),   G' = (k1 J1, k1 beta, beta_dot, beta_ddot) of a unit command.

The mean of the two over the step, which is enough for a6 and k1, is off by r (h - r)/2 in its first moment, and draws
the delay by 1 ms and the frequency by 8 % (constant, 70 s, whose standard deviations are 0.1 ms and 0.6 %).
"""

import numpy as np
from scipy.linalg import expm

UNKNOWN = ("a6", "k1", "natural_frequency", "damping_ratio", "delay")


def generator(w: float, zeta: float, h: float) -> np.ndarray:
    """Times h, of (double integral, integral, beta, beta_dot/w, u)."""
    m = np.zeros((5, 5))
    m[0, 1] = m[1, 2] = h
    m[2, 3], m[3, 2:5] = w * h, (-w * h, -2 * zeta * w * h, w * h)
    return m


def generator_slopes(w: float, zeta: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """The generator's derivatives for w and zeta."""
    by_w, by_zeta = np.zeros((5, 5)), np.zeros((5, 5))
    by_w[2, 3], by_w[3, 2:5] = h, (-h, -2 * zeta * h, h)
    by_zeta[3, 3] = -2 * w * h
    return by_w, by_zeta


def constants(w: float, zeta: float, h: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """J2, J1, PHI with GAMMA: rows (double integral, integral, beta, beta_dot) of columns (beta, beta_dot, u); and
    their derivatives for w and zeta."""
    m = generator(w, zeta, h)
    e = expm(m)
    slopes = [expm(np.block([[m, d], [np.zeros((5, 5)), m]]))[:5, 5:] for d in generator_slopes(w, zeta, h)]
    up, down = np.diag([1, 1, 1, w, 1.0]), np.diag([1, 1, 1, 1 / w, 1.0])
    by_up, by_down = np.diag([0, 0, 0, 1.0, 0]), np.diag([0, 0, 0, -1 / w**2, 0])
    by_w = up @ slopes[0] @ down + by_up @ e @ down + up @ e @ by_down
    return (up @ e @ down)[:4, 2:], [by_w[:4, 2:], (up @ slopes[1] @ down)[:4, 2:]]


def nozzle_part(k1: float, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The effect of constants, or of their derivatives, on the state: (4, 4) from it, (4,) from a held command."""
    scale = np.array([k1, k1, 1.0, 1.0])
    return np.column_stack([np.zeros((4, 2)), scale[:, None] * c[:, :2]]), scale * c[:, 2]


def rows(p: np.ndarray, z: np.ndarray, u: np.ndarray, noises: np.ndarray, h: float) -> np.ndarray:
    """(3 n, 10): each innovation's sensitivities to the offset and to UNKNOWN, then itself, over its deviation.

    p (5,) what it is linearised about;  z (n, 3), u (n,) measurements and commands;  noises (5,) variances
    """
    a6, k1, w, zeta, delay = p
    whole = int(delay / h + 1e-9)
    rest = h - (delay - whole * h)
    now, slopes = constants(w, zeta, h)
    late, late_slopes = constants(w, zeta, rest)
    f, g = nozzle_part(k1, now)
    f[:2, :2] = [[1 + 0.5 * a6 * h * h, h + a6 * h**3 / 6], [a6 * (h + a6 * h**3 / 6), 1 + 0.5 * a6 * h * h]]
    g_late = nozzle_part(k1, late)[1]
    speed = np.array([k1 * late[1, 2], k1 * late[2, 2], late[3, 2],
                      w * w * (1.0 - late[2, 2]) - 2.0 * zeta * w * late[3, 2]])  # G'(h - r)
    push = np.array([0.5 * h * h, h, 0.0, 0.0])
    noise = np.outer(g, g) * noises[3] + np.outer(push, push) * noises[4]
    x, cov, s, found = np.array([*z[0], 0.0]), np.diag([*noises[:3], 0.25]), np.eye(4, 9), []
    past = np.concatenate([np.zeros(whole + 1), u])
    for k in range(len(u)):
        for c in range(3):
            variance, e, row = cov[c, c] + noises[c], z[k, c] - x[c], s[c].copy()
            gain = cov[:, c] / variance
            found.append(np.append(row, e) / np.sqrt(variance))
            x, s, cov = x + gain * e, s - np.outer(gain, row), cov - np.outer(gain, cov[c])
        old, jump = past[k], past[k + 1] - past[k]
        drive = np.zeros((4, 9))
        drive[:2, 4] = h * h * (0.5 * x[0] + h / 6 * x[1]), h * (x[0] + 0.5 * h * x[1])
        drive[:2, 5] = now[:2] @ [x[2], x[3], old] + late[:2, 2] * jump
        for j in range(2):
            moved, by_command = nozzle_part(k1, slopes[j])
            drive[:, 6 + j] = moved @ x + by_command * old + nozzle_part(k1, late_slopes[j])[1] * jump
        drive[:, 8] = -speed * jump
        s, x = f @ s + drive, f @ x + g * old + g_late * jump
        cov = f @ cov @ f.T + noise
    return np.array(found)


def fitted(z: np.ndarray, u: np.ndarray, noises: np.ndarray, h: float, start: np.ndarray,
           sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """UNKNOWN and their standard deviations from one window's own data, relinearised; sigma (3,) of the servo's prior,
    in its units, about start (5,)."""
    p, most = start.copy(), np.array([1.0, 2.0, 10.0, 0.2, 0.008])
    for _ in range(12):
        table = rows(p, z, u, noises, h)
        prior = np.zeros((3, 10))
        prior[:, 6:9], prior[:, 9] = np.diag(1 / sigma), (start[2:] - p[2:]) / sigma
        a = np.vstack([table, prior])
        scale = np.linalg.norm(a[:, :9], axis=0)
        step = np.linalg.lstsq(a[:, :9] / scale, a[:, 9], rcond=None)[0] / scale
        p = np.maximum(p + np.clip(step[4:], -most, most), [-np.inf, -np.inf, 1.0, 0.01, 0.0])
        information = (a[:, :9] / scale).T @ (a[:, :9] / scale)
        std = np.sqrt(np.diag(np.linalg.inv(information)))[4:] / scale[4:]
        if np.all(np.abs(step[4:]) < 0.05 * std):
            break
    return p, std

"""Flights behind any linear law, by an integration of their own, and their margins by python-control.

A law is (a, b, c, d, T): u_k = sum a_i u_(k-1-i) + b_i theta_(k-i) + c_i theta_dot_(k-i) + d_i theta_ref_(k-i), every
T [s].
"""

import math
from typing import NamedTuple

import control
import numpy as np
from scipy.linalg import expm
from scipy.signal import bilinear, ss2tf

GUIDANCE = ([0, 6, 16, 28, 34, 44, 48, 56, 70], [0, 0, -0.1396, -0.1396, -0.0524, -0.0873, -0.0873, -0.0262, -0.0524])
STD = {"theta": 3.5e-4, "theta_dot": 5.2e-4, "beta": 3.5e-4, "command": 7.0e-4, "acceleration": 8.7e-4}
LIMIT = 0.12            # rad
STILL = ([0.0, 70.0], [0.0, 0.0])


class Vehicle(NamedTuple):
    """a6, k1 [1/s^2], the servo's natural frequency [rad/s], damping ratio and delay [s], damping of the rate [1/s]."""

    a6: float = 2.0
    k1: float = -7.0
    frequency: float = 50.0
    damping: float = 0.7
    delay: float = 0.008
    rate_damping: float = 0.0


USUAL = Vehicle()


class AnyLaw(NamedTuple):
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    T: float


def law(den, theta, rate=(0.0,), ref=None, T=0.01, late=0) -> AnyLaw:
    """The law of polynomials in z^-1: den u = z^-late (theta theta + rate theta_dot + ref theta_ref); ref: -theta."""
    n = max(len(den) - 1, len(theta) - 1 + late, len(rate) - 1 + late)

    def padded(x, k):
        return np.concatenate([np.zeros(k), np.asarray(x, float), np.zeros(n + 1 - k - len(x))])

    b = padded(theta, late)
    return AnyLaw(-padded(den, 0)[1:], b, padded(rate, late), -b if ref is None else padded(ref, late), T)


def pd(kp, kd, tau, T=0.01):
    """(den, theta) of a PD whose derivative is filtered over tau [s]."""
    alpha = tau / (tau + T)
    return np.array([1.0, -alpha]), kp * np.array([1.0, -alpha]) + kd / (tau + T) * np.array([1.0, -1.0])


def second(w, zeta, T=0.01, top=None):
    """(num, den) of a second-order low-pass, or of a notch whose numerator has the damping ratio `top`."""
    return bilinear([w * w] if top is None else [1.0, 2.0 * top * w, w * w], [1.0, 2.0 * zeta * w, w * w], 1.0 / T)


def laws(T=0.01) -> dict[str, AnyLaw]:
    one, (den, num) = np.array([1.0, -1.0]), pd(1.2, 0.5, 0.05)
    (nn, dn), (n4, d4), (n3, d3) = second(30.0, 0.6, top=0.1), second(40.0, 0.7), second(30.0, 0.7)
    lead = bilinear([0.6, 1.5], [1.0 / 30.0, 1.0], 100.0)
    gain, feed = np.array([[0.25, 0.01], [0.3, 0.3]]), np.array([[1.3, 0.55]])
    A = np.array([[1.0, T], [2.0 * T, 1.0]]) + np.array([[-3.5 * T * T], [-7.0 * T]]) @ feed - gain
    (tops, dens), (rates, _) = (ss2tf(A, gain, feed, np.zeros((1, 2)), k) for k in (0, 1))
    fold = np.convolve
    return {"pd": law(den, num), "pd hot": law(*pd(3.0, 1.1, 0.03)), "pd soft": law(*pd(0.7, 0.35, 0.1)),
            "pd 50 Hz": law(*pd(1.2, 0.5, 0.05, 0.02), T=0.02), "pd late": law(den, num, late=2),
            "pd gyro": law([1.0], [1.2], [0.45]),
            "pid": law(fold(den, one), fold(num, one) + fold(den, [0.5 * T, 0.0])),
            "cascade": law(one, 1.25 * one + [2.0 * T, 0.0], 0.5 * one + [0.8 * T, 0.0]), "lead": law(lead[1], lead[0]),
            "pd notch": law(fold(den, dn), fold(num, nn)), "pd low-pass": law(fold(den, d4), fold(num, n4)),
            "gyro low-pass": law(d3, 1.2 * d3, 0.45 * n3), "feed-forward": law(den, num, ref=-0.7 * num),
            "pd lag": law(fold(den, [1.0, -0.6]), fold(num, [0.4])),
            "observer": law(dens, tops[0], rates[0])}


LAWS = laws()


def sampled(vehicle: Vehicle, T: float) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """F (4, 4) of theta, theta_dot, beta, beta_dot over T; what the command of 0, 1, ... periods ago moves, (4,) each;
    what a held acceleration moves."""
    a6, k1, w, zeta, delay, rate_damping = vehicle
    A = np.zeros((6, 6))
    A[0, 1] = A[1, 5] = A[2, 3] = 1.0
    A[1, :3] = a6, -rate_damping, k1
    A[3, 2:5] = -w * w, -2.0 * zeta * w, w * w
    whole = int(delay / T + 1e-9)
    rest = max(delay - whole * T, 0.0)
    all_of, late, early = expm(A * T), expm(A * (T - rest)), expm(A * rest)
    moves = [np.zeros(4)] * whole + [late[:4, 4], late[:4, :4] @ early[:4, 4]]
    return all_of[:4, :4], moves, all_of[:4, 5]


def fly(of: AnyLaw, vehicle: Vehicle = USUAL, seed: int = 0, duration: float = 70.0, guidance=GUIDANCE,
        copies: bool = False) -> dict[str, np.ndarray]:
    """Columns of a flight, one row a tick; copies: theta and theta_dot are other sensors' than those of the law."""
    a, b, c, d, T = of
    n, order = round(duration / T), len(a)
    noise = np.random.default_rng((31, seed)).standard_normal((n, 7)) * [*STD.values(), STD["theta"], STD["theta_dot"]]
    ref = np.interp(np.arange(n) * T, *guidance)
    F, moves, push = sampled(vehicle, T)
    x, u, th, om, re = np.zeros(4), np.zeros(order + len(moves) + 1), *(np.zeros(order + 1) for _ in range(3))
    acted, out = np.zeros(len(moves)), np.zeros((n, 5))
    for k in range(n):
        for past, new in ((th, x[0] + noise[k, 0]), (om, x[1] + noise[k, 1]), (re, ref[k])):
            past[1:], past[0] = past[:-1].copy(), new
        command = b @ th + c @ om + d @ re + a @ u[:order]
        command = min(max(command, -LIMIT), LIMIT)
        u[1:], u[0] = u[:-1].copy(), command
        acted[1:], acted[0] = acted[:-1].copy(), command + noise[k, 3]
        seen = x[:2] + (noise[k, 5:] if copies else noise[k, :2])
        out[k] = *seen, x[2] + noise[k, 2], command, ref[k]
        x = F @ x + sum(move * each for move, each in zip(moves, acted, strict=True)) + push * noise[k, 4]
    names = ("theta", "theta_dot", "beta", "beta_cmd", "theta_ref")
    return {"t": np.round(np.arange(n) * T, 9)} | dict(zip(names, out.T, strict=True))


def response(of: AnyLaw, vehicle: Vehicle, omega: np.ndarray) -> np.ndarray:
    """The loop gain L (p,) at omega (p,) [rad/s] by python-control's systems; 1 + L = 0 is the verge."""
    F, moves, _ = sampled(vehicle, of.T)
    z, total = np.exp(1j * omega * of.T), 0.0
    for row, top in ((0, of.b), (1, of.c)):
        if np.any(top):
            plant = sum(control.ss(F, move[:, None], np.eye(4)[row:row + 1], 0.0, of.T)(z) * z**-k
                        for k, move in enumerate(moves))
            total = total + control.tf(top, np.r_[1.0, -of.a], of.T)(z) * plant
    return -np.asarray(total)


def truth(of: AnyLaw, vehicle: Vehicle = USUAL, points: int = 3000) -> np.ndarray:
    """Low and high gain [dB], phase [deg], delay [ms], modulus and disk margin by python-control, as `MARGIN_NAMES`."""
    omega = np.geomspace(1e-3, 0.9999 * math.pi / of.T, points)
    gain = response(of, vehicle, omega)
    gains, phases, distances, _, at, _ = control.stability_margins(control.frd(gain, omega), returnall=True)
    static = -1.0 / gain[0].real if abs(gain[0].imag) < 1e-2 * abs(gain[0].real) else math.nan   # at z = 1
    last = -1.0 / gain[-1].real if abs(gain[-1].imag) < 1e-2 * abs(gain[-1].real) else math.nan  # at z = -1
    gains = np.r_[gains, static, last]
    low, high = gains[(gains > 0) & (gains < 1)], gains[gains > 1]
    with np.errstate(divide="ignore"):
        return np.array([20.0 * math.log10(low.max()) if len(low) else -math.inf,
                         20.0 * math.log10(high.min()) if len(high) else math.inf,
                         np.abs(phases).min() if len(phases) else math.inf,
                         1e3 * (np.mod(np.radians(phases), 2.0 * np.pi) / at).min() if len(phases) else math.inf,
                         np.abs(distances).min(), 2.0 * np.min(np.abs((1.0 + gain) / (1.0 - gain)))])

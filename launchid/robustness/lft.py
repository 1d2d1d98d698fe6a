"""The closed loop as an upper LFT F_u(M, Delta), Delta = diag(delta_a6, delta_k1), exact and minimal.

a6 = a6_0 (1 + sigma_a6 delta_a6), k1 = k1_0 (1 + sigma_k1 delta_k1), |delta| <= 1.  Plant and actuator are
continuous, the controller is discrete, so M is a linear system with jumps (Kabamba & Hara, IEEE TAC 38, 1993;
Chen & Francis, Optimal Sampled-Data Control Systems, 1995), here closed around plant, actuator and controller:

    flow      x' = a x + b w,   zeta = c x + d w,   w = Delta zeta      between the jumps
    tick      x <- tick x + hold u + reference r,  u = command x + command_reference r     at k T
    switch    x <- switch x                                                at k T + fraction, only with a delay

Delta enters the flow alone, each delta once: the flow is F_u(M, Delta) = a + b Delta (I - d Delta)^-1 c (Zhou, Doyle &
Glover, Robust and Optimal Control, 1996, ch. 10).  Over one period the jumps and two matrix exponentials of that
flow give the loop at the ticks, for any delta, without approximation.

Why not an LFT in z: the zero-order-hold equivalent holds exp(sqrt(a6) T), which is not rational in delta, so no
finite M(z) with two deltas is exact.  The exact M(z) of the lifted loop (Bamieh & Pearson, IEEE TAC 37, 1992;
Dullerud, Control of Uncertain Sampled-Data Systems, 1996) is an operator whose Delta-channel is L2[0, T); the jump
system is its state space.

Assumptions: parameters frozen at the asked time; linear loop: no deflection limit, noise or quantisation; the plant of
`blocks`, of which a6 and k1 alone are uncertain; delta constant in time; the delay holds each command and cuts inside a
period exactly.

State (n,): that of `blocks.flow_of`, theta first, v [rad] at the actuator's input last; the controller's
(`blocks.realised`); then [rad] the commands under way: the one due at kT + fraction, and the queue.
"""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.errors import InputError
from sim.flight import parameters
from sim.nominal import Nominal, Profile

from ..controller.law import Law
from .airframe import frozen
from .blocks import THETA, Plants, flow_of, realised, static_factor, static_line

EXPONENTIAL_ORDER = 14   # scaled norm <= 1/2: the remainder is below 3e-17
OFF_CIRCLE = 1e-13       # relative: far above rounding, far below what any margin shows
WHOLE_PERIOD = 1e-9      # of a period: a delay this close to whole periods is whole


@dataclass(frozen=True, eq=False)
class Lft:
    """LFT of the closed loop frozen at t [s], arrays of the module's equations: flow a, b, c, d; jumps tick, hold,
    reference, command, switch.  a6, k1 [1/s^2] at delta = 0; sigma (2,) their relative range; fraction, period [s]."""

    t: float                    # s
    a6: float                   # 1/s^2, at delta = 0
    k1: float                   # 1/s^2
    sigma: np.ndarray           # (2,) of a6, k1
    a: np.ndarray               # (n, n)
    b: np.ndarray               # (n, 2)
    c: np.ndarray               # (2, n)
    d: np.ndarray               # (2, 2)
    tick: np.ndarray            # (n, n)
    hold: np.ndarray            # (n,)
    reference: np.ndarray       # (n,)
    command: np.ndarray         # (n,)
    command_reference: float
    switch: np.ndarray          # (n, n)
    fraction: float             # s, after the tick
    period: float               # s
    delay: float                # s, between the controller's command and the actuator's input
    plant: Plants               # at delta = 0
    law: Law

    def parameters(self, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a6, k1, each (...) [1/s^2], at delta (..., 2)."""
        factor = 1.0 + self.sigma * delta
        return self.a6 * factor[..., 0], self.k1 * factor[..., 1]

    @property
    def has_other_paths(self) -> bool:
        """Whether commands reach the sensors by more than k1."""
        further = self.plant.further
        return further.turn != 0.0 or further.z_beta != 0.0 or further.nozzle_inertia != 0.0 or any(
            mode.is_bending for mode in self.plant.modes)

    def static(self, delta: np.ndarray) -> np.ndarray:
        """Return the factor (m,) on the gain with a root at z = 1, at delta (m, 2); NaN where no factor has one."""
        a6, k1 = self.parameters(delta)
        return static_factor(self.plant._replace(a6=a6, k1=k1), self.law)

    def static_line(self) -> tuple[float, float, float]:
        """Return (p, q, r) of the line p a6 + q k1 + r = 0 on which the loop has a root at z = 1."""
        return static_line(self.plant, self.law)


class Sampled(NamedTuple):
    """Loops at the ticks, cut at the controller's output: x+ = a x + b u + b_reference r (x before each tick).

    The controller commands command x + command_reference r; the loop is closed when u is that command.
    """

    a: np.ndarray               # (..., n, n)
    b: np.ndarray               # (..., n)
    b_reference: np.ndarray     # (..., n)
    command: np.ndarray         # (n,)
    command_reference: float
    period: float               # s

    def take(self, index: np.ndarray) -> "Sampled":
        """Return those loops that `index` selects along the first axis."""
        return self._replace(a=self.a[index], b=self.b[index], b_reference=self.b_reference[index])

    def gain(self, omega: np.ndarray) -> np.ndarray:
        """Return the loop gain L(exp(i omega T)) (..., p) at omega (..., p) [rad/s], as `loop_gain`."""
        return loop_gain(self, omega)


def value_at(profile: Profile, t: float, what: str) -> tuple[float, float]:
    """Return (a6, k1) of a profile at t [s]; InputError, begun with `what`, outside it (one node holds at all
    times)."""
    covers = len(profile.t) == 1 or profile.t[0] <= t <= profile.t[-1]
    if not math.isfinite(t) or not covers:
        raise InputError(f"{what}: t = {t!r} s: expected a time from {profile.t[0]:g} to {profile.t[-1]:g} s")
    a6, k1 = profile.at(np.array(t))
    return float(a6), float(k1)


def lft_at(nominal: Nominal, t: float, kp: float | None = None, kd: float | None = None) -> Lft:
    """Return the linear fractional transformation M of a nominal's closed loop, frozen at time t [s].

    kp, kd [s]   instead of the nominal's gains
    Raises InputError: a section missing, sigma not above 0, a time the profile does not cover, an effect that no loop
    has a model of.
    """
    nominal.require("uncertainty", "actuator", "controller")
    assert nominal.uncertainty is not None
    value_at(nominal.vehicle, t, f"{nominal.path}: [vehicle]")
    a6, k1 = (float(x) for x in parameters(nominal, np.array(t)))
    sigma = np.array(value_at(nominal.uncertainty, t, f"{nominal.path}: [uncertainty]"))
    if not np.all(sigma > 0.0):
        raise InputError(f"{nominal.path}: uncertainty = {sigma.tolist()} at t = {t!r} s: expected sigma above 0")
    plant, law = frozen(nominal, t, a6, k1, kp, kd)
    flow, own, delay = flow_of(plant), realised(law), float(plant.delay[0])
    whole, fraction = split_delay(delay, law.period)
    entry, begin = len(flow.alpha) - 1, len(flow.alpha)   # the actuator's input, the controller's first state
    fixed = begin + len(own.c)
    n = fixed + whole + (fraction > 0.0)
    a, b, c = np.zeros((n, n)), np.zeros((n, 2)), np.zeros((2, n))
    a[:begin, :begin] = flow.state[0]
    b[:begin] = flow.driven[:, None]
    c[0, :begin], c[1, :begin] = a6 * sigma[0] * flow.alpha, k1 * sigma[1] * flow.beta
    command, tick, reference = np.zeros(n), np.eye(n), np.zeros(n)
    channel = 1 if law.is_of_rate else 0   # of the reference
    command[:begin], command[begin:fixed] = own.d @ flow.sensed, own.c
    tick[begin:fixed, :begin], tick[begin:fixed, begin:fixed] = own.b @ flow.sensed, own.a
    reference[begin:fixed] = -own.b[:, channel]
    hold, switch = _delay_line(tick, whole, fraction, entry, fixed)
    return Lft(t=float(t), a6=a6, k1=k1, sigma=sigma, a=a, b=b, c=c, d=np.zeros((2, 2)), tick=tick, hold=hold,
               reference=reference, command=command, command_reference=-float(own.d[channel]), switch=switch,
               fraction=fraction, period=law.period, delay=whole * law.period + fraction, plant=plant, law=law)


def split_delay(delay: float, period: float) -> tuple[int, float]:
    """Return delay [s] as a number of whole periods and the rest [s], 0 <= rest < period."""
    whole = math.floor(delay / period + WHOLE_PERIOD)
    rest = delay - whole * period
    return whole, rest if rest > WHOLE_PERIOD * period else 0.0


def _delay_line(tick: np.ndarray, whole: int, fraction: float, entry: int,
                fixed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return hold (n,) and switch (n, n); write the queue's shift into `tick` (n, n) in place.  entry: the actuator's
    input; fixed: the first state of the queue, or of what is due.

    At a tick the oldest of `whole` queued commands leaves the queue, the new one enters; what leaves is at the
    actuator's input at once, or, with a fraction of a period left, waits in `due` until the switch.
    """
    n = len(tick)
    hold, switch = np.zeros(n), np.eye(n)
    leaves = fixed if fraction > 0.0 else entry
    places = [leaves, *range(n - whole, n)]      # from the exit back to the entry
    for place, behind in itertools.pairwise(places):
        tick[place] = np.eye(n)[behind]
    tick[places[-1]] = 0.0
    hold[places[-1]] = 1.0
    if fraction > 0.0:
        switch[entry] = np.eye(n)[fixed]
    return hold, switch


def checked(delta: np.ndarray | tuple[float, float]) -> np.ndarray:
    """Return delta (..., 2) of a6, k1 as an array; ValueError unless every |delta| <= 1."""
    delta = np.asarray(delta, dtype=float)
    if delta.shape[-1:] != (2,) or not np.all(np.abs(delta) <= 1.0):
        raise ValueError(f"delta = {delta.tolist()}: expected delta_a6, delta_k1 within [-1, 1]")
    return delta


def star(lft: Lft, delta: np.ndarray) -> np.ndarray:
    """Return the flow F_u(M, Delta) (..., n, n) at delta (..., 2) of a6, k1, any real: |delta| <= 1 is not checked."""
    block = np.zeros((*delta.shape, 2))
    block[..., 0, 0], block[..., 1, 1] = delta[..., 0], delta[..., 1]
    return lft.a + lft.b @ block @ np.linalg.inv(np.eye(2) - lft.d @ block) @ lft.c


def exponential(a: np.ndarray) -> np.ndarray:
    """Return exp(a), a (..., n, n): Taylor series, scaled and squared (Higham, Functions of Matrices, 2008, ch. 10)."""
    norm = float(np.abs(a).sum(axis=-1).max(initial=0.0))
    squarings = max(0, math.ceil(math.log2(2.0 * norm))) if norm > 0.0 else 0
    x = a / 2.0**squarings
    term = np.broadcast_to(np.eye(a.shape[-1]), a.shape)
    result = term.copy()
    for order in range(1, EXPONENTIAL_ORDER + 1):
        term = term @ x / order
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def sample(lft: Lft, delta: np.ndarray) -> Sampled:
    """Return the loop from tick to tick, cut at the controller's output, for delta (..., 2), any real; exact."""
    flow = star(lft, np.asarray(delta, dtype=float))
    period = exponential(flow * (lft.period - lft.fraction))
    if lft.fraction > 0.0:
        period = period @ lft.switch @ exponential(flow * lft.fraction)
    return Sampled(a=period @ lft.tick, b=period @ lft.hold, b_reference=period @ lft.reference,
                   command=lft.command, command_reference=lft.command_reference, period=lft.period)


def close(loop: Sampled) -> np.ndarray:
    """Return the closed loop's state matrix (..., n, n) over a period, A + B C of the sampled loop and its controller;
    states that the controller sets anew at each tick give eigenvalues of 0."""
    return loop.a + loop.b[..., :, None] * loop.command


def spectral_radius(loop: Sampled) -> np.ndarray:
    """Return the largest |eigenvalue| (...) of the closed loop; below 1 it is stable."""
    return np.abs(np.linalg.eigvals(close(loop))).max(axis=-1)


def loop_gain(loop: Sampled, omega: np.ndarray) -> np.ndarray:
    """Return L(exp(i omega T)) (..., p) at omega (..., p) [rad/s], from the actuator's input to minus the command.

    The closed loop's characteristic equation is 1 + L = 0.
    """
    return -_resolvent(loop.a, loop.b[..., None], omega, loop.period)[..., 0] @ loop.command


def frequency_response(lft: Lft, delta: np.ndarray | tuple[float, float], omega: np.ndarray) -> np.ndarray:
    """Return the closed loop (..., p, 2) at the ticks, at omega (p,) [rad/s], from theta_ref (of a law of the rate
    alone: rate_ref) to (theta, command).

    delta (..., 2) within [-1, 1], else ValueError.  Closed from the responses of the cut loop: the tiny theta near half
    the sampling rate keeps full precision.
    """
    loop = sample(lft, checked(delta))
    inputs = np.stack([loop.b, loop.b_reference], axis=-1)
    x = _resolvent(loop.a, inputs, np.asarray(omega, dtype=float), loop.period)
    command = np.einsum("...nk,n->...k", x, loop.command)
    u = (command[..., 1] + loop.command_reference) / (1.0 - command[..., 0])
    return np.stack([x[..., THETA, 1] + x[..., THETA, 0] * u, u], axis=-1)


def _resolvent(a: np.ndarray, b: np.ndarray, omega: np.ndarray, period: float) -> np.ndarray:
    """Return (z I - a)^-1 b (..., p, n, k) at z = exp(i omega period), omega (..., p), a (..., n, n), b (..., n, k).

    An undamped plant (a6 <= 0) has its poles on the circle: met exactly, all z step off it by OFF_CIRCLE.
    """
    z = np.exp(1j * omega * period)
    entry = b[..., None, :, :].astype(complex)
    try:
        return np.linalg.solve(_pencil(z, a), entry)
    except np.linalg.LinAlgError:
        return np.linalg.solve(_pencil(z * (1.0 + OFF_CIRCLE), a), entry)


def _pencil(z: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return z I - a (..., p, n, n)."""
    return z[..., None, None] * np.eye(a.shape[-1]) - a[..., None, :, :]

"""The linear blocks of a frozen loop: plant, servo, modes, drift and what lies before the servo; and the controller.

`loops` (many loops as rational functions), `lft` (uncertain a6 and k1) and through them margins and mu are made of
these, so that whatever stands here is known to all of them.  What a nominal's sections and effects are in a loop says
`airframe`; a controller as a law says `controller.law`.

    theta_ddot = a6 alpha + k1 beta - d theta_dot + c beta_ddot + sum_s coupling_s w_s^2 psi_s + lean theta + turn beta,
    alpha = theta - gamma,   gamma_dot = z_alpha alpha + z_beta beta

States: theta, theta_dot, beta, (beta_dot/w of a servo of second order), (gamma), (a lag before the servo), (a wash-out
behind that), then (x, x_dot) of each mode; last the command as it arrives, which is held.
"""

from typing import NamedTuple

import numpy as np

from ..controller.law import Law

THETA, THETA_DOT, BETA = range(3)
PIT = 0.9   # size of a zero of the law, from which on its frequency is looked at closely


class Mode(NamedTuple):
    """A mode of slosh (psi'' + 2 z w psi' + w^2 psi = -theta_ddot, theta_ddot += size w^2 psi) or of bending
    (eta'' + 2 z w eta' + w^2 eta = size w^2 beta; the attitude's sensor sees eta, the gyro `at_rate` eta')."""

    name: str                       # slosh1, bending1, ...
    frequency: np.ndarray | float   # rad/s, of all plants or of each (m,), as the next
    damping: np.ndarray | float     # its damping ratio
    size: np.ndarray | float        # coupling of slosh; gain of bending at the attitude's sensor [rad/rad]
    at_theta: float = 1.0           # of bending: 0 if the attitude's sensor does not see it
    at_rate: float = 1.0            # of bending: gain at the gyro over that at the attitude's sensor

    @property
    def is_bending(self) -> bool:
        return self.name.startswith("bending")


class Further(NamedTuple):
    """What else is known of a loop, the same in all plants; each 0 (gyro_scale 1) where there is none."""

    z_alpha: float = 0.0         # 1/s, of a drifting flight path
    z_beta: float = 0.0          # 1/s
    command_lag: float = 0.0     # s, time constant of a lag before the servo
    washout: float = 0.0         # s, time constant of a wash-out behind it
    nozzle_inertia: float = 0.0  # c, of a servo of second order
    lean: float = 0.0            # 1/s^2, of theta in theta_ddot, beside a6
    turn: float = 0.0            # 1/s^2, of beta in theta_ddot, beside k1
    gyro_scale: float = 1.0      # of theta_dot as the controller sees it

    @property
    def drifts(self) -> bool:
        return self.z_alpha != 0.0 or self.z_beta != 0.0


NOTHING_FURTHER = Further()


class Plants(NamedTuple):
    """m plants, arrays (m,): a6, k1 [1/s^2]; servo frequency [rad/s], damping ratio, transport delay [s], at least 0.

    rate_damping   [1/s], (m,) or one number: theta_ddot = a6 theta + k1 beta - rate_damping theta_dot
    is_first_order  the servo is beta_dot = frequency (u - beta), its damping ratio unused
    """

    a6: np.ndarray         # 1/s^2
    k1: np.ndarray         # 1/s^2
    frequency: np.ndarray  # rad/s, of the servo
    damping: np.ndarray    # its damping ratio
    delay: np.ndarray      # s, at least 0
    rate_damping: np.ndarray | float = 0.0
    is_first_order: bool = False
    modes: tuple[Mode, ...] = ()
    further: Further = NOTHING_FURTHER


def plants_of(parameters: np.ndarray, is_first_order: bool = False, modes: tuple[Mode, ...] = (),
              further: Further = NOTHING_FURTHER) -> Plants:
    """Return plants from rows (m, 5 or more) of a6, k1, natural frequency, damping ratio, delay, rate damping, and
    frequency and size of each of `modes`, which has its other numbers; a delay below 0 becomes 0."""
    a6, k1, frequency, damping, delay = parameters.T[:5]
    rate_damping = parameters[:, 5] if parameters.shape[1] > 5 else 0.0
    modes = tuple(mode._replace(frequency=parameters[:, 6 + 2 * k], size=parameters[:, 7 + 2 * k])
                  for k, mode in enumerate(modes))
    return Plants(a6, k1, frequency, damping, np.maximum(delay, 0.0), rate_damping, is_first_order, modes, further)


class Flow(NamedTuple):
    """m plants between the jumps: x' = state x with the command last, and how a6 alpha and k1 beta enter it.

    state   (m, n + 1, n + 1)
    sensed  (2, n + 1)  what the sensors of attitude and rate see
    alpha   (n + 1,)    the row of alpha;  beta: that of beta
    driven  (n + 1,)    what an angular acceleration moves: theta_dot, and the rates of slosh against it
    """

    state: np.ndarray
    sensed: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    driven: np.ndarray


def flow_of(plants: Plants) -> Flow:
    """Return the flow of m plants; ValueError for a nozzle's inertia behind a servo of first order, whose rate
    jumps."""
    further, servo = plants.further, 1 if plants.is_first_order else 2
    m, w = len(plants.a6), plants.frequency
    gamma = 2 + servo if further.drifts else None
    at = 2 + servo + further.drifts
    lag = at if further.command_lag > 0.0 else None
    at += lag is not None
    washed = at if further.washout > 0.0 else None
    first = at + (washed is not None)
    n = first + 2 * len(plants.modes)
    state, sensed = np.zeros((m, n + 1, n + 1)), np.zeros((2, n + 1))
    alpha, beta, driven = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    sensed[0, THETA] = sensed[1, THETA_DOT] = alpha[THETA] = beta[BETA] = driven[THETA_DOT] = 1.0
    state[:, THETA, THETA_DOT] = 1.0
    state[:, THETA_DOT, THETA], state[:, THETA_DOT, BETA] = plants.a6, plants.k1
    state[:, THETA_DOT, THETA] += further.lean
    state[:, THETA_DOT, BETA] += further.turn
    state[:, THETA_DOT, THETA_DOT] = -np.asarray(plants.rate_damping)
    if gamma is not None:
        alpha[gamma] = -1.0
        state[:, THETA_DOT, gamma] = -plants.a6
        state[:, gamma] = further.z_alpha * alpha + further.z_beta * beta
    drive = np.zeros(n + 1)   # what the servo follows
    drive[n if lag is None else lag] = 1.0
    if lag is not None:
        state[:, lag, n], state[:, lag, lag] = 1.0 / further.command_lag, -1.0 / further.command_lag
    if washed is not None:
        slow = drive.copy()
        slow[washed] -= 1.0
        state[:, washed] = slow / further.washout
        drive = slow
    if plants.is_first_order:
        state[:, BETA] = w[:, None] * drive
        state[:, BETA, BETA] -= w
    else:
        state[:, BETA, BETA + 1] = w
        state[:, BETA + 1] = w[:, None] * drive
        state[:, BETA + 1, BETA] -= w
        state[:, BETA + 1, BETA + 1] = -2.0 * plants.damping * w
    if further.nozzle_inertia != 0.0:
        if plants.is_first_order:
            raise ValueError("nozzle_inertia behind a servo of first order: expected one of second order")
        state[:, THETA_DOT] += further.nozzle_inertia * w[:, None] * state[:, BETA + 1]
    _fill_modes(plants.modes, first, state, sensed, driven)
    sensed[1] *= further.gyro_scale
    return Flow(state, sensed, alpha, beta, driven)


def _fill_modes(modes: tuple[Mode, ...], first: int, state: np.ndarray, sensed: np.ndarray,
                driven: np.ndarray) -> None:
    """Fill in the modes, from state `first` on, into the rigid plant's flow, arrays as of `Flow`."""
    for k, mode in enumerate(modes):
        x, v = first + 2 * k, first + 2 * k + 1
        stiffness = np.square(mode.frequency)
        state[:, x, v], state[:, v, x], state[:, v, v] = 1.0, -stiffness, -2.0 * mode.damping * mode.frequency
        if mode.is_bending:
            state[:, v, BETA] = mode.size * stiffness
            sensed[0, x], sensed[1, v] = mode.at_theta, mode.at_rate
        else:
            state[:, THETA_DOT, x] = mode.size * stiffness
    for k, mode in enumerate(modes):
        if not mode.is_bending:   # driven by the acceleration, with all that is in it
            state[:, first + 2 * k + 1] -= state[:, THETA_DOT]
            driven[first + 2 * k + 1] = -1.0


def peaks_of(plants: Plants, law: Law) -> tuple[float, ...]:
    """Return the frequencies [rad/s] at which a loop has peaks and pits: the modes, of the middle plant (of slosh the
    zero and the pole), and zeros of the law that are hardly damped."""
    zeros = [1.0 + np.roots(np.atleast_2d(top)[0]) for top in (law.theta, law.rate) if np.any(top)]
    peaks = [float(np.angle(z)) / law.period for z in np.concatenate(zeros) if z.imag > 0.0 and abs(z) > PIT] \
        if zeros else []
    for mode in plants.modes:
        frequency, size = float(np.median(mode.frequency)), float(np.median(mode.size))
        peaks += [frequency] if mode.is_bending else [frequency, frequency * float(np.sqrt(max(1.0 + size, 0.0)))]
    return tuple(peaks)


def centres_of(plants: Plants) -> np.ndarray | None:
    """Return where each mode of each plant has its peak (m, k) [rad/s], of slosh the pole; None without modes."""
    if not plants.modes:
        return None
    m = len(plants.a6)
    return np.column_stack([np.broadcast_to(mode.frequency if mode.is_bending else mode.frequency * np.sqrt(
        np.maximum(1.0 + np.asarray(mode.size), 0.0)), m) for mode in plants.modes])


# ---- where a nozzle that stands no longer holds the vehicle


def standing_gain(law: Law) -> np.ndarray:
    """Return what a law makes of an attitude that stands (m,) or (1,): a command per attitude; 0 if nothing, inf if an
    integral answers it."""
    if law.is_of_rate and not law.has_integral:
        return np.zeros(1)
    top = np.atleast_2d(law.rate if law.is_of_rate else law.theta)[:, -1]
    lag = np.atleast_2d(law.lag)
    with np.errstate(divide="ignore", invalid="ignore"):
        if law.is_of_rate:   # the sum of the rate is the attitude
            return np.asarray(top / (lag[:, -2] * law.period))
        return np.asarray(np.where(law.has_integral, np.inf, top / lag[:, -1]))


def standing_bend(plants: Plants, law: Law) -> np.ndarray | float:
    """Return what the attitude's sensor shows of bending under a nozzle that stands, rad/rad."""
    bend = sum(mode.size * mode.at_theta for mode in plants.modes if mode.is_bending)
    return bend * (not law.is_of_rate)


def static_factor(plants: Plants, law: Law) -> np.ndarray:
    """Return the factor (m,) on the gain at which a nozzle that stands no longer holds the aerodynamic moment: 1 + g L
    = 0 at z = 1; NaN where no factor does that."""
    further, gain, bend = plants.further, standing_gain(law), standing_bend(plants, law)
    if further.drifts or further.washout > 0.0 or not np.any(gain):
        return np.full(len(plants.a6), np.nan)
    a6, k1 = plants.a6 + further.lean, plants.k1 + further.turn
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = gain * further.gyro_scale if law.is_of_rate else gain
        return np.asarray(-a6 / (gain * k1 * (1.0 - bend * a6 / k1)))


def static_line(plants: Plants, law: Law) -> tuple[float, float, float]:
    """Return (p, q, r) of the line p a6 + q k1 + r = 0 on which a loop has a root at z = 1; of the first plant."""
    further = plants.further
    if further.drifts:   # a steady alpha and beta that neither turn the vehicle nor its path
        return further.z_beta, -further.z_alpha, further.z_beta * further.lean - further.z_alpha * further.turn
    if further.washout > 0.0:   # a nozzle that stands goes home
        return 1.0, 0.0, further.lean
    gain, bend = float(standing_gain(law)[0]), float(np.atleast_1d(standing_bend(plants, law))[0])
    if np.isinf(gain):
        p, q = -bend, 1.0
    else:
        gain *= further.gyro_scale if law.is_of_rate else 1.0
        p, q = 1.0 - gain * bend, gain
    return p, q, p * further.lean + q * further.turn


# ---- the controller


class Realised(NamedTuple):
    """A law as x <- a x + b e, command = c x + d e, with e = (error of attitude, error of rate): n states."""

    a: np.ndarray   # (n, n)
    b: np.ndarray   # (n, 2)
    c: np.ndarray   # (n,)
    d: np.ndarray   # (2,)


def realised(law: Law) -> Realised:
    """Return the states of one law: the observable canonical form in w = z - 1 (Kailath, Linear Systems, 1980, ch.
    2.1)."""
    lag = np.trim_zeros(law.lag, "f")
    n = len(lag) - 1
    tops = np.stack([law.theta[-n - 1:], law.rate[-n - 1:]], axis=1) / lag[0]
    lag = lag / lag[0]
    a = np.eye(n) + np.eye(n, k=1)
    a[:, :1] -= lag[1:, None]
    b, c = tops[1:] - np.outer(lag[1:], tops[0]), np.eye(1, n)[0] if n else np.zeros(0)
    scale = float(np.abs(b).max(initial=0.0))   # the states are then of the errors' size, as the plant's are
    return Realised(a, b / scale, c * scale, tops[0]) if scale > 0.0 else Realised(a, b, c, tops[0])

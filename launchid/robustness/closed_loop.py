"""Fit a law whose input the log does not hold exactly, by the likelihood of the closed loop.

Two logs are such.  Another sensor's columns: the controller saw the same motion with noise of its own.  Rows slower
than the controller: it saw what lies between them.  A regression of the commands on the columns is biased then (errors
in variables in a closed loop; Soderstrom, Automatica 43, 2007).  The likelihood of the loop is not: vehicle, servo and
law are one linear system, whose measurements are the columns and the commands, and whose noise has unknown levels
(Ljung, System Identification, 1999, ch. 13: direct identification with a model of the noise).

    vehicle   theta'' = a6 theta - damping theta' + k1 beta + m + w,   m a slow moment, w held over a period
    servo     beta'' = w^2 (u - beta) - 2 zeta w beta',   u the command `delay` before, with noise
    law       u_k = s1 + b0 e + c0 r,   s_i <- s_(i+1) + a_i u + b_i e + c_i r,   e = theta - share theta_ref,
              r = theta'
    log       theta, theta_dot, beta with noise; u exact to its rounding

1. *Structures*: PD, PD on the gyro, PID, lag, low-pass, notch, and each up to two periods late: from those that the
   likelihood of a part of the log prefers the best go on with every row (Schwarz, Ann. Stat. 6, 1978).
2. *Fit*: Fisher scoring, every number free: vehicle and servo about what is known of them, law, levels of noise.
3. *Answer*: all laws within ALIKE nats of the best, each with the covariance of its numbers, the others' errors in it.
4. *Doubts*: what the command leaves must be white, normal in its kurtosis, and no part of the flight may ask for
   another law.  Else there is no answer.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.kernels import kernel

from ..controller.fit import Answered, FittedLaw, law_of_numbers
from ..controller.law import shift
from ..series import filled, white_variance
from ..sums import along, inner, products, square
from .lft import exponential

BURN = 1.0           # s that the filter needs to settle
LEAST = 15.0         # s of a log
LOST_MOST = 0.02     # of the rows, that may lack a value
FLOOR = 5e-4         # of the rms step of the command: noise of the logged command, at least
ALIKE = 4.0          # nats within which a law is as likely as another
DRAFT_ROWS = 2000    # of the log, by which structures are compared
DRAFTS = ((3, 10, 0.05, False), (12, 3, 0.01, True))   # rounds, drafts that go on, floor, of each structure one
ROUNDS = 25          # of the last fit
DOUBLINGS = 14       # of Riccati's equation
SETTLED = 0.01       # nats: a smaller gain is the last
STEPS = (1e-5, 1e-5, 1e-5, 1e-5, 1e-6, 1e-5)   # of slopes: a6, k1 (relative), ln w, ln zeta, delay [s], damping [1/s]
LAW_STEP = 1e-6      # the same of the law's numbers, relative: these are known to 1e-4 if the others stand still
LEVEL_STEP = 1e-4    # the same of the levels' logarithms
LEVELS = ("acceleration", "command", "theta", "theta_dot", "beta", "seen theta", "seen theta_dot")
NOISES, OF_FLOOR, OF_MOMENT = 9, 7, 8   # LEVELS, floor of the command, slow moment
LEVEL_DOUBT = 2.0    # of ln: one sigma of a noise level about its start
WANDER = 1e-4        # rad/s^2 a period: of the slow moment
WHITE = 60.0         # of a chi square of LAGS, that residuals may have
LAGS = 25
KURTOSIS_SIGMAS = 6.0
CHANGE_SIGMAS = 8.0  # of the score of a part of the flight
PARTS = 7
EXACT_FLOORS = 3.0   # times the floor: what is left of commands that are told exactly
UNLIKE = 10.0        # times the log's noise: more the controller's sensors do not have
MOST_DELAY = 3       # periods


@dataclass(frozen=True, eq=False)
class Data:
    """A log for the likelihood: y (n, 4) = theta, theta_dot, beta, command; reference (n m,) at every period, m periods
    a row; period [s]; is_same: the law saw the log's own columns."""

    y: np.ndarray
    reference: np.ndarray
    period: float
    m: int
    is_same: bool

    @property
    def step(self) -> float:
        return float(np.sqrt(np.nanmean(np.diff(self.y[:, 3]) ** 2)))

    def part(self, first: int, last: int) -> "Data":
        return replace(self, y=self.y[first:last], reference=self.reference[first * self.m:last * self.m])


@kernel
def innovations(A, K, C, bx, by, y, m, e):
    """Write the innovations e (n, p) of a steady filter: m times x <- A x + bx from row to row, and K e."""
    states, seen = A.shape[0], C.shape[0]
    x, new = np.zeros(states), np.zeros(states)
    for k in range(y.shape[0]):
        for i in range(seen):
            v = y[k, i] - by[k, i]
            for j in range(states):
                v -= C[i, j] * x[j]
            e[k, i] = v if not math.isnan(v) else 0.0
        for r in range(m):
            for i in range(states):
                v = bx[k * m + r, i]
                for j in range(states):
                    v += A[i, j] * x[j]
                if r == m - 1:
                    for j in range(seen):
                        v += K[i, j] * e[k, j]
                new[i] = v
            x[:] = new


def steady(A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray,
           S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gain (n, p) and the innovations' covariance (p, p) of the steady Kalman filter x <- A x + w, y = C x +
    v, cov w, v, w v' = Q, R, S: Riccati's equation by doubling (Anderson, Int. J. Control 28, 1978)."""
    inverse = np.linalg.inv(R)
    a, g, h = (A - S @ inverse @ C).T, C.T @ inverse @ C, Q - S @ inverse @ S.T
    one = np.eye(len(A))
    for _ in range(DOUBLINGS):
        w = np.linalg.inv(one + g @ h)
        a, g, h = a @ w @ a, g + a @ w @ g @ a.T, h + a.T @ h @ w @ a
        g, h = 0.5 * (g + g.T), 0.5 * (h + h.T)
    inside = C @ h @ C.T + R
    return (A @ h @ C.T + S) @ np.linalg.inv(inside), inside


@dataclass(frozen=True, eq=False)
class Model:
    """A structure of a law on a log.  Numbers p: plant (6,), law, share of the reference, constant, ln of LEVELS.

    The law's numbers are its polynomials' in z - 1 (`controller.law`): in z those of a slow pole, of an integral above
    all, are so much alike that no step finds its way along them.

    order    of the law;  has_rate: it answers the gyro too;  late: periods before it answers
    prior    (6,) of the plant;  weight (6, 6): inverse square root of its covariance, in rows
    start    of the levels;  floor  [rad] of the command
    """

    data: Data
    order: int
    has_rate: bool
    late: int
    prior: np.ndarray
    weight: np.ndarray
    start: np.ndarray
    floor: float

    @property
    def count(self) -> int:
        """Return how many numbers the law has, share and constant too."""
        free = self.order + 1 - self.late
        return self.order - self.late + free * (1 + self.has_rate) + 2

    def law(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a (n,), b, c (n + 1,) of numbers (count - 2,) of the law."""
        count, none = self.order + 1 - self.late, np.zeros(self.late)
        turn = np.linalg.inv(shift(count))
        a = np.concatenate([-(np.append(1.0, q[:count - 1]) @ turn)[1:], none])
        b, c = (np.concatenate([none, part @ turn]) if len(part) else np.zeros(self.order + 1)
                for part in (q[count - 1:2 * count - 1], q[2 * count - 1:]))
        return a, b, c

    def run(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return innovations (n, 4), their covariance (4, 4), and the logarithm of likelihood and prior."""
        data, k = self.data, 6 + self.count
        a, b, c = self.law(p[6:k - 2])
        std = np.zeros(NOISES)
        std[:len(p) - k] = np.exp(p[k:])
        std[OF_FLOOR], std[OF_MOMENT] = self.floor, WANDER
        system = system_of(p[:6], a, b, c, data.period, data.is_same)
        A, G, C, H = system.A, system.G * std, system.C, system.H * std
        Q, S, lifted = G @ G.T, G @ H.T, A
        for _ in range(data.m - 1):
            Q, S, lifted = A @ Q @ A.T + G @ G.T, A @ S, A @ lifted
        none = np.zeros((len(data.y), 4)), np.eye(4), -math.inf
        try:
            K, inside = steady(lifted, C, Q, H @ H.T, S)
            inverse = np.linalg.inv(inside)
        except np.linalg.LinAlgError:
            return none
        sign, size = np.linalg.slogdet(inside)
        if sign <= 0.0 or not np.isfinite(K).all():
            return none
        e = np.empty((len(data.y), 4))
        reference = p[k - 2] * data.reference
        told = p[k - 1] - b[0] * reference   # what is known of the command: constant and reference
        inputs, seen = np.outer(told, system.command), np.zeros_like(e)
        inputs[:, 5:5 + self.order] += np.outer(told, a) - np.outer(reference, b[1:])
        seen[:, 3] = told[::data.m]
        innovations(A, K, C, inputs, seen, data.y, data.m, e)
        e = e[round(BURN / (data.period * data.m)):]
        value = -0.5 * (len(e) * size + inner(weighed(e, inverse).ravel(), e.ravel()))
        if not math.isfinite(value):
            return none
        off, levels = self.weight @ (p[:6] - self.prior), (p[k:] - self.start) / LEVEL_DOUBT
        return e, inside, value - 0.5 * float(off @ off) - 0.5 * float(levels @ levels)

    def score(self, p: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return value, gradient, Fisher's information, slopes of the innovations (k, n, 4), innovations."""
        e, inside, value = self.run(p)
        k = 6 + self.count
        h = np.concatenate([np.array(STEPS) * [abs(p[0]) + 0.1, abs(p[1]) + 0.1, 1.0, 1.0, 1.0, 1.0],
                            LAW_STEP * np.maximum(np.abs(p[6:k]), 0.05), np.full(len(p) - k, LEVEL_STEP)])
        slopes, spread = np.zeros((len(p), *e.shape)), np.zeros((len(p), 4, 4))
        for j in range(len(p)):
            q = p.copy()
            q[j] += h[j]
            if j == 4 and q[4] > MOST_DELAY * self.data.period:
                q[4], h[j] = p[4] - h[j], -h[j]
            e1, inside1, there = self.run(q)
            if not math.isfinite(there):
                continue
            slopes[j], spread[j] = (e1 - e) / h[j], (inside1 - inside) / h[j]
        inverse, n = np.linalg.inv(inside), len(e)
        left, turned = weighed(e, inverse), inverse @ spread
        gradient = -np.einsum("kni,ni->k", slopes, left) - 0.5 * n * np.trace(turned, axis1=1, axis2=2) \
            + 0.5 * np.einsum("ij,kij->k", products(left, left), spread)
        flat = slopes.reshape(len(p), -1)
        information = np.einsum("kn,ln->kl", flat, weighed(slopes, inverse).reshape(len(p), -1)) \
            + 0.5 * n * np.einsum("kij,lji->kl", turned, turned)
        own = self.weight.T @ self.weight
        gradient[:6] -= own @ (p[:6] - self.prior)
        information[:6, :6] += own
        gradient[k:] -= (p[k:] - self.start) / LEVEL_DOUBT**2
        information[range(k, len(p)), range(k, len(p))] += 1.0 / LEVEL_DOUBT**2
        return value, gradient, information, slopes, e

    def fit(self, p: np.ndarray, rounds: int) -> tuple[np.ndarray, float, np.ndarray]:
        """Return numbers, value and information after Fisher scoring with damping (Levenberg and Marquardt)."""
        k, damping = 6 + self.count, 1e-3
        value, gradient, information, *_ = self.score(p)
        wide = np.ones(len(p))
        for _ in range(rounds):
            before, scale = value, np.sqrt(np.maximum(np.diag(information), 1e-12))
            wide[6:k] = 0.5 + 0.5 * np.abs(p[6:k]).max(initial=0.0)
            for _ in range(8):
                matrix = information / np.outer(scale, scale) + damping * np.eye(len(p))
                q = p + np.clip(np.linalg.solve(matrix, gradient / scale) / scale, -wide, wide)
                q[4] = min(max(q[4], 0.0), MOST_DELAY * self.data.period)
                q[k:] = np.maximum(q[k:], -18.0)
                now = self.run(q)[2]
                if now > value:
                    p, damping = q, max(0.1 * damping, 1e-9)
                    value, gradient, information, *_ = self.score(p)
                    break
                damping = max(10.0 * damping, 1e-4)
            if not math.isfinite(value) or value - before < SETTLED:
                break
        return p, value, information


def weighed(e: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Return innovations or slopes (..., n, 4) times the inverse of their covariance (4, 4)."""
    return np.asarray(np.einsum("...i,ij->...j", e, inverse))


class System(NamedTuple):
    """x <- A x + G n + command u0 + ..., y = C x + H n: states theta, theta_dot, beta, beta_dot/w, slow moment, those
    of the law, past commands; noises n (NOISES,) of one standard deviation; command: what a known part of it moves."""

    A: np.ndarray
    G: np.ndarray
    C: np.ndarray
    H: np.ndarray
    command: np.ndarray


def system_of(plant: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray, period: float, is_same: bool) -> System:
    """Return the closed loop of a plant (6,) and a law, from one of its periods to the next."""
    F, push, moves = flow(plant, period)
    n, past = len(a), len(moves) - 1
    states = 5 + n + past
    theta, rate = (2, 3) if is_same else (5, 6)   # the noise that the law sees
    noisy, answer = np.zeros(NOISES), np.zeros(states)   # the command as it is issued: of noise, of states
    noisy[theta], noisy[rate] = b[0], c[0]
    answer[0], answer[1], answer[5:5 + min(n, 1)] = b[0], c[0], 1.0
    A, G, command = np.zeros((states, states)), np.zeros((states, NOISES)), np.zeros(states)
    A[:5, :5] = F
    A[:5] += np.outer(moves[0], answer)
    G[:5] = np.outer(moves[0], noisy)
    G[:5, 0], G[:5, 1], G[4, OF_MOMENT] = push, np.sum(moves, axis=0), 1.0
    command[:5] = moves[0]
    for i in range(1, n + 1):
        A[4 + i], G[4 + i] = a[i - 1] * answer, a[i - 1] * noisy
        A[4 + i, 0] += b[i]
        A[4 + i, 1] += c[i]
        A[4 + i, 5 + i] += float(i < n)
        G[4 + i, theta] += b[i]
        G[4 + i, rate] += c[i]
    A[5 + n], G[5 + n], command[5 + n] = answer, noisy, 1.0
    for j in range(past):
        A[:5, 5 + n + j] += moves[j + 1]
        if j > 0:
            A[5 + n + j, 4 + n + j] = 1.0
    C, H = np.zeros((4, states)), np.zeros((4, NOISES))
    C[0, 0] = C[1, 1] = C[2, 2] = H[0, 2] = H[1, 3] = H[2, 4] = H[3, OF_FLOOR] = 1.0
    C[3], H[3] = answer, H[3] + noisy
    return System(A, G, C, H, command)


def flow(plant: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return F (5, 5) of theta, theta_dot, beta, beta_dot/w, slow moment over a period, what a held acceleration moves
    (5,), and what the command of 0, 1, ... periods ago moves (5,) each."""
    a6, k1, log_w, log_zeta, delay, damping = plant
    w, zeta, delay = math.exp(log_w), math.exp(log_zeta), max(float(delay), 0.0)
    A = np.zeros((6, 6))   # and the command
    A[0, 1], A[1, 0], A[1, 1], A[1, 2], A[1, 4] = 1.0, a6, -damping, k1, 1.0
    A[2, 3], A[3, 2], A[3, 3], A[3, 5] = w, -w, -2.0 * zeta * w, w
    whole = int(delay / period + 1e-9)
    rest = max(delay - whole * period, 0.0)
    late, early = exponential(A * np.array([period - rest, rest])[:, None, None])
    F = (late @ early)[:5, :5]
    moves = [np.zeros(5)] * whole + [late[:5, 5], late[:5, :5] @ early[:5, 5]]
    return F, F[:, 4] - np.eye(5)[4], moves


# ---- structures to start from


class Draft(NamedTuple):
    """A law to start from: polynomials in z^-1 of command, attitude and rate (None: not answered), periods late."""

    command: np.ndarray
    theta: np.ndarray
    rate: np.ndarray | None = None
    late: int = 0


def library(kp: float, kd: float, ki: float, T: float) -> list[Draft]:
    """Return laws about gains kp, kd [s], ki [1/s], every T [s]: PD, PD on the gyro, PID, with a lag, a low-pass, a
    notch."""
    kd = max(kd, 0.1 * abs(kp))
    one, lag, still = np.array([1.0, -1.0]), np.array([1.0, -0.6]), np.array([1.0])
    alpha = 0.8   # of a derivative over four periods
    den, top = np.array([1.0, -alpha]), kp * np.array([1.0, -alpha]) + 0.2 * kd / T * one
    integral = (ki if ki * kp > 0.0 else 0.4 * kp) * T
    drafts = [Draft(den, top, None, late) for late in (0, 1, 2)]
    drafts += [Draft(still, kp * still, kd * still, late) for late in (0, 1, 2)]
    drafts += [Draft(_product(den, one), _product(top, one) + integral * np.append(den, 0.0)),
               Draft(_product(den, lag), 0.4 * np.append(top, 0.0)),
               Draft(one, kp * one + [integral, 0.0], kd * one), Draft(lag, kp * lag, 0.4 * kd * np.array([1.0, 0.0]))]
    for w in (0.25 / T, 0.6 / T):
        low, bottom = _second(w, 0.7, T)
        notch, wide = _second(w, 0.6, T, 0.1)
        drafts += [Draft(_product(den, bottom), _product(top, low)), Draft(bottom, kp * bottom, kd * low),
                   Draft(bottom, kp * low, kd * low), Draft(_product(den, wide), _product(top, notch)),
                   Draft(wide, kp * notch, kd * notch)]
    return drafts


def _product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.convolve(one, other))


def _second(w: float, zeta: float, T: float, depth: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of a low-pass of second order by Tustin's rule; a notch of damping `depth`."""
    k = 2.0 / T
    bottom = np.array([k * k + 2.0 * zeta * w * k + w * w, 2.0 * (w * w - k * k), k * k - 2.0 * zeta * w * k + w * w])
    top = w * w * np.array([1.0, 2.0, 1.0]) if depth is None else \
        np.array([k * k + 2.0 * depth * w * k + w * w, 2.0 * (w * w - k * k), k * k - 2.0 * depth * w * k + w * w])
    return top / bottom[0], bottom / bottom[0]


def _model(data: Data, draft: Draft, prior: np.ndarray, weight: np.ndarray, levels: np.ndarray,
           floor: float) -> tuple[Model, np.ndarray]:
    """Return the model of a draft's structure, and the numbers to start from."""
    n = max(len(draft.command), len(draft.theta)) - 1 + draft.late
    count = n + 1 - draft.late
    parts = [draft.command, *(each for each in (draft.theta, draft.rate) if each is not None)]
    turn = shift(count)
    law = np.concatenate([(np.pad(part, (0, count - len(part))) @ turn)[first:]
                          for first, part in zip((1, 0, 0), parts, strict=False)])
    start = levels[:5] if data.is_same else levels[:7] if draft.rate is not None else levels[:6]
    model = Model(data, n, draft.rate is not None, draft.late, prior, weight, start, floor * data.step)
    return model, np.concatenate([prior, law, [1.0, 0.0], start])


@dataclass(frozen=True, eq=False)
class Found:
    """A controller's law as the likelihood of the closed loop finds it, with the plant's numbers (6,), their covariance
    (6, 6), and the noise levels (7,)."""

    law: FittedLaw
    plant: np.ndarray
    plant_covariance: np.ndarray
    levels: np.ndarray


def data_of(ticks: Answered, m: int) -> Data | str:
    """Return the longest part of a log whose commands are off their limit, for a controller with m periods a row; one
    sentence if there is none.  m above 1: the controller saw the rows' own values, and others between them."""
    names = ("theta", "theta_dot", "beta")
    lacking = [name for name in (*names, "theta_ref") if not np.isfinite(ticks.columns[name]).any()]
    if lacking:
        return f"the log has no {' and no '.join(lacking)}"
    free = ticks.free | ~np.isfinite(ticks.command)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], free.astype(int), [0]])))
    first, last = max(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True), key=lambda x: x[1] - x[0],
                      default=(0, 0))
    y = np.column_stack([*(ticks.columns[name] for name in names), ticks.command])[first:last]
    if (last - first) * ticks.period < LEAST:
        return f"less than {LEAST:g} s are off the deflection limit"
    if np.mean(~np.isfinite(y).all(axis=1)) > LOST_MOST:
        return "too many rows lack a value"
    reference = filled(ticks.columns["theta_ref"][first:last], at=np.arange(m * (last - first)) / m)
    return Data(y, reference, ticks.period / m, m, m > 1)


def levels_of(data: Data) -> np.ndarray:
    """Return logarithms of LEVELS to start from: of the columns by their third differences, else small ones."""
    white = [math.sqrt(white_variance(x)) for x in data.y[:, :3].T]
    small = 1e-3 * data.step
    return np.log([1e-3, data.step, *np.maximum(white, small), *np.maximum(white[:2], small)])


def fit_closed_loop(data: Data, prior: np.ndarray, covariance: np.ndarray) -> list[Found] | str:
    """Return the laws that are as likely as the best one, the best first; a sentence if none is to be believed.

    prior, covariance  of the plant (6,): a6, k1, ln w, ln zeta, delay, damping
    """
    levels = levels_of(data)
    value, vector = np.linalg.eigh(covariance + np.diag(np.full(6, 1e-14)))
    weight = (vector / np.sqrt(value)).T
    first = min(round(5.0 / (data.period * data.m)), max(len(data.y) - DRAFT_ROWS, 0))
    part = data.part(first, first + DRAFT_ROWS)
    tried = [_model(part, draft, prior, weight, levels, DRAFTS[0][2])
             for of_error in (True, False) for draft in library(*_gains(data, of_error), data.period)
             if (draft.rate is None) == of_error]
    for rounds, left, floor, once in DRAFTS:
        tried = _best([_fitted(replace(model, floor=floor * part.step), p, rounds) for model, p in tried], left, once)
    last = sorted((_fitted(replace(model, data=data, floor=FLOOR * data.step), p, ROUNDS) for model, p in tried),
                  key=lambda each: -each.worth)
    if not math.isfinite(last[0].worth):
        return "no law makes the closed loop as likely as the log"
    if doubts := _doubts(last[0].model, last[0].p):
        return "; ".join(doubts)
    return [_found(each) for each in last if each.worth > last[0].worth - ALIKE]


class _Fitted(NamedTuple):
    """A model, its numbers as fitted, Schwarz's value of it, the information."""

    model: Model
    p: np.ndarray
    worth: float
    information: np.ndarray


def _fitted(model: Model, start: np.ndarray, rounds: int) -> _Fitted:
    p, value, information = model.fit(start, rounds)
    return _Fitted(model, p, value - 0.5 * math.log(len(model.data.y)) * model.count, information)


def _best(made: list[_Fitted], count: int, once: bool) -> list[tuple[Model, np.ndarray]]:
    """Return the `count` best fits.

    once  of each structure, as late as is likeliest, the best one alone; and the best structure's next in lateness.
    Else simple laws that differ in lateness alone would leave no place for a richer one.
    """
    def shape(model: Model) -> tuple[int, bool]:
        return model.order - model.late, model.has_rate

    ranked = sorted(made, key=lambda each: -each.worth)
    if not once:
        return [(each.model, each.p) for each in ranked[:count]]
    best: dict[tuple[int, bool], tuple[Model, np.ndarray]] = {}
    for each in ranked:
        best.setdefault(shape(each.model), (each.model, each.p))
    first = ranked[0].model
    later = [(each.model, each.p) for each in ranked
             if each.model.late != first.late and shape(each.model) == shape(first)]
    return [*list(best.values())[:count], *later[:1]]


def _gains(data: Data, of_error: bool) -> tuple[float, float, float]:
    """Return kp, kd [s] and ki [1/s] that smoothed commands have of smoothed attitude, rate (of_error: less the
    reference's) and integral."""
    period = data.period * data.m
    rows = max(3, round(0.25 / period) | 1)
    mean = np.ones(rows) / rows
    error = np.nan_to_num(data.y[:, 0] - data.reference[::data.m])
    rate = np.nan_to_num(data.y[:, 1]) - of_error * np.gradient(data.reference[::data.m], period)
    design = np.column_stack([*(np.convolve(x, mean, "valid") for x in (error, rate, np.cumsum(error) * period)),
                              np.ones(len(error) - rows + 1)])
    command = np.convolve(np.nan_to_num(data.y[:, 3]), mean, "valid")
    kp, kd, ki, _ = np.linalg.solve(products(design, design), along(design, command))
    return float(kp), float(kd), float(ki)


def _found(made: _Fitted) -> Found:
    """Return the law with the covariance of its numbers, in which the errors of all others are."""
    model, p = made.model, made.p
    scale = 1.0 / np.sqrt(np.maximum(np.diag(made.information), 1e-300))
    covariance = np.linalg.pinv(made.information * np.outer(scale, scale), rcond=1e-12, hermitian=True) \
        * np.outer(scale, scale)
    k = 4 + model.count
    count = model.order + (model.order + 1) * (1 + model.has_rate)
    turn = np.array([np.concatenate(model.law(row)) for row in (np.zeros(k - 6), *np.eye(k - 6))]).T[:count]
    turn = turn[:, 1:] - turn[:, :1]   # of the free numbers to a, b, c
    numbers = np.concatenate(model.law(p[6:k]))[:count]
    of, period = ("error", "theta_dot") if model.has_rate else ("error",), model.data.period
    e, *_ = model.run(p)
    law = FittedLaw(law_of_numbers(numbers, model.order, of, period), numbers, turn @ covariance[6:k, 6:k] @ turn.T,
                    model.order, of, math.sqrt(square(e[:, 3]) / len(e)), model.data.step, is_likely=True)
    return Found(law, p[:6], covariance[:6, :6], p[k + 2:])


def _doubts(model: Model, p: np.ndarray) -> list[str]:
    """Return why a law is not to be believed: what it leaves of the command is no white noise, or changes."""
    _, _, _, slopes, e = model.score(p)
    _, inside, _ = model.run(p)
    n, k, root = len(e), 6 + model.count, np.linalg.cholesky(inside)
    x = np.linalg.solve(root, e.T)[3]
    words, size = [], float(np.mean(x * x))
    if root[3, 3] < EXACT_FLOORS * model.floor and size < EXACT_FLOORS:   # the rows tell the commands to the floor
        return []
    box = n * n * sum((inner(x[j:], x[:-j]) / (n * size)) ** 2 / (n - j) for j in range(1, LAGS + 1))
    if box > WHITE:
        words.append(f"what the best law leaves of the commands is no white noise (chi square {box:.0f} of {LAGS})")
    kurtosis = float(np.mean(x**4)) / size**2 - 3.0
    if abs(kurtosis) > KURTOSIS_SIGMAS * math.sqrt(24.0 / n):
        words.append(f"what the best law leaves of the commands is not normal (kurtosis {kurtosis:.2g})")
    level = np.exp(p[k:])
    words += [f"the controller's {name} would be {own / log:.2g} times as noisy as the log's"
              for name, own, log in zip(LEVELS[5:], level[5:], level[2:4], strict=False) if not own < UNLIKE * log]
    inverse, worst, free = np.linalg.inv(inside), 0.0, range(6, k - 2)
    for rows in np.array_split(np.arange(n), PARTS):
        own = slopes[6:k - 2, rows]
        g = -np.einsum("kni,ni->k", own, weighed(e[rows], inverse))
        information = np.einsum("kn,ln->kl", own.reshape(len(free), -1), weighed(own, inverse).reshape(len(free), -1))
        scale = np.sqrt(np.diag(information)) + 1e-300
        chi = float((g / scale) @ np.linalg.lstsq(information / np.outer(scale, scale), g / scale, rcond=1e-8)[0])
        worst = max(worst, (chi - len(free)) / math.sqrt(2.0 * len(free)))
    if worst > CHANGE_SIGMAS:
        words.append("the law changes in the flight")
    return words

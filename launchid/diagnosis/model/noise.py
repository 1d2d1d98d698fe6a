"""Noise levels of a log, and the Kalman gains they make.

Five levels: attitude sensor, gyro, nozzle sensor, command, unmodelled acceleration; and those of the world's states
(`data.world`).  Each is the nominal's times a factor.  The factors maximise the likelihood of the log (Ljung, System
Identification, 2nd ed., ch. 7.4) with a log-normal prior around the declared ones, so that a level the log does not
show stays as declared, and within bounds: a sensor whose level collapses would make every other misfit infinitely
unlikely.  Upwards the acceleration has no bound: what no model explains must be able to stand somewhere.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.sections import Sensors

from ..data.record import BETA, CHANNELS, THETA, THETA_DOT, Record
from ..data.world import ATTITUDE, GYRO, NOZZLE, NOZZLE_SENSOR, WIND
from .ahead import horizon_variances
from .lanes import LANES, likelihoods
from .likelihood import likelihood, whiten
from .linear import Modes, matched, modes_of, state_matrices
from .point import Point, begins_at_rest, path_slope, vehicle
from .predictor import N_RIGID, made_good

LEVELS = ("theta", "theta_dot", "beta", "command", "acceleration")
ACCELERATION = 4
SMALLEST = 1.0e-3      # of a level over the declared: below it a log is as good as free of that noise
LARGEST = 1.0e3
BOUNDED = (0.3, 3.0)   # of a level over the declared, as the contract says
WRONG_NOISE = 1.5      # factor by which levels may be declared wrong without a word
STILL = 0.25           # s: a6, k1 of a launcher move by less than 1 % meanwhile
FLOOR = 1e-6           # rad, rad/s, rad, rad, rad/s^2: declared 0 becomes this
START_RATE = 0.1       # rad/s, one sigma of a rate that no gyro tells at the first row
REST = 1e-6            # rad, rad/s, one sigma of a vehicle that is known to stand: below what any sensor tells
MOST = {"plant": 0.3, "actuator": 0.05, "theta": 0.05, "theta_dot": 0.05, "beta": 0.05}  # of a launcher: `largest`
SENSOR_OF = {ATTITUDE: THETA, GYRO: THETA_DOT, NOZZLE_SENSOR: BETA}
TAYLOR_ORDER = 10      # of matrices below 1/2: the remainder is below 1e-10


def declared(record: Record) -> np.ndarray:
    """The nominal's levels (5 + the world's,), quantisation as step/sqrt(12); never 0."""
    sensors: Sensors = record.nominal.sensors
    simulation = record.nominal.simulation
    levels = [np.hypot(sensors.theta_std, sensors.theta_step / 12**0.5),
              np.hypot(sensors.theta_dot_std, sensors.theta_dot_step / 12**0.5),
              np.hypot(sensors.beta_std, sensors.beta_step / 12**0.5), record.actuator.command_noise_std,
              simulation.acceleration_noise_std if simulation is not None else 0.0]
    if not record.command_is_known:
        levels[3] = levels[2]  # the measured nozzle angle is the command
    return np.append(np.maximum(levels, FLOOR), [each.level for each in record.world.levels])


def bounds(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest factor (levels,) of the declared levels."""
    own = declared(record)[:5] > FLOOR
    least, most = {"free": (SMALLEST, LARGEST), "declared": (1.0, 1.0), "bounded": BOUNDED}[record.noise]
    low, high = np.where(own, least, SMALLEST), np.where(own, most, LARGEST)
    if record.noise == "bounded":
        high[ACCELERATION] = LARGEST
    spans = [(least, most) if record.noise == "free" and each.span != (1.0, 1.0) else each.span
             for each in record.world.levels]
    return np.append(low, [span[0] for span in spans]), np.append(high, [span[1] for span in spans])


def nothing_foreseen(record: Record, counts: np.ndarray | None = None) -> float:
    """Log-likelihood of a model that knows no more than the range of each channel: no log tells more nats against any
    model than against this one.

    counts  (n,) bool: rows that count, None: all
    """
    z, noise = record.z if counts is None else record.z[counts], declared(record)
    count = np.isfinite(z).sum(axis=0)
    span = [float(np.ptp(column[np.isfinite(column)])) if known else 1.0
            for column, known in zip(record.z.T, np.isfinite(record.z).any(axis=0), strict=True)]
    return -float(count @ np.log(np.maximum(span, noise[:3])))


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Linear dynamics over a row, for covariances, and where noise enters.

    States: theta, theta_dot, beta, beta_dot; then, where noise is held over rows or there are modes, the held command
    noise and acceleration; then value and rate of each mode; then the world's.
    """

    modes: Modes
    f: np.ndarray               # (b, m, m)
    c: np.ndarray               # (3, m)
    block: np.ndarray           # (n,) of each row
    resets: np.ndarray          # (n,) bool, rows at which held noises are drawn anew; all False: each row, in the q
    command_q: np.ndarray       # (b, m, m) for unit variance of the command noise
    acceleration_q: np.ndarray  # (b, m, m)
    unknown_q: np.ndarray       # (b, m, m) of commands that the log does not have
    entry: np.ndarray           # (b, m, 2) how a command or acceleration held over a row moves the state
    rate_scale: float           # of the gyro: gains are those of one without (`predictor`)
    slots: np.ndarray           # (m,) where each state stands in gains (n, 6 + 2 modes + the world's, 3)
    fresh: tuple[tuple[int, float], ...]   # (state, variance over a row for unit level) of the world's levels
    first: tuple[tuple[int, float], ...]   # (state, variance before the first row; -1: that of the level itself)


def dynamics(record: Record, point: Point) -> Dynamics:
    """The model at a point, linear: its a6, k1, servo, damping and modes."""
    n, period = record.rows, record.period
    v = vehicle(record, point)
    modes = modes_of(v)
    size = max(1, round(STILL / period))
    constant = np.ptp(v.a6) == 0.0 and np.ptp(v.k1) == 0.0
    block = np.zeros(n, np.int64) if constant else np.arange(n) // size
    middle = np.minimum(np.unique(block) * size + size // 2, n - 1)
    half = np.minimum(2 * (record.first_step + record.every * middle), len(v.a6) - 1)
    m, held, ticks = N_RIGID + 2 * len(modes), record.held > 1, record.every // record.tick // record.fine
    a, c = state_matrices(v, v.a6[half], v.k1[half])
    f, part = exponential(a * period), exponential(a * (period / ticks))
    entry = f[:, :, 4:6].copy()
    entry[:, 4:6] = 0.0
    q = np.zeros((3, len(half), m, m))
    if not held:
        q = _held_noise(part, ticks)
        if record.fine > 1:  # its rows fall between ticks, all of which
            q[2] = q[0]
        f[:, 4:6, :] = f[:, :, 4:6] = 0.0
    resets = (np.arange(n) - record.held_phase) % record.held == 0 if held else np.zeros(n, bool)
    scale = float(v.flight[0].gyro_scale)
    c[THETA_DOT] *= scale
    kept = slice(0, m if held or modes else 4)
    f, entry, c = f[:, kept, kept].copy(), entry[:, kept].copy(), c[:, kept].copy()
    command_q, acceleration_q, between_q = (x[:, kept, kept].copy() for x in q)
    own = Dynamics(modes, f, c, block, resets, command_q, acceleration_q, record.between**2 * between_q, entry,
                   float(made_good(scale)), np.arange(m)[kept], (), ())
    return _with_lost(record, _in_the_world(record, own, record.a6[half], v.k1[half], path_slope(v)))


def _with_lost(record: Record, own: Dynamics) -> Dynamics:
    """The dynamics with blocks of their own for the rows that the log does not have: their command is not believed."""
    if record.lost is None:
        return own
    enters = record.unknown * own.entry[:, :, 0]
    unknown_q = np.concatenate([own.unknown_q, enters[:, :, None] * enters[:, None, :]])
    f, command_q, acceleration_q, entry = (
        np.concatenate([x, x]) for x in (own.f, own.command_q, own.acceleration_q, own.entry))
    return replace(own, f=f, command_q=command_q, acceleration_q=acceleration_q, unknown_q=unknown_q, entry=entry,
                   block=np.where(record.lost, own.block + len(own.f), own.block))


def _in_the_world(record: Record, own: Dynamics, a6: np.ndarray, k1: np.ndarray, z_alpha: float) -> Dynamics:
    """The dynamics with the world's states behind the vehicle's;  a6 (`predictor.push`), k1 (b,) [1/s^2] of the blocks;
    z_alpha [1/s] of the flight path."""
    sources, period = record.world.sources, record.period
    (b, m, _), w = own.f.shape, len(sources)
    f, entry, c = np.zeros((b, m + w, m + w)), np.zeros((b, m + w, 2)), np.zeros((3, m + w))
    f[:, :m, :m], entry[:, :m], c[:, :m] = own.f, own.entry, own.c
    fresh, first = [], []
    for j, source in enumerate(sources, start=m):
        f[:, j, j] = source.keep(period, z_alpha)
        if source.entry in SENSOR_OF:
            c[SENSOR_OF[source.entry], j] = 1.0
        else:
            gain = {WIND: a6, NOZZLE: k1}.get(source.entry, np.ones(b))
            f[:, :m, j] = own.entry[:, :, 1] * gain[:, None]
        if source.is_stochastic:
            fresh.append((j, source.fresh(period)))
        first.append((j, source.initial**2 if math.isinf(source.time_constant) else -1.0))
    q = [np.pad(x, ((0, 0), (0, w), (0, w))) for x in (own.command_q, own.acceleration_q, own.unknown_q)]
    slots = np.append(own.slots, N_RIGID + 2 * len(own.modes) + np.arange(w))
    return Dynamics(own.modes, f, c, own.block, own.resets, q[0], q[1], q[2], entry, own.rate_scale, slots,
                    tuple(fresh), tuple(first))


def _held_noise(part: np.ndarray, ticks: int) -> np.ndarray:
    """(3, b, m, m) covariance over a row of unit command noise, of unit acceleration, and of the first in the ticks
    between rows alone, each drawn anew every tick; part (b, m, m) is the transition over a tick."""
    b, m, _ = part.shape
    q = np.zeros((3, b, m, m))
    free = part.copy()
    free[:, 4:6, :] = free[:, :, 4:6] = 0.0
    carry = np.broadcast_to(np.eye(m), (b, m, m))
    for j in range(ticks - 1, -1, -1):
        for k in range(2):
            enters = part[:, :, 4 + k].copy()
            enters[:, 4:6] = 0.0
            enters = np.einsum("bij,bj->bi", carry, enters)
            outer = enters[:, :, None] * enters[:, None, :]
            q[k] += outer
            if k == 0 and j > 0:
                q[2] += outer
        carry = free @ carry
    return q


def exponential(a: np.ndarray) -> np.ndarray:
    """exp of matrices (b, m, m): Taylor series of a part, squared up (Moler and Van Loan 2003, method 3)."""
    squarings = max(0, int(np.ceil(np.log2(max(float(np.max(np.abs(a).sum(axis=2))), 1e-300)))) + 1)
    scaled, term = a / 2.0**squarings, np.broadcast_to(np.eye(a.shape[1]), a.shape).copy()
    total = term.copy()
    for order in range(1, TAYLOR_ORDER + 1):
        term = term @ scaled / order
        total += term
    for _ in range(squarings):
        total = total @ total
    return total


@dataclass(frozen=True, eq=False)
class Disturbance:
    """One generic state d beside the model: d' = -d/time_constant + white, of this standard deviation, which adds to
    `place`: plant (acceleration), actuator (command), or the channel theta, theta_dot, beta."""

    place: str
    std: float
    time_constant: float


def largest(record: Record, place: str) -> float:
    """Standard deviation beyond which no disturbance of a place is sought, in its unit: a launcher's, or as much as
    what moves this vehicle, its command or the channel itself."""
    if place == "plant":
        moved = np.std(record.commands) * np.sqrt(np.mean(record.k1**2))
        swung = np.nanstd(record.z[:, THETA]) * np.sqrt(np.mean(record.a6**2)) if "theta" in record.channels else 0.0
        return max(MOST["plant"], float(moved), float(swung))
    own = record.commands if place == "actuator" else record.z[:, CHANNELS.index(place)]
    return max(MOST[place], float(np.nanstd(own)))


@dataclass(frozen=True, eq=False)
class Filter:
    """Gains and whitening of one set of levels."""

    levels: np.ndarray     # (5 + the world's,)
    gains: np.ndarray      # (n, 6 + 2 modes + the world's, 3), of a gyro that tells rad/s
    low: np.ndarray        # (n, 3, 3)
    whitened: np.ndarray   # (n, 3) innovations of this filter, whitened
    modes: Modes           # whose gains stand behind the rigid body's
    log_likelihood: float

    def whiten(self, innovations: np.ndarray) -> np.ndarray:
        """The whitened innovations (n, 3) under these gains."""
        out = np.empty_like(innovations)
        whiten(self.low, innovations, out)
        return out


class Refilter:
    """The innovations of one filter as filters with other levels, and a generic disturbance beside the model, have
    them.

    base    (n, 3) innovations of the filter `of`; None: of one that corrects nothing
    counts  (n,) bool: rows that count, None: all
    """

    def __init__(self, record: Record, dyn: Dynamics, base: np.ndarray, of: "Filter | None" = None,
                 counts: np.ndarray | None = None) -> None:
        self.record, self.dyn, self.base = record, dyn, base
        self.base_gains = np.zeros((record.rows, len(dyn.slots), 3))
        if of is not None:
            self.base_gains = gains_in(dyn, of, record)
        self.counts = np.ones(record.rows, bool) if counts is None else counts

    def log_likelihood(self, levels: np.ndarray, disturbance: Disturbance | None = None) -> float:
        """The log-likelihood of the rows that count."""
        return self._run(levels, disturbance, np.zeros((0, 1, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)))

    def log_likelihoods(self, levels: np.ndarray, disturbance: Disturbance | None = None) -> np.ndarray:
        """The log-likelihoods (k,) of the rows that count, of each row of levels (k, 5 + the world's)."""
        return self._abreast([(own, disturbance) for own in levels])

    def with_sizes(self, levels: np.ndarray, place: str, sizes: np.ndarray, time_constant: float) -> np.ndarray:
        """The log-likelihoods (k,) of the rows that count, of levels (5 + the world's,) with a disturbance of each size
        (k,)."""
        return self._abreast([(levels, Disturbance(place, float(size), time_constant)) for size in sizes])

    def _abreast(self, sets: list[tuple[np.ndarray, Disturbance | None]]) -> np.ndarray:
        """The log-likelihoods (k,) of sets that differ in variances alone, LANES at a time; for one alone the other
        kernel is faster."""
        if len(sets) == 1:
            return np.array([self.log_likelihood(*sets[0])])
        totals = np.zeros((-(-len(sets) // LANES), LANES))
        for k in range(len(totals)):
            lanes = sets[k * LANES:(k + 1) * LANES]
            each = [self._matrices(*one) for one in lanes + lanes[:1] * (LANES - len(lanes))]
            q, p, held = (np.stack([matrices[j].ravel() for matrices in each], axis=-1) for j in (1, 3, 4))
            r = np.stack([levels[:3]**2 for levels, _ in lanes + lanes[:1] * (LANES - len(lanes))], axis=-1)
            likelihoods(each[0][0], self.dyn.block, q, each[0][2], r, p, self.dyn.resets, held, self.base,
                        self.base_gains, self.counts, totals[k:k + 1])
        return totals.ravel()[:len(sets)]

    def filter(self, levels: np.ndarray, disturbance: Disturbance | None = None) -> "Filter":
        """The filter at these levels: its gains and whitening."""
        n, m, modes, world = self.record.rows, self.dyn.f.shape[1], self.dyn.modes, self.record.world
        size = m if disturbance is None else m + 1
        gains, low, whitened = np.zeros((n, size, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3))
        total = self._run(levels, disturbance, gains, low, whitened)
        full = np.zeros((n, N_RIGID + 2 * len(modes) + len(world.sources), 3))
        full[:, self.dyn.slots] = gains[:, :m]
        full[:, :, THETA_DOT] *= self.dyn.rate_scale
        return Filter(levels, full, low, whitened, modes, total)

    def gains(self, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The Kalman gains (n, m, 3), in these dynamics' units, and (n, 3, 3) lower factor of the innovations."""
        n, m = self.record.rows, self.dyn.f.shape[1]
        gains, low = np.zeros((n, m, 3)), np.zeros((n, 3, 3))
        self._run(levels, None, gains, low, np.zeros((n, 3)))
        return gains, low

    def horizon_variances(self, levels: np.ndarray, spacing: int, ahead: int) -> np.ndarray:
        """The variances (s, 3) of measured less predicted where nothing but noise of these levels is, `ahead` rows
        after every `spacing`-th."""
        dyn, measured = self.dyn, np.isfinite(self.record.z)
        variances = np.zeros((-(-self.record.rows // spacing), 3))
        f, q, c, p, held = self._matrices(levels, None)
        horizon_variances(f, dyn.block, q, c, levels[:3]**2, p, dyn.resets, held, measured, spacing, ahead, variances)
        return variances

    def _run(self, levels: np.ndarray, disturbance: Disturbance | None, gains: np.ndarray, low: np.ndarray,
             whitened: np.ndarray) -> float:
        dyn = self.dyn
        f, q, c, p, held = self._matrices(levels, disturbance)
        return float(likelihood(f, dyn.block, q, c, levels[:3]**2, p, dyn.resets, held, self.base, self.base_gains,
                                self.counts, gains, low, whitened))

    def _matrices(self, levels: np.ndarray, disturbance: Disturbance | None) -> tuple[np.ndarray, ...]:
        """Transition and process noise (b, m, m), measurement (3, m), first covariance (m, m), variances of held
        noises."""
        record, dyn = self.record, self.dyn
        q = levels[3]**2 * dyn.command_q + levels[4]**2 * dyn.acceleration_q + dyn.unknown_q
        for (state, variance), level in zip(dyn.fresh, levels[5:], strict=True):
            q[:, state, state] = variance * level**2
        f, c, p = dyn.f, dyn.c, _start(record, levels, dyn)
        if disturbance is not None:
            f, q, c, p = _with_disturbance(record, dyn, disturbance, f, q, c, p)
        return f, q, c, p, levels[3:5]**2 if record.held > 1 else np.zeros(0)


def run_filter(record: Record, dyn: Dynamics, levels: np.ndarray, base: np.ndarray, of: "Filter | None" = None) \
        -> Filter:
    """The filter with these levels, from the innovations `base` of another (`Refilter`)."""
    return Refilter(record, dyn, base, of).filter(levels)


def first_filter(record: Record, levels: np.ndarray) -> Filter:
    """Gains for these levels before any innovations are known."""
    return run_filter(record, dynamics(record, Point()), levels, record.z)


def gains_in(dyn: Dynamics, of: Filter, record: Record) -> np.ndarray:
    """The gains (n, m, 3) of a filter in these dynamics, whose modes and gyro it need not know."""
    gains = np.ascontiguousarray(carried_over(of, dyn.modes, len(record.world.sources))[:, dyn.slots])
    gains[:, :, THETA_DOT] /= dyn.rate_scale
    return gains


def carried_over(of: Filter, modes: Modes, world: int) -> np.ndarray:
    """Gains (n, 6 + 2 modes + world, 3) that a filter made for other modes amounts to: a slosh mode it does not know
    feels its corrections of the rate, a bending mode nothing (as `predictor.shift_state`)."""
    gains = np.zeros((len(of.gains), N_RIGID + 2 * len(modes) + world, 3))
    gains[:, :N_RIGID] = of.gains[:, :N_RIGID]
    gains[:, gains.shape[1] - world:] = of.gains[:, of.gains.shape[1] - world:]
    known = matched(of.modes, modes)
    for k, mode in enumerate(modes):
        slot = N_RIGID + 2 * k
        if known[k] >= 0:
            gains[:, slot:slot + 2] = of.gains[:, known[k]:known[k] + 2]
        elif not mode.bends:
            gains[:, slot + 1] = -of.gains[:, 1]
    return gains


def _start(record: Record, levels: np.ndarray, dyn: Dynamics) -> np.ndarray:
    """Covariance (m, m) before the first row; the state begins at the first measured values, or at rest."""
    p = np.zeros((dyn.f.shape[1], dyn.f.shape[1]))
    level_of = {state: level for (state, _), level in zip(dyn.fresh, levels[5:], strict=True)}
    for state, variance in dyn.first:
        p[state, state] = level_of[state]**2 if variance < 0.0 else variance
    p[0, 0] = (30.0 * levels[0])**2
    p[1, 1] = START_RATE**2
    if begins_at_rest(record):
        p[0, 0] = p[1, 1] = REST**2
    nozzle = 30.0 * levels[2]
    if "beta" not in record.channels:  # it begins where it was sent, or anywhere that it is sent to
        nozzle = max(nozzle, float(np.std(record.commands)))
    p[2, 2] = nozzle**2
    p[3, 3] = (nozzle * record.actuator.frequency)**2
    return p


def _with_disturbance(record: Record, dyn: Dynamics, of: Disturbance, f: np.ndarray, q: np.ndarray, c: np.ndarray,
                      p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The matrices with one more state, last."""
    b, m, _ = f.shape
    new_f, new_q, new_p = np.zeros((b, m + 1, m + 1)), np.zeros((b, m + 1, m + 1)), np.zeros((m + 1, m + 1))
    new_f[:, :m, :m], new_q[:, :m, :m], new_p[:m, :m] = f, q, p
    new_c = np.zeros((3, m + 1))
    new_c[:, :m] = c
    keep = float(np.exp(-record.period / of.time_constant))
    new_f[:, m, m] = keep
    new_q[:, m, m] = of.std**2 * (1.0 - keep**2)
    new_p[m, m] = of.std**2
    if of.place in CHANNELS:
        new_c[CHANNELS.index(of.place), m] = 1.0
    else:
        source = dyn.entry[:, :, 0 if of.place == "actuator" else 1]
        new_f[:, :m, m] = source[:, :m]
    return new_f, new_q, new_c, new_p

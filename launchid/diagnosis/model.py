"""Model of the diagnosis: the nominal's vehicle with the usual numbers free; numbers in, whitened innovations out."""

import math
import time
from typing import Any, NamedTuple

import numpy as np

from . import filter as ekf
from .adapter import Track
from .believed import believed, forcing

ARC_MINUTE = 2.9e-4    # rad of nozzle: no thrust is aligned better, so a moment that slow and small is nobody's fault
MOMENT_TIME = 20.0     # s, the time of that moment: slow beside the vehicle, several times in a flight
WIND_LEVEL = 0.005     # rad, rad/sqrt(s): of weather that nobody declared, where its fit begins
THIRD_DIFFERENCES = 20.0  # variance of third differences of white noise
WEATHER = {"turbulence": ekf.QG, "wind_walk": ekf.QM}   # causes that are a level
MODEL_FOLDS, FOLD_PASSES, SCORE_BLOCKS = 6, 3, 24   # of the score, times they go round, stretches for its error
CURVES = {"sin(theta)": ekf.SIN, "cos(theta)": ekf.COS, "theta^2": ekf.SQUARE, "theta^3": ekf.CUBE,
          "sign(theta_dot)": ekf.SIGN, "theta*theta_dot": ekf.CROSS, "beta^2": ekf.K2}
LINEAR_TERMS = ("1", "theta", "theta_dot", "beta")
KINEMATIC = ("gyro_bias", "gyro_scale", "gyro_delay")   # say something of the columns alone, and turn no vehicle
SMOOTH_INPUT = 0.4     # second over first differences of a measured input, up to which its acceleration is known
LONG = 20.0            # s, of a log that shows what changes slowly
RESPONSE_STEP = 0.02   # s, about, of small responses between two rows
DENSEST = 30.0         # times the declared, up to which a sensor's noise of a stand may be fitted
LOUDEST = 1e4          # times the declared, of the acceleration of a stand: nominals of others declare what they like


class Stopped(Exception):
    """Raised when the time limit of [diagnosis] has passed: the diagnosis ends without a conclusion."""


class Number(NamedTuple):
    """One number of the model: null its nominal value, tol how far from it is nobody's fault, prior one sigma, step of
    its slope, low and high its range, cause and parameter in the catalogue's words ("": none)."""

    name: str
    null: float
    tol: float
    prior: float
    step: float
    low: float = -math.inf
    high: float = math.inf
    cause: str = ""
    parameter: str = ""


def filled(x: np.ndarray) -> np.ndarray:
    """Return x (n,) with NaN replaced by lines between neighbours; zeros if all are NaN."""
    good = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(len(x)), good, x[good]) if len(good) else np.zeros(len(x))


def white_std(x: np.ndarray) -> float:
    """Return one sigma of the white part of x, by its third differences; 0 of ten values or fewer."""
    x = x[np.isfinite(x)]
    return float(np.std(np.diff(x, 3)) / math.sqrt(THIRD_DIFFERENCES)) if len(x) > 10 else 0.0


class Scales(NamedTuple):
    """The sizes of a log's motion: acceleration [rad/s^2], attitude, rate, nozzle, command (rms about the mean)."""

    acceleration: float
    theta: float
    omega: float
    beta: float


class Model:
    """A track with a table of numbers: filters the log for given values of them.

    numbers  the table, grown by `with_shapes`;  shapes  the candidates beyond the usual numbers that are fitted
    middle   (n,) times [s] of the rows' middles from the log's own;  tau  (n,) time from -1 to 1 over the log
    motion   (n, 3) attitude, rate, nozzle by the filter: what forced columns are made of
    nozzle   (n sub,) at the beginning of every step of the filter, for a mode may swing faster than rows show
    nozzle_rate  (n,) over each row as predicted at its beginning: what is measured at its end knows the row's noise
    """

    def __init__(self, track: Track, noise: str = "bounded") -> None:
        self.track, nominal, self.noise = track, track.nominal, noise
        self.t, self.z, self.n, self.retimed = track.t, track.z, len(track.z), 0.0
        self.dt = np.diff(track.t)
        self.centre = 0.5 * (track.t[0] + track.t[-2])
        self.middle, self.tau = track.t[:-1] + 0.5 * self.dt - self.centre, np.linspace(-1.0, 1.0, self.n)
        self.is_long = float(track.t[-1] - track.t[0]) > LONG
        self.servo = track.record.actuator
        self.known = believed(track, self.servo)
        self.a6, self.k1, self.terms, self.given = self.known.a6, self.known.k1, self.known.terms, self.known.numbers
        self.is_commanded = track.record.input != "beta"   # of the measured nozzle nothing is told of the servo
        self.has = {name: bool(np.isfinite(self.z[:, k]).any())
                    for k, name in enumerate(("theta", "theta_dot", "beta"))}
        self.has_theta, self.has_beta = self.has["theta"], self.has["beta"]
        self.has_both, self.has_no_path = self.has_theta and self.has["theta_dot"], not track.record.path.size
        self.unsure = 2.0 * track.record.unsure * self.n   # squares that commands may feign which no row saw
        self.brake = math.inf     # [s] of the monotonic clock, after which nothing is filtered
        self.law = nominal.controller or track.record.law
        self.is_flown = self.law is not None and nominal.simulation is not None
        u = track.commands
        self.is_smooth = float(np.std(np.diff(u, 2))) < SMOOTH_INPUT * float(np.std(np.diff(u)))  # of a measured input
        self.scales = self._scales()
        self.is_unstable = bool(np.any(self.a6 != 0.0))
        self.input_moves = bool(np.any(self.k1 != 0.0)) and self.scales.beta > 1e-9
        self.has_commands = self.is_commanded and self.input_moves
        self.widths = np.repeat(self.dt / track.sub, track.sub)
        self.integral = np.append(0.0, np.cumsum(track.commands * np.diff(track.ticks)))
        self.inputs: dict[tuple[float, ...], np.ndarray] = {}
        self.in_weather("")
        self.E, self.S = np.zeros((self.n, 3)), np.full((self.n, 3), np.nan)
        self.K, self.X, self.A = np.zeros((self.n, 3, 6)), np.zeros((self.n, 6)), np.zeros((self.n, 6))
        self.E2, self.C = np.zeros((self.n, 3)), np.zeros((0, 6, 6))
        self.columns: dict[tuple[object, ...], Any] = {}     # of shapes, kept
        self.shapes: list = []
        self.numbers: list[Number] = []
        self.nozzle = np.interp(track.edges[:-1], track.ticks[:-1], track.commands)
        self.motion = np.column_stack([filled(self.z[:, 0]), filled(self.z[:, 1]), self.nozzle[::track.sub]])
        self.flat = np.zeros(0, np.int64)
        self._know()

    def _know(self) -> None:
        """Set the forcing by the nominal's own effects, from the motion as it is known by now."""
        rest = {name: value for name, value in self.terms.items() if name not in CURVES and name not in LINEAR_TERMS}
        self.force, self.air, self.shift = forcing(self.known, self.track, rest, self.motion, self.nozzle)

    # ---- what the nominal says of noise

    def _scales(self) -> Scales:
        theta = filled(self.z[:, 0]) if self.has["theta"] else np.cumsum(filled(self.z[:, 1]) * self.dt)
        omega = filled(self.z[:, 1]) if self.has["theta_dot"] else np.gradient(theta, self.t[:-1])
        apart = max(2, round(0.2 / float(np.median(self.dt))))
        acceleration = float(np.std(omega[apart:] - omega[:-apart])) / (apart * float(np.median(self.dt)))
        command = self.track.commands
        return Scales(acceleration + 1e-12, float(np.std(theta)) + 1e-12, float(np.std(omega)) + 1e-12,
                      float(np.std(command)) + 1e-12)

    def _levels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return declared levels, sigma of their logarithm (0: not fitted), largest log factor, (7,) each."""
        nominal, r = self.track.nominal, self.track.record
        s, a, sim, c, known = nominal.sensors, nominal.actuator, nominal.simulation, self.law, self.known
        self.tick = tick = c.period if c is not None else float(np.median(self.dt))
        given = [(s.theta_std, s.theta_step), (s.theta_dot_std, s.theta_dot_step), (s.beta_std, s.beta_step)]
        sensor = []
        for k, (white_part, step) in enumerate(given):
            white, std = white_std(self.z[:, k]), math.hypot(white_part, step / math.sqrt(12.0))
            if not self.is_flown and white > 0.0:
                std = min(std, 3.0 * white)
            sensor.append(max(std, 0.05 * white, 1e-9))
        noise = sim.acceleration_noise_std if sim is not None else 0.0
        qa = max(noise, 1e-3 * self.scales.acceleration) * math.sqrt(tick)
        if self.is_commanded:
            qc = math.hypot((a.command_noise_std if a is not None else 0.0) * math.sqrt(tick),
                            r.between * math.sqrt(r.tick * r.step))
        else:
            qc = s.beta_std * math.sqrt(self.track.period)
        self.is_windy = known.walk > 0.0 or known.turbulence > 0.0
        if self.is_windy:
            turns = float(np.mean(known.z_alpha))   # the path turns with a wind that wanders, which is then less felt
            qg, self.m0, self.tau_g = known.turbulence, known.initial, known.turbulence_time
            self.tau_m = 1.0 / turns if turns > 0.0 else math.inf
            qm = known.walk * (math.sqrt(0.5 * self.tau_m) if turns > 0.0 else 1.0)
        elif self.is_flown:
            qm = self.m0 = ARC_MINUTE * max(float(np.sqrt(np.mean(self.k1**2))), 1e-3)
            qg, self.tau_m, self.tau_g = 0.0, MOMENT_TIME, 1.0
        else:
            qm, qg, self.m0, self.tau_m, self.tau_g = 0.02 * self.scales.acceleration / math.sqrt(5.0), 0.0, \
                0.0, math.inf, 1.0
        levels = np.array([*sensor, qa, max(qc, 1e-12), max(qm, 1e-12), max(qg, 1e-12)])
        if self.is_flown:
            spread = np.array([0.5, 0.5, 0.5, 0.5, 0.3, 1.0 if self.is_windy else 0.0, 1.0 if qg > 0.0 else 0.0])
            cap = np.log([3.0, 3.0, 3.0, 3.0, 3.0, 2.0, 2.0])
        else:
            spread = np.array([1.0, 1.0, 1.0, 2.5, 0.0 if qc == 0.0 else 1.0, 1.5, 0.0])
            cap = np.log([DENSEST, DENSEST, DENSEST, LOUDEST, DENSEST, 10.0, 1.0])
        if self.noise == "declared":
            spread[:] = 0.0
        elif self.noise == "free":
            spread, cap = np.where(spread > 0.0, 5.0, 0.0), np.full(len(cap), math.log(LOUDEST))
        spread[:3] *= [self.has["theta"], self.has["theta_dot"], self.has["beta"]]
        return np.log(levels), spread, cap

    def in_weather(self, name: str) -> None:
        """Make the air turbulent or its wind a walk (`name`), of a level that is fitted; "": as the nominal says."""
        self.levels0, self.spread, self.cap = self._levels()
        self.weather = name
        if name:
            k = WEATHER[name]
            if name == "wind_walk":
                self.is_windy, self.tau_m, self.m0 = True, math.inf, WIND_LEVEL
            self.levels0[k], self.spread[k], self.cap[k] = math.log(WIND_LEVEL), 2.0, math.log(40.0)
        self.moves = np.flatnonzero(self.spread > 0.0)
        self.levels = self.levels0.copy()
        self.inputs.clear()

    def retime(self, late: float) -> bool:
        """Move the gyro's column earlier by the whole rows in `late` [s]; return whether there are any: no series of
        few terms says what such a gyro does."""
        row = float(np.median(self.dt))
        rows = round((late - self.retimed) / row)
        if rows < 1 or not self.is_flown:
            return False
        z = self.z.copy()
        z[:-rows, 1] = self.z[rows:, 1]
        z[-rows:, 1] = np.nan
        self.z, self.retimed, self.flat = z, self.retimed + rows * row, np.zeros(0, np.int64)
        return True

    # ---- numbers to the filter's arrays

    def index(self, name: str) -> int:
        return self._at[name]

    @property
    def names(self) -> frozenset[str]:
        return frozenset(self._at)

    def with_numbers(self, numbers: list[Number], shapes: list) -> None:
        """Set the table of numbers, and the shapes whose numbers stand in it."""
        self.numbers, self.shapes = numbers, shapes
        self._at = {each.name: k for k, each in enumerate(numbers)}
        self.null, self.tol, self.prior, self.step, self.low, self.high = (
            np.array([each[k] for each in numbers]) for k in range(1, 7))
        if not shapes or not hasattr(self, "base_input"):
            _, self.base_input, _, self.base_constants = self.arrays(self.null)

    def input_of(self, get, c: np.ndarray) -> np.ndarray:
        """Return the servo's input (n, sub) [rad]: commands after delay, lag, washout, play, rate limit and gain."""
        key = (get("delay"), max(get("lag"), 0.0), max(get("washout"), 0.0), get("play"), get("rate_limit"))
        if key not in self.inputs:
            delay, lag, washout, play, limit = key
            ticks, edges = self.track.ticks, self.track.edges - (self.servo.delay * self.is_commanded + delay)
            commands, integral = self.track.commands, self.integral
            if play > 0.0:
                commands = np.empty(len(commands))
                ekf.played(self.track.commands, play, self.servo.command_noise_std * self.is_commanded, commands)
                integral = np.append(0.0, np.cumsum(commands * np.diff(ticks)))
            total = np.interp(edges, ticks, integral)
            total = np.where(edges < ticks[0], (edges - ticks[0]) * commands[0], total)
            total = np.where(edges > ticks[-1], integral[-1] + (edges - ticks[-1]) * commands[-1], total)
            u = sent = np.diff(total) / self.widths
            if lag > 0.0 or washout > 0.0 or limit > 0.0:
                u = np.empty(len(u))
                ekf.nozzle_input(sent, self.widths, c, lag, washout, 1.0 / limit if limit > 0.0 else 0.0, u)
            if len(self.inputs) > 24:
                self.inputs.pop(next(iter(self.inputs)))
            self.inputs[key] = u.reshape(self.n, self.track.sub)
        return get("gain", 1.0) * self.inputs[key] + get("null_angle")

    def arrays(self, p: np.ndarray):
        """Return the filter's arrays for numbers p: z (n, 3) less known shifts, u (n, sub), rows (n, 6), constants."""
        at = self._at

        def get(name: str, missing: float = 0.0) -> float:
            return float(p[at[name]]) if name in at else self.given.get(name, missing)

        c = np.zeros(ekf.N_FILTER_CONSTANTS)
        c[ekf.SERVO_ORDER_PLACE] = ekf.FIRST_ORDER_SERVO if self.servo.is_first_order else ekf.SECOND_ORDER_SERVO
        c[ekf.W] = self.servo.frequency * max(get("bandwidth", 1.0), 0.01)
        c[ekf.ZETA] = 1.0 if self.servo.is_first_order else self.servo.damping_ratio
        c[ekf.DT], c[ekf.DW] = get("attitude_delay"), get("gyro_delay") - self.retimed
        c[ekf.SCALE], c[ekf.GYRO], c[ekf.NULL] = get("gyro_scale", 1.0), get("gyro_bias"), get("nozzle_bias")
        c[ekf.SOFT] = max(0.05 * self.scales.omega, 1e-9)
        c[ekf.TAU_M], c[ekf.TAU_G] = self.tau_m, self.tau_g
        c[ekf.KAPPA], c[ekf.COMMAND_PERIOD] = get("inertia"), self.tick
        rows = np.zeros((self.n, 6))
        for name, code in CURVES.items():
            c[code] = get("term " + name, self.terms.get(name, 0.0))
        c[ekf.SIGN] -= get("friction")
        c[ekf.SIN] += get("sine")
        c[ekf.CUBE] += get("cubic") * float(np.mean(self.a6))
        a6, k1 = self.a6 * get("a6", 1.0), self.k1
        rows[:, 1] = a6 + get("term theta", self.terms.get("theta", 0.0)) - get("sine")
        rows[:, 2] = get("term theta_dot", self.terms.get("theta_dot", 0.0)) - get("damping")
        rows[:, 3] = k1 * (get("k1", 1.0) + get("k1_slope") * (self.t[:-1] - self.centre)) + \
            get("term beta", self.terms.get("beta", 0.0))
        f = get("moment") + k1 * get("misalignment") + a6 * get("wind") + self.force + \
            get("term 1", self.terms.get("1", 0.0)) + get("a6", 1.0) * self.air
        rows[:, 4] = self.a6 if self.is_windy else 1.0
        rows[:, 5] = self.a6
        z, u = self.z - self.shift, self.input_of(get, c)
        for shape in self.shapes:
            values = tuple(float(p[at[name]]) for name in shape.names)
            if not any(values[:shape.kind.linear]):
                continue
            rows[:, 3] *= shape.effectiveness(self, values)
            force, sent, moved = shape.effect(self, values)
            f = f if force is None else f + force
            u = u if sent is None else u + sent
            z = z if moved is None else z - moved
        rows[:, 0] = f
        return z, u, rows, c

    def P0(self) -> np.ndarray:
        s, lv = self.scales, np.exp(self.levels)
        return np.array([(100.0 if not self.has["theta"] else 10.0) * s.theta**2 + lv[0]**2, 10.0 * s.omega**2 +
                         100.0 * lv[1]**2, self.m0**2, lv[ekf.QG]**2, s.beta**2, (10.0 * s.beta)**2])

    def run(self, p: np.ndarray, frozen: bool = False) -> None:
        """Filter with numbers p: set E, S, K, X, A; frozen: E2 with the last gains.  Stopped after the time limit."""
        if time.monotonic() > self.brake:
            raise Stopped
        z, u, rows, c = self.arrays(p)
        ekf.run(self.t, np.ascontiguousarray(z), u, rows, c, np.exp(self.levels), self.P0(), self.track.sub, frozen,
                self.E2 if frozen else self.E, self.S, self.K, self.X, self.A, self.C)
        if not frozen:
            self.last = (z, rows, c)
            self.last_input, self.mean_input = u, u.mean(axis=1)
            self.weight = 1.0 / np.sqrt(self.S.ravel()[self.flat])

    def white(self, p: np.ndarray, frozen: bool = False) -> np.ndarray:
        """Return the whitened innovations (r,) with numbers p; frozen: with the last filter's gains and variances."""
        self.run(p, frozen)
        if not len(self.flat):
            self._choose_rows()
        out = np.empty(len(self.flat))
        self.log_variance = ekf.whiten((self.E2 if frozen else self.E).ravel(), self.S.ravel(), self.flat, out)
        return out

    def move_to(self, p: np.ndarray) -> None:
        """Run the filter with numbers p: its path, variances and `log_variance` are then those of p."""
        self.white(p)

    def _choose_rows(self) -> None:
        """Choose rows and channels to score: not the first, nor those after a gap, while the filter settles."""
        ok, skip = np.isfinite(self.S), max(10, self.n // 200)
        for k in (0, *(np.flatnonzero(self.dt > 20.0 * self.dt[0]) + 1)):
            ok[k:k + skip] = False
        self.rows, self.channel = np.nonzero(ok)
        self.flat = np.flatnonzero(ok.ravel())
        self.fold = self.rows * (MODEL_FOLDS * FOLD_PASSES) // self.n % MODEL_FOLDS
        self.block = self.rows * SCORE_BLOCKS // self.n

    def respond(self, force: np.ndarray, command: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Return the change (r,) of the whitened innovations by a small force (n,) [rad/s^2], command (n,) [rad] and
        shift (n, 3) of the measurements, about the last filter's path."""
        z, rows, c = self.last
        E = np.empty((self.n, 3))
        sub = max(1, round(self.track.period / RESPONSE_STEP))
        ekf.respond(self.t, z, rows, c, sub, self.K, self.A, force, command, shift, E)
        return E.ravel()[self.flat] * self.weight

    def ahead(self, starts: np.ndarray, spans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return errors and variances (starts, spans, 3) of open-loop predictions; variances are NaN without `C`."""
        z, rows, c = self.last
        errors, variances = np.empty((2, len(starts), len(spans), 3))
        ekf.ahead(self.t, np.ascontiguousarray(z), self.last_input, rows, c, np.exp(self.levels), self.track.sub,
                  self.X, self.C, starts, spans, errors, variances)
        return errors, variances

    def settle(self) -> None:
        """Store the filtered motion of the last run, from which forced columns are made."""
        self.motion = np.column_stack([self.X[:, 0], self.X[:, 1], self.X[:, 4]])
        predicted = self.X[1:, ekf.B] - np.sum(self.K[1:, :, ekf.B] * self.E[1:], axis=1)
        self.nozzle_rate = np.append((predicted - self.X[:-1, ekf.B]) / self.dt[:-1], 0.0)
        self.nozzle = ekf.nozzle_path(self.X, self.last_input, self.last[2], self.track.period / self.track.sub)
        self.columns.clear()
        self._know()

"""The filtered formulation's model of the vehicle: profile, actuator, noises."""

import math
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

NOISES = ("theta_std", "theta_dot_std", "beta_std", "command_noise_std", "acceleration_noise_std")
N_NOISES = len(NOISES)
WIND_NOISES = ("walk", "turbulence")  # levels that a model with wind has beside them, in this order
OFFSETS = ("thrust_misalignment", "moment", "attitude_bias", "gyro_bias", "nozzle_sensor_bias")
N_OFFSETS = len(OFFSETS)
MAX_NUISANCES = len(WIND_NOISES) + N_OFFSETS
MAX_LEVELS = N_NOISES + len(WIND_NOISES)
MODE_KINDS = ("slosh", "bending")
MODE_NUMBERS = ("frequency", "size", "damping_ratio")  # what of a mode may be unknown
MAX_MODES = 3   # of each kind
MAX_NUMBERS = 2 * MAX_MODES * len(MODE_NUMBERS)
MAX_KNOWN = 8  # terms, and sines of time, that may be known to act
SERVO = ("natural_frequency", "damping_ratio", "delay")  # what of a servo may be unknown
DRIFTS = ("a6_drift", "k1_drift")
# what a nuisance state is: the wind's two parts, then OFFSETS
WALK, TURBULENCE, MISALIGNMENT, MOMENT, ATTITUDE_BIAS, GYRO_BIAS, NOZZLE_BIAS = range(7)
SPREADS = ("wind_initial", "turbulence", *OFFSETS)  # of each nuisance, one sigma at the first sample

NODE_FIELDS = {"profile_t": ("profile_a6", "profile_k1"), "sigma_t": ("sigma_a6", "sigma_k1"),
               "forecast_t": ("forecast",),
               "drift_t": ("drift_alpha", "drift_beta"), "moment_t": ("known_moment",)}
AT_LEAST_ZERO = ("delay", "time_constant", "backlash", "command_lag", "washout", "rate_limit", "rate_wind_up",
                 "walk", "wind_initial", "turbulence", "gamma_std", *OFFSETS,
                 *(f"{name}_sigma" for name in SERVO), *DRIFTS)


@dataclass(frozen=True, kw_only=True)
class Oscillator:
    """One mode of slosh or bending.

    kind          `slosh`: psi'' + 2 z w psi' + w^2 psi = -theta_ddot, theta_ddot += size w^2 psi; or
                  `bending`: eta'' + 2 z w eta' + w^2 eta = size w^2 beta, which the sensors show
    t [s]         nodes of frequency w [rad/s], size (coupling; gain [rad/rad]) and damping ratio z, linear between
    frequency_sigma, size_sigma, damping_ratio_sigma  one sigma of what is not known of it, as a share; 0: known
    angle, rate   what attitude sensor and gyro show of eta and eta'
    """

    kind: str
    t: tuple[float, ...]
    frequency: tuple[float, ...]
    size: tuple[float, ...]
    damping_ratio: tuple[float, ...]
    frequency_sigma: float = 0.0
    size_sigma: float = 0.0
    damping_ratio_sigma: float = 0.0
    angle: float = 1.0
    rate: float = 1.0

    def numbers(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Name and nodes of each number."""
        return tuple((name, getattr(self, name)) for name in MODE_NUMBERS)

    def __post_init__(self) -> None:
        if self.kind not in MODE_KINDS:
            raise ValueError(f"kind={self.kind!r}: expected {' or '.join(MODE_KINDS)}")
        if not self.t or any(b <= a for a, b in pairwise(self.t)):
            raise ValueError(f"t={self.t!r}: expected increasing times")
        for name, values in self.numbers():
            if len(values) != len(self.t) or not all(map(math.isfinite, values)):
                raise ValueError(f"{name}={values!r}: expected {len(self.t)} finite numbers, as many as t")
            if (name != "size" and min(values) < 0.0) or (name == "frequency" and min(values) == 0.0):
                raise ValueError(f"{name}={values!r}: expected numbers above 0")
        for name in (*(f"{name}_sigma" for name in MODE_NUMBERS), "angle", "rate"):
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)
            if not math.isfinite(value) or (name.endswith("_sigma") and value < 0.0):
                raise ValueError(f"{name}={value!r}: expected a finite number of at least 0")
        if self.kind == "slosh":
            object.__setattr__(self, "angle", 0.0)
            object.__setattr__(self, "rate", 0.0)


@dataclass(frozen=True, kw_only=True)
class Model:
    """Nominal of theta_ddot = a6(t) alpha + k1(t) (beta + m) - d theta_dot behind an actuator,
    alpha = theta - gamma + w.

    profile_t  [s], profile_a6, profile_k1 [1/s^2]  nodes, linear between, held beyond; one node: constant
    natural_frequency [rad/s], damping_ratio, delay [s]  beta_ddot = w^2 (u(t - delay) - beta) - 2 zeta w beta_dot
    time_constant [s]      of a first-order actuator, beta_dot = (u(t - delay) - beta)/time_constant; 0: second order,
                           else natural_frequency and damping_ratio are not used
    natural_frequency_sigma, damping_ratio_sigma, delay_sigma [s]  one sigma of what is not known of the servo before
                           the flight, of frequency and damping relative; 0: known.  Any above 0: it is estimated
    theta_std [rad], theta_dot_std [rad/s], beta_std [rad]  white sensor noise, one draw per sample
    command_noise_std [rad], acceleration_noise_std [rad/s^2]  process noise, one draw per `noise_period`
    noise_period [s]       how long a draw of the process noise is held
    sigma_t [s], sigma_a6, sigma_k1  nodes of the relative range a = a0 (1 + sigma delta), |delta| <= 1, linear between,
                           held beyond; empty: no uncertainty level is asked for
    walk [rad/sqrt(s)], wind_initial [rad]  random walk of the wind angle, its standard deviation at the first sample
    turbulence [rad], turbulence_time [s]   stationary first-order part of the wind angle
    forecast_t [s], forecast [rad]  nodes of the wind that is known beforehand; empty: none
    drift_t [s], drift_alpha, drift_beta [1/s]  nodes of gamma_dot = z_alpha alpha + z_beta (beta + m), where no sample
                           says gamma; empty: gamma is 0 there
    gamma_std [rad]        white noise of the samples' gamma
    thrust_misalignment, attitude_bias, nozzle_sensor_bias [rad], gyro_bias [rad/s], moment [rad/s^2]  one sigma of
                           constants that are not known before the flight; 0: known to be `known_...`
    known_lean [rad]       thrust misalignment that is known; known_theta [rad], known_theta_dot [rad/s], known_beta
                           [rad]: known sensor offsets; gyro_scale, command_gain, command_offset [rad]: what gyro and
                           actuator are known to make of rate and command
    known_damping [1/s]    d
    nozzle_inertia         c of theta_ddot += c beta_ddot, of a second-order actuator
    modes                  slosh, then bending: up to MAX_MODES `Oscillator` of each
    moment_t [s], known_moment [rad/s^2]  nodes of an acceleration that is known beforehand; empty: none
    sines                  the same: up to MAX_KNOWN of (amplitude [rad/s^2], frequency [rad/s], phase [rad])
    known_terms            up to MAX_KNOWN of (library term, coefficient), accelerations that are known
    known_cubic [1/rad^2]  c of a6 (alpha + c alpha^3), which acts in place of a6 alpha
    backlash [rad], command_lag [s], washout [s]  half width of a play on the command, time constants of a lag behind
                           it and of a wash-out behind that; 0: none
    rate_limit [rad/s]     of the servo, 0: none;  rate_wind_up  share of it by which its own rate may run beyond
    a6_drift, k1_drift [1/min]  one sigma of how fast a6 and k1 leave the profile, relative; 0: their ratio to it is
                           constant but for sudden changes

    A wrong value raises ValueError naming field, value and allowed range.
    """

    profile_t: tuple[float, ...]
    profile_a6: tuple[float, ...]
    profile_k1: tuple[float, ...]
    natural_frequency: float
    damping_ratio: float
    theta_std: float
    theta_dot_std: float
    beta_std: float
    command_noise_std: float
    acceleration_noise_std: float
    noise_period: float
    delay: float = 0.0
    sigma_t: tuple[float, ...] = ()
    sigma_a6: tuple[float, ...] = ()
    sigma_k1: tuple[float, ...] = ()
    time_constant: float = 0.0
    walk: float = 0.0
    wind_initial: float = 0.0
    turbulence: float = 0.0
    turbulence_time: float = 1.0
    forecast_t: tuple[float, ...] = ()
    forecast: tuple[float, ...] = ()
    drift_t: tuple[float, ...] = ()
    drift_alpha: tuple[float, ...] = ()
    drift_beta: tuple[float, ...] = ()
    gamma_std: float = 0.0
    thrust_misalignment: float = 0.0
    moment: float = 0.0
    attitude_bias: float = 0.0
    gyro_bias: float = 0.0
    nozzle_sensor_bias: float = 0.0
    known_lean: float = 0.0
    known_theta: float = 0.0
    known_theta_dot: float = 0.0
    known_beta: float = 0.0
    gyro_scale: float = 1.0
    command_gain: float = 1.0
    command_offset: float = 0.0
    known_damping: float = 0.0
    nozzle_inertia: float = 0.0
    modes: tuple[Oscillator, ...] = ()
    moment_t: tuple[float, ...] = ()
    known_moment: tuple[float, ...] = ()
    sines: tuple[tuple[float, float, float], ...] = ()
    known_terms: tuple[tuple[str, float], ...] = ()
    known_cubic: float = 0.0
    backlash: float = 0.0
    command_lag: float = 0.0
    washout: float = 0.0
    rate_limit: float = 0.0
    rate_wind_up: float = 0.0
    natural_frequency_sigma: float = 0.0
    damping_ratio_sigma: float = 0.0
    delay_sigma: float = 0.0
    a6_drift: float = 0.0
    k1_drift: float = 0.0

    def __post_init__(self) -> None:
        for nodes, values in NODE_FIELDS.items():
            self._require_nodes(nodes, values)
        if not self.profile_t:
            raise ValueError(f"profile_t={self.profile_t!r}: expected at least one node")
        self._require_known()
        for field in fields(self):
            if isinstance(field.default, tuple) or field.name.startswith("profile"):
                continue
            value = float(getattr(self, field.name))
            object.__setattr__(self, field.name, value)
            if field.name in ("natural_frequency", "damping_ratio") and self.time_constant > 0.0:
                continue
            if field.name.startswith("known") or field.name in ("command_offset", "nozzle_inertia"):
                allowed, words = True, ""
            elif field.name in ("damping_ratio", *AT_LEAST_ZERO):
                allowed, words = value >= 0.0, " of at least 0"
            else:
                allowed, words = value > 0.0, " above 0"
            if not (math.isfinite(value) and allowed):
                raise ValueError(f"{field.name}={value!r}: expected a finite number{words}")
        if self.time_constant > 0.0 and self.natural_frequency_sigma + self.damping_ratio_sigma > 0.0:
            raise ValueError(f"time_constant={self.time_constant!r}: a first-order actuator has no natural_frequency "
                             "and no damping_ratio: expected a delay_sigma alone")
        if self.time_constant > 0.0 and self.nozzle_inertia != 0.0:
            raise ValueError(f"nozzle_inertia={self.nozzle_inertia!r}: a first-order actuator jumps, expected 0")

    def _require_nodes(self, nodes: str, names: tuple[str, ...]) -> None:
        """Increasing times, and as many finite numbers of each name; a range sigma is above 0."""
        for name in (nodes, *names):
            values = tuple(float(x) for x in getattr(self, name))
            object.__setattr__(self, name, values)
            positive = name in ("sigma_a6", "sigma_k1")
            good = all(math.isfinite(x) and (x > 0 or not positive) for x in values)
            if not good or len(values) != len(getattr(self, nodes)):
                raise ValueError(f"{name}={values!r}: expected {len(getattr(self, nodes))} finite numbers"
                                 f"{' above 0' if positive else ''}, as many as {nodes}")
        times = getattr(self, nodes)
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"{nodes}={times!r}: expected increasing times")

    def _require_known(self) -> None:
        """Finite sines and terms, MAX_KNOWN at most of each."""
        sines = tuple(tuple(float(x) for x in each) for each in self.sines)
        terms = tuple((name, float(x)) for name, x in self.known_terms)
        object.__setattr__(self, "sines", sines)
        object.__setattr__(self, "known_terms", terms)
        kinds = [MODE_KINDS.index(each.kind) for each in self.modes]
        if kinds != sorted(kinds) or max(map(kinds.count, kinds), default=0) > MAX_MODES:
            raise ValueError(f"modes={self.modes!r}: expected slosh before bending, at most {MAX_MODES} of each")
        if len(sines) > MAX_KNOWN or not all(len(each) == 3 and all(map(math.isfinite, each)) for each in sines):
            raise ValueError(f"sines={sines!r}: expected up to {MAX_KNOWN} of three finite numbers")
        if len(terms) > MAX_KNOWN or not all(isinstance(name, str) and math.isfinite(x) for name, x in terms):
            raise ValueError(f"known_terms={terms!r}: expected up to {MAX_KNOWN} library terms with finite "
                             "coefficients")

    @property
    def mode_counts(self) -> tuple[int, int, int, int, int]:
        """Modes, sloshes among them, their unknown numbers, 1 if any changes with time, 1 if a sensor shows any."""
        numbers = sum(getattr(mode, f"{name}_sigma") > 0.0 for mode in self.modes for name in MODE_NUMBERS)
        shows = self.nozzle_inertia != 0.0 or any(mode.angle != 0.0 or mode.rate != 0.0 for mode in self.modes)
        return (len(self.modes), sum(mode.kind == "slosh" for mode in self.modes), numbers,
                int(any(len(mode.t) > 1 for mode in self.modes)), int(shows))

    @property
    def known(self) -> tuple[int, int, int, int]:
        """What is known beside a6 and k1: 1 if any acceleration, how many terms, how many sines, 1 if the command is
        shaped."""
        acts = bool(self.moment_t or self.sines or self.known_terms) or self.known_cubic != 0.0
        shaped = max(self.backlash, self.command_lag, self.washout) > 0.0
        return int(acts), len(self.known_terms), len(self.sines), int(shaped)

    @property
    def levels(self) -> tuple[str, ...]:
        """Names of the noise levels, in the order of `variances`."""
        return NOISES + tuple(name for name in WIND_NOISES if getattr(self, name) > 0.0)

    @property
    def nuisances(self) -> tuple[int, ...]:
        """The nuisances that are carried as states beside the vehicle's: WALK .. NOZZLE_BIAS."""
        wind = [(WALK, self.walk > 0.0 or self.wind_initial > 0.0), (TURBULENCE, self.turbulence > 0.0)]
        constants = [(MISALIGNMENT + k, getattr(self, name) > 0.0) for k, name in enumerate(OFFSETS)]
        return tuple(role for role, there in wind + constants if there)

    @property
    def servo_sigma(self) -> tuple[float, ...]:
        """One sigma of what is not known of SERVO; empty where all of it is known."""
        sigma = tuple(getattr(self, f"{name}_sigma") for name in SERVO)
        return sigma if any(sigma) else ()

    def variances(self, sample_period: float) -> np.ndarray:
        """Variances (5 to 7,) in the order of `levels`; process noise keeps its spectral density at the sample period,
        the walk's is a second's."""
        held = self.noise_period / sample_period
        scale = {"command_noise_std": held, "acceleration_noise_std": held}
        squares = {name: getattr(self, name) * getattr(self, name) for name in self.levels}
        return np.array([scale.get(name, 1.0) * square for name, square in squares.items()])

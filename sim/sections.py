"""The sections of a nominal as frozen dataclasses, SI units (s, rad); `sim.nominal` reads and writes them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from .errors import InputError
from .result import Result

if TYPE_CHECKING:
    from .effects import Effect
    from .result import Columns, Figure


@dataclass(frozen=True, eq=False)
class Profile:
    """a6 and k1 (n,) [1/s^2] at nodes t (n,) [s], increasing; linear between the nodes."""

    t: np.ndarray    # s
    a6: np.ndarray   # 1/s^2
    k1: np.ndarray   # 1/s^2
    path: str = ""   # of the CSV file it was read from

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (a6, k1) at times t [s], held constant beyond the ends."""
        return np.interp(t, self.t, self.a6), np.interp(t, self.t, self.k1)


@dataclass(frozen=True, eq=False)
class Drift:
    """[drift]: gamma_dot = z_alpha alpha + z_beta (beta + m), z_alpha, z_beta [1/s] linear between nodes t [s]."""

    t: np.ndarray        # s, increasing
    z_alpha: np.ndarray  # 1/s
    z_beta: np.ndarray   # 1/s
    path: str = ""       # of the CSV file it was read from

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (z_alpha, z_beta) at times t [s], held constant beyond the ends."""
        return np.interp(t, self.t, self.z_alpha), np.interp(t, self.t, self.z_beta)


@dataclass(frozen=True, eq=False)
class Forecast:
    """Wind (n,) [rad] that is known before the flight, at nodes t (n,) [s], linear between the nodes."""

    t: np.ndarray     # s, increasing
    wind: np.ndarray  # rad
    path: str = ""    # of the CSV file it was read from

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return the wind angle [rad] at times t [s], held constant beyond the ends."""
        return np.interp(t, self.t, self.wind)


ANYWHERE, AT_REST = "anywhere", "at rest"   # how a log begins
UNKNOWN_WIND = 0.05  # rad, one sigma at t = 0: 3 degrees, a few m/s of mean wind at the dynamic pressure's maximum


@dataclass(frozen=True)
class Wind:
    """[wind]: w = profile + walk + turbulence, the angle [rad] that the air adds to the angle of attack."""

    walk: float = 0.0                 # rad/sqrt(s), of a random walk
    turbulence: float = 0.0           # rad, one sigma of a stationary first-order process
    turbulence_time: float = 1.0      # s, its correlation falls to exp(-1) over it
    initial: float = math.nan         # rad, one sigma of the walk at t = 0; not given: UNKNOWN_WIND, 0 if calm
    profile: Forecast | None = None   # flown, and known

    def __post_init__(self) -> None:
        if math.isnan(self.initial):
            object.__setattr__(self, "initial", UNKNOWN_WIND if self.walk > 0.0 or self.turbulence > 0.0 else 0.0)

    @property
    def is_calm(self) -> bool:
        """Whether all parts of the wind are 0 for certain."""
        return self.walk == self.turbulence == self.initial == 0.0 and \
            (self.profile is None or not np.any(self.profile.wind))


@dataclass(frozen=True)
class Offsets:
    """[offsets]: one sigma of constants that nobody knows before the flight; one of 0 is known to be 0."""

    thrust_misalignment: float = 0.0  # rad, m of k1 (beta + m)
    attitude_bias: float = 0.0        # rad, on theta as measured, seen by the controller too
    gyro_bias: float = 0.0            # rad/s, on theta_dot as measured
    nozzle_sensor_bias: float = 0.0   # rad, on beta as measured
    moment: float = 0.0               # rad/s^2, on theta_ddot

    @property
    def is_known(self) -> bool:
        """Whether all offsets are known to be 0."""
        return self == Offsets()


@dataclass(frozen=True)
class InTime:
    """A number over flight time: nodes t [s], increasing, with their values; linear between, held beyond."""

    t: tuple[float, ...]
    value: tuple[float, ...]

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return the number at times t (n,) [s]."""
        return np.interp(t, self.t, self.value)


def constant(x: float) -> InTime:
    """Return a number that is the same at all times."""
    return InTime((0.0,), (x,))


SLOSH_DAMPING = constant(0.02)    # of a baffled tank, as the effect's
BENDING_DAMPING = constant(0.03)  # of light alloy, as the effect's
MOST_MODES = 3  # of slosh, and of bending: more than a launcher's controller is designed for


@dataclass(frozen=True)
class Slosh:
    """One [[slosh]]: psi'' + 2 z w psi' + w^2 psi = -theta_ddot; theta_ddot += coupling w^2 psi."""

    frequency: InTime                 # w, rad/s
    coupling: InTime
    damping_ratio: InTime = SLOSH_DAMPING   # z
    frequency_sigma: float = 0.0      # one sigma of what is not known, as a share of the number; 0: known
    coupling_sigma: float = 0.0
    damping_ratio_sigma: float = 0.0


@dataclass(frozen=True)
class Bending:
    """One [[bending]]: eta'' + 2 z w eta' + w^2 eta = w^2 beta; theta measured += gain eta, theta_dot += gyro_gain
    eta'."""

    frequency: InTime                 # w, rad/s
    gain: InTime                      # rad/rad, at the attitude sensor
    damping_ratio: InTime = BENDING_DAMPING   # z
    gyro_gain: InTime | None = None   # rad/rad, at the gyro; None: `gain`
    frequency_sigma: float = 0.0      # one sigma of what is not known, as a share of the number; 0: known
    gain_sigma: float = 0.0           # of both gains, which are off together
    damping_ratio_sigma: float = 0.0


SERVO = ("natural_frequency", "damping_ratio", "delay")  # of what [actuator] may give a sigma
DRIFT_RATES = ("a6_drift", "k1_drift")  # what [uncertainty] may say of how fast a6 and k1 leave the profile


@dataclass(frozen=True)
class Actuator:
    """[actuator]: beta_ddot = w^2 (u - beta) - 2 zeta w beta_dot, or, with a time constant T, beta_dot = (u - beta)/T;
    u is the delayed command plus noise."""

    natural_frequency: float = math.nan  # w, rad/s
    damping_ratio: float = math.nan   # zeta
    command_noise_std: float = 0.0    # rad, one draw per controller period
    deflection_limit: float = math.inf  # rad, on the controller's output
    delay: float = 0.0                # s
    time_constant: float = 0.0        # T, s; 0: second order
    natural_frequency_sigma: float = 0.0  # relative, one sigma of what is not known of it before the flight; 0: known
    damping_ratio_sigma: float = 0.0  # the same
    delay_sigma: float = 0.0          # s, one sigma

    @property
    def is_known(self) -> bool:
        """Whether all of its numbers are known, so that none is estimated: every sigma is 0."""
        return self.natural_frequency_sigma == self.damping_ratio_sigma == self.delay_sigma == 0.0

    @property
    def is_first_order(self) -> bool:
        return self.time_constant > 0.0

    @property
    def frequency(self) -> float:
        """The servo's frequency [rad/s]: w, or 1/T."""
        return 1.0 / self.time_constant if self.is_first_order else self.natural_frequency

    @property
    def lag(self) -> float:
        """The time [s] by which the servo follows a slow command late, without its delay."""
        return self.time_constant if self.is_first_order else 2.0 * self.damping_ratio / self.natural_frequency


@dataclass(frozen=True)
class Follow:
    """What the centre of a notch follows: a mode's frequency as the estimator on board tracks it, at most the share
    `reach` from `frequency`, the declared one; that itself while no estimate is valid."""

    mode: str                         # slosh1 .. or bending1 ..
    frequency: float                  # rad/s
    depth_damping: float
    width_damping: float
    reach: float

    def centre(self, tracked: float) -> float:
        """Return the centre [rad/s] for a tracked frequency [rad/s], NaN where it is not valid."""
        if not math.isfinite(tracked):
            return self.frequency
        return min(max(tracked, (1.0 - self.reach) * self.frequency), (1.0 + self.reach) * self.frequency)


@dataclass(frozen=True)
class Section:
    """Filter y_k = b0 x_k + b1 x_(k-1) + b2 x_(k-2) - a1 y_(k-1) - a2 y_(k-2), at the controller's period, from
    rest; one that follows a mode has these coefficients at the declared frequency."""

    b: tuple[float, float, float]
    a: tuple[float, float, float]     # a[0] is 1
    follow: Follow | None = None

    def tuned(self, frequency: float, period: float) -> "Section":
        """Return a filter that follows a mode with its centre at the tracked frequency [rad/s]; period [s]."""
        own = self.follow
        assert own is not None
        return replace(notch(period, own.centre(frequency), own.depth_damping, own.width_damping), follow=own)


def notch(period: float, frequency: float, depth_damping: float, width_damping: float) -> Section:
    """Return the section of (s^2 + 2 depth w s + w^2)/(s^2 + 2 width w s + w^2), w = frequency [rad/s], by `tustin`."""
    return tustin(period, frequency, (1.0, depth_damping, 1.0), (1.0, width_damping, 1.0))


def lowpass(period: float, frequency: float, damping_ratio: float) -> Section:
    """Return the section of w^2/(s^2 + 2 damping w s + w^2), w = frequency [rad/s], by `tustin`."""
    return tustin(period, frequency, (0.0, 0.0, 1.0), (1.0, damping_ratio, 1.0))


def tustin(period: float, frequency: float, numerator: tuple[float, float, float],
           denominator: tuple[float, float, float]) -> Section:
    """Return a filter as discrete section by Tustin's rule, prewarped at w = frequency [rad/s]: s = w/c (z - 1)/(z +
    1), c = tan(w period/2) (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., ch. 8.3).

    numerator, denominator  m, zeta, n of m s^2 + 2 zeta w s + n w^2
    """
    c = math.tan(0.5 * frequency * period)

    def quadratic(m: float, zeta: float, n: float) -> tuple[float, float, float]:
        """Return the coefficients of c^2/w^2 (m s^2 + 2 zeta w s + n w^2) (z + 1)^2, powers of z falling."""
        return m + 2.0 * zeta * c + n * c * c, 2.0 * (n * c * c - m), m - 2.0 * zeta * c + n * c * c

    a0, a1, a2 = quadratic(*denominator)
    b0, b1, b2 = quadratic(*numerator)
    return Section((b0 / a0, b1 / a0, b2 / a0), (1.0, a1 / a0, a2 / a0))


LAWS = ("attitude", "rate", "gyro")  # of a controller, numbered so in a flight's record


@dataclass(frozen=True)
class Controller:
    """[controller].  Law `attitude`: command = kp e + kd d, d = (tau d + e - e_previous)/(tau + period), e =
    theta_measured - theta_ref.

    Law `rate`: command = kp e + ki integral(e), e = theta_dot_measured - rate_ref; the integral is the sum of period e
    with the current sample, from 0; a sample whose command (filters and test input in it) is beyond the limit is not
    kept in it.

    Law `gyro`: command = kp (theta_measured - theta_ref) + kd (theta_dot_measured - rate_ref).

    Filters follow the law, in order.
    """

    kp: float                         # of `rate`: s
    kd: float                         # s; 0 of `rate`
    derivative_time_constant: float   # s; 0 of `rate` and `gyro`
    period: float                     # s
    law: str = "attitude"             # or one of LAWS
    ki: float = 0.0                   # of `rate` alone, no unit
    filters: tuple[Section, ...] = ()

    @property
    def is_rate_law(self) -> bool:
        return self.law == "rate"

    @property
    def reads(self) -> tuple[tuple[str, str], ...]:
        """What the law reads: the measured column and its reference, of each error."""
        attitude, rate = ("theta", "theta_ref"), ("theta_dot", "rate_ref")
        return {"attitude": (attitude,), "rate": (rate,), "gyro": (attitude, rate)}[self.law]

    @property
    def followed(self) -> tuple[str, ...]:
        """The modes that filters follow."""
        return tuple(dict.fromkeys(each.follow.mode for each in self.filters if each.follow is not None))

    def following(self, tracked: Mapping[str, float]) -> "Controller":
        """Return the controller with its filters at the tracked frequencies [rad/s] of modes; NaN or missing: not
        valid."""
        if not self.followed:
            return self
        return replace(self, filters=tuple(
            each if each.follow is None else each.tuned(tracked.get(each.follow.mode, math.nan), self.period)
            for each in self.filters))


@dataclass(frozen=True)
class Guidance:
    """[guidance]: attitude [rad] and rate [rad/s] references at nodes t [s], linear between, held beyond the ends."""

    t: tuple[float, ...]              # s, increasing
    theta_ref: tuple[float, ...]      # rad
    rate_ref: tuple[float, ...] = ()  # rad/s; (): the slope of theta_ref

    def attitude_at(self, t: np.ndarray) -> np.ndarray:
        """Return the attitude reference [rad] at times t [s]."""
        return np.interp(t, self.t, self.theta_ref)

    def rate_at(self, t: np.ndarray) -> np.ndarray:
        """Return the rate reference [rad/s] at times t [s]; if not given, theta_ref's slope after t, 0 outside."""
        if self.rate_ref:
            return np.interp(t, self.t, self.rate_ref)
        slopes = np.concatenate([[0.0], np.diff(self.theta_ref) / np.diff(self.t), [0.0]])
        return slopes[np.searchsorted(self.t, t, side="right")]


@dataclass(frozen=True)
class Multisine:
    """[test_input]: sum of amplitude sin(frequency (t - start) + phase) while start <= t < start + duration,
    added to the controller's output before the deflection limit."""

    start: float                      # s
    duration: float                   # s
    frequency: tuple[float, ...]      # rad/s
    amplitude: tuple[float, ...]      # rad
    phase: tuple[float, ...]          # rad

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return the test input [rad] at times t (n,) [s]; outside its duration -0.0, which changes no bit of a sum."""
        angle = np.zeros(len(t))
        for frequency, amplitude, phase in zip(self.frequency, self.amplitude, self.phase, strict=True):
            angle += amplitude * np.sin(frequency * (t - self.start) + phase)
        return np.where((self.start <= t) & (t < self.start + self.duration), angle, -0.0)


@dataclass(frozen=True)
class Sensors:
    """[sensors]: one sigma of white noise, drawn per sample, and quantisation step (0: none) of each; period [s]."""

    period: float                     # s
    theta_std: float                  # rad
    theta_dot_std: float              # rad/s
    beta_std: float                   # rad
    theta_step: float = 0.0           # rad
    theta_dot_step: float = 0.0       # rad/s
    beta_step: float = 0.0            # rad
    gamma_std: float = 0.0            # rad, of a flight-path angle in the log
    alpha_std: float = 0.0            # rad, of an angle of attack in the log
    alpha_source: str = "inertial"    # it does not see the wind; "air": it does


@dataclass(frozen=True)
class Simulation:
    """[simulation]: duration [s], step [s] of integration, one sigma of unmodelled acceleration [rad/s^2]."""

    duration: float                   # s
    step: float = 0.001               # s, Runge-Kutta 4
    acceleration_noise_std: float = 0.0  # rad/s^2, one draw per controller period


@dataclass(frozen=True)
class Diagnosis:
    """[diagnosis]: errors (one sigma) of a6, k1, times and command that a model may have without being called wrong,
    and limits on the search's work."""

    tolerance: float = 0.02           # of a6 and k1, relative
    timing: float = 0.001             # s, of servo and transport times
    command: float = 1e-4             # rad, rms to which the command need be reproduced
    effort: float = 1.0               # of the work that a search may do, over the ordinary
    time_limit: float = 600.0         # s, an emergency brake: what it stops has no answer
    begins: str = ANYWHERE            # or AT_REST: a log from t = 0 on begins at attitude 0, standing still


@dataclass(frozen=True)
class Required:
    """[margins]: the margins that the loop must keep; one of 0 is not required."""

    gain_db: float = 6.0              # by which the gain may fall, and rise
    phase_deg: float = 30.0
    delay_ms: float = 0.0

    @property
    def words(self) -> str:
        """What is required, in words."""
        said = ((self.gain_db, "dB"), (self.phase_deg, "degrees"), (self.delay_ms, "ms"))
        return ", ".join(f"{value:g} {unit}" for value, unit in said if value > 0.0) or "nothing"


@dataclass(frozen=True, eq=False)
class Nominal(Result):
    """One nominal file.  Sections a command does not need may be absent (None); `require` asks for them.

    theta_ddot = a6 alpha + k1 (beta + m) + sum coefficient*term, alpha = theta - gamma + w: without [drift] gamma is 0,
    without [wind] and effects w, without [offsets] and effects m.  Of a plant given by [vehicle.terms] `vehicle` holds
    the coefficients of `theta` and `beta`, constant, and `terms` all others, by their names in the library.
    """

    name: str
    vehicle: Profile
    sensors: Sensors
    uncertainty: Profile | None = None   # sigma of a6 and k1 over time
    a6_drift: float | None = None        # 1/min, one sigma of how fast a6 leaves the profile; None: not given
    k1_drift: float | None = None        # 1/min, the same of k1
    actuator: Actuator | None = None
    controller: Controller | None = None
    guidance: Guidance | None = None
    simulation: Simulation | None = None
    diagnosis: Diagnosis = field(default_factory=Diagnosis)
    margins: Required = field(default_factory=Required)
    test_input: Multisine | None = None
    drift: Drift | None = None
    wind: Wind | None = None
    offsets: Offsets | None = None
    slosh: tuple[Slosh, ...] = ()
    bending: tuple[Bending, ...] = ()
    effects: tuple["Effect", ...] = ()
    terms: tuple[tuple[str, float], ...] = ()  # (library term, coefficient)
    path: str = ""

    def nodes(self) -> np.ndarray:
        """Return the times (n,) [s] at which a6, k1 or their range are given."""
        return self.vehicle.t if self.uncertainty is None else np.union1d(self.vehicle.t, self.uncertainty.t)

    def drift_rates(self) -> tuple[float, float]:
        """Return one sigma of how fast a6 and k1 leave the profile, shares a minute.

        Where [uncertainty] gives none, each may leave the profile by its whole range within the flight; without a
        range neither drifts.
        """
        given = (self.a6_drift, self.k1_drift)
        if self.uncertainty is None or self.simulation is None:
            whole = (0.0, 0.0)
        else:
            minutes = self.simulation.duration / 60.0
            whole = (float(np.max(self.uncertainty.a6)) / minutes, float(np.max(self.uncertainty.k1)) / minutes)
        a6, k1 = (default if rate is None else rate for rate, default in zip(given, whole, strict=True))
        return a6, k1

    def table(self) -> "Columns":
        t = self.nodes()
        a6, k1 = self.vehicle.at(t)
        given = {"t": t, "a6": a6, "k1": k1}
        if self.uncertainty is not None:
            given |= dict(zip(("sigma_a6", "sigma_k1"), self.uncertainty.at(t), strict=True))
        return {name: x.tolist() for name, x in given.items()}

    def summary(self) -> str:
        """Return the nominal in words: parameters with their ranges over time, sensors, and the other sections."""
        def span(x: np.ndarray) -> str:
            return f"{x[0]:.4g}" if np.ptp(x) == 0.0 else f"{np.min(x):.4g} .. {np.max(x):.4g}"

        head = f"{self.name or 'nominal'}: a6 {span(self.vehicle.a6)}, k1 {span(self.vehicle.k1)} 1/s^2"
        if len(self.vehicle.t) > 1:
            head += f", over {self.vehicle.t[0]:g} .. {self.vehicle.t[-1]:g} s"
        if self.uncertainty is not None:
            head += f"; range sigma {span(self.uncertainty.a6)}, {span(self.uncertainty.k1)}"
        s = self.sensors
        lines = [head, f"sensors: every {s.period:g} s; one sigma of theta {s.theta_std:g} rad, theta_dot "
                       f"{s.theta_dot_std:g} rad/s, beta {s.beta_std:g} rad"]
        lines += ["terms: " + ", ".join(f"{x:g} {name}" for name, x in self.terms)] if self.terms else []
        there = [name for name in ("actuator", "controller", "guidance", "simulation", "test_input", "drift", "wind",
                                   "offsets") if getattr(self, name) is not None]
        lines += [f"sections: {', '.join(there)}"] if there else []
        modes = ["slosh"] * len(self.slosh) + ["bending"] * len(self.bending)
        lines += [f"modes: {', '.join(modes)}"] if modes else []
        lines += [f"effects: {', '.join(each.name for each in self.effects)}"] if self.effects else []
        return "\n".join(lines)

    def _figure(self) -> "Figure":
        from .pictures import range_figure
        return range_figure(self)

    def require(self, *sections: str) -> None:
        """Raise InputError naming the first of these sections that the file lacks."""
        for section in sections:
            if getattr(self, section) is None:
                raise InputError(f"{self.path}: section [{section}] is missing; this command needs it")

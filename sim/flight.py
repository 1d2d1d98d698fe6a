"""Fly a nominal: the whole flight at once, or one `Sample` at a time for a host loop.

Two sensor suites: `ideal`, the paper's (true theta, theta_dot, beta, theta_ddot
at the integration step, no unmodelled acceleration; navigation noise on the
controller's attitude and command noise stay in the loop), and `flight` (the
nominal's noises at `sensors.period`, unmodelled accelerations, no theta_ddot).
Effects on a sensor (bias, scale, delay) show in both.

Noise: one independent stream a source, one draw per integration step or
controller period, so a flight's noise does not depend on the rate of its log, nor
on wind and offsets (`sim.disturbance_draws`), which have other streams.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import starmap

import numpy as np

from launchid_core import Sample

from .disturbance_draws import drawn_offsets, drawn_wind, offset_effects
from .effects import Effect
from .errors import InputError, UsageError
from .nominal import Nominal
from .plant import CLOCK_DIGITS, Factor, packed, parameters, tuning
from .sections import LAWS
from .vehicle.actuator import FIRST_ORDER_DAMPING
from .vehicle.record import CONTROLLER_TICK, LOG_ROW, SECTION, SENSOR_NOISE, Vehicle, assembled
from .vehicle.step import advance

SUITES = ("flight", "ideal")
MAX_STEPS = 2e7      # of one flight: 1 GB of noise draws
LOST_ANGLE = 0.5  # rad: beyond it small angles fail and no deflection within its limit brings these vehicles back
LOST_ANGLE_TERMS = math.pi  # rad: a plant given by its terms holds at any angle, until it has turned over


_STREAMS = {"theta": 0, "theta_dot": 1, "beta": 2, "command": 3, "acceleration": 4, "gamma": 5}


@dataclass(frozen=True, eq=False)
class Flight:
    """A flown log.  Arrays of equal length, SI units; theta_ddot is NaN in the `flight` suite.

    a6, k1 [1/s^2], true_gamma [rad] and wind [rad] (all of it) are the truth at each row, offsets [unit of each] the
    constants that were drawn; `lost` tells that the vehicle left the small-angle range and the log ends there.
    gamma [rad] as navigation has it is NaN without [drift], rate_ref [rad/s] without a law that reads the rate.
    """

    t: np.ndarray
    theta_ref: np.ndarray
    beta_cmd: np.ndarray
    beta: np.ndarray
    theta: np.ndarray
    theta_dot: np.ndarray
    theta_ddot: np.ndarray
    a6: np.ndarray
    k1: np.ndarray
    period: float
    lost: bool
    gamma: np.ndarray
    true_gamma: np.ndarray
    wind: np.ndarray
    rate_ref: np.ndarray
    offsets: dict[str, float]

    def samples(self) -> Iterator[Sample]:
        """Yield the log's rows as the estimator's samples."""
        return starmap(Sample, self.rows().tolist())

    def rows(self) -> np.ndarray:
        """Return an array (n, 7) for `Estimator.replay`: t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma."""
        return np.column_stack([self.t, self.theta, self.theta_dot, self.beta, self.theta_ddot, self.beta_cmd,
                                self.gamma])


def is_whole(value: float, unit: float) -> bool:
    """Whether value/unit is an integer >= 1, to 1e-6."""
    ratio = value / unit
    return math.isfinite(ratio) and round(ratio) >= 1 and abs(ratio - round(ratio)) <= 1e-6


def whole(value: float, unit: float, name: str) -> int:
    """Return value/unit [s/s] as an integer >= 1; UsageError, which calls the value `name`, if it is none."""
    if not is_whole(value, unit):
        raise UsageError(f"{name} {value!r}: expected a whole number of simulation steps ({unit} s)")
    return round(value / unit)


def noise(seed: int, stream: str, std: float, count: int) -> np.ndarray:
    """Return `count` normal draws of standard deviation `std` from a source's stream: the seed alone decides them."""
    if std == 0.0:
        return np.zeros(count)
    return std * np.random.default_rng((_STREAMS[stream], seed)).standard_normal(count)


def excitation(nominal: Nominal, ticks: int, period: float) -> np.ndarray:
    """Return the test input (ticks,) [rad] of each controller period of `period` [s]; -0.0 where there is none."""
    t = np.round(np.arange(ticks) * period, CLOCK_DIGITS)
    return np.full(ticks, -0.0) if nominal.test_input is None else nominal.test_input.at(t)


def prepare(nominal: Nominal, seed: int, suite: str, period: float | None, a6_factor: Factor,
            k1_factor: Factor, effects: Iterable[Effect] = ()) -> tuple[Vehicle, int]:
    """Return a vehicle ready to fly from t = 0, and its number of steps; arguments as `fly_whole`."""
    nominal.require("actuator", "controller", "guidance", "simulation")
    if suite not in SUITES:
        raise UsageError(f"suite {suite!r}: expected one of {', '.join(SUITES)}")
    simulation, controller, actuator = nominal.simulation, nominal.controller, nominal.actuator
    assert simulation is not None and controller is not None and actuator is not None and nominal.guidance is not None
    h = simulation.step
    spacing = h if suite == "ideal" else nominal.sensors.period
    log_every = whole(spacing if period is None else period, h, "period")
    if simulation.duration / h > MAX_STEPS:
        raise InputError(f"{nominal.path}: simulation.duration = {simulation.duration!r}: expected at most "
                         f"{MAX_STEPS:g} steps of {h:g} s")
    control_every = whole(controller.period, h, "controller.period")
    steps = math.ceil(simulation.duration / h - 1e-9)
    ticks = -(-steps // control_every)

    offsets = drawn_offsets(nominal.offsets, seed)
    effects = (*effects, *offset_effects(offsets))
    changes = packed(nominal, effects)
    sensors, guidance = nominal.sensors, nominal.guidance

    ticking = np.arange(ticks) * controller.period
    tick = np.zeros(ticks, CONTROLLER_TICK)
    tick["reference"] = guidance.attitude_at(ticking)
    tick["rate_reference"] = guidance.rate_at(np.round(ticking, CLOCK_DIGITS))
    tick["excitation"] = excitation(nominal, ticks, controller.period)
    tick["noise"] = noise(seed, "command", actuator.command_noise_std, ticks)
    unmodelled = 0.0 if suite == "ideal" else simulation.acceleration_noise_std
    tick["acceleration"] = noise(seed, "acceleration", unmodelled, ticks) + offsets.get("moment", -0.0)

    noises = np.empty(steps, SENSOR_NOISE)
    for name in ("theta", "theta_dot", "beta"):
        noises[name] = noise(seed, name, getattr(sensors, f"{name}_std"), steps)

    half_steps = np.arange(2 * steps + 1) * (0.5 * h)
    a6, k1 = parameters(nominal, half_steps, a6_factor, k1_factor, effects)
    vehicle = assembled({**constants(nominal), "control_every": control_every, "log_every": log_every}, changes, tick,
                        noises, a6, k1, np.zeros(ticks), sections(nominal),
                        wind=drawn_wind(nominal.wind, seed, steps, h, changes),
                        drift=None if nominal.drift is None else np.stack(nominal.drift.at(half_steps)),
                        tuning=tuning(nominal, len(changes.modes), steps, h))
    return vehicle, steps


def constants(nominal: Nominal) -> dict[str, float]:
    """Return the constants of a nominal that can fly, FLIGHT's field name -> value in SI units."""
    actuator, controller, sensors = nominal.actuator, nominal.controller, nominal.sensors
    simulation = nominal.simulation
    assert actuator is not None and controller is not None and simulation is not None
    frequency, damping = (1.0 / actuator.time_constant, FIRST_ORDER_DAMPING) if actuator.is_first_order else \
        (actuator.natural_frequency, actuator.damping_ratio)
    return {"step": simulation.step, "period": controller.period, "frequency": frequency, "damping": damping,
            "first_order": actuator.is_first_order, "delay": actuator.delay, "limit": actuator.deflection_limit,
            "law": LAWS.index(controller.law), "kp": controller.kp, "kd": controller.kd, "ki": controller.ki,
            "time_constant": controller.derivative_time_constant, "theta_step": sensors.theta_step,
            "theta_dot_step": sensors.theta_dot_step, "beta_step": sensors.beta_step,
            "lost_angle": LOST_ANGLE_TERMS if nominal.terms else LOST_ANGLE}


def steering(nominal: Nominal, vehicle: Vehicle,
             believed: Nominal | None = None) -> Callable[[Vehicle, int, np.ndarray], None]:
    """Return what flies a vehicle on: `advance`, or, where filters follow what is tracked, the same with the estimator
    of the nominal, or of what is believed, in the loop."""
    if nominal.controller is None or not nominal.controller.followed:
        return advance
    from .following import Following
    return Following(believed or nominal, vehicle)


def _reads_rate(nominal: Nominal) -> bool:
    assert nominal.controller is not None
    return any(name == "theta_dot" for name, _ in nominal.controller.reads)


def sections(nominal: Nominal) -> np.ndarray:
    """Return the controller's filters as an array (n,) of SECTION, at rest."""
    assert nominal.controller is not None
    return np.array([(*section.b, *section.a[1:], 0.0, 0.0) for section in nominal.controller.filters], SECTION)


def measured_gamma(nominal: Nominal, seed: int, suite: str, steps: int) -> np.ndarray:
    """Return navigation's error (steps,) [rad] of the flight-path angle at every step; NaN without [drift]."""
    if nominal.drift is None:
        return np.full(steps, math.nan)
    return noise(seed, "gamma", 0.0 if suite == "ideal" else nominal.sensors.gamma_std, steps)


def _columns(suite: str) -> dict[str, str]:
    """Return column -> its name in a LOG_ROW: exact for `ideal`, noisy for `flight`."""
    return {name: f"exact_{name}" if suite == "ideal" else name for name in ("theta", "theta_dot", "beta")}


def fly_whole(nominal: Nominal, seed: int = 0, suite: str = "flight", period: float | None = None,
              a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, effects: Iterable[Effect] = (),
              believed: Nominal | None = None) -> Flight:
    """Fly to the end and return the log.

    nominal    what is flown; needs [actuator], [controller], [guidance], [simulation]
    seed       >= 0, of all noise
    suite      `flight` or `ideal`
    period     [s] of the log; None: the suite's
    a6_factor, k1_factor  the true parameters over the nominal's: a number or a function of time
    effects    flown beside the nominal's own, see `sim.effects`
    believed   the nominal of the estimator that filters follow, if it is not the one that flies
    """
    vehicle, steps = prepare(nominal, seed, suite, period, a6_factor, k1_factor, effects)
    state = vehicle.flight[0]
    every = int(state.log_every)
    rows = np.empty(-(-steps // every), LOG_ROW)
    steering(nominal, vehicle, believed)(vehicle, steps, rows)
    n = int(state.rows)
    log = {name: rows[name][:n].copy() for name in LOG_ROW.names or ()}
    chosen = {name: log[column] for name, column in _columns(suite).items()}
    ddot = log["true_theta_ddot"] if suite == "ideal" else np.full(n, np.nan)
    at = every * np.arange(n)
    tick = vehicle.ticks[at // int(state.control_every)]
    return Flight(t=np.round(log["t"], CLOCK_DIGITS), theta_ref=log["theta_ref"], beta_cmd=log["beta_cmd"],
                  theta_ddot=ddot, a6=vehicle.a6[2 * at], k1=vehicle.k1[2 * at],
                  period=every * float(state.step), lost=bool(state.lost),
                  gamma=log["true_gamma"] + measured_gamma(nominal, seed, suite, steps)[at],
                  true_gamma=log["true_gamma"], wind=log["wind"],
                  rate_ref=tick["rate_reference"].copy() if _reads_rate(nominal) else np.full(n, np.nan),
                  offsets=drawn_offsets(nominal.offsets, seed), **chosen)


def fly(nominal: Nominal, seed: int = 0, suite: str = "flight", period: float | None = None,
        a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, effects: Iterable[Effect] = ()) -> Iterator[Sample]:
    """Fly as `fly_whole`, but yield one Sample at a time: a step is computed when its sample is asked for."""
    vehicle, steps = prepare(nominal, seed, suite, period, a6_factor, k1_factor, effects)
    state = vehicle.flight[0]
    every = int(state.log_every)
    column = _columns(suite)
    gamma = measured_gamma(nominal, seed, suite, steps)
    rows, fly_on = np.empty(1, LOG_ROW), steering(nominal, vehicle)
    for start in range(0, steps, every):
        state.rows = 0
        fly_on(vehicle, min(every, steps - start), rows)
        if state.rows == 0:
            return
        row = dict(zip(LOG_ROW.names or (), rows[0].tolist(), strict=True))
        yield Sample(round(row["t"], CLOCK_DIGITS), row[column["theta"]], row[column["theta_dot"]],
                     row[column["beta"]], row["true_theta_ddot"] if suite == "ideal" else math.nan, row["beta_cmd"],
                     row["true_gamma"] + float(gamma[start]))
        if state.lost:
            return

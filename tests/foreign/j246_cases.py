"""The faults hidden in flights of JSBSim's J246, and the nominal that each is to be judged against.

The nominal's numbers are the vehicle's own along the reference flight: loads, masses, places and thrusts that JSBSim
reports (`j246.vehicle_parameters`), its servo's lag, and half a step of delay, which its filter has.  None of them is
identified.  Seeds below JUDGING are for building, the others for judging: nothing is chosen on them.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from . import j246
from .j246 import Faults, Flight

JUDGING = 1000            # seeds from here on are for judging
DURATION = 40.0           # s, of a log
CALM_SPREAD = 900         # first of the seeds from which the declared level of turbulence is taken
SPREAD_SEEDS = 4
NODE = 1.0                # s, between the nominal's nodes
PLAIN_POLE = 600.0        # rad/s: second pole of a second-order servo that stands for the first-order one


@dataclass(frozen=True)
class Case:
    """One flight to come, and what a diagnosis should say of it.

    causes       right names, any of which counts; (): nothing is wrong
    look_alikes  names that are no error beside or instead: the log cannot tell them apart
    parameter, size  of the first cause, as the nominal must be changed (nan: not judged)
    k1_scale     of the nominal's k1 against the true one
    declared     severity of the turbulence that the nominal declares; 0: calm
    """

    faults: Faults
    causes: tuple[str, ...] = ()
    look_alikes: tuple[str, ...] = ()
    parameter: str = ""
    size: float = math.nan
    k1_scale: float = 1.0
    declared: int = 0


CONSTANTS = ("thrust_misalignment", "steady_wind", "attitude_bias", "nozzle_sensor_bias", "actuator_bias",
             "moment_step")


def calm(rng: np.random.Generator) -> Case:
    """Nothing is wrong."""
    return Case(Faults())


def windy(rng: np.random.Generator) -> Case:
    """JSBSim's turbulence, declared."""
    return Case(Faults(severity=4), declared=4)


def untrimmed(rng: np.random.Generator) -> Case:
    """Nothing is wrong but the reference's trim of 1e-4 rad, which nobody adds."""
    return Case(Faults(trim=False))


def weak_gimbal(rng: np.random.Generator) -> Case:
    """One nozzle of two moves by 45 to 70 % of its command; the sensor sees the other."""
    share = float(rng.uniform(0.45, 0.7))
    return Case(Faults(gimbal=share), ("control_effectiveness",), (), "scale", 0.5 * (1.0 + share))


def gimbal_fails(rng: np.random.Generator) -> Case:
    """The same, from some time on."""
    share, time = float(rng.uniform(0.2, 0.6)), round(float(rng.uniform(12.0, 28.0)), 2)
    return Case(Faults(gimbal=share, gimbal_time=time), ("control_loss",), ("control_effectiveness",), "fraction",
                0.5 * (1.0 - share))


def k1_wrong(rng: np.random.Generator) -> Case:
    """The nominal's k1 is 15 to 30 % too large or too small."""
    scale = float(rng.uniform(1.15, 1.3)) ** float(rng.choice([-1.0, 1.0]))
    return Case(Faults(), ("control_effectiveness",), (), "scale", 1.0 / scale, k1_scale=scale)


def gust(rng: np.random.Generator) -> Case:
    """A 1 - cos gust of 12 to 20 m/s; its size is the largest wind angle, read from the flight."""
    speed = float(rng.uniform(12.0, 20.0)) * float(rng.choice([-1.0, 1.0]))
    time, duration = round(float(rng.uniform(6.0, 20.0)), 2), round(float(rng.uniform(2.0, 5.0)), 2)
    return Case(Faults(gust=speed, gust_time=time, gust_duration=duration), ("gust",), (), "angle")


def slow_servo(rng: np.random.Generator) -> Case:
    """The servo's lag is 12 to 25 rad/s instead of 60."""
    lag = float(rng.uniform(12.0, 25.0))
    return Case(Faults(lag=lag), ("actuator_bandwidth",), (), "scale", lag / 60.0)


def late_servo(rng: np.random.Generator) -> Case:
    """20 to 50 ms of transport delay before the servo."""
    delay = round(float(rng.uniform(0.02, 0.05)), 3)
    return Case(Faults(servo_delay=delay), ("actuator_delay",), (), "delay", delay)


def gyro_bias(rng: np.random.Generator) -> Case:
    """0.002 to 0.006 rad/s."""
    rate = float(rng.uniform(0.002, 0.006)) * float(rng.choice([-1.0, 1.0]))
    return Case(Faults(gyro_bias=rate), ("gyro_bias",), (), "rate", rate)


def late_gyro(rng: np.random.Generator) -> Case:
    """30 to 60 ms."""
    delay = round(float(rng.uniform(0.03, 0.06)), 3)
    return Case(Faults(gyro_delay=delay), ("gyro_delay",), (), "delay", delay)


def attitude_bias(rng: np.random.Generator) -> Case:
    """0.01 to 0.02 rad; a6 is small, and a constant moment of any kind looks alike."""
    angle = float(rng.uniform(0.01, 0.02)) * float(rng.choice([-1.0, 1.0]))
    return Case(Faults(attitude_bias=angle), ("attitude_bias",), CONSTANTS, "angle", angle)


def engine_out(rng: np.random.Generator) -> Case:
    """A core engine stops: a moment, read from the flight, and a fifth of the thrust less."""
    return Case(Faults(engine_out=round(float(rng.uniform(10.0, 28.0)), 2)), ("moment_step",), (), "acceleration")


def turbulence(rng: np.random.Generator) -> Case:
    """JSBSim's turbulence of high severity, not declared."""
    return Case(Faults(severity=6), ("turbulence", "wind_walk"), (), "level")


def servo_bias(rng: np.random.Generator) -> Case:
    """The model's own: 0.0017 rad, in the nozzle, and seen by its sensor."""
    return Case(Faults(servo_bias=True), ("actuator_bias",), (), "angle", 0.0017)


def servo_hysteresis(rng: np.random.Generator) -> Case:
    """The model's own: a width of 0.0017 rad."""
    return Case(Faults(servo_hysteresis=True), ("actuator_backlash",), (), "half_width", 0.00085)


def servo_rate(rng: np.random.Generator) -> Case:
    """The model's own: 0.085 rad/s."""
    return Case(Faults(servo_rate=True), ("actuator_rate_limit",), (), "rate", 0.085)


def servo_own(rng: np.random.Generator) -> Case:
    """All three."""
    return Case(Faults(servo_bias=True, servo_hysteresis=True, servo_rate=True),
                ("actuator_rate_limit", "actuator_bias", "actuator_backlash"), (), "")


CASES: dict[str, Callable[[np.random.Generator], Case]] = {
    made.__name__: made for made in (
        calm, windy, untrimmed, weak_gimbal, gimbal_fails, k1_wrong, gust, slow_servo, late_servo, gyro_bias, late_gyro,
        attitude_bias, engine_out, turbulence, servo_bias, servo_hysteresis, servo_rate, servo_own)}
SIX = ("weak_gimbal", "k1_wrong", "gust", "slow_servo", "gyro_bias", "engine_out")  # kinds that were asked for first


def case(name: str, seed: int) -> Case:
    """A case by name, its sizes and times by seed."""
    return CASES[name](np.random.default_rng([seed, 2, list(CASES).index(name)]))


def flown(name: str, seed: int, duration: float = DURATION) -> tuple[Case, Flight]:
    """The case, with the sizes that only the flight tells, and its flight."""
    of = case(name, seed)
    flight = j246.fly(of.faults, seed, duration)
    if name == "gust":
        wind = flight.truth["wind"]
        of = replace(of, size=float(wind[np.argmax(np.abs(wind))]))
    if name == "turbulence":
        of = replace(of, size=float(np.std(flight.truth["wind"])))
    if name == "engine_out":
        of = replace(of, size=float(np.mean(unexplained(flight)[flight.columns["t"] > of.faults.engine_out + 1.0])))
    return of, flight


def unexplained(flight: Flight) -> np.ndarray:
    """theta_ddot [rad/s^2] by row that a6 alpha + k1 beta of the reference do not predict."""
    true, ref = flight.truth, j246.reference()
    rows = len(true["theta"])
    return true["theta_ddot"] - ref["a6"][:rows] * (true["theta"] - true["gamma"]) - ref["k1"][:rows] * true["beta"]


@functools.cache
def climate(severity: int) -> tuple[float, float]:
    """(level [rad], correlation time [s]) of JSBSim's turbulence on the angle of attack, from flights of their own."""
    winds = [j246.fly(Faults(severity=severity), CALM_SPREAD + k, DURATION).truth["wind"] for k in range(SPREAD_SEEDS)]
    lag = round(0.5 / j246.PERIOD)
    shared = float(np.mean([np.mean(w[:-lag] * w[lag:]) for w in winds]) / np.mean([np.mean(w * w) for w in winds]))
    return float(np.sqrt(np.mean([np.mean(w * w) for w in winds]))), 0.5 / -math.log(shared)


# ---- files


def write_log(path: Path, flight: Flight, navigated: bool = False) -> None:
    """The log's CSV; `navigated`: with the column gamma."""
    columns = flight.columns | ({"gamma": flight.gamma} if navigated else {})
    names = list(columns)
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    path.write_text(",".join(names) + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows), encoding="utf-8")


def servo_lines(pole: float) -> str:
    """A servo of second order with this second pole [rad/s], as late as the vehicle's of first order at 60 rad/s."""
    slow = 1.0 / (1.0 / 60.0 - 1.0 / pole)
    frequency = math.sqrt(slow * pole)
    return f"natural_frequency = {frequency!r}\ndamping_ratio = {0.5 * (slow + pole) / frequency!r}"


def write_nominal(path: Path, of: Case, seed: int, plain: bool = False, duration: float = DURATION,
                  pole: float | None = None) -> None:
    """Write the nominal: a TOML file, and beside it the profiles NAME.vehicle.csv and NAME.drift.csv.

    plain  without [drift] and [wind], and with a second-order servo without delay: for commands that know no others
    pole   [rad/s] with a second-order servo that has this second pole
    """
    ref = j246.reference()
    at = np.arange(0, round(duration / j246.PERIOD) + 1, round(NODE / j246.PERIOD))
    t = at * j246.PERIOD
    _write_profile(path, "vehicle", "t,a6,k1", (t, ref["a6"][at], of.k1_scale * ref["k1"][at]))
    nodes_t, nodes = j246.guidance(seed)
    noise = j246.NOISE
    servo = servo_lines(PLAIN_POLE) if plain else \
        f"{f'time_constant = {1.0 / 60.0!r}' if pole is None else servo_lines(pole)}\ndelay = {0.5 * j246.STEP!r}"
    world = ""
    if not plain:
        _write_profile(path, "drift", "t,z_alpha,z_beta", (t, ref["z_alpha"][at], ref["z_beta"][at]))
        world = f'[drift]\nprofile = "{path.stem}.drift.csv"\n'
        if of.declared:
            level, time = climate(of.declared)
            world += f"\n[wind]\nturbulence = {level!r}\nturbulence_time = {time!r}\ninitial = 0.0\n"
    path.write_text(f"""# JSBSim's J246 along its gravity turn: numbers from its loads, masses and thrusts. SI units.
name = "{path.stem}"

[vehicle]
profile = "{path.stem}.vehicle.csv"

{world}
[actuator]
{servo}
command_noise_std = {noise["command"]!r}
deflection_limit = {j246.LIMIT!r}

[controller]
kp = {j246.KP!r}
kd = {j246.KD!r}
derivative_time_constant = {j246.TAU!r}
period = {j246.PERIOD!r}

[guidance]
t = {list(nodes_t)!r}
theta_ref = {list(nodes)!r}

[sensors]
period = {j246.PERIOD!r}
theta_std = {noise["theta"]!r}
theta_dot_std = {noise["theta_dot"]!r}
beta_std = {noise["beta"]!r}
gamma_std = {j246.GAMMA_NOISE!r}

[simulation]
duration = {duration!r}
step = 0.001
acceleration_noise_std = {noise["moment"]!r}

[diagnosis]
tolerance = 0.02
""", encoding="utf-8")


def _write_profile(path: Path, section: str, header: str, columns: tuple[np.ndarray, ...]) -> None:
    rows = zip(*(column.tolist() for column in columns), strict=True)
    text = header + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
    path.with_name(f"{path.stem}.{section}.csv").write_text(text, encoding="utf-8")

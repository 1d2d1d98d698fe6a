"""The first nominal as a file, its standard deviations as comments, and as JSON."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..effects import Effect, effect
from ..files import write_text
from ..nominal import Actuator, Nominal, Profile, Sensors, Simulation, Wind, constant_profile, nominal_lines
from ..shown import known, saying_what_plus_minus_is, with_std
from .answer import First, Number

TOLD = 3.0             # standard deviations from 0: below, an offset is none
LONGEST_STEP = 0.001   # s, of the integration
FAST = 200.0           # rad/s: a servo in the place of one that no sensor sees; its lag is taken off the delay
FAST_DAMPING = 0.7
UNKNOWN_THETA = 0.01   # rad: of a sensor that the log has not, a guess
UNITS = {"moment": "rad/s^2", "gyro_bias": "rad/s", "theta": "rad", "theta_dot": "rad/s", "beta": "rad",
         "command": "rad", "acceleration": "rad/s^2", "walk": "rad/sqrt(s)", "turbulence": "rad",
         "turbulence_time": "s", "moment_walk": "rad/s^2/sqrt(s)", "moment_turbulence": "rad/s^2"}
TERM_UNITS = {"theta_dot": "1/s", "sign(theta_dot)": "rad/s^2"}


def nominal_of(made: First, name: str) -> Nominal:
    """The nominal that a simulation should use."""
    made = as_known(made)
    vehicle, terms, effects = plant(made)
    step = made.period / math.ceil(made.period / LONGEST_STEP - 1e-9)
    return Nominal(
        name=name, vehicle=vehicle, terms=terms, effects=effects, actuator=actuator(made), sensors=sensors(made),
        simulation=Simulation(duration=made.duration, step=step,
                              acceleration_noise_std=made.noise["acceleration"][0]),
        wind=wind(made) if is_wind(made) else None)


def wind(made: First) -> Wind:
    """The section [wind] of the nominal."""
    walk, turbulence, time = (made.wind.get(name, (default, 0.0))[0]
                              for name, default in (("walk", 0.0), ("turbulence", 0.0), ("turbulence_time", 1.0)))
    return Wind(walk=walk, turbulence=turbulence, turbulence_time=time)


def as_known(made: First) -> First:
    """Every value that goes into the file or before a reader, to where its standard deviation makes it known."""
    def one(number: Number) -> Number:
        return known(*number), number[1]

    def each(numbers: dict[str, Number]) -> dict[str, Number]:
        return {name: one(number) for name, number in numbers.items()}

    def along(values: np.ndarray, stds: np.ndarray) -> np.ndarray:
        return np.array([known(*number) for number in zip(values.tolist(), stds.tolist(), strict=True)])

    return replace(made, a6=along(made.a6, made.a6_std), k1=along(made.k1, made.k1_std),
                   delay=None if made.delay is None else one(made.delay),
                   servo=None if made.servo is None else (one(made.servo[0]), one(made.servo[1])),
                   terms=each(made.terms), noise=each(made.noise), wind=each(made.wind), offsets=each(made.offsets))


def is_wind(made: First) -> bool:
    """The slow moments are wind: a6 is known, and they are not only accelerations."""
    return bool(made.wind) and not any(name.startswith("moment") for name in made.wind)


def told(made: First, name: str) -> bool:
    """An offset that is not 0."""
    value, std = made.offsets.get(name, (0.0, 1.0))
    return abs(value) > TOLD * std


def plant(made: First) -> tuple[Profile, tuple[tuple[str, float], ...], tuple[Effect, ...]]:
    """[vehicle] and [[effects]]: two numbers or a profile, offsets as effects; a test stand by its terms."""
    effects = [effect("gyro_bias", rate=made.offsets["gyro_bias"][0])] if told(made, "gyro_bias") else []
    if made.sine or (made.terms and len(made.t) == 1):
        gravity = "sin(theta)" if made.sine else "theta"
        terms = {gravity: float(made.a6.mean()), "beta": float(made.k1.mean())}
        terms |= {name: value for name, (value, _) in made.terms.items()}
        if told(made, "moment"):
            terms["1"] = made.offsets["moment"][0]
        vehicle = constant_profile(terms.pop("theta", 0.0), terms.pop("beta"))
        return vehicle, tuple(terms.items()), tuple(effects)
    if told(made, "moment"):
        k1 = float(made.k1.mean())
        angle = known(made.offsets["moment"][0] / k1, made.offsets["moment"][1] / abs(k1))
        effects.append(effect("thrust_misalignment", angle=angle))
    if "theta_dot" in made.terms:
        effects.append(effect("aero_damping", coefficient=-made.terms["theta_dot"][0]))
    if "sign(theta_dot)" in made.terms:
        effects.append(effect("friction", coefficient=-made.terms["sign(theta_dot)"][0]))
    if len(made.t) == 1:
        return constant_profile(float(made.a6[0]), float(made.k1[0])), (), tuple(effects)
    return Profile(made.t, made.a6, made.k1), (), tuple(effects)


def actuator(made: First) -> Actuator | None:
    """[actuator] where a command was logged; a nozzle that was measured is the input itself."""
    if made.delay_of == "beta" or made.delay is None:
        return None
    delay = max(made.delay[0], 0.0)
    if made.servo is None:
        return Actuator(FAST, FAST_DAMPING, delay=max(delay - 2.0 * FAST_DAMPING / FAST, 0.0))
    noise = made.noise.get("command", (0.0, 0.0))[0]
    return Actuator(made.servo[0][0], made.servo[1][0], command_noise_std=noise, delay=delay)


def sensors(made: First) -> Sensors:
    """[sensors]; of one that the log has not, what differencing or a guess would give."""
    theta = made.noise.get("theta", (UNKNOWN_THETA, 0.0))[0]
    rate = made.noise.get("theta_dot", (math.sqrt(2.0) * theta / made.period, 0.0))[0]
    return Sensors(period=made.period, theta_std=theta, theta_dot_std=rate,
                   beta_std=made.noise.get("beta", (0.0, 0.0))[0])


# ---- words


def shown(number: Number, unit: str = "") -> str:
    return f"+- {number[1]:.2g}" + (f" {unit}" if unit else "")


def comments(made: First) -> dict[tuple[str, str], str]:
    """(section, key) -> comment."""
    a6, k1 = (f"+- {std.mean():.2g}" for std in (made.a6_std, made.k1_std))
    said = {("vehicle", "a6"): f"{a6} 1/s^2", ("vehicle", "k1"): f"{k1} 1/s^2",
            ("vehicle", "profile"): f"a6 {a6}, k1 {k1} 1/s^2 in the mean; each in the JSON",
            ("vehicle.terms", '"theta"'): "" if made.sine else f"{a6} 1/s^2",
            ("vehicle.terms", '"sin(theta)"'): f"{a6} 1/s^2",
            ("vehicle.terms", '"beta"'): f"{k1} 1/s^2", ("sensors", "period"): "s, of the log",
            ("simulation", "duration"): "s, of the log"}
    said |= {("vehicle.terms", f'"{name}"'): shown(number, TERM_UNITS[name]) for name, number in made.terms.items()}
    for name, key in (("theta", "theta_std"), ("theta_dot", "theta_dot_std"), ("beta", "beta_std")):
        there = name in made.noise
        said["sensors", key] = shown(made.noise[name], UNITS[name]) if there else "not in the log, or not used: a guess"
    said["simulation", "acceleration_noise_std"] = shown(made.noise["acceleration"], "rad/s^2")
    if made.delay is not None:
        said["actuator", "delay"] = shown(made.delay, "s")
    if made.servo is not None:
        said["actuator", "natural_frequency"] = shown(made.servo[0], "rad/s")
        said["actuator", "damping_ratio"] = shown(made.servo[1])
    else:
        said["actuator", "natural_frequency"] = "no nozzle was measured: fast, its lag taken off the delay"
    if "command" in made.noise:
        said["actuator", "command_noise_std"] = shown(made.noise["command"], "rad")
    said |= {("wind", name): shown(number, UNITS[name]) for name, number in made.wind.items()}
    if "moment" in made.offsets:
        moment = made.offsets["moment"]
        said["effects", "angle"] = f"a moment of {with_std(*moment)} rad/s^2"
        said["vehicle.terms", '"1"'] = shown(made.offsets["moment"], "rad/s^2")
    if "gyro_bias" in made.offsets:
        said["effects", "rate"] = shown(made.offsets["gyro_bias"], "rad/s")
    return said


def commented(lines: list[str], made: First, source: str) -> Iterator[str]:
    """The lines of a nominal file with what is known of each number behind it."""
    yield f"# The first nominal out of {source} alone: one standard deviation behind each number. SI units."
    if made.delay is not None and made.delay_of == "beta":
        yield f"# The motion lags beta by {with_std(*made.delay)} s."
    for name in ("moment", "gyro_bias"):
        if name in made.offsets and not told(made, name):
            yield f"# {name}: {with_std(*made.offsets[name])} {UNITS[name]}, not significantly different from 0."
    for name, number in made.wind.items() if not is_wind(made) else ():
        yield f"# {name}: {with_std(*number)} {UNITS[name]} (a6 is too vague to call it wind)."
    for note in made.notes:
        yield f"# {note}"
    said, section = comments(made), ""
    for line in lines:
        if line.startswith("["):
            section = line.strip("[]")
        key = line.split(" = ")[0]
        words = said.get((section, key))
        yield f"{line}  # {words}" if words and " = " in line else line


def write(made: First, path: str | Path) -> None:
    """The nominal file."""
    path = Path(path)
    lines = nominal_lines(nominal_of(made, path.stem), path)
    write_text(path, (line + "\n" for line in commented(lines, made, Path(made.path).name)))


def lines(made: First, out: str) -> list[str]:
    """The lines for a terminal."""
    gravity = "sin(theta)" if made.sine else "theta"
    said = [f"{made.path}: {made.rows} rows, {made.period:g} s apart, {made.duration:.4g} s"]
    for t, *numbers in zip(made.t, made.a6, made.a6_std, made.k1, made.k1_std, strict=True):
        when = f"  at {t:.2f} s" if len(made.t) > 1 else ""
        said.append(f"a6 ({gravity}) {with_std(*numbers[:2])} 1/s^2, k1 {with_std(*numbers[2:])} 1/s^2{when}")
    said += [f"term {name} {with_std(*number)} {TERM_UNITS[name]}" for name, number in made.terms.items()]
    if made.delay is not None:
        after = "beta" if made.delay_of == "beta" else "the command"
        said.append(f"delay after {after} {with_std(*made.delay)} s")
    if made.servo is not None:
        said.append(f"servo {with_std(*made.servo[0])} rad/s, damping ratio {with_std(*made.servo[1])}")
    for words, each in (("offset", made.offsets), ("noise", made.noise), ("wind", made.wind)):
        said += [f"{words} {name} {with_std(*number)} {UNITS[name]}" for name, number in each.items()]
    return [*saying_what_plus_minus_is(said), *made.notes, f"{out}: written"]


def number_json(number: Number | None) -> dict[str, float] | None:
    return None if number is None else {"value": float(number[0]), "std": float(number[1])}


def report(made: First) -> dict[str, Any]:
    """The nominal JSON.  a6, k1: null where the log cannot tell them; `profile` where they vary."""
    constant = len(made.t) == 1
    no_k1 = any("k1" in reason or "neither" in reason or "input" in reason for reason in made.refused)
    no_a6 = any(reason.startswith("a6") or "neither" in reason for reason in made.refused)

    def whole(value: np.ndarray, std: np.ndarray) -> dict[str, float] | None:
        return number_json((float(value[0]), float(std[0]))) if constant else None
    profile = None
    if not constant and not made.refused:
        profile = [dict(zip(("t", "a6", "a6_std", "k1", "k1_std"), map(float, row), strict=True))
                   for row in zip(made.t, made.a6, made.a6_std, made.k1, made.k1_std, strict=True)]
    return {
        "log": made.path, "rows": made.rows, "period": made.period,
        "a6": None if no_a6 else whole(made.a6, made.a6_std), "k1": None if no_k1 else whole(made.k1, made.k1_std),
        "a6_term": "sin(theta)" if made.sine else "theta", "profile": profile,
        "terms": {name: number_json(number) for name, number in made.terms.items()},
        "delay": None if no_k1 else number_json(made.delay), "delay_of": made.delay_of,
        "actuator": None if made.servo is None else {"natural_frequency": number_json(made.servo[0]),
                                                     "damping_ratio": number_json(made.servo[1])},
        "offsets": {name: number_json(number) for name, number in made.offsets.items()},
        "noise": {name: number_json(number) for name, number in made.noise.items()},
        "wind": {name: number_json(number) for name, number in made.wind.items()},
        "fit": {"r2_held_out": made.r2}, "refused": list(made.refused), "notes": list(made.notes)}

"""Write the first nominal as a file with standard deviations as comments, as JSON, and as lines for a terminal."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.effects import Effect, effect
from sim.files import write_text
from sim.nominal import (
    Actuator,
    Controller,
    Nominal,
    Profile,
    Sensors,
    Simulation,
    Wind,
    constant_profile,
    nominal_lines,
)

from ..formatting import known, saying_what_plus_minus_is, with_std
from .answer import First, Number

DIGITS = 9             # of a number that has no deviation
TOLD = 3.0             # standard deviations from 0: below, an offset is none
INTEGRATION_STEP = 0.001  # s, of the integration
UNSEEN_SERVO_FREQUENCY = 200.0  # rad/s: a servo in the place of one that no sensor sees; its lag is taken off the delay
FAST_DAMPING = 0.7
UNKNOWN_THETA = 0.01   # rad: of a sensor that the log has not, a guess
UNIT_OF = {"moment": "rad/s^2", "gyro_bias": "rad/s", "theta": "rad", "theta_dot": "rad/s", "beta": "rad",
           "command": "rad", "acceleration": "rad/s^2", "walk": "rad/sqrt(s)", "turbulence": "rad",
           "turbulence_time": "s", "moment_walk": "rad/s^2/sqrt(s)", "moment_turbulence": "rad/s^2"}
TERM_UNITS = {"theta_dot": "1/s", "sign(theta_dot)": "rad/s^2"}


def nominal_of(numbers: First, name: str) -> Nominal:
    """Return the nominal to simulate with, values rounded to what their standard deviations make known."""
    numbers = as_known(numbers)
    vehicle, terms, effects = plant(numbers)
    step = numbers.period / math.ceil(numbers.period / INTEGRATION_STEP - 1e-9)
    return Nominal(
        name=name, vehicle=vehicle, terms=terms, effects=effects, actuator=actuator(numbers),
        controller=controller(numbers), sensors=sensors(numbers),
        simulation=Simulation(duration=float(f"{numbers.duration:.{DIGITS}g}"), step=step,
                              acceleration_noise_std=numbers.noise["acceleration"][0]),
        wind=wind(numbers) if is_wind(numbers) else None)


def wind(numbers: First) -> Wind:
    """Return the nominal's section [wind]; levels not found are 0."""
    walk, turbulence, time = (numbers.wind.get(name, (default, 0.0))[0]
                              for name, default in (("walk", 0.0), ("turbulence", 0.0), ("turbulence_time", 1.0)))
    return Wind(walk=walk, turbulence=turbulence, turbulence_time=time)


def as_known(first: First) -> First:
    """Return the nominal with every value rounded to the digits that its standard deviation makes known."""
    def one(number: Number) -> Number:
        return known(*number), number[1]

    def each(numbers: dict[str, Number]) -> dict[str, Number]:
        return {name: one(number) for name, number in numbers.items()}

    def along(values: np.ndarray, stds: np.ndarray) -> np.ndarray:
        return np.array([known(*number) for number in zip(values.tolist(), stds.tolist(), strict=True)])

    return replace(first, a6=along(first.a6, first.a6_std), k1=along(first.k1, first.k1_std),
                   delay=None if first.delay is None else one(first.delay),
                   servo=None if first.servo is None else (one(first.servo[0]), one(first.servo[1])),
                   terms=each(first.terms), noise=each(first.noise), wind=each(first.wind), offsets=each(first.offsets))


def is_wind(numbers: First) -> bool:
    """Whether the slow moments are given as wind angles: a6 is known well enough to divide by."""
    return bool(numbers.wind) and not any(name.startswith("moment") for name in numbers.wind)


def told(numbers: First, name: str) -> bool:
    """Whether offset `name` is significant: |offset| > TOLD std."""
    value, std = numbers.offsets.get(name, (0.0, 1.0))
    return abs(value) > TOLD * std


def plant(numbers: First) -> tuple[Profile, tuple[tuple[str, float], ...], tuple[Effect, ...]]:
    """Return [vehicle] (numbers or profile), further terms (of a test stand), and offsets, dampings as [[effects]]."""
    effects = [effect("gyro_bias", rate=numbers.offsets["gyro_bias"][0])] if told(numbers, "gyro_bias") else []
    if numbers.sine or (numbers.terms and len(numbers.t) == 1):
        gravity = "sin(theta)" if numbers.sine else "theta"
        terms = {gravity: float(numbers.a6.mean()), "beta": float(numbers.k1.mean())}
        terms |= {name: value for name, (value, _) in numbers.terms.items()}
        if told(numbers, "moment"):
            terms["1"] = numbers.offsets["moment"][0]
        vehicle = constant_profile(terms.pop("theta", 0.0), terms.pop("beta"))
        return vehicle, tuple(terms.items()), tuple(effects)
    if told(numbers, "moment"):
        k1 = float(numbers.k1.mean())
        angle = known(numbers.offsets["moment"][0] / k1, numbers.offsets["moment"][1] / abs(k1))
        effects.append(effect("thrust_misalignment", angle=angle))
    if "theta_dot" in numbers.terms:
        effects.append(effect("aero_damping", coefficient=-numbers.terms["theta_dot"][0]))
    if "sign(theta_dot)" in numbers.terms:
        effects.append(effect("friction", coefficient=-numbers.terms["sign(theta_dot)"][0]))
    if len(numbers.t) == 1:
        return constant_profile(float(numbers.a6[0]), float(numbers.k1[0])), (), tuple(effects)
    return Profile(numbers.t, numbers.a6, numbers.k1), (), tuple(effects)


def actuator(numbers: First) -> Actuator | None:
    """Return [actuator]; None where no command was logged or no delay found: the measured nozzle is the input then.  A
    beta that acts behind a servo is a command."""
    if numbers.delay is None or (numbers.delay_of == "beta" and numbers.servo is None):
        return None
    delay = max(numbers.delay[0], 0.0)
    if numbers.servo is None:
        return Actuator(UNSEEN_SERVO_FREQUENCY, FAST_DAMPING,
                        delay=max(delay - 2.0 * FAST_DAMPING / UNSEEN_SERVO_FREQUENCY, 0.0))
    noise = numbers.noise.get("command", (0.0, 0.0))[0]
    (w, w_std), (zeta, zeta_std) = numbers.servo
    unknown = {} if "beta" in numbers.noise else {   # no sensor shows the nozzle: the next flight goes on estimating it
        name: float(f"{sigma:.2g}") for name, sigma in (
            ("natural_frequency_sigma", w_std / w), ("damping_ratio_sigma", zeta_std / zeta),
            ("delay_sigma", numbers.delay[1]))}
    return Actuator(w, zeta, command_noise_std=noise, delay=delay, **unknown)


def controller(numbers: First) -> Controller | None:
    """Return [controller]; None where the commands show none, or there is no [actuator] that they are for."""
    law = numbers.law
    if law is None or actuator(numbers) is None:
        return None
    c = law.controller
    kd, ki = (c.kd, known(c.ki, law.kd_std)) if c.is_rate_law else (known(c.kd, law.kd_std), c.ki)
    return replace(c, kp=known(c.kp, law.kp_std), kd=kd, ki=ki,
                   derivative_time_constant=float(f"{c.derivative_time_constant:.{DIGITS}g}"))


def sensors(numbers: First) -> Sensors:
    """Return [sensors]; a sensor that the log lacks gets the noise of differencing, or a guess."""
    theta = numbers.noise.get("theta", (UNKNOWN_THETA, 0.0))[0]
    rate = numbers.noise.get("theta_dot", (math.sqrt(2.0) * theta / numbers.period, 0.0))[0]
    return Sensors(period=numbers.period, theta_std=theta, theta_dot_std=rate,
                   beta_std=numbers.noise.get("beta", (0.0, 0.0))[0])


# ---- words


def shown(number: Number, unit: str = "") -> str:
    return f"+- {number[1]:.2g}" + (f" {unit}" if unit else "")


def level_words(number: Number, unit: str) -> str:
    """Return the comment of a noise level: its deviation, or that the log shows no more than a limit."""
    return shown(number, unit) if number[1] < number[0] else f"{unit}, at most: less does not show"


def comments(numbers: First) -> dict[tuple[str, str], str]:
    """Return (section, key) of the nominal file -> its comment, mostly the standard deviation."""
    a6, k1 = (f"+- {std.mean():.2g}" for std in (numbers.a6_std, numbers.k1_std))
    said = {("vehicle", "a6"): f"{a6} 1/s^2", ("vehicle", "k1"): f"{k1} 1/s^2",
            ("vehicle", "profile"): f"a6 {a6}, k1 {k1} 1/s^2 in the mean; each in the JSON",
            ("vehicle.terms", '"theta"'): "" if numbers.sine else f"{a6} 1/s^2",
            ("vehicle.terms", '"sin(theta)"'): f"{a6} 1/s^2",
            ("vehicle.terms", '"beta"'): f"{k1} 1/s^2", ("sensors", "period"): "s, of the log",
            ("simulation", "duration"): "s, of the log"}
    said |= {("vehicle.terms", f'"{name}"'): shown(number, TERM_UNITS[name]) for name, number in numbers.terms.items()}
    for name, key in (("theta", "theta_std"), ("theta_dot", "theta_dot_std"), ("beta", "beta_std")):
        there = name in numbers.noise
        said["sensors", key] = level_words(numbers.noise[name], UNIT_OF[name]) if there else \
            f"{UNIT_OF[name]}, not in the log, or not used: a guess"
    said["simulation", "acceleration_noise_std"] = level_words(numbers.noise["acceleration"], "rad/s^2")
    if numbers.delay is not None:
        said["actuator", "delay"] = shown(numbers.delay, "s")
    if numbers.servo is not None:
        said["actuator", "natural_frequency"] = shown(numbers.servo[0], "rad/s") if numbers.servo[0][1] > 0.0 else \
            "rad/s, at least: as fast as the rows show; damping_ratio and delay tell the lag"
        said["actuator", "damping_ratio"] = shown(numbers.servo[1])
    else:
        said["actuator", "natural_frequency"] = "no nozzle was measured: fast, its lag taken off the delay"
    if numbers.law is not None:
        own = numbers.law.controller.is_rate_law
        said["controller", "kp"] = shown((0.0, numbers.law.kp_std), "s" if own else "")
        said["controller", "ki" if own else "kd"] = shown((0.0, numbers.law.kd_std), "" if own else "s")
        said["controller", "period"] = "s, of the commands"
    if "command" in numbers.noise:
        said["actuator", "command_noise_std"] = shown(numbers.noise["command"], "rad")
    said |= {("wind", name): shown(number, UNIT_OF[name]) for name, number in numbers.wind.items()}
    if "moment" in numbers.offsets:
        moment = numbers.offsets["moment"]
        said["effects", "angle"] = f"a moment of {with_std(*moment)} rad/s^2"
        said["vehicle.terms", '"1"'] = shown(numbers.offsets["moment"], "rad/s^2")
    if "gyro_bias" in numbers.offsets:
        said["effects", "rate"] = shown(numbers.offsets["gyro_bias"], "rad/s")
    return said


def commented(lines: list[str], numbers: First, source: str) -> Iterator[str]:
    """Yield the lines of a nominal file, each with its number's standard deviation as comment, after notes."""
    yield f"# The first nominal out of {source} alone: one standard deviation behind each number. SI units."
    if len(numbers.t) == 1 and not numbers.sine:
        yield "# To compare, in SI: k1 = -thrust*arm/inertia, a6 = q*S*C_N_alpha*(lever of the air force)/inertia."
    if numbers.delay is not None and numbers.delay_of == "beta":
        yield f"# The motion lags beta by {with_std(*numbers.delay)} s." if numbers.servo is None else \
            "# What is logged as beta acts behind a servo: it is the command. Rename it beta_cmd, or map it so."
    for name in ("moment", "gyro_bias"):
        if name in numbers.offsets and not told(numbers, name):
            yield f"# {name}: {with_std(*numbers.offsets[name])} {UNIT_OF[name]}, not significantly different from 0."
    for name, number in numbers.wind.items() if not is_wind(numbers) else ():
        yield f"# {name}: {with_std(*number)} {UNIT_OF[name]} (a6 is too vague to call it wind)."
    for note in numbers.notes:
        yield f"# {note}"
    said, section = comments(numbers), ""
    for line in lines:
        if line.startswith("["):
            section = line.strip("[]")
        key = line.split(" = ")[0]
        words = said.get((section, key))
        yield f"{line}  # {words}" if words and " = " in line else line


def write(numbers: First, path: str | Path) -> None:
    """Write the nominal file to `path`, standard deviations as comments."""
    path = Path(path)
    lines = nominal_lines(nominal_of(numbers, path.stem), path)
    write_text(path, (line + "\n" for line in commented(lines, numbers, Path(numbers.path).name)))


def lines(first: First, out: str) -> list[str]:
    """Return the numbers as lines for a terminal; `out` is the file that was written."""
    gravity = "sin(theta)" if first.sine else "theta"
    said = [f"{first.path}: {first.rows} rows, {first.period:g} s apart, {first.duration:.4g} s"]
    for t, *numbers in zip(first.t, first.a6, first.a6_std, first.k1, first.k1_std, strict=True):
        when = f"  at {t:.2f} s" if len(first.t) > 1 else ""
        said.append(f"a6 ({gravity}) {with_std(*numbers[:2])} 1/s^2, k1 {with_std(*numbers[2:])} 1/s^2{when}")
    said += [f"term {name} {with_std(*number)} {TERM_UNITS[name]}" for name, number in first.terms.items()]
    if first.delay is not None:
        after = "beta" if first.delay_of == "beta" else "the command"
        said.append(f"delay after {after} {with_std(*first.delay)} s")
    if first.servo is not None:
        said.append(f"servo {with_std(*first.servo[0])} rad/s, damping ratio {with_std(*first.servo[1])}")
    if first.law is not None:
        c, (name, unit) = first.law.controller, ("ki", "") if first.law.controller.is_rate_law else ("kd", " s")
        said.append(f"controller kp {with_std(c.kp, first.law.kp_std)}, {name} "
                    f"{with_std(getattr(c, name), first.law.kd_std)}{unit}, every {c.period:g} s")
    for words, each in (("offset", first.offsets), ("noise", first.noise), ("wind", first.wind)):
        said += [f"{words} {name} {with_std(*number)} {UNIT_OF[name]}" for name, number in each.items()]
    return [*saying_what_plus_minus_is(said), *first.notes, f"{out}: written"]


def number_json(number: Number | None) -> dict[str, float] | None:
    return None if number is None else {"value": float(number[0]), "std": float(number[1])}


def report(numbers: First) -> dict[str, Any]:
    """Return the JSON of `launchid nominal`; a6, k1 null if the log cannot tell them, `profile` if they vary."""
    constant = len(numbers.t) == 1
    no_k1 = any("k1" in reason or "neither" in reason or "input" in reason for reason in numbers.refused)
    no_a6 = any(reason.startswith("a6") or "neither" in reason for reason in numbers.refused)

    def whole(value: np.ndarray, std: np.ndarray) -> dict[str, float] | None:
        return number_json((float(value[0]), float(std[0]))) if constant else None
    profile = None
    if not constant and not numbers.refused:
        profile = [dict(zip(("t", "a6", "a6_std", "k1", "k1_std"), map(float, row), strict=True))
                   for row in zip(numbers.t, numbers.a6, numbers.a6_std, numbers.k1, numbers.k1_std, strict=True)]
    return {
        "log": numbers.path, "rows": numbers.rows, "period": numbers.period,
        "a6": None if no_a6 else whole(numbers.a6, numbers.a6_std),
        "k1": None if no_k1 else whole(numbers.k1, numbers.k1_std),
        "a6_term": "sin(theta)" if numbers.sine else "theta", "profile": profile,
        "terms": {name: number_json(number) for name, number in numbers.terms.items()},
        "delay": None if no_k1 else number_json(numbers.delay), "delay_of": numbers.delay_of,
        "actuator": None if numbers.servo is None else {"natural_frequency": number_json(numbers.servo[0]),
                                                        "damping_ratio": number_json(numbers.servo[1])},
        "controller": None if numbers.law is None else {
            "law": numbers.law.controller.law, "kp": number_json((numbers.law.controller.kp, numbers.law.kp_std)),
            **({"ki": number_json((numbers.law.controller.ki, numbers.law.kd_std))}
               if numbers.law.controller.is_rate_law else
               {"kd": number_json((numbers.law.controller.kd, numbers.law.kd_std))}),
            "period": numbers.law.controller.period},
        "offsets": {name: number_json(number) for name, number in numbers.offsets.items()},
        "noise": {name: number_json(number) for name, number in numbers.noise.items()},
        "wind": {name: number_json(number) for name, number in numbers.wind.items()},
        "fit": {"r2_held_out": numbers.r2}, "refused": list(numbers.refused), "notes": list(numbers.notes)}

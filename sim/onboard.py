"""Make the model of the filtered formulation (`launchid_core.Model`) from a nominal."""

import math
from typing import Any

import numpy as np

from launchid_core import SLOWEST, Model, Oscillator

from .disturbance_draws import sources
from .effects import values
from .effects.actuator import slowed
from .effects.environment import gust_angle
from .errors import InputError
from .nominal import Nominal
from .plant import gyro_shares, modes_of, packed, parameters
from .sections import MOST_MODES, SERVO, UNKNOWN_WIND, Actuator, Slosh
from .vehicle.actuator import FIRST_ORDER_DAMPING

SMALLEST_STD = 1.0e-9  # of a noise in a model
LARGEST_STD = 1.0e6
JUST_BEFORE = 1.0e-6   # s: a jump of the profile takes as long
GUST_NODES = 65        # of a one-minus-cosine as straight lines: within 6e-4 of its height
SLOPE_NODES = 129      # of a k1 that is a product of two lines over the flight: within 1.6e-5 of its change
MODELLED = ("control_effectiveness", "aero_instability", "actuator_delay", "actuator_bandwidth", "control_slope",
            "lateral_drift", "turbulence", "wind_walk", "controller_mismatch")
TERMS = ("aero_cubic", "missing_term", "nozzle_inertia")  # of theta_ddot
COMMAND_PATH = ("actuator_backlash", "input_washout", "actuator_rate_limit")  # on the command that is known
# what no model of the filter is near enough to, and what to do instead
REFUSED = {
    "friction": "at rest it sticks, which no slope describes: use --formulation integral --library "
                "\"theta,beta,sign(theta_dot)\"",
    "attitude_delay": "declare the sum of the delays as actuator_delay: a6 and k1 come out the same, or give the log's "
                      "theta its own stamps",
    "gyro_delay": "leave theta_dot out of the log, or give it its own stamps"}
OFFSET_KINDS = {"actuator_gain": "scale", "actuator_bias": "angle", "attitude_bias": "angle", "gyro_bias": "rate",
                "gyro_scale": "scale", "nozzle_sensor_bias": "angle", "thrust_misalignment": "angle",
                "aero_damping": "coefficient"}  # constants, exact
MODES = {"slosh": "coupling", "bending": "gain"}  # with the name of their size
KNOWN_IN_TIME = ("steady_wind", "gust", "control_loss", "moment_step", "periodic_disturbance")


def onboard_model(nominal: Nominal, period: float | None = None, path: str = "") -> Model:
    """Return the filtered formulation's model, from a nominal's [vehicle], [actuator], [sensors], [controller],
    [simulation], [wind], [offsets], [drift] and [[effects]].

    period, path  [s] of the samples that it is for, and where they are from: InputError if they are too slow

    Without [controller] the noises of command and acceleration are one draw per sensor period. Quantisation of a sensor
    adds step^2/12 to its variance.  A noise declared 0 becomes 1e-9 of its unit, so that the filter stays regular.
    InputError for an effect or [vehicle.terms] that the model cannot hold.
    """
    nominal.require("actuator", "simulation")
    noise_period = nominal.controller.period if nominal.controller is not None else nominal.sensors.period
    if nominal.controller is not None and period is not None and period > SLOWEST * nominal.controller.period:
        raise InputError(
            f"{path or nominal.path}: samples {period:g} s apart: the filtered formulation expected at most {SLOWEST} "
            f"of the controller's periods of {nominal.controller.period:g} s, or too many commands are missing; log "
            "faster, or identify without a nominal")
    if nominal.terms:
        raise InputError(f"{nominal.path}: [vehicle.terms]: the filtered formulation models theta and beta alone; "
                         "expected a6 and k1 or a profile")
    understood = (*MODELLED, *OFFSET_KINDS, *KNOWN_IN_TIME, *TERMS, *COMMAND_PATH, *MODES)
    for effect in nominal.effects:
        if effect.name not in understood:
            raise InputError(f"{nominal.path}: effect {effect.name!r}: the filtered formulation has no model of it; "
                             + REFUSED.get(effect.name, "expected a nominal without it"))
        if "sign(theta_dot)" in str(values(effect).get("term", "")):
            raise InputError(f"{nominal.path}: effect {effect.name!r} with sign(theta_dot): {REFUSED['friction']}")
    actuator, sensors, simulation = nominal.actuator, nominal.sensors, nominal.simulation
    assert actuator is not None and simulation is not None

    def std(value: float, step: float = 0.0) -> float:
        if not value <= LARGEST_STD:
            raise InputError(f"{nominal.path}: a noise of {value:g}: expected at most {LARGEST_STD:g}")
        return max(math.sqrt(value**2 + step**2 / 12.0), SMALLEST_STD)

    t = _nodes(nominal)
    a6, k1 = parameters(nominal, t)
    a6_drift, k1_drift = nominal.drift_rates()
    return Model(
        profile_t=tuple(t), profile_a6=tuple(a6), profile_k1=tuple(k1), **servo_of(nominal, actuator),
        theta_std=std(sensors.theta_std, sensors.theta_step),
        theta_dot_std=std(sensors.theta_dot_std, sensors.theta_dot_step),
        beta_std=std(sensors.beta_std, sensors.beta_step), command_noise_std=std(actuator.command_noise_std),
        acceleration_noise_std=std(simulation.acceleration_noise_std), noise_period=noise_period,
        gamma_std=max(sensors.gamma_std, sensors.alpha_std), **_known(nominal), **_air(nominal), **_unknown(nominal),
        modes=_modes(nominal), **_forced(nominal), **_terms(nominal), **_command_path(nominal),
        a6_drift=a6_drift, k1_drift=k1_drift)


def _nodes(nominal: Nominal) -> np.ndarray:
    """Return times [s] of the profile's nodes, with those of sudden losses of control and of slopes of k1."""
    jumps = [float(values(each)["time"]) for each in nominal.effects if each.name == "control_loss"]
    t = nominal.vehicle.t
    if any(each.name == "control_slope" for each in nominal.effects):
        assert nominal.simulation is not None
        t = np.union1d(t, np.linspace(0.0, nominal.simulation.duration, SLOPE_NODES))
    if not jumps:
        return t
    return np.unique(np.concatenate([t, jumps, np.array(jumps) - JUST_BEFORE]))


def servo_of(nominal: Nominal, actuator: Actuator) -> dict[str, Any]:
    """Return the servo's fields of `Model`, with the delays and bandwidths of the nominal's effects."""
    delay = sum(float(values(effect)["delay"]) for effect in nominal.effects if effect.name == "actuator_delay")
    bandwidth, lags = 1.0, []
    for effect in nominal.effects:
        if effect.name == "actuator_bandwidth":
            scale, share = float(values(effect)["scale"]), float(values(effect)["lag"])
            damping = FIRST_ORDER_DAMPING if actuator.is_first_order else actuator.damping_ratio
            factor, lag = slowed(scale, share, 1.0, damping)
            lags += [lag / (bandwidth * actuator.frequency)] * (lag > 0.0)
            bandwidth *= factor
    if len(lags) > 1:
        raise InputError(f"{nominal.path}: effect 'actuator_bandwidth' with a lag stands {len(lags)} times: expected "
                         "one")
    return {"natural_frequency": actuator.natural_frequency * bandwidth, "damping_ratio": actuator.damping_ratio,
            "time_constant": actuator.time_constant / bandwidth, "delay": actuator.delay + delay,
            "command_lag": lags[0] if lags else 0.0,
            **{f"{name}_sigma": getattr(actuator, f"{name}_sigma") for name in SERVO}}


def _known(nominal: Nominal) -> dict[str, Any]:
    """Return the fields of `Model` for constant offsets and scales that the nominal's effects fix."""
    known = {"known_lean": 0.0, "known_theta": 0.0, "known_theta_dot": 0.0, "known_beta": 0.0, "gyro_scale": 1.0,
             "command_gain": 1.0, "command_offset": 0.0, "known_damping": 0.0}
    added = {"attitude_bias": "known_theta", "nozzle_sensor_bias": "known_beta", "thrust_misalignment": "known_lean",
             "aero_damping": "known_damping"}
    for effect in nominal.effects:
        if effect.name not in OFFSET_KINDS:
            continue
        value = float(values(effect)[OFFSET_KINDS[effect.name]])
        if effect.name in added:
            known[added[effect.name]] += value
        elif effect.name == "actuator_gain":
            known["command_gain"] *= value
            known["command_offset"] *= value
        elif effect.name == "actuator_bias":
            known["command_offset"] += value
        elif effect.name == "gyro_scale":
            known["gyro_scale"] *= value
            known["known_theta_dot"] *= value
        else:
            known["known_theta_dot"] += value
    return known


def _air(nominal: Nominal) -> dict[str, Any]:
    """Return the fields of `Model` for wind and drift that are known beforehand."""
    fields: dict[str, tuple[float, ...]] = {}
    forecasts = [] if nominal.wind is None or nominal.wind.profile is None else [nominal.wind.profile]
    winds = [values(effect) for effect in nominal.effects if effect.name in ("steady_wind", "gust")]
    if forecasts or winds:
        gusts = [np.linspace(float(blow["time"]), float(blow["time"]) + float(blow["duration"]), GUST_NODES)
                 for blow in winds if "time" in blow]
        t = np.unique(np.concatenate([np.zeros(1), *(each.t for each in forecasts), *gusts]))
        wind = sum((each.at(t) for each in forecasts), np.zeros(len(t)))
        for blow in winds:
            wind = wind + _blown({name: float(value) for name, value in blow.items()}, t)
        fields["forecast_t"], fields["forecast"] = tuple(t), tuple(wind)
    drift, drifts = nominal.drift, [values(each) for each in nominal.effects if each.name == "lateral_drift"]
    if drift is not None or drifts:
        t = np.zeros(1) if drift is None else drift.t
        z_alpha, z_beta = (np.zeros(1), np.zeros(1)) if drift is None else (drift.z_alpha, drift.z_beta)
        fields |= {"drift_t": tuple(t),
                   "drift_alpha": tuple(z_alpha + sum(float(each["z_alpha"]) for each in drifts)),
                   "drift_beta": tuple(z_beta + sum(float(each["z_beta"]) for each in drifts))}
    return fields


def _blown(blow: dict[str, float], t: np.ndarray) -> np.ndarray:
    """Return the wind angle (n,) [rad] at t (n,) [s] of a gust (with a time) or of a steady wind."""
    if "time" not in blow:
        return np.full(len(t), blow["angle"])
    return np.array([gust_angle(blow["angle"], blow["time"], blow["duration"], at) for at in t])


def _unknown(nominal: Nominal) -> dict[str, Any]:
    """Return the fields of `Model` for levels of unknown wind and offsets; alpha measured in air holds the wind."""
    levels: dict[str, float] = {}
    walks, turbulences = sources(nominal.wind, packed(nominal))
    if (nominal.wind is not None or walks or turbulences) and nominal.sensors.alpha_source == "inertial":
        levels = {"walk": math.hypot(*(level for level, _ in walks)),
                  "wind_initial": math.hypot(*(initial for _, initial in walks))}
        if any(each.name == "wind_walk" for each in nominal.effects):
            levels["wind_initial"] = max(levels["wind_initial"], UNKNOWN_WIND)  # the log may begin in flight
        level = math.hypot(*(level for level, _ in turbulences))
        levels["turbulence"] = level
        if turbulences:  # of several the mean of their times, each by its power
            levels["turbulence_time"] = sum(each**2 * time for each, time in turbulences) / level**2
    if nominal.offsets is not None:
        offsets = nominal.offsets
        levels |= {name: getattr(offsets, name) for name in ("thrust_misalignment", "moment", "attitude_bias",
                                                             "gyro_bias", "nozzle_sensor_bias")}
    return levels


def _modes(nominal: Nominal) -> tuple[Oscillator, ...]:
    """Return slosh, then bending: of [[slosh]], [[bending]] and the effects of these names, but those of size 0."""
    made: dict[str, list[Oscillator]] = {kind: [] for kind in MODES}
    for mode in modes_of(nominal):
        kind = "slosh" if isinstance(mode, Slosh) else "bending"
        angle, rate = (0.0, 0.0) if isinstance(mode, Slosh) else gyro_shares(mode)
        size = mode.coupling if isinstance(mode, Slosh) else mode.gain if angle else mode.gyro_gain
        assert size is not None
        t = np.unique(np.concatenate([mode.frequency.t, size.t, mode.damping_ratio.t]))
        made[kind].append(Oscillator(
            kind=kind, t=tuple(t), frequency=tuple(mode.frequency.at(t)), size=tuple(size.at(t)),
            damping_ratio=tuple(mode.damping_ratio.at(t)), frequency_sigma=mode.frequency_sigma,
            size_sigma=getattr(mode, f"{MODES[kind]}_sigma"), damping_ratio_sigma=mode.damping_ratio_sigma, angle=angle,
            rate=rate))
    for effect in nominal.effects:
        if effect.name in MODES:
            p = {name: float(value) for name, value in values(effect).items()}
            made[effect.name].append(Oscillator(
                kind=effect.name, t=(0.0,), frequency=(p["frequency"],), size=(p[MODES[effect.name]],),
                damping_ratio=(p["damping_ratio"],)))
    for kind, modes in made.items():
        made[kind] = [mode for mode in modes if any(mode.size)]
        if len(made[kind]) > MOST_MODES:
            raise InputError(f"{nominal.path}: {len(made[kind])} modes of {kind}: expected at most {MOST_MODES}")
    return (*made["slosh"], *made["bending"])


def _forced(nominal: Nominal) -> dict[str, Any]:
    """Return the fields of `Model` for accelerations in time that the nominal's effects fix."""
    steps = [values(each) for each in nominal.effects if each.name == "moment_step"]
    sines = [values(each) for each in nominal.effects if each.name == "periodic_disturbance"]
    fields: dict[str, Any] = {"sines": tuple((float(each["amplitude"]), float(each["frequency"]), float(each["phase"]))
                                             for each in sines)}
    if steps:
        begins = np.array([float(each["time"]) for each in steps])
        t = np.unique(np.concatenate([begins - JUST_BEFORE, begins]))
        moment = sum((float(each["acceleration"]) * (t >= float(each["time"])) for each in steps), np.zeros(len(t)))
        fields |= {"moment_t": tuple(t), "known_moment": tuple(moment)}
    return fields


def _terms(nominal: Nominal) -> dict[str, Any]:
    """Return the fields of `Model` for terms of theta_ddot that the nominal's effects fix."""
    terms = [(str(values(each)["term"]), float(values(each)["coefficient"])) for each in nominal.effects
             if each.name == "missing_term"]
    changes = packed(nominal)
    if changes.nozzle_inertia != 0.0 and nominal.actuator is not None and nominal.actuator.is_first_order:
        raise InputError(f"{nominal.path}: effect 'nozzle_inertia' with a first-order actuator, whose rate jumps: "
                         "expected natural_frequency and damping_ratio")
    return {"known_terms": tuple(terms), "known_cubic": changes.aero_cubic, "nozzle_inertia": changes.nozzle_inertia}


def _command_path(nominal: Nominal) -> dict[str, Any]:
    """Return the fields of `Model` for play and wash-out of the command; several plays add, one wash-out is held."""
    play = sum(float(values(each)["half_width"]) for each in nominal.effects if each.name == "actuator_backlash")
    times = [float(values(each)["time_constant"]) for each in nominal.effects if each.name == "input_washout"]
    times = [time for time in times if math.isfinite(time)]
    if len(times) > 1:
        raise InputError(f"{nominal.path}: effect 'input_washout' stands {len(times)} times: expected one")
    changes = packed(nominal)
    limit = {} if math.isinf(changes.rate_limit) else {
        "rate_limit": changes.rate_limit, "rate_wind_up": changes.rate_reach / changes.rate_limit - 1.0}
    return {"backlash": play, "washout": times[0] if times else 0.0, **limit}

"""Frozen loops by python-control: each block's transfer function written by hand, a zero-order hold, the law in z."""

import control
import numpy as np

from sim.effects import values
from sim.nominal import Nominal

S = control.tf([1, 0], [1])


def loop_gain(nominal: Nominal, a6: float, k1: float, omega: np.ndarray) -> np.ndarray:
    """L at omega (p,) [rad/s] of a nominal's loop with a6, k1 [1/s^2]; of its effects those that the tests name."""
    told = {each.name: values(each)
            for each in nominal.effects}

    def of(name: str, key: str, neutral: float = 0.0) -> float:
        return float(told.get(name, {}).get(key, neutral))

    term = {told["missing_term"]["term"]: told["missing_term"]["coefficient"]} if "missing_term" in told else {}
    damping = of("aero_damping", "coefficient") - term.get("theta_dot", 0.0)
    z_alpha, z_beta = of("lateral_drift", "z_alpha"), of("lateral_drift", "z_beta")
    if nominal.drift is not None:
        z_alpha, z_beta = float(nominal.drift.z_alpha[0]), float(nominal.drift.z_beta[0])
    lean, inertia = term.get("sin(theta)", 0.0), of("nozzle_inertia", "coefficient")
    swing = sum((m.coupling.value[0] * m.frequency.value[0]**2 * S**2 / (
        S**2 + 2 * m.damping_ratio.value[0] * m.frequency.value[0] * S + m.frequency.value[0]**2)
        for m in nominal.slosh), control.tf([0], [1]))
    # theta (s^2 + d s + swing - lean) = a6 alpha + (k1 + c s^2) beta, alpha (s + z_alpha) = s theta - z_beta beta
    top = (k1 + inertia * S**2) * (S + z_alpha) - a6 * z_beta
    bottom = (S**2 + damping * S + swing - lean) * (S + z_alpha) - a6 * S
    if z_alpha == z_beta == 0.0:
        top, bottom = k1 + inertia * S**2, S**2 + damping * S + swing - lean - a6
    rigid, seen, rate = top / bottom, control.tf([0], [1]), control.tf([0], [1])
    for m in nominal.bending:
        w, gain = m.frequency.value[0], m.gain.value[0]
        gyro_gain = gain if m.gyro_gain is None else m.gyro_gain.value[0]
        resonance = w * w / (S**2 + 2 * m.damping_ratio.value[0] * w * S + w * w)
        seen, rate = seen + gain * resonance, rate + gyro_gain * S * resonance
    servo, own = nominal.actuator, nominal.controller
    period = own.period
    before = control.tf([1], [1])
    w, z = servo.natural_frequency, servo.damping_ratio
    if "actuator_bandwidth" in told:   # all of the slowing by a lag: 2 z/w (1/scale - 1)
        before = before / (1 + 2 * z / w * (1 / of("actuator_bandwidth", "scale") - 1) * S)
    if "input_washout" in told:
        before = before * 8.0 * S / (8.0 * S + 1)
    moved = before / (1 + servo.time_constant * S) if servo.is_first_order else \
        before * w * w / (S**2 + 2 * z * w * S + w * w)
    z_line = np.exp(1j * omega * period)

    def held(plant: control.TransferFunction) -> np.ndarray:
        return control.sample_system(control.ss(control.minreal(plant, verbose=False)), period)(z_line)

    scale = of("gyro_scale", "scale", 1.0)
    late = np.exp(-1j * omega * (servo.delay + of("controller_mismatch", "delay")))
    kp, kd = own.kp * of("controller_mismatch", "kp_scale", 1.0), own.kd * of("controller_mismatch", "kd_scale", 1.0)
    passed = late * np.prod([np.polyval(f.b, z_line) / np.polyval(f.a, z_line) for f in own.filters], axis=0)
    if own.law == "rate":
        law = kp + own.ki * period / (1 - 1 / z_line)
        return -passed * law * scale * held(moved * (rigid * S + rate))
    if own.law == "gyro":
        return -passed * (kp * held(moved * (rigid + seen)) + kd * scale * held(moved * (rigid * S + rate)))
    tau = own.derivative_time_constant
    law = kp + kd * (1 - 1 / z_line) / (tau + period - tau / z_line)
    return -passed * law * held(moved * (rigid + seen))

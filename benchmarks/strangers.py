"""Strangers' logs with a known truth: the diagnosis of bodies that the project's own simulator did not fly.

    python benchmarks/strangers.py [--half tuning|held-out | --first SEED] [--rough] [--only WORD...] [--out FILE]
                                   [--compare FILE]

Six kinds of body (a drone's roll, a bench with a propeller, a servo with a load, a balancing robot, a pendulum with a
measured torque, a stand), integrated at 1 ms with nothing of the packages. Their input acts late, by a delay and a
servo of first or second order that no row measures; beside the white noise of the sensors they are moved by a coloured
disturbance and a vibration that no model has, 5 to 20 times the acceleration noise that the nominal declares; rates are
50 to 500 Hz.
The stand has damping, friction and a drag of the second order; its nominal the damping and the friction that a
regression gives for all three; its disturbance is up to twice as loud, its input may be small.
The nominal is right but for one thing, or right: its delay is all of the body's lateness, without its form.
right: the thing, or its look-alike, is named and nothing else, or a right nominal is consistent; wrong: anything else
is named, or a wrong nominal is consistent; refused: neither. Both halves of the seeds were looked at;
--first gives bodies that nobody has seen.
--rough: besides, what every log has that others measured, and no nominal says: an input that is curved by a fifth and
loses a tenth along the log, a gyro that is late and 2 % off, quantised columns, a slow moment, stamps that jitter.
"""

import argparse
import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from launchid.diagnosis.answer import headline, report
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import Log, log_of_values
from sim.nominal import Nominal
from sim.nominal.reader import nominal_of
from sim.nominal.table import Table

STEP = 1e-3            # s of the integration
SECONDS = 16.0
HALVES = {"tuning": 9000, "held-out": 9500}   # first seed
LATE = ("actuator_delay", "actuator_bandwidth", "actuator_rate_limit")
DRAWN = {"stand": 4}   # of each thing that may be wrong, once elsewhere
TRIM = ("attitude_bias", "steady_wind", "thrust_misalignment", "actuator_bias", "missing_term(1)")
GAIN = ("control_effectiveness", "actuator_gain", "missing_term(beta)")
# body: things that may be wrong -> names that are right
WRONG = {
    "drone": {"": (), "k1": GAIN, "late": LATE, "damping": ("aero_damping", "missing_term(theta_dot)"), "trim": TRIM},
    "bench": {"": (), "k1": GAIN, "late": LATE, "sine": ("missing_term(sin(theta))",),
              "damping": ("aero_damping", "missing_term(theta_dot)")},
    "servo": {"": (), "k1": GAIN, "late": LATE, "own damping": ("aero_damping", "missing_term(theta_dot)"),
              "friction": ("friction", "missing_term(sign(theta_dot))")},
    "robot": {"": (), "k1": GAIN, "late": LATE, "a6": ("aero_instability", "missing_term(theta)"), "trim": TRIM},
    "pendulum": {"": (), "k1": GAIN, "friction": ("friction", "missing_term(sign(theta_dot))"),
                 "linear": ("missing_term(sin(theta))", "aero_cubic", "missing_term(theta^3)"),
                 "sine": ("missing_term(sin(theta))",)},
    "stand": {"": (), "k1": GAIN, "friction": ("friction", "missing_term(sign(theta_dot))"),
              "own damping": ("aero_damping", "missing_term(theta_dot)")}}


class Body(NamedTuple):
    """theta'' = a6 theta - g sin(theta) - (c + d |omega|) omega - f sign(omega) + k (b + trim), b the input that acts,
    after delay and servo."""

    a6: float = 0.0
    g: float = 0.0
    c: float = 0.0
    d: float = 0.0
    f: float = 0.0
    k: float = 0.0
    trim: float = 0.0
    delay: float = 0.0
    servo: float = 0.0     # rad/s, natural frequency; 0: none
    zeta: float = 1.0      # 0: of first order
    kp: float = 0.0        # of its own loop, none: random steps of the input
    kd: float = 0.0
    loud: float = 1.0      # factor of the disturbance
    size: float = 0.0      # of the steps of reference or input


def drawn(kind: str, rng: np.random.Generator) -> Body:
    """Return a body of a kind, its numbers drawn."""
    u = rng.uniform
    if kind == "drone":
        k, w = u(40.0, 120.0), u(4.0, 6.0)
        return Body(c=u(1.0, 3.0), k=k, trim=u(0.02, 0.05), delay=u(0.008, 0.025), servo=u(25.0, 50.0),
                    zeta=u(0.7, 1.0), kp=w * w / k, kd=1.6 * w / k, size=u(0.2, 0.4))
    if kind == "bench":
        return Body(g=u(4.0, 12.0), c=u(0.6, 1.5), k=u(6.0, 14.0), delay=u(0.01, 0.03), servo=1.0 / u(0.05, 0.14),
                    zeta=0.0, size=u(0.4, 0.8))
    if kind == "servo":
        k, w = u(40.0, 120.0), u(7.0, 12.0)
        return Body(c=u(4.0, 10.0), f=u(2.0, 6.0), k=k, delay=u(0.006, 0.02), servo=u(60.0, 120.0), zeta=0.8,
                    kp=w * w / k, kd=0.6 * w / k, size=u(0.5, 1.0))
    if kind == "robot":
        a6, k = u(15.0, 50.0), -u(1.0, 8.0)
        w = 1.6 * math.sqrt(a6)
        return Body(a6=a6, k=k, trim=-u(0.02, 0.05) * a6 / k, delay=u(0.004, 0.01), servo=1.0 / u(0.008, 0.02),
                    zeta=0.0, kp=(w * w + a6) / k, kd=1.5 * w / k, size=u(0.05, 0.1))
    if kind == "stand":
        return Body(g=u(6.0, 20.0), c=u(0.4, 1.5), d=u(0.1, 0.8), f=u(0.5, 2.0), k=u(10.0, 25.0),
                    delay=u(0.005, 0.02), servo=1.0 / u(0.02, 0.06), zeta=0.0, size=u(0.15, 0.6), loud=u(1.0, 2.0))
    return Body(g=u(15.0, 60.0), c=0.05, f=u(0.6, 1.5), k=u(5.0, 10.0), delay=0.0, size=u(1.0, 3.0))


def flown(body: Body, rate: float, rng: np.random.Generator,
          rough: bool = False) -> tuple[dict[str, np.ndarray], float, float]:
    """Return columns t, theta, theta_dot, input, the rms acceleration and the white part of the disturbance."""
    n, every = int(SECONDS / STEP), round(1.0 / rate / STEP)
    steps = np.repeat(rng.uniform(-1.0, 1.0, n // 700 + 1), 700)[:n] * body.size
    slow = np.cumsum(rng.normal(size=n)) * math.sqrt(STEP)
    steps += 0.1 * body.size * np.sin(3.0 * np.arange(n) * STEP + slow)
    time_constant, hum = rng.uniform(0.03, 0.15), rng.uniform(30.0, 90.0)
    e, tone = rng.normal(size=n), np.sin(hum * np.arange(n) * STEP + 3.0 * slow)
    share = body.loud * rng.uniform(0.05, 0.15)
    theta, omega, b, v, x, u = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    curve, worn, drift, phase = (0.2, 0.1, 0.03, 6.0) * rng.uniform(size=4) if rough else np.zeros(4)
    late, out, acc = round(body.delay / STEP), np.empty((n, 3)), np.empty(n)
    sent = np.zeros(n)
    swings = 0.3 * body.g * min(body.size, 1.0)
    typical = max(0.4 * abs(body.k) * body.size * (abs(body.kp) if body.kp else 1.0), swings)
    for i in range(n):
        if i % every == 0:
            u = (body.kp * (steps[i] - theta) - body.kd * omega) if body.kp else steps[i]
            u = float(u)
        out[i] = theta, omega, u
        sent[i] = u
        now = sent[i - late] if i >= late else 0.0
        if body.servo == 0.0:
            b = now
        elif body.zeta == 0.0:
            b += STEP * body.servo * (now - b)
        else:
            v += STEP * body.servo * (body.servo * (now - b) - 2.0 * body.zeta * v)
            b += STEP * v
        x += -x * STEP / time_constant + math.sqrt(2.0 * STEP / time_constant) * e[i]
        force = b
        if rough:
            force = b * (1.0 + curve * (math.tanh(abs(b * body.k) / typical) - 0.5)) * (1.0 - worn * i / n)
        a = body.a6 * theta - body.g * math.sin(theta) - (body.c + body.d * abs(omega)) * omega \
            - body.f * math.tanh(omega / 0.02) + body.k * (force + body.trim) \
            + rough * drift * typical * math.sin(2.0 * math.pi * i / n + phase)
        acc[i] = a
        a += share * typical * (x + 0.7 * tone[i])
        omega += STEP * a
        theta += STEP * omega
    rows = out[::every].copy()
    t = np.arange(len(rows)) * every * STEP
    if rough:
        gyro_late = rng.integers(1, 8)
        rows[:, 1] = rng.uniform(0.98, 1.02) * np.roll(out[:, 1], gyro_late)[::every]
        rows[:, :2] = np.round(rows[:, :2] / (2e-3, 1e-2)) * (2e-3, 1e-2)
        t = t + 0.05 * every * STEP * rng.uniform(-1.0, 1.0, len(t))
    noise = rng.uniform(0.5, 2.0) * np.array([1e-3, 1e-2])
    columns = {"t": t, "theta": rows[:, 0] + noise[0] * rng.normal(size=len(t)),
               "theta_dot": rows[:, 1] + noise[1] * rng.normal(size=len(t)), "input": rows[:, 2]}
    return columns, float(np.std(acc)), share * typical


def regressed(body: Body, omega: np.ndarray) -> Body:
    """Return the body with the damping and friction that stand for all its dissipation along the rates `omega`."""
    truth = (body.c + body.d * np.abs(omega)) * omega + body.f * np.sign(omega)
    (c, f), *_ = np.linalg.lstsq(np.column_stack([omega, np.sign(omega)]), truth, rcond=None)
    return body._replace(c=float(c), d=0.0, f=float(f))


def nominal_for(kind: str, body: Body, wrong: str, rate: float, motion: float, rng: np.random.Generator) -> Nominal:
    """Return the nominal of a body, one thing wrong, or nothing ("")."""
    off = rng.choice([0.65, 1.5])
    off_damping = 0.6 if kind == "stand" else 0.4
    k = body.k * (off if wrong == "k1" else 1.0)
    damping = 0.0 if wrong == "damping" else body.c * (off_damping if wrong == "own damping" else 1.0)
    terms: dict[str, float] = {"beta": k}
    if body.a6:
        terms["theta"] = body.a6 * (off if wrong == "a6" else 1.0)
    if body.g:
        terms["theta" if wrong == "linear" else "sin(theta)"] = -body.g * (off if wrong == "sine" else 1.0)
    if damping:
        terms["theta_dot"] = -damping
    if body.f and wrong != "friction":
        terms["sign(theta_dot)"] = -body.f
    if body.trim and wrong != "trim":
        terms["1"] = body.k * body.trim
    lag = 0.0 if not body.servo else (1.0 if body.zeta == 0.0 else 2.0 * body.zeta) / body.servo
    table: dict[str, Any] = {
        "vehicle": {"terms": terms},
        "sensors": {"period": 1.0 / rate, "theta_std": 1e-3, "theta_dot_std": 1e-2, "beta_std": 1e-3},
        "simulation": {"duration": SECONDS, "acceleration_noise_std": motion / rng.uniform(5.0, 20.0)}}
    if kind != "pendulum":
        table["actuator"] = {"natural_frequency": 500.0, "damping_ratio": 0.7}
        if wrong != "late":
            table["actuator"]["delay"] = round(max(body.delay + lag - 2.0 * 0.7 / 500.0, 0.0), 4)
    return nominal_of(Table(Path(f"{kind}.toml"), table | {"name": kind}))


def cases(first: int) -> list[tuple[str, str, str, int]]:
    """Return (name, kind, wrong, seed) of the bodies from a first seed on."""
    out = []
    for a, (kind, of) in enumerate(WRONG.items()):
        for b, wrong in enumerate((*of, "") * DRAWN.get(kind, 1)):
            seed = first + 10 * a + b
            out.append((f"{kind}-{wrong.replace(' ', '-') or 'right'}-{seed}", kind, wrong, seed))
    return out


def made(kind: str, wrong: str, seed: int, rough: bool = False) -> tuple[Log, Nominal]:
    """Return the log and the nominal of a case."""
    rng = np.random.default_rng(seed)
    body, rate = drawn(kind, rng), float(rng.choice([50.0, 100.0, 200.0, 500.0]))
    columns, _, motion = flown(body, rate, rng, rough)
    if body.d:
        body = regressed(body, columns["theta_dot"])
    nominal = nominal_for(kind, body, wrong, rate, motion, rng)
    sent = columns.pop("input")
    if kind == "pendulum":
        columns["beta"] = sent + 0.01 * body.size * rng.normal(size=len(sent))
    else:
        columns["beta_cmd"] = sent
    return log_of_values(f"{kind}-{seed}", columns), nominal


def outcome(kind: str, wrong: str, answer: dict[str, Any]) -> str:
    """Return right, wrong or refused."""
    if not wrong:
        return "right" if answer["verdict"] == "consistent" else "wrong" if answer["causes"] else "refused"
    if answer["verdict"] == "consistent":
        return "wrong"
    accepted, hit = WRONG[kind][wrong], False
    for cause in answer["causes"]:
        term = cause["parameters"].get("term", {}).get("value")
        names = {cause["cause"], f"{cause['cause']}({term})", *cause["indistinguishable_from"]}
        good = bool(names & set(accepted))
        if not good and not (wrong == "linear" and term == "theta"):
            return "wrong"
        hit = hit or good
    return "right" if hit else "refused"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", choices=tuple(HALVES), default="tuning")
    parser.add_argument("--first", type=int, help="seed of other bodies")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--compare", type=Path)
    parser.add_argument("--rough", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    told = args.compare.read_text().splitlines() if args.compare else []
    before = {row["name"]: row["outcome"] for row in map(json.loads, told)}
    rows = []
    for name, kind, wrong, seed in cases(HALVES[args.half] if args.first is None else args.first):
        if args.only and not any(word in name for word in args.only):
            continue
        log, nominal = made(kind, wrong, seed, args.rough)
        begun = time.process_time()
        result = diagnose(log, nominal)
        seconds, answer = time.process_time() - begun, report(result)
        row = {"name": name, "outcome": outcome(kind, wrong, answer), "seconds": round(seconds, 2),
               "said": headline(result), "doubts": answer["doubts"] + answer["remaining"],
               "nearest": [each["resembles"] for each in answer["nearest"]]}
        rows.append(row)
        change = f" (was {before[name]})" if before.get(name, row["outcome"]) != row["outcome"] else ""
        print(f"{row['outcome']:8s}{change} {name:28s} {seconds:5.1f} s  {row['said']}", flush=True)
        if args.verbose or change:
            print("            ", row["nearest"], row["doubts"], flush=True)
        if args.out:
            args.out.write_text("\n".join(map(json.dumps, rows)) + "\n")
    for words, of in (("wrong nominals", [r for r in rows if "-right-" not in r["name"]]),
                      ("right nominals", [r for r in rows if "-right-" in r["name"]])):
        counts = {key: sum(r["outcome"] == key for r in of) for key in ("right", "wrong", "refused")}
        print(words, len(of), counts)
    print("seconds: median", round(float(np.median([r["seconds"] for r in rows])), 1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

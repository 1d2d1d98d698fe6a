"""Logs of benches that no nominal flew: a motor or a pendulum with what its nominal lacks, and what loggers do.

The generator is written out here: theta_ddot = -W sin(theta) - D theta_dot + K u + more, by steps of a tenth of a row,
the command held from row to row.  A nominal believes 0.8 K, and nothing of what is more.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import launchid
from launchid.log.check import checked
from launchid.log.log import log_of
from launchid.weakform.bands import agreeing_top, disagreements
from launchid.weakform.pieces import pieces_of
from launchid.weakform.prepare import usable
from sim.errors import InputError

SECONDS, FINE = 25.0, 10   # of a log; steps a row
TOLERANCE = 0.02           # of a number, beside its deviation: how far a bench's equation may be told
NOISE = 5e-4               # rad
Bench = tuple[float, float, float]   # W [1/s^2], D [1/s], K
MOTOR, PENDULUM = (0.0, 10.0, 20.0), (80.0, 1.0, 25.0)
More = Callable[[float, float, float], float]   # of theta, theta_dot and the acceleration so far


def flown(bench: Bench, period: float, seed: int, more: More | None = None, lag: float = 0.0) -> dict[str, np.ndarray]:
    """Return t, theta, theta_dot without noise, and beta_cmd of a bench; lag [s] of its motor."""
    rng, n = np.random.default_rng(seed), round(SECONDS / period)
    w, d, k = bench
    hold = max(1, round(0.2 / period))
    u = np.repeat(rng.choice([-1.0, -0.5, 0.5, 1.0], n // hold + 1), hold)[:n]
    theta, rate, x, v, moved, h = np.zeros(n), np.zeros(n), 0.0, 0.0, 0.0, period / FINE
    for row in range(n):
        theta[row], rate[row] = x, v
        for _ in range(FINE):
            moved += (u[row] - moved) * (min(h / lag, 1.0) if lag else 1.0)
            a = -w * math.sin(x) - d * v + k * moved
            a += more(x, v, a) if more is not None else 0.0
            x, v = x + h * (v + 0.5 * h * a), v + h * a
    return {"t": np.arange(n) * period, "theta": theta + NOISE * rng.normal(size=n), "theta_dot": rate, "beta_cmd": u}


def friction(size: float) -> More:
    """Return a dry friction that sticks."""
    return lambda x, v, a: -a if abs(v) < 1e-3 and abs(a) < size else -size * math.copysign(1.0, v or a)


def cogging(size: float) -> More:
    """Return the moment of a motor's magnets, twelve a turn."""
    return lambda x, v, a: size * math.sin(12.0 * x)


def believed(folder: Path, bench: Bench, period: float, more: str = "") -> Path:
    """Write the nominal of a bench, with K 20 % low."""
    w, d, k = bench
    path = folder / "bench.toml"
    path.write_text(
        'name = "bench"\n[vehicle.terms]\n' + (f'"sin(theta)" = {-w}\n' if w else "") +
        f'"theta_dot" = {-d}\n"beta" = {0.8 * k}\n{more}[actuator]\nnatural_frequency = 20000\ndamping_ratio = 0.7\n'
        f"[sensors]\nperiod = {period}\ntheta_std = {NOISE}\ntheta_dot_std = 0.01\nbeta_std = 0.001\n"
        f"[simulation]\nduration = {SECONDS}\nacceleration_noise_std = 0.1\n", encoding="utf-8")
    return path


def held(report: dict[str, Any], truth: dict[str, float]) -> list[bool]:
    """Whether each OK window's 95 % intervals, and TOLERANCE beside, hold the truth."""
    return [all(abs(w["terms"][term] - value) < 1.96 * math.hypot(w["terms_std"][term], TOLERANCE * value)
                for term, value in truth.items()) for w in report["windows"] if w["valid"]]


def without(columns: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    return {each: x for each, x in columns.items() if each != name}


@pytest.mark.parametrize("period", [0.01, 0.02])
@pytest.mark.parametrize(("bench", "more", "lag"), [
    (MOTOR, None, 0.0), (MOTOR, friction(4.0), 0.0), (MOTOR, cogging(2.0), 0.0), (MOTOR, None, 0.03),
    (PENDULUM, None, 0.0), (PENDULUM, friction(5.0), 0.0), (PENDULUM, cogging(3.0), 0.0), (PENDULUM, None, 0.03)],
    ids=["motor", "motor friction", "motor cogging", "motor lag", "pendulum", "pendulum friction", "pendulum cogging",
         "pendulum lag"])
def test_a_bench_is_told_whatever_its_nominal_lacks(tmp_path, bench, more, lag, period):
    made = launchid.identify(without(flown(bench, period, 1, more, lag), "theta_dot"),
                             believed(tmp_path, bench, period)).report
    truth = {"beta": bench[2], **({"sin(theta)": -bench[0]} if bench[0] else {})}
    of_windows = held(made, truth)
    assert len(of_windows) >= 4 and sum(of_windows) >= len(of_windows) - 1


def test_a_term_that_the_log_shows_is_fitted_and_said(tmp_path):
    columns = without(flown(MOTOR, 0.01, 2, friction(4.0)), "theta_dot")
    made = launchid.identify(columns, believed(tmp_path, MOTOR, 0.01))
    assert any("sign(theta_dot) act in it" in line for line in made.warnings)
    assert all(w["terms"]["sign(theta_dot)"] == pytest.approx(-4.0, rel=0.15)
               for w in made.report["windows"] if w["valid"])


def test_a_small_term_that_is_lacking_is_in_the_deviations(tmp_path):
    """A drag of the second order is none of the terms that may join."""
    columns = flown(PENDULUM, 0.01, 10, lambda x, v, a: -0.04 * v * abs(v))
    made = launchid.identify(without(columns, "theta_dot"), believed(tmp_path, PENDULUM, 0.01)).report
    of_windows = held(made, {"beta": 25.0, "sin(theta)": -80.0})
    assert len(of_windows) >= 4 and sum(of_windows) >= len(of_windows) - 1


def test_slow_rows_keep_a_fast_pendulum(tmp_path):
    """In rows of 25 ms trapezia of means were 0.7 % off at 12 rad/s, in every window alike."""
    bench = (140.0, 1.0, 28.0)
    made = launchid.identify(without(flown(bench, 0.025, 3), "theta_dot"), believed(tmp_path, bench, 0.025)).report
    stiffness = np.array([w["terms"]["sin(theta)"] for w in made["windows"] if w["valid"]])
    assert len(stiffness) >= 4 and stiffness.mean() == pytest.approx(-140.0, rel=2e-3)


def test_a_command_that_jumps_in_every_row_is_no_noise(tmp_path):
    """Behind a delay of one and a half rows; steps of a nozzle that nobody measured passed for its sensor's noise."""
    period, bench = 0.02, (69.0, 0.3, 230.0)
    columns = flown(bench, period, 4)
    rng = np.random.default_rng(0)
    u, n = rng.choice([-0.1, 0.1], len(columns["t"])), len(columns["t"])
    theta, x, v, h = np.zeros(n), 0.0, 0.0, period / FINE
    fine = np.concatenate([np.zeros(15), np.repeat(u, FINE)])
    for step in range(n * FINE):
        if step % FINE == 0:
            theta[step // FINE] = x
        a = -69.0 * math.sin(x) - 0.3 * v + 230.0 * fine[step]
        x, v = x + h * (v + 0.5 * h * a), v + h * a
    late = believed(tmp_path, bench, period).read_text(encoding="utf-8").replace(
        "damping_ratio = 0.7", "damping_ratio = 0.7\ndelay = 0.03")
    (tmp_path / "bench.toml").write_text(late, encoding="utf-8")
    made = launchid.identify({"t": columns["t"], "theta": theta + NOISE * rng.normal(size=n), "beta_cmd": u},
                             tmp_path / "bench.toml").report
    of_windows = held(made, {"beta": 230.0, "sin(theta)": -69.0})
    assert len(of_windows) >= 4 and sum(of_windows) >= len(of_windows) - 1


def test_a_log_of_rates_alone_is_taken_where_no_term_has_theta(tmp_path):
    rng, columns = np.random.default_rng(5), without(flown(MOTOR, 0.01, 5), "theta")
    columns["theta_dot"] = columns["theta_dot"] + 0.01 * rng.normal(size=len(columns["t"]))
    made = launchid.identify(columns, believed(tmp_path, MOTOR, 0.01))
    of_windows = held(made.report, {"beta": 20.0})
    assert len(of_windows) == 5 and all(of_windows) and any("no column theta" in line for line in made.warnings)
    with pytest.raises(InputError, match="theta"):
        launchid.identify(columns, believed(tmp_path, PENDULUM, 0.01))


def test_a_command_written_a_row_late_is_shifted(tmp_path):
    columns = without(flown(MOTOR, 0.01, 6), "theta_dot")
    columns["beta_cmd"] = np.concatenate([[0.0], columns["beta_cmd"][:-1]])   # of the row before
    made = launchid.identify(columns, believed(tmp_path, MOTOR, 0.01)).report
    assert made["late"]["delay"]["value"] == pytest.approx(-0.01, abs=1e-3)
    assert all(held(made, {"beta": 20.0})) and made["lacks"] == []


def test_rows_that_are_slower_than_a_damping_are_told(tmp_path):
    fast = (0.0, 40.0, 150.0)
    made = launchid.identify(without(flown(fast, 0.02, 7), "theta_dot"), believed(tmp_path, fast, 0.02)).report
    assert not any(w["valid"] for w in made["windows"]) and "theta_dot fades within" in made["unchecked"]


def test_terms_of_a_nominals_effects_are_its_own(tmp_path):
    path = tmp_path / "craft.toml"
    path.write_text('name = "craft"\n[vehicle]\na6 = -4.0\nk1 = -5.0\n[[effects]]\nname = "aero_damping"\n'
                    'coefficient = 2.0\n[[effects]]\nname = "thrust_misalignment"\nangle = 0.01\n[sensors]\n'
                    "period = 0.01\ntheta_std = 1e-3\ntheta_dot_std = 1e-3\nbeta_std = 1e-4\n", encoding="utf-8")
    columns = flown((4.0, 2.0, -5.0), 0.01, 8, lambda x, v, a: -4.0 * (x - math.sin(x)) - 0.05)
    made = launchid.identify({"t": columns["t"], "theta": columns["theta"], "theta_dot": columns["theta_dot"],
                              "beta": columns["beta_cmd"]}, path).report
    assert made["lacks"] == [] and all(set(w["terms"]) == {"theta", "beta", "theta_dot", "1"}
                                       for w in made["windows"] if w["valid"])
    assert sum(held(made, {"theta": -4.0, "beta": -5.0, "theta_dot": -2.0})) >= 4


@pytest.mark.parametrize("is_true", [True, False])
def test_slow_and_fast_modes_agree_if_the_equation_is_true(is_true):
    """A load on a spring moves with the motor where it is slow, and stays where it is fast."""
    load = [0.0, 0.0]

    def sprung(x: float, v: float, a: float) -> float:
        pull = 0.3 * (625.0 * (x - load[0]) + 2.5 * (v - load[1]))
        load[1] += 0.01 / FINE * pull / 0.3
        load[0] += 0.01 / FINE * load[1]
        return -pull

    columns = flown(MOTOR, 0.01, 9, None if is_true else sprung)
    rows = usable(checked(log_of({"t": columns["t"], "theta": columns["theta"], "beta": columns["beta_cmd"]})))
    assert rows is not None
    pieces = pieces_of(rows, ("theta_dot", "beta"))
    assert math.isinf(agreeing_top(pieces, ("theta_dot", "beta"))) == is_true
    assert (disagreements(pieces)[1] == 0.0) == is_true

"""The measured pendulum logs: physics that nobody of this project simulated.

theta_ddot = -a sin(theta) + b torque - friction, a = 20.3..21.4 1/s^2 by the device's own data sheet.
The logs are not part of this project; without them these tests are skipped.
"""

import json
from pathlib import Path

import pytest

from sim.cli import main

DEVICE = (20.3, 21.4)  # 1/s^2
LOGS = ("dircol", "ddp")
WITH_FRICTION, WITHOUT = "sin(theta),beta,sign(theta_dot)", "sin(theta),beta"


def terms(capsys, folder: Path, name: str, library: str) -> dict[str, float]:
    """Active terms of the one window over the whole log."""
    status = main(["identify", str(folder / f"dfki_pendulum_{name}.csv"), "--library", library,
                   "--formulation", "integral", "--window", "all", "--json", "-"])
    out = capsys.readouterr().out
    assert status == 0
    windows = json.loads(out)["windows"]
    assert len(windows) == 1 and windows[0]["valid"]
    return windows[0]["terms"]


@pytest.mark.parametrize("name", LOGS)
def test_gravity_term_is_the_device_s(real_logs, capsys, name):
    found = terms(capsys, real_logs, name, WITH_FRICTION)
    assert 0.85 * DEVICE[0] <= -found["sin(theta)"] <= 1.15 * DEVICE[1]
    assert found["sign(theta_dot)"] < 0 < found["beta"]


def test_without_friction_the_second_log_gives_too_little_gravity(real_logs, capsys):
    with_friction = -terms(capsys, real_logs, "ddp", WITH_FRICTION)["sin(theta)"]
    without = -terms(capsys, real_logs, "ddp", WITHOUT)["sin(theta)"]
    print(f"gravity term of the ddp log: {with_friction:.2f} with friction, {without:.2f} without, data sheet {DEVICE}")
    assert without < 17.3 <= with_friction


def test_large_library_keeps_gravity_and_torque(real_logs, capsys):
    found = terms(capsys, real_logs, "dircol", "quadratic+sin")
    assert {"sin(theta)", "beta"} <= set(found)
    assert found["sin(theta)"] < 0 < found["beta"]

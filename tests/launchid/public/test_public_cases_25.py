"""A body that spins through many turns, and simulations that do run away: evidence is a number of the log, or none."""

import json
import math

import numpy as np
import pytest

from launchid.cli.main import main
from launchid.diagnosis.answer import report
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import OPTIONAL, REQUIRED, Log, write_columns
from sim.nominal import Nominal, load_nominal

ROWS, PERIOD = 1200, 0.01   # s
GAIN, DAMPING = 4000.0, 0.73  # 1/s^2, 1/s: a motor that spins up to 230 rad/s, 300 turns in 12 s
TOML = """name = "spinning"
[vehicle.terms]
"beta" = 4167.0
{more}
[actuator]
natural_frequency = 1000.0
damping_ratio = 0.7
[sensors]
period = 0.01
theta_std = 0.0003
theta_dot_std = 0.35
beta_std = 0.0001
[simulation]
duration = 20.0
acceleration_noise_std = 3.0
[diagnosis]
time_limit = 3600.0
"""


def spun() -> dict[str, np.ndarray]:
    """The columns: theta_ddot = GAIN u - DAMPING theta_dot, exact under a held command; no nozzle sensor."""
    rng, left = np.random.default_rng(25), math.exp(-DAMPING * PERIOD)
    t, rows, theta, rate = np.arange(ROWS) * PERIOD, [], 0.0, 0.0
    for command in np.where(t // 2.0 % 2.0 == 0.0, -0.03, -0.045):
        rows.append((theta, rate, command))
        end = GAIN * command / DAMPING
        theta += end * PERIOD + (rate - end) * (1.0 - left) / DAMPING
        rate = end + (rate - end) * left
    exact = np.array(rows)
    return {"t": t, "theta": exact[:, 0] + 3e-4 * rng.standard_normal(ROWS),
            "theta_dot": exact[:, 1] + 0.35 * rng.standard_normal(ROWS), "beta_cmd": exact[:, 2]}


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    return spun()


def log_of(columns) -> Log:
    values = {name: columns.get(name, np.full(ROWS, math.nan)) for name in REQUIRED + OPTIONAL}
    return Log("spin.csv", tuple(columns), (), **values)


def nominal(folder, more: str = "") -> Nominal:
    path = folder / "spinning.toml"
    path.write_text(TOML.format(more=more), encoding="utf-8")
    return load_nominal(path)


def numbers(value):
    """Every number of a JSON."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for each in value for number in numbers(each)]
    return [float(value)] if isinstance(value, int | float) else []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("drop", [(), pytest.param(("theta",), marks=pytest.mark.campaign)],
                         ids=["all columns", "without theta"])
def test_a_body_that_spins_through_300_turns_is_judged(columns, tmp_path, drop):
    """The body's drag is found; no row is worth more than its shortened errors (`filter.whiten`) can be."""
    assert np.max(np.abs(columns["theta"])) > 300 * 2.0 * math.pi
    made = diagnose(log_of({name: x for name, x in columns.items() if name not in drop}), nominal(tmp_path))
    assert made.verdict in ("explained", "dominant") and made.named[0].cause == "aero_damping"
    assert made.named[0].values["coefficient"] == pytest.approx(DAMPING, abs=4 * made.named[0].std["coefficient"])
    assert made.named[0].values["coefficient"] == pytest.approx(DAMPING, rel=0.05)
    assert all(abs(each) < ROWS * 3 * 0.5 * 16.0 * 1e3 for each in numbers(report(made)))


@pytest.mark.filterwarnings("error")
def test_a_nominal_that_could_not_fly_names_nothing(columns, tmp_path, capsys):
    """Drag of the wrong sign and a thousand times too large: no cause, and no warning on the way to the page."""
    made = diagnose(log_of(columns), nominal(tmp_path, '"theta_dot" = 60000.0'))
    assert (made.verdict, made.named) == ("unexplained", ())
    write_columns(tmp_path / "spin.csv", columns)
    main(["diagnose", str(tmp_path / "spin.csv"), str(tmp_path / "spinning.toml"), "--report", str(tmp_path / "r")])
    assert "Warning" not in capsys.readouterr().err
    assert json.loads((tmp_path / "r" / "verdict.json").read_text(encoding="utf-8"))["verdict"] == "unexplained"

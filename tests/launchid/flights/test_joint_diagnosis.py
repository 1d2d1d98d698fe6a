"""Several flights diagnosed in one fit: what they share is known better, and clean flights stay consistent."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from launchid.diagnosis.several import SeveralLogs, diagnose_jointly
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import Log, flown_log, log_of, write_columns
from launchid.main import main
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

DAMPING = 0.15   # 1/s
DURATION = 35.0  # s


def brief() -> Nominal:
    """The constant nominal, flown for DURATION."""
    nominal = load_nominal("constant")
    assert nominal.simulation is not None
    return replace(nominal, simulation=replace(nominal.simulation, duration=DURATION))


def flights(seeds: range, damping: float = 0.0) -> list[Log]:
    nominal = brief()
    effects = (effect("aero_damping", coefficient=damping),) if damping else ()
    return [flown_log(fly_whole(nominal, seed, effects=effects), f"flight {seed}") for seed in seeds]


def test_what_flights_share_is_found_in_one_fit_and_known_better():
    nominal, logs = brief(), flights(range(41, 43), DAMPING)
    alone, found = diagnose(logs[0], nominal), diagnose_jointly(logs, nominal)
    assert not isinstance(found, str) and found.verdict == "explained"
    one, = found.named
    value, std = one.parameters["coefficient"]
    assert one.cause == "aero_damping" and abs(value - DAMPING) < 3.0 * std
    assert std < 0.9 * alone.named[0].parameters["coefficient"][1]


def test_clean_flights_stay_consistent_and_each_keeps_its_own_clock():
    found = diagnose_jointly(flights(range(51, 53)), brief())
    assert not isinstance(found, str) and found.verdict == "consistent" and not found.named
    assert found.model is not None and isinstance(found.model.log, SeveralLogs)
    log = found.model.log
    first = np.array(log.first)
    assert log.tau[first] == pytest.approx(-1.0) and log.tau[first[1:] - 1] == pytest.approx(1.0)
    assert np.all(np.diff(log.t) > 0.0)


def test_flights_of_other_periods_are_not_joined():
    log, = flights(range(3, 4))
    slow = log_of({name: x[::2] for name, x in log.measured().items()}, "slow")
    said = diagnose_jointly([*flights(range(1, 2)), slow], load_nominal("constant"))
    assert isinstance(said, str) and "periods" in said


@pytest.mark.campaign
def test_the_command_writes_what_all_flights_show(tmp_path: Path):
    names = []
    for log in flights(range(41, 43), DAMPING):
        names.append(str(tmp_path / f"{log.path}.csv"))
        write_columns(names[-1], log.measured())
    out, report = tmp_path / "d.json", tmp_path / "report"
    assert main(["diagnose", *names, "constant", "--json", str(out), "--report", str(report)]) == 0
    said = json.loads(out.read_text())
    assert [each["cause"] for each in said["causes"]] == ["aero_damping"]
    assert "All flights together" in said["headline"] and "extension.toml" in said["next"]
    assert load_nominal(str(report / "extension.toml")).effects[0].name == "aero_damping"

"""Samples slower than the controller: used with wider deviations up to 2.5 of its periods, refused beyond."""

import dataclasses

import numpy as np
import pytest

from launchid.identification.windows import run
from launchid.log.log import write_flight
from launchid.main import main
from launchid_core import Config
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model

PERIOD = 0.01  # of the constant nominal's controller


def config(period: float, **more) -> Config:
    nominal = load_nominal("constant")
    return Config(**{"window": 5.0, "sample_period": period, "formulation": "filtered",
                     "model": onboard_model(nominal)} | more)


def test_the_limit_is_two_and_a_half_controller_periods():
    assert config(2.5 * PERIOD).sample_period == 2.5 * PERIOD
    with pytest.raises(ValueError, match=r"sample_period=0\.0251.*2\.5 of the controller's periods of 0\.01 s"):
        config(0.0251)
    with pytest.raises(InputError, match=r"slow\.csv: samples 0\.2 s apart.*2\.5 of the controller's periods of 0\.01"):
        onboard_model(load_nominal("constant"), 0.2, "slow.csv")
    Config(window=5.0, sample_period=0.2)  # the others do without the commands


@pytest.mark.parametrize("command", [("identify",), ("uncertainty",)])
def test_a_5_hz_log_is_refused_in_one_line(tmp_path, capsys, command):
    flight = fly_whole(load_nominal("constant"), 1, "flight", 0.2)
    write_flight(tmp_path / "slow.csv", flight)
    nominal = ["--nominal", "constant"] if command == ("identify",) else ["constant"]
    assert main([*command, str(tmp_path / "slow.csv"), *nominal]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "0.2 s apart" in said and "2.5 of the controller's periods" in said


def test_at_half_the_rate_intervals_cover():
    """Windows of 5 s and the tracked estimate: 95 % intervals over four flights, within what 56 windows can tell."""
    nominal = load_nominal("vega_like")
    made = Config(window=5.0, sample_period=2 * PERIOD, formulation="filtered", model=onboard_model(nominal))
    scaled = []
    for seed in range(700, 704):
        for e in run(made, fly_whole(nominal, seed, "flight", 2 * PERIOD).samples())[0]:
            for each, t in ((e, 0.5 * (e.t_start + e.t_end)), (e.tracked, e.t_end)):
                if each.valid:
                    a6, k1 = (float(x[0]) for x in nominal.vehicle.at(np.array([t])))
                    scaled += [(each.a6 - a6) / each.a6_std, (each.k1 - k1) / each.k1_std]
    assert np.mean(np.abs(scaled) < 1.96) > 0.88 and np.max(np.abs(scaled)) < 5.0


@pytest.mark.parametrize(("name", "is_known"), [("constant", False), ("vega_like", True), ("greensite_cr826", False)])
def test_a_clean_flight_at_half_the_rate_contradicts_no_model(name, is_known):
    """The commands between the samples are noise of their own, in the second half of a step."""
    nominal = load_nominal(name)
    if not is_known:
        nominal = dataclasses.replace(nominal, actuator=dataclasses.replace(
            nominal.actuator, natural_frequency_sigma=0.3, damping_ratio_sigma=0.3, delay_sigma=0.02))
    made = Config(window=5.0, sample_period=2 * PERIOD, formulation="filtered", model=onboard_model(nominal))
    statuses = [e.status.name for seed in range(700, 703)
                for e in run(made, fly_whole(nominal, seed, "flight", 2 * PERIOD).samples())[0]]
    assert len(statuses) >= 40 and statuses.count("MODEL") <= 0.05 * len(statuses)

"""A log's start is evidence where it begins at a state that the nominal knows."""

from dataclasses import replace

import pytest

from launchid.diagnosis.causes import HYPOTHESES
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import flown_log
from sim.effects import effect
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal, write_nominal

AMONG = ("attitude_bias", "steady_wind", "thrust_misalignment")
BIAS = 0.01        # rad, twice what the flight's rest would tell from none


def believed(begins: str) -> Nominal:
    """The constant nominal, of 20 s, whose log begins so."""
    found = load_nominal("constant")
    assert found.simulation is not None
    return replace(found, simulation=replace(found.simulation, duration=20.0),
                   diagnosis=replace(found.diagnosis, begins=begins))


def named(begins: str, name: str) -> set[str]:
    nominal = believed(begins)
    log = flown_log(fly_whole(nominal, 4, effects=[effect(name, angle=BIAS)]))
    made = diagnose(log, nominal, hypotheses=tuple(each for each in HYPOTHESES if each.cause in AMONG))
    return {cause for each in made.causes for cause in (each.cause, *each.rivals)}


def test_a_sensor_s_bias_is_told_from_an_offset_of_the_plant_by_the_start():
    """The vehicle stands at 0, where an attitude sensor with a bias does not read 0."""
    assert named("anywhere", "attitude_bias") > {"attitude_bias"}
    assert named("at rest", "attitude_bias") == {"attitude_bias"}


def test_a_wind_is_no_sensor_s_bias_then():
    found = named("at rest", "steady_wind")
    assert "steady_wind" in found and "attitude_bias" not in found


def test_it_is_a_word_of_the_nominal(tmp_path):
    write_nominal(believed("at rest"), tmp_path / "n.toml")
    assert 'begins = "at rest"' in (tmp_path / "n.toml").read_text()
    assert load_nominal(tmp_path / "n.toml").diagnosis.begins == "at rest"
    (tmp_path / "n.toml").write_text((tmp_path / "n.toml").read_text().replace("at rest", "somehow"))
    with pytest.raises(InputError, match=r'diagnosis\.begins = .somehow.: expected "anywhere" or "at rest"'):
        load_nominal(tmp_path / "n.toml")

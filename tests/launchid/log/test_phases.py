"""The phases of a flight: the burn of a model rocket is found; a steady flight has one phase, whatever acts in it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hobby_rocket import Rocket, as_hobby_csv, fly

import launchid
from launchid.log.check import checked
from launchid.log.log import Log, log_of
from launchid.log.phases import DOES_NOT, HELD, MOVES, Phase, checked_flight, flown_phase, phases_of
from launchid.main import main

EDGE = 0.1   # s, by which an edge may be off, beside the row's own period
MAP = """[time]
name = "time_ms"
unit = "ms"
[columns.theta]
from = "pitch_deg"
unit = "deg"
[columns.theta_dot]
from = "gyro_y_dps"
unit = "deg/s"
[columns.beta_cmd]
from = "servo_us"
unit = "deg"
scale = -0.02
offset = 30.0
"""


def phases(log: Log) -> list[Phase]:
    seen = checked(log)
    return phases_of(seen.log, seen.data)


def without(log: Log, *columns: str) -> Log:
    return log_of({name: x for name, x in log.measured().items() if name not in columns})


@pytest.mark.parametrize(("rocket", "seed"), [
    (Rocket(), 11), (Rocket(is_still_on_pad=True), 12), (Rocket(beta_std=5e-4, period=0.01), 14),
    (Rocket(burn=7.0, thrust=7.0, pad=15.0, coast=8.0, chute=40.0), 14), (Rocket(period=0.04), 15),
    (Rocket(burn=2.0), 17)],
    ids=["as it is", "still on the pad", "nozzle measured", "long", "25 Hz", "a burn of 2 s"])
def test_the_burn_is_found(rocket, seed):
    found = flown_phase(phases(log_of(fly(rocket, seed))))
    assert found is not None
    assert found.first == pytest.approx(rocket.pad, abs=EDGE + rocket.period)
    assert found.last == pytest.approx(rocket.pad + rocket.burn, abs=EDGE + rocket.period)


@pytest.mark.campaign
@pytest.mark.parametrize(("rocket", "starts", "ends"), [
    (Rocket(), 0.9, 0.9), (Rocket(is_still_on_pad=True), 0.9, 0.9), (Rocket(beta_std=5e-4, period=0.01), 0.6, 0.9),
    (Rocket(rate_std=3e-4, theta_std=3e-4, push=0.05), 0.9, 0.9), (Rocket(rate_std=1e-2, theta_std=5e-3), 0.0, 0.9),
    (Rocket(period=0.04), 0.6, 0.9), (Rocket(period=0.005), 0.7, 0.9), (Rocket(burn=2.0), 0.9, 0.6),
    (Rocket(burn=2.0, rate_std=1e-2), 0.0, 0.6)],
    ids=["as it is", "still on the pad", "nozzle measured", "quiet", "noisy gyro", "25 Hz", "200 Hz", "2 s",
         "2 s, noisy"])
def test_the_burn_is_found_in_most_flights_and_never_cut(rocket, starts, ends):
    found = [flown_phase(phases(log_of(fly(rocket, 2000 + seed)))) for seed in range(24)]
    first = np.array([0.0 if each is None else each.first for each in found]) - rocket.pad
    last = np.array([np.inf if each is None else each.last for each in found]) - rocket.pad - rocket.burn
    assert np.all(first < 0.3)
    assert np.all(last > -0.3)
    assert np.mean(first > -0.15 - rocket.period) >= starts
    assert np.mean(last < 0.15 + rocket.period) >= ends


def test_the_words_of_the_phases_in_order():
    kinds = [each.kind for each in phases(log_of(fly(Rocket(), 11)))]
    assert kinds == [HELD, MOVES, DOES_NOT]


@pytest.mark.parametrize("nominal", ["constant", "vega_like", "greensite_cr826"])
def test_a_steady_flight_has_one_phase(nominal):
    log = launchid.simulate(nominal, seed=31).log
    for each in (log, without(log, "beta"), without(log, "theta_dot")):
        assert phases(each) == []


@pytest.mark.parametrize("effect", [
    "control_loss:fraction=0.6,time=30", "control_effectiveness:scale=0.5", "friction:coefficient=0.01",
    "gust:angle=0.03,time=55,duration=14", "steady_wind:angle=0.1", "aero_damping:coefficient=2",
    "actuator_backlash:half_width=0.002"])
def test_nothing_that_a_nominal_may_have_is_a_phase(effect):
    assert phases(launchid.simulate("constant", seed=32, effects=[effect]).log) == []


def test_wind_is_no_phase():
    from sim.nominal import load_nominal
    from sim.sections import Offsets, Wind
    nominal = replace(load_nominal("constant"), offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005),
                      wind=Wind(walk=0.005, turbulence=0.005, initial=0.05))
    for seed in (3, 4):
        assert phases(launchid.simulate(nominal, seed=seed).log) == []


def test_a_beta_of_another_time_tells_no_phase():
    log = launchid.simulate("constant", seed=1).log
    for share in (0.3, 0.4, 0.6):
        n = round(share * len(log.t))
        assert phases(replace(log, beta=np.roll(log.beta, n), beta_cmd=np.roll(log.beta_cmd, n))) == []


def test_too_little_to_tell_is_one_phase():
    log = log_of(fly(Rocket(), 11))
    assert phases(launchid.read_log(log, from_=2.5, to=4.0)) == []
    assert phases(replace(log, beta_cmd=np.full(len(log.t), 0.01))) == []


def test_identify_and_nominal_use_the_flight_and_say_so(tmp_path, capsys):
    rocket = Rocket()
    (tmp_path / "raw.csv").write_text(as_hobby_csv(fly(rocket, 11)))
    (tmp_path / "map.toml").write_text(MAP)
    raw, rest = str(tmp_path / "raw.csv"), ["--map", str(tmp_path / "map.toml")]
    assert main(["identify", raw, *rest, "--window", "all", "--json", str(tmp_path / "i.json")]) == 0
    assert "beta moves the vehicle from 2.5" in capsys.readouterr().err
    window, = json.loads((tmp_path / "i.json").read_text())["windows"]
    assert window["valid"] and window["t_start"] > 2.5
    assert abs(window["k1"] - rocket.k1) < 3.0 * window["k1_std"]
    assert main(["nominal", raw, *rest, "--out", str(tmp_path / "n.toml"), "--json", str(tmp_path / "n.json")]) == 0
    numbers = json.loads((tmp_path / "n.json").read_text())
    assert abs(numbers["k1"]["value"] - rocket.k1) < 3.0 * numbers["k1"]["std"]
    assert main(["identify", raw, *rest, "--from", "start", "--window", "all", "--json", str(tmp_path / "a.json")]) == 0
    window, = json.loads((tmp_path / "a.json").read_text())["windows"]
    assert window["t_start"] == 0.0


def test_rows_that_a_user_chose_stay():
    log = launchid.read_log(fly(Rocket(), 11), from_="start")
    assert checked_flight(log).log.is_same(checked(log).log)
    assert len(checked_flight(launchid.read_log(log, from_=1.0, to=8.0)).log.t) == 351


def edges(columns: dict[str, np.ndarray]) -> tuple[float, float]:
    found = flown_phase(phases(log_of(columns)))
    assert found is not None
    return found.first, found.last


def test_what_a_day_at_the_field_adds_hides_no_burn():
    rocket, draw = Rocket(), np.random.default_rng(3)
    columns = fly(rocket, 11)
    t, burn = columns["t"], (rocket.pad, rocket.pad + rocket.burn)
    shaken = columns["theta_dot"] + np.where((t > 1.0) & (t < rocket.pad), draw.normal(0.0, 0.05, len(t)), 0.0)
    jerked = columns["theta_dot"].copy()
    at = np.searchsorted(t, rocket.pad + rocket.burn + rocket.coast)
    jerked[at:at + 4] += [14.0, -10.0, 5.0, -2.0]
    loud = columns["theta_dot"] + draw.normal(0.0, 0.01, len(t))
    for rate in (shaken, jerked, loud):
        assert edges({**columns, "theta_dot": rate}) == pytest.approx(burn, abs=0.5)
    assert edges({name: x for name, x in columns.items() if name != "theta_dot"}) == pytest.approx(burn, abs=0.5)

"""The world outside: wind, offsets and drift, by their laws, where they vanish, and against matrix exponentials."""

import dataclasses
import math

import numpy as np
import pytest
from every import every
from scipy.linalg import expm
from shortened import short
from test_sim import refused

from launchid.log.log import read_log, write_flight
from launchid.main import main
from sim.disturbance_draws import OFFSET_DRAWS, drawn_offsets, drawn_wind
from sim.effects import from_text
from sim.errors import InputError
from sim.flight import SUITES, Flight, fly, fly_whole
from sim.nominal import (
    BUILT_IN,
    Drift,
    Forecast,
    Multisine,
    Nominal,
    Offsets,
    Wind,
    load_nominal,
    write_nominal,
)

COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot", "theta_ddot", "a6", "k1")
DRIFT = Drift(np.zeros(1), np.array([-0.03]), np.array([-0.02]))
WINDY = Wind(walk=0.01, turbulence=0.01, turbulence_time=0.7)
UNSURE = Offsets(0.01, 0.005, 0.004, 0.003, 0.02)
STILL = {"theta_std": 0.0, "theta_dot_std": 0.0, "beta_std": 0.0}


def silent(duration: float, **sections) -> Nominal:
    """Open loop without any noise."""
    return short(duration, **{"sensors": STILL, "simulation": {"acceleration_noise_std": 0.0},
                              "actuator": {"command_noise_std": 0.0}, "controller": {"kp": 0.0, "kd": 0.0}, **sections})


def bits(flight: Flight, names: tuple[str, ...] = COLUMNS) -> bytes:
    return b"".join(getattr(flight, name).tobytes() for name in names)


def constant_wind(angle: float) -> Wind:
    return Wind(profile=Forecast(np.zeros(1), np.array([angle])))


# ---- laws of the draws


def test_walk_s_variance_grows_as_its_square_times_time():
    step, steps = 0.01, 400
    walks = np.array([drawn_wind(Wind(walk=0.03, initial=0.02), seed, steps, step) for seed in range(3000)])
    for k in (0, 100, 400):
        expected = 0.02**2 + 0.03**2 * k * step
        assert np.var(walks[:, k]) == pytest.approx(expected, rel=5 * math.sqrt(2 / 3000))
    increments = np.diff(walks[:200], axis=1)
    assert abs(np.mean(increments[:, 1:] * increments[:, :-1])) < 5 * np.var(increments) / math.sqrt(increments.size)


@pytest.mark.parametrize("time_constant", [0.3, 2.0])
def test_turbulence_is_stationary_and_its_correlation_falls_to_one_over_e(time_constant):
    step, lag = 0.01, round(time_constant / 0.01)
    wind = Wind(turbulence=0.04, turbulence_time=time_constant, initial=0.0)
    flown = np.array([drawn_wind(wind, seed, 3 * lag, step) for seed in range(3000)])
    for k in (0, lag, 3 * lag):
        assert np.std(flown[:, k]) == pytest.approx(0.04, rel=5 / math.sqrt(2 * 3000))
    for k in (lag, 2 * lag):
        correlation = np.mean(flown[:, 0] * flown[:, k]) / 0.04**2
        assert correlation == pytest.approx(math.exp(-k * step / time_constant), abs=5 / math.sqrt(3000))


def test_offsets_have_their_sigma_and_no_correlation():
    drawn = np.array([list(drawn_offsets(UNSURE, seed).values()) for seed in range(3000)])
    for k, name in enumerate(OFFSET_DRAWS):
        assert np.std(drawn[:, k]) == pytest.approx(getattr(UNSURE, name), rel=5 / math.sqrt(2 * 3000))
    assert np.max(np.abs(np.corrcoef(drawn.T) - np.eye(5))) < 5 / math.sqrt(3000)


def test_walk_turbulence_and_offsets_are_left_alone_by_each_other():
    walk, turbulence = (drawn_wind(wind, 3, 500, 0.01) for wind in
                        (Wind(walk=0.01), Wind(turbulence=0.02, initial=0.0)))
    both = drawn_wind(Wind(walk=0.01, turbulence=0.02), 3, 500, 0.01)
    assert np.array_equal(both, walk + turbulence)
    assert drawn_offsets(Offsets(moment=0.02), 3)["moment"] == drawn_offsets(UNSURE, 3)["moment"]


def test_forecast_is_linear_between_nodes_and_held_beyond():
    forecast = Forecast(np.array([1.0, 3.0]), np.array([0.0, 0.04]))
    assert forecast.at(np.array([0.0, 1.5, 2.0, 9.0])).tolist() == [0.0, 0.01, 0.02, 0.04]
    flight = fly_whole(short(wind=Wind(profile=forecast)))
    assert np.allclose(flight.wind, forecast.at(flight.t), rtol=0.0, atol=1e-15)


# ---- where they vanish


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("name", BUILT_IN)
def test_levels_of_zero_change_no_bit(name, suite):
    nominal = short(5.0, name)
    none = dataclasses.replace(nominal, wind=Wind(), offsets=Offsets())
    still = dataclasses.replace(none, drift=Drift(np.zeros(1), np.zeros(1), np.zeros(1)))
    plain = fly_whole(nominal, 3, suite)
    assert bits(fly_whole(none, 3, suite)) == bits(fly_whole(still, 3, suite)) == bits(plain)
    assert np.isnan(plain.gamma).all() and plain.offsets == {} and not plain.wind.any() and not plain.true_gamma.any()


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("period", [None, 0.02])
def test_one_sample_at_a_time_is_the_whole_flight_bit_for_bit(suite, period):
    nominal = short(sensors={"gamma_std": 1e-3}, wind=WINDY, offsets=UNSURE, drift=DRIFT)
    flight = fly_whole(nominal, 3, suite, period)
    assert np.array(list(flight.samples())).tobytes() == np.array(list(fly(nominal, 3, suite, period))).tobytes()
    assert np.isfinite(flight.gamma).all()


# ---- the equations


@pytest.mark.parametrize("effects", [(), ("steady_wind:angle=0.02", "thrust_misalignment:angle=0.01")])
def test_acceleration_and_drift_are_the_equations(effects):
    nominal = short(wind=WINDY, drift=DRIFT)
    f = fly_whole(nominal, 3, "ideal", effects=map(from_text, effects))
    m = 0.01 if effects else 0.0
    alpha = f.theta - f.gamma + f.wind
    assert np.allclose(f.theta_ddot, f.a6 * alpha + f.k1 * (f.beta + m), rtol=0.0, atol=1e-14)
    slope = -0.03 * alpha - 0.02 * (f.beta + m)  # the wind is linear over a step, so the trapezoid is of second order
    assert np.allclose(np.diff(f.gamma), 0.5 * f.period * (slope[1:] + slope[:-1]), rtol=0.0, atol=1e-9)


def test_drifting_flight_is_the_matrix_exponential():
    """Open loop under a held command, states theta, theta_dot, beta, beta_dot, gamma, and the constants u, w, m."""
    u, w, m, angle, moment = 0.01, 0.02, 0.004, 0.0, 0.0
    held = Multisine(0.0, 9.0, (1e-9,), (u,), (math.pi / 2,))
    nominal = dataclasses.replace(silent(2.0, drift=DRIFT, wind=constant_wind(w)), test_input=held)
    flight = fly_whole(nominal, 0, "ideal", effects=[from_text(f"thrust_misalignment:angle={m}")])
    a6, k1, frequency, zeta, z_alpha, z_beta = 2.0, -7.0, 50.0, 0.7, -0.03, -0.02
    a = np.zeros((8, 8))
    a[0, 1] = a[2, 3] = 1.0
    a[1, [0, 4, 2, 6, 7]] = a6, -a6, k1, a6, k1
    a[3, [2, 3, 5]] = -frequency**2, -2 * zeta * frequency, frequency**2
    a[4, [0, 4, 2, 6, 7]] = z_alpha, -z_alpha, z_beta, z_alpha, z_beta
    x = expm(a * flight.t[-1]) @ np.array([angle, moment, 0.0, 0.0, 0.0, u, w, m])
    assert flight.t[-1] == pytest.approx(2.0 - 0.001)
    for value, column in ((x[0], flight.theta), (x[1], flight.theta_dot), (x[2], flight.beta), (x[4], flight.gamma)):
        assert column[-1] == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize("drift", [None, DRIFT])
def test_constant_forecast_is_the_steady_wind(drift):
    forecast = fly_whole(short(wind=constant_wind(0.02), drift=drift), 2)
    steady = fly_whole(short(drift=drift), 2, effects=[from_text("steady_wind:angle=0.02")])
    for name in ("theta", "theta_dot", "beta", "wind", "true_gamma"):
        assert np.allclose(getattr(forecast, name), getattr(steady, name), rtol=0.0, atol=1e-13), name
    assert forecast.wind[0] == steady.wind[0] == 0.02


def test_cubic_is_in_the_angle_of_attack():
    cubic = from_text("aero_cubic:coefficient=30")
    f = fly_whole(short(wind=constant_wind(0.02), drift=DRIFT), 3, "ideal", effects=[cubic])
    alpha = f.theta - f.gamma + 0.02
    assert np.allclose(f.theta_ddot, f.a6 * (alpha + 30 * alpha**3) + f.k1 * f.beta, rtol=0.0, atol=1e-14)


def test_each_offset_is_its_effect():
    for name, key in (("thrust_misalignment", "angle"), ("attitude_bias", "angle"), ("gyro_bias", "rate"),
                      ("nozzle_sensor_bias", "angle")):
        flight = fly_whole(short(offsets=Offsets(**{name: 0.01})), 2)
        assert list(flight.offsets) == [name]
        same = fly_whole(short(), 2, effects=[from_text(f"{name}:{key}={flight.offsets[name]!r}")])
        assert bits(flight) == bits(same), name


def test_moment_is_in_the_acceleration():
    f = fly_whole(short(offsets=Offsets(moment=0.02)), 2, "ideal")
    assert np.allclose(f.theta_ddot - f.a6 * f.theta - f.k1 * f.beta, f.offsets["moment"], rtol=0.0, atol=1e-14)


def test_gamma_has_its_noise_in_the_flight_suite_alone():
    nominal = short(20.0, sensors={"gamma_std": 2e-3}, drift=DRIFT)
    flight, ideal = (fly_whole(nominal, 1, suite, 0.01) for suite in ("flight", "ideal"))
    noise = flight.gamma - flight.true_gamma
    assert np.std(noise) == pytest.approx(2e-3, rel=5 / math.sqrt(2 * len(noise)))
    assert np.array_equal(ideal.gamma, ideal.true_gamma)
    assert bits(flight) == bits(fly_whole(short(20.0, drift=DRIFT), 1))


# ---- files


def test_log_has_gamma_with_drift_alone(tmp_path):
    path = tmp_path / "log.csv"
    for nominal, there in ((short(), False), (short(drift=DRIFT, sensors={"gamma_std": 1e-3}), True)):
        flight = fly_whole(nominal, 1)
        write_flight(path, flight)
        log = read_log(path)
        assert ("gamma" in log.columns) is there and "rate_ref" not in log.columns
        assert log.gamma.tobytes() == flight.gamma.tobytes()
        assert np.array(list(log.samples())).tobytes() == np.array(list(flight.samples())).tobytes()


def test_alpha_is_turned_into_gamma(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,theta,beta,alpha\n0,0.3,0,0.1\n0.01,0.3,0,\n")
    gammas = [sample.gamma for sample in read_log(path).samples()]
    assert gammas[0] == 0.3 - 0.1 and math.isnan(gammas[1])


def test_gamma_and_alpha_together_are_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,theta,beta,alpha,gamma\n0,0.3,0,0.1,0.2\n")
    with pytest.raises(InputError, match="line 1: columns gamma and alpha"):
        read_log(path)


def test_sections_of_the_world_read_back(tmp_path):
    nodes = np.array([0.0, 1.0, 2.5])
    drift = Drift(nodes, np.array([-0.03, -0.02, -0.1 / 3]), np.array([-0.02, -0.01, 0.0]))
    forecast = Forecast(nodes, np.array([0.0, 0.02, 0.1 / 7]))
    for k, (given, wind) in enumerate(((DRIFT, WINDY), (drift, dataclasses.replace(WINDY, profile=forecast)))):
        path = tmp_path / f"n{k}.toml"
        nominal = short(drift=given, wind=wind, offsets=UNSURE,
                        sensors={"gamma_std": 1e-3, "alpha_std": 2e-3, "alpha_source": "air"})
        write_nominal(nominal, path)
        again = load_nominal(path)
        write_nominal(again, path)
        again = load_nominal(path)
        assert (again.offsets, again.sensors) == (UNSURE, nominal.sensors)
        assert dataclasses.replace(again.wind, profile=None) == WINDY
        for name in ("t", "z_alpha", "z_beta"):
            assert np.array_equal(getattr(again.drift, name), getattr(given, name))
        assert bits(fly_whole(again, 3), (*COLUMNS, "gamma", "wind")) == \
            bits(fly_whole(nominal, 3), (*COLUMNS, "gamma", "wind"))
    assert np.array_equal(again.wind.profile.wind, forecast.wind)


@every(("text", "expected"), [
    ("[drift]\nz_alpha = -0.1", "key 'drift.z_beta' is missing"),
    ("[drift]\nz_gamma = 1", "unknown key 'drift.z_gamma'"),
    ("[drift]\nz_alpha = true\nz_beta = 0", "drift.z_alpha = True"), ("drift = 3", "drift = 3"),
    ("[drift]\nprofile = 'd.csv'\nz_alpha = 1", "[drift] has a profile and other keys"),
    ("[drift]\nprofile = 3", "drift.profile = 3: expected the path of a CSV file t,z_alpha,z_beta"),
    ("[drift]\nprofile = 'wrong.csv'", "line 1: expected the header t,z_alpha,z_beta"),
    ("[wind]\nprofile = 'wrong.csv'", "line 1: expected the header t,wind"),
    ("[wind]\nwalk = -1", "wind.walk = -1: expected a number of at least 0"),
    ("[wind]\nturbulence_time = 0", "wind.turbulence_time = 0: expected a number above 0"),
    ("[wind]\ninitial = nan", "wind.initial = nan"), ("[wind]\nlevel = 1", "unknown key 'wind.level'"),
    ("[wind]\nprofile = 1", "wind.profile = 1"), ("[offsets]\nmoment = -1", "offsets.moment = -1"),
    ("[offsets]\ngyro = 1", "unknown key 'offsets.gyro'"), ("[offsets]\nmoment = '1'", "offsets.moment = '1'"),
    ("[diagnosis]\ntiming = -1", "diagnosis.timing = -1"), ("[diagnosis]\ntime_limit = 0", "diagnosis.time_limit = 0"),
    ("[diagnosis]\neffort = 0", "diagnosis.effort = 0")])
def test_wrong_key_is_named(tmp_path, text, expected):
    (tmp_path / "wrong.csv").write_text("t,gusts\n0,1\n")
    top, _, rest = text.partition("\n") if text.startswith("drift =") else ("", "", text)
    text = f"{top}\n[vehicle]\na6 = 2.0\nk1 = -7.0\n[sensors]\nperiod = 0.01\ntheta_std = 0.0\ntheta_dot_std = 0.0\n"
    assert expected in refused(tmp_path / "n.toml", f"{text}beta_std = 0.0\n{rest}\n")


# ---- commands


def test_simulate_writes_gamma(tmp_path):
    write_nominal(short(1.0, drift=DRIFT, wind=WINDY), tmp_path / "n.toml")
    assert main(["simulate", str(tmp_path / "n.toml"), "--out", str(tmp_path / "log.csv"), "--seed", "2"]) == 0
    columns = read_log(tmp_path / "log.csv").columns
    assert columns == ("t", "theta", "beta", "theta_dot", "beta_cmd", "theta_ref", "gamma")

"""The data check: no clean flight and no physical effect is bad data, every fault is found by name and place."""

import dataclasses
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shortened import short

from launchid.log.detect import VALUES, DataCheck, check
from launchid.log.log import Log, read_log
from launchid.log.stamps import gaps, usable_rows
from sim.effects import CATALOGUE, from_text
from sim.flight import Flight, fly_whole
from sim.nominal import BUILT_IN, Nominal, constant_profile
from sim.sections import Sensors

COLUMNS = ("t", *VALUES)
OPTIONAL = ("theta_dot", "beta_cmd", "theta_ref")
STD = {"theta": 3.5e-4, "theta_dot": 5.2e-4, "beta": 3.5e-4}  # of the nominals' sensors
SENSED = st.sampled_from(sorted(STD))
NAMES = st.sampled_from(("constant", "vega_like"))
SEEDS = st.integers(100, 103)  # few, for the flights are kept; none of them set a threshold
SOME = settings(max_examples=8)
DURATION = 40.0

GROSS = (
    "control_effectiveness:scale=0.4", "control_effectiveness:scale=1.6", "control_loss:fraction=0.5,time=12",
    "aero_instability:scale=0.3", "aero_instability:scale=1.7", "aero_damping:coefficient=2",
    "aero_cubic:coefficient=50",
    "friction:coefficient=0.5", "thrust_misalignment:angle=0.087", "slosh:coupling=2,frequency=6",
    "bending:gain=0.1,frequency=60", "bending:gain=0.05,frequency=157,damping_ratio=0.01",
    "bending:gain=0.3,frequency=40,damping_ratio=0.01", "missing_term:term=theta^3,coefficient=50",
    "gust:angle=0.087,time=10,duration=0.3", "gust:angle=0.087,time=10,duration=5", "steady_wind:angle=0.087",
    "periodic_disturbance:amplitude=2,frequency=30", "periodic_disturbance:amplitude=10,frequency=100",
    "actuator_delay:delay=0.06", "actuator_bandwidth:scale=0.3", "actuator_bandwidth:scale=2.5",
    "input_washout:time_constant=2",
    "actuator_gain:scale=0.6", "actuator_gain:scale=1.4", "actuator_rate_limit:rate=0.02",
    "actuator_backlash:half_width=0.035", "actuator_bias:angle=0.087", "attitude_bias:angle=-0.087",
    "attitude_delay:delay=0.06", "gyro_bias:rate=0.087", "gyro_scale:scale=0.5", "gyro_scale:scale=1.5",
    "gyro_delay:delay=0.06", "nozzle_sensor_bias:angle=0.087", "controller_mismatch:kp_scale=0.6",
    "controller_mismatch:kp_scale=1.5,kd_scale=0.5", "controller_mismatch:delay=0.06",
    "moment_step:acceleration=0.2,time=20", "nozzle_inertia:coefficient=-0.02", "nozzle_inertia:coefficient=0.02",
    "control_slope:slope=-0.01", "lateral_drift:z_alpha=0.3,z_beta=0.2", "turbulence:level=0.03,time_constant=0.2",
    "wind_walk:level=0.01")


@lru_cache
def nominal(name: str) -> Nominal:
    """The built-in nominal, its flight shortened."""
    return short(DURATION, name)


def log_of(flight: Flight) -> Log:
    return Log("flight.csv", COLUMNS, (), **{name: getattr(flight, name).copy() for name in COLUMNS})


@lru_cache(maxsize=64)
def flown(name: str, seed: int, effect: str = "", suite: str = "flight", period: float = 0.01,
          noise: float = 1.0, quantum: float = 0.0) -> Log:
    """A flight's log; noise times the nominal's, quantised to so many of the nominal's stds."""
    of = nominal(name)
    sensors = {f"{channel}_std": noise * std for channel, std in STD.items()}
    sensors |= {f"{channel}_step": quantum * std for channel, std in STD.items()}
    of = dataclasses.replace(of, sensors=dataclasses.replace(of.sensors, **sensors))
    return log_of(fly_whole(of, seed, suite, period, effects=[from_text(effect)] if effect else []))


def changed(log: Log, **columns: np.ndarray) -> Log:
    return dataclasses.replace(log, **columns)


def with_rows(log: Log, name: str, start: int, count: int, value: float | None) -> Log:
    """`count` rows of a channel replaced; None: by the first of them."""
    x = getattr(log, name).copy()
    x[start:start + count] = x[start] if value is None else value
    return changed(log, **{name: x})


def kept(log: Log, rows: np.ndarray) -> Log:
    return changed(log, **{name: getattr(log, name)[rows] for name in COLUMNS})


def kinds(found: DataCheck) -> list[tuple[str, str | None]]:
    for fault in found.faults:
        assert fault.message and fault.message.isprintable(), fault
    return [(fault.kind, fault.channel) for fault in found.faults]


def messages(found: DataCheck) -> str:
    return "; ".join(fault.message for fault in found.faults)


def judged(log: Log, name: str = "constant") -> list[tuple[str, str | None]]:
    return kinds(check(log, nominal(name)))


def good(log: Log, name: str = "constant") -> None:
    """Nothing is wrong, and every measured value may be used."""
    found = check(log, nominal(name))
    assert not found.is_bad, messages(found)
    assert found.usable.all()
    for channel in VALUES:
        assert np.array_equal(found.masks[channel], np.isfinite(getattr(log, channel))), channel


# ---- what is not a fault


def test_every_cause_of_the_catalogue_is_in_the_list():
    assert {effect.partition(":")[0] for effect in GROSS} == set(CATALOGUE)


@pytest.mark.parametrize(("effect", "name"), [
    pytest.param(effect, name, marks=[] if k % 2 == odd else [pytest.mark.campaign])
    for k, effect in enumerate(GROSS) for odd, name in enumerate(("constant", "vega_like"))])
def test_a_physical_effect_is_not_bad_data(effect, name):
    good(flown(name, 104, effect), name)


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("suite", ["flight", "ideal"])
@pytest.mark.parametrize("period", [0.005, 0.01, 0.02])
def test_a_clean_flight_is_not_bad_data(name, suite, period):
    good(flown(name, 105, "", suite, period), name)


@SOME
@given(NAMES, SEEDS, st.sampled_from(("", *GROSS)), st.sampled_from((0.5, 1.0, 2.0)),
       st.sampled_from((0.5, 1.0, 2.0, 5.0)),
       st.sampled_from((0.005, 0.01, 0.02)))
def test_neither_noise_nor_quantisation_nor_rate_is_bad_data(name, seed, effect, noise, quantum, period):
    good(flown(name, seed, effect, "flight", period, noise, quantum), name)


@given(NAMES, SEEDS, st.sets(st.sampled_from(OPTIONAL)), SENSED, st.floats(0.1, 5.0))
@SOME
def test_missing_columns_and_a_log_rounded_by_its_writer_are_not_bad_data(name, seed, missing, channel, steps):
    log = flown(name, seed)
    quantum = steps * STD[channel]
    log = changed(log, **{channel: np.round(getattr(log, channel) / quantum) * quantum})
    good(changed(log, **{column: np.full(len(log.t), np.nan) for column in missing}), name)


@SOME
@given(NAMES, SEEDS, st.integers(0, 99))
def test_jitter_and_one_odd_period_are_not_bad_data(name, seed, draw):
    log = flown(name, seed)
    rng = np.random.default_rng(draw)
    good(changed(log, t=log.t + 0.01 * rng.uniform(-0.2, 0.2, len(log.t))), name)
    later = log.t + np.where(np.arange(len(log.t)) > rng.integers(1, len(log.t)), rng.uniform(-0.005, 0.006), 0.0)
    good(changed(log, t=later), name)


@pytest.mark.parametrize(("half_width", "period"), [(0.002, 0.02), (0.01, 0.005), (0.035, 0.01)])
def test_a_nozzle_held_still_by_backlash_without_noise_is_not_stale(half_width, period):
    for name, seed in (("constant", 41), ("vega_like", 41), ("greensite_cr826", 41), ("vega_like", 42)):
        good(flown(name, seed, f"actuator_backlash:half_width={half_width}", "ideal", period), name)


def test_a_lost_vehicle_s_short_log_is_not_bad_data():
    log = flown("constant", 106, "control_loss:fraction=0.9,time=8")
    assert len(log.t) < 0.9 * DURATION / 0.01
    good(log)


@pytest.mark.parametrize("name", ["dircol", "ddp"])
def test_the_real_logs_are_good(real_logs: Path, name):
    pendulum = Nominal("pendulum", constant_profile(-20.0, 7.0), Sensors(0.002, 0.003, 0.07, 0.2))
    found = check(read_log(real_logs / f"dfki_pendulum_{name}.csv"), pendulum)
    assert not found.is_bad, messages(found)


@pytest.mark.parametrize("rows", [1, 2, 3, 10, 50, 100])
def test_short_logs_pass(rows):
    good(kept(flown("constant", 100), np.arange(1000, 1000 + rows)))


# ---- one channel


@given(NAMES, SEEDS, SENSED, st.integers(10, 60), st.floats(0.0, 1.0))
def test_stale_run(name, seed, channel, count, place):
    log = flown(name, seed)
    start = round(place * (len(log.t) - count))
    found = check(with_rows(log, channel, start, count, None), nominal(name))
    assert kinds(found) == [("stale", channel)]
    assert (~found.masks[channel]).sum() == count - 1 and not found.masks[channel][start + 1:start + count].any()
    assert f"{log.t[start]:.6g} s" in messages(found)


@pytest.mark.parametrize("value", [np.nan, 0.0])
@given(NAMES, SEEDS, st.sampled_from((*sorted(STD), "beta_cmd", "theta_ref")), SENSED, st.integers(5, 60),
       st.floats(0.0, 1.0))
def test_dropout_without_values_and_to_zero(value, name, seed, channel, sensed, count, place):
    log, channel = flown(name, seed), sensed if value == 0.0 else channel
    start = round(place * (len(log.t) - count))
    found = check(with_rows(log, channel, start, count, value), nominal(name))
    assert kinds(found) == [("dropout", channel)]
    assert not found.masks[channel][start:start + count].any()
    assert value == 0.0 or (~found.masks[channel]).sum() == count == found.faults[0].rows


@pytest.mark.parametrize("channel", sorted(STD))
def test_a_long_stale_run_of_a_quantised_channel_shows_by_its_jump(channel):
    """Ten seconds of a manoeuvre: the value it comes back to is many quanta away."""
    log = flown("constant", 101, "", "flight", 0.01, 1.0, 2.0)
    assert ("stale", channel) in judged(with_rows(log, channel, 850, 200 if channel == "theta" else 1500, None))


@given(NAMES, SEEDS, SENSED, st.floats(30.0, 3e3), st.booleans(), st.floats(0.0, 1.0))
def test_spike(name, seed, channel, sigmas, up, place):
    log = flown(name, seed)
    row = round(2 + place * (len(log.t) - 5))  # the outermost two rows are judged with less power
    value = getattr(log, channel)[row] + (sigmas if up else -sigmas) * STD[channel]
    found = check(with_rows(log, channel, row, 1, value), nominal(name))
    assert kinds(found) == [("spike", channel)]
    assert np.flatnonzero(~found.masks[channel]).tolist() == [row]


@pytest.mark.parametrize("channel", ["theta", "theta_dot", "beta", "beta_cmd", "theta_ref"])
@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e30, -99999.0])
def test_range(channel, value):
    found = check(with_rows(flown("constant", 100), channel, 1234, 2, value), nominal("constant"))
    assert kinds(found) == [("range", channel)]
    assert np.flatnonzero(~found.masks[channel]).tolist() == [1234, 1235]


# ---- stamps


@SOME
@given(SEEDS, st.integers(5, 3900))
def test_stamps_repeated_backward_missing_nonfinite(seed, row):
    log = flown("constant", seed)
    again = kept(log, np.sort(np.append(np.arange(len(log.t)), row)))
    back, blank = log.t.copy(), log.t.copy()
    back[row], blank[row] = back[row - 3], np.nan
    lost = np.delete(np.arange(len(log.t)), row)
    for bad, word, place in ((again, "repeated", row + 1), (changed(log, t=back), "backward", row),
                             (changed(log, t=blank), "no number", row), (kept(log, lost), "missing", None)):
        found = check(bad, nominal("constant"))
        assert kinds(found) == [("stamps", "t")] and word in messages(found)
        assert found.faults[0].rows == 1
        assert np.flatnonzero(~found.usable).tolist() == ([] if place is None else [place])


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=30))
def test_usable_stamps_of_anything_are_finite_and_increase(stamps):
    t = np.array(stamps, dtype=np.float64)
    usable = t[usable_rows(t)]
    assert np.isfinite(usable).all() and (np.diff(usable) > 0.0).all()


def test_every_lost_row_shows_through_a_jitter_of_a_fifth_of_the_period():
    """Steps are 0.6 to 1.4 periods where no row is lost and 1.6 at least where one is."""
    rng = np.random.default_rng(3)
    rows = np.arange(20_000)
    t = 0.01 * (rows + rng.uniform(-0.2, 0.2, len(rows)))
    lost = rows[7::40]
    kept_rows = np.setdiff1d(rows, lost)
    found = gaps(t[kept_rows], np.arange(len(kept_rows)))
    assert [before for before, _, _ in found] == t[lost - 1].tolist() and {rows for _, _, rows in found} == {1}
    assert gaps(t, rows) == []


def test_a_log_that_changes_its_rate_has_no_gap():
    t = np.concatenate((np.arange(100) * 0.01, 1.0 + np.arange(300) * 0.03))
    assert gaps(t, np.arange(len(t))) == []


# ---- between channels


@pytest.mark.parametrize("channel", [
    "theta", "theta_dot", "beta_cmd", "t",
    *(pytest.param(each, marks=pytest.mark.campaign) for each in ("beta", "theta_ref"))])
@SOME
@given(st.sampled_from(BUILT_IN), SEEDS, st.sampled_from((0.005, 0.01, 0.02)))
def test_degrees_and_milliseconds(channel, name, seed, period):
    log = flown(name, seed, "", "flight", period)
    values = getattr(log, channel)
    found = check(changed(log, **{channel: 1e3 * values if channel == "t" else np.degrees(values)}), nominal(name))
    assert kinds(found) == [("unit", channel)]
    assert ("milliseconds" if channel == "t" else f"{channel} looks like degrees") in messages(found)
    assert channel == "t" or not found.masks[channel].any()


@pytest.mark.parametrize("channel", ["theta_dot", "beta", "beta_cmd", "theta_ref"])
@SOME
@given(st.sampled_from(BUILT_IN), SEEDS, st.sampled_from((0.005, 0.01, 0.02)))
def test_sign(channel, name, seed, period):
    log = flown(name, seed, "", "flight", period)
    assert judged(changed(log, **{channel: -getattr(log, channel)}), name) == [("sign", channel)]


@pytest.mark.parametrize("pair", [("theta", "theta_dot"), ("beta", "beta_cmd"), ("theta", "beta"),
                                  ("theta", "theta_ref"), ("theta_dot", "beta")])
@SOME
@given(st.sampled_from(BUILT_IN), SEEDS, st.sampled_from((0.005, 0.01, 0.02)))
def test_swapped(pair, name, seed, period):
    first, second = pair
    log = flown(name, seed, "", "flight", period)
    found = check(changed(log, **{first: getattr(log, second), second: getattr(log, first)}), nominal(name))
    assert kinds(found) == [("swapped", None)]
    assert f"{first} and {second} look exchanged" in messages(found)


# ---- anything


@given(st.lists(st.sampled_from((0.0, 1e-3, -0.1, 7.0, np.nan, np.inf, -1e300, 5e-324)), min_size=7, max_size=700),
       st.integers(0, 99))
@example([0.0, np.nan, 0.0, 0.0, 0.0, np.nan, np.nan], 67)  # a reference whose attitude is masked
def test_never_raises(values, draw):
    rng = np.random.default_rng(draw)
    n = int(rng.integers(1, 300))
    columns = {name: rng.choice(values, n) for name in COLUMNS}
    if draw % 2:
        columns["t"] = 0.01 * np.arange(n)
    found = check(Log("any.csv", COLUMNS, (), **columns), nominal("constant"))
    assert found.is_bad == bool(kinds(found))
    assert all(mask.shape == (n,) and mask.dtype == bool for mask in (found.usable, *found.masks.values()))
    for channel, mask in found.masks.items():
        assert np.isfinite(columns[channel][mask]).all() and found.usable[mask].all()

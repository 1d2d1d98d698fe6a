"""What sensors add is found between columns, taken off, and told: a gyro's scale and lag, a scale of the nozzle's."""

import numpy as np
import pytest
from hidden.build import Build
from hidden.motion import run
from hidden.spec import Spec

import launchid
from launchid.judge.scale import between_scales
from launchid.log.check import checked
from launchid.log.log import log_of
from launchid.log.stamps import even_grid
from launchid.log.steps import step_of, with_steps

DURATION = 40.0   # s
NAMES = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot")


def flown(seed: int, gyro_scale: float = 1.0, attitude_late: float = 0.0, **knobs: float) -> dict[str, np.ndarray]:
    """A flight of the independent generator, 100 Hz, of the nominal `constant` (a6 2, k1 -7)."""
    b = Build(Spec(nominal="constant", seed=seed, duration=DURATION, reference="rough"))
    b.gyro_gain *= gyro_scale
    b.attitude_late += attitude_late
    b.set(**knobs)
    motion, clock, course = b.parts()
    rows = np.zeros((clock.steps // clock.log_every, len(NAMES)))
    run(motion, clock, course, rows)
    return {name: rows[:, k].copy() for k, name in enumerate(NAMES)}


def sensed(columns: dict[str, np.ndarray], nominal: str | None = "constant"):
    return checked(log_of(columns), None if nominal is None else launchid.load_nominal(nominal)).sensed


def identified(columns: dict[str, np.ndarray], **options):
    return launchid.identify(columns, "constant", window=10.0, **options)


@pytest.mark.filterwarnings("ignore")
def test_a_gyro_s_lag_is_found_and_taken_off():
    columns = flown(1, gyro_lag=0.02)
    (fault,) = sensed(columns).faults
    assert fault.channel == "theta_dot" and 15.0 < float(fault.message.split(" is ")[1].split(" ms")[0]) < 25.0
    made = identified(columns)
    assert all(e.valid and abs(e.k1 + 7.0) < 3.5 * e.k1_std and abs(e.a6 - 2.0) < 3.5 * e.a6_std
               for e in made.estimates)
    assert np.array_equal(made.log.theta_dot, columns["theta_dot"])   # as it was logged


@pytest.mark.filterwarnings("ignore")
def test_a_late_attitude_is_found_and_a_clean_log_has_nothing():
    (fault,) = sensed(flown(2, attitude_late=0.03)).faults
    assert fault.channel == "theta" and 25.0 < float(fault.message.split(" is ")[1].split(" ms")[0]) < 35.0
    for seed in range(3, 7):
        assert sensed(flown(seed)).faults == () and sensed(flown(seed), None).faults == ()


@pytest.mark.filterwarnings("ignore")
def test_k1_is_between_the_scales_of_the_nozzle_s_sensor_and_of_the_servo():
    columns = flown(7)
    scaled = columns | {"beta": 0.9 * columns["beta"]}
    assert sensed(scaled).nozzle_scale == pytest.approx(0.9, abs=0.004)
    for e in identified(scaled).estimates:
        assert e.valid and e.k1_std > 0.05 * abs(e.k1)
        assert abs(e.k1 + 7.0) < 2.5 * e.k1_std and abs(0.9 * e.k1 + 7.0) < 3.5 * e.k1_std
        assert e.xi[e.terms.index("beta"), 1] == e.k1 and abs(e.a6 - 2.0) < 3.5 * e.a6_std


@pytest.mark.filterwarnings("ignore")
def test_the_scale_of_one_changes_nothing_and_the_inverse_undoes():
    e = identified(flown(8)).estimates[0]
    assert between_scales(e, 1.0).k1 == e.k1 and between_scales(e, 1.0).k1_std == e.k1_std
    assert between_scales(between_scales(e, 1.1), 1.0 / 1.1).k1 == pytest.approx(e.k1, rel=1e-12)


def test_stamps_early_or_late_and_rounded_to_coarse_ticks_are_on_their_line():
    rng, even = np.random.default_rng(1), 0.01 * np.arange(3000)
    stamps = np.maximum.accumulate(0.008 * np.floor((even + 0.002 * rng.standard_normal(3000)) / 0.008))
    grid, period, tick = even_grid(stamps, is_twice=False)
    assert (period, tick) == (pytest.approx(0.01, rel=1e-4), pytest.approx(0.008))
    assert np.ptp(grid - even) < 1e-3
    kept = np.delete(np.arange(3000), np.arange(1500, 1510))   # ten rows lost
    late, *_ = even_grid(stamps[kept], is_twice=False)
    assert np.max(np.abs(late - late[0] - (even - even[0])[kept])) < 0.011


@pytest.mark.filterwarnings("ignore")
def test_a_column_in_another_unit_is_named_and_has_no_valid_window():
    columns = flown(9)
    for name, factor, words in (("theta_dot", 1000.0, "milliradians/s"), ("theta", 18000.0 / np.pi, "centidegrees")):
        seen = checked(log_of(columns | {name: factor * columns[name]}))
        assert words in seen.foreign
        assert not any(e.valid for e in identified(columns | {name: factor * columns[name]}).estimates)


def test_a_step_is_found_declared_and_refused_where_its_error_is_no_noise():
    columns, nominal = flown(10), launchid.load_nominal("constant")
    fine, coarse = (columns | {"theta": step * np.round(columns["theta"] / step)} for step in (1e-3, 2e-3))
    assert step_of(columns["theta"]) == 0.0 and step_of(np.round(fine["theta"], 5)) == pytest.approx(1e-3)
    assert with_steps(nominal, log_of(columns)) is nominal
    assert with_steps(nominal, log_of(fine)).sensors.theta_step == pytest.approx(1e-3)
    assert all(e.valid for e in identified(fine).estimates) and not sensed(fine).coarse
    with pytest.warns(launchid.DataWarning, match="steps of 0.002 rad"):
        assert not any(e.valid for e in identified(coarse).estimates)

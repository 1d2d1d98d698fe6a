"""Numbers of a log of commands alone, whose servo nobody saw, are as far off as their deviations say."""

import numpy as np
import pytest
from hobby_rocket import Rocket, fly

import launchid
from launchid.log.check import checked
from launchid.log.log import log_of


def off(seeds: range) -> np.ndarray:
    """Return the errors of a6 and k1 over their deviations (seeds, 2), of burns that are one window each."""
    rows = []
    for seed in seeds:
        rocket = Rocket()
        (e,) = launchid.identify(fly(rocket, seed), window="all").estimates
        assert e.valid
        a6 = np.mean([rocket.a6(t - rocket.pad) for t in np.linspace(e.t_start, e.t_end, 200)])
        rows.append([(e.a6 - a6) / e.a6_std, (e.k1 - rocket.k1) / e.k1_std])
    return np.array(rows)


def test_a_servo_that_nobody_saw_makes_k1_no_larger_than_its_deviation():
    """Over 6 burns of 3.8 s at 50 Hz: with the commands smoothed between the rows their mean was 1.4 too large."""
    made = off(range(300, 306))
    assert np.all(np.abs(made.mean(axis=0)) < 0.9) and np.all(np.sqrt(np.mean(made**2, axis=0)) < 1.5)


@pytest.mark.campaign
def test_intervals_of_commands_alone_hold():
    made = off(range(400, 460))
    assert np.all(np.mean(np.abs(made) < 1.96, axis=0) >= 0.90)
    assert np.all(np.abs(made.mean(axis=0)) < 0.4) and np.all(np.sqrt(np.mean(made**2, axis=0)) < 1.2)


def test_a_burn_of_2_s_at_50_hz_has_a_first_nominal():
    """Of 95 rows: k1 within its deviation's reach, and the deviation is no larger than 8 %."""
    for seed in (500, 501):
        rocket = Rocket(burn=2.0)
        made = launchid.nominal(fly(rocket, seed)).numbers
        assert abs(made.k1.mean() - rocket.k1) < 3.0 * made.k1_std.mean() < 0.24 * abs(rocket.k1)


def test_a_gyro_at_its_limit_is_the_reason():
    """A first nominal that cannot be told names the end stop before what follows from it, and no foreign motion."""
    columns = fly(Rocket(), 1)
    columns["theta_dot"] = np.clip(columns["theta_dot"], -0.5, 0.5)
    with pytest.raises(launchid.InputError, match="theta_dot is at an end stop") as said:
        launchid.nominal(columns)
    assert "not the slope" not in str(said.value)


def test_lines_over_a_gyro_at_its_limit_are_no_other_motion():
    for seed in (1, 2):
        for limit in (0.3, 0.5):
            columns = fly(Rocket(), seed)
            columns["theta_dot"] = np.clip(columns["theta_dot"], -limit, limit)
            faults = checked(log_of(columns)).faults
            assert {fault.kind for fault in faults} == {"stale"}

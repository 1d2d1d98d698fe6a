"""A notch that follows the frequency which the estimator on board tracks."""

import dataclasses
import math
from unittest import mock

import numpy as np
import pytest
from shortened import short
from test_sim import refused

from launchid.monte_carlo.requirement.flight import Flyer, flight_job
from sim import following
from sim.disturbance_draws import drawn_modes
from sim.flight import Flight, fly, fly_whole
from sim.nominal import Nominal, load_nominal, write_nominal
from sim.sections import Follow, constant, notch

LAUNCHER = short(14.0, "cr826_max_q")
DECLARED = 18.9  # rad/s


def off(factor: float, of: Nominal = LAUNCHER) -> Nominal:
    """The launcher with another bending frequency."""
    return dataclasses.replace(of, bending=(dataclasses.replace(of.bending[0], frequency=constant(factor * DECLARED)),))


def with_filters(*filters, of: Nominal = LAUNCHER) -> Nominal:
    return dataclasses.replace(of, controller=dataclasses.replace(of.controller, filters=filters))


FOLLOWS, = LAUNCHER.controller.filters
FIXED = with_filters(dataclasses.replace(FOLLOWS, follow=None))


def centres(true: Nominal) -> tuple[Flight, np.ndarray]:
    """The flight, and the frequencies [rad/s] that its notch was given."""
    found, tuned = [], following.tune

    def noted(vehicle, filters):
        b = filters[0].b
        found.append(math.acos(-b[1] / (b[0] + b[2])) / LAUNCHER.controller.period)
        tuned(vehicle, filters)

    with mock.patch.object(following, "tune", noted):
        return fly_whole(true, 3, believed=LAUNCHER), np.array(found)


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_it_finds_the_mode(factor):
    flight, found = centres(off(factor))
    assert not flight.lost and found[:2] == pytest.approx(DECLARED, abs=1.0)
    assert np.abs(found[45:] / (factor * DECLARED) - 1.0).max() < 0.02


def test_it_holds_what_a_fixed_one_loses():
    assert fly_whole(off(1.2, FIXED), 3).lost


def test_without_room_to_follow_it_is_the_fixed_one():
    tied = with_filters(dataclasses.replace(FOLLOWS, follow=dataclasses.replace(FOLLOWS.follow, reach=0.0)))
    for name in ("theta", "beta_cmd"):
        assert np.allclose(getattr(fly_whole(tied, 3), name), getattr(fly_whole(FIXED, 3), name), rtol=0.0, atol=1e-12)


def test_the_log_does_not_change_the_flight():
    """One sample at a time, or rows of another period: the same bits."""
    flight = fly_whole(LAUNCHER, 3)
    assert np.array(list(flight.samples())).tobytes() == np.array(list(fly(LAUNCHER, 3))).tobytes()
    for period, every in ((0.02, 2), (0.03, 3), (0.005, 0.5), (0.004, 0.4)):
        other = fly_whole(LAUNCHER, 3, period=period)
        both = np.intersect1d(flight.t, other.t)
        assert len(both) == len(range(0, len(flight.t), math.lcm(round(10 * every), 10) // 10))
        for name in ("theta", "beta_cmd", "beta"):
            assert np.array_equal(getattr(flight, name)[np.isin(flight.t, both)],
                                  getattr(other, name)[np.isin(other.t, both)]), (period, name)


def test_centre_is_the_tracked_frequency_within_reach_else_the_declared():
    own = Follow("bending1", 20.0, 0.01, 0.4, 0.25)
    assert [own.centre(x) for x in (21.0, 40.0, 1.0, math.nan)] == [21.0, 25.0, 15.0, 20.0]
    moved = dataclasses.replace(notch(0.01, 20.0, 0.01, 0.4), follow=own).tuned(21.0, 0.01)
    assert (moved.b, moved.a) == (notch(0.01, 21.0, 0.01, 0.4).b, notch(0.01, 21.0, 0.01, 0.4).a)


def test_it_reads_back(tmp_path):
    write_nominal(LAUNCHER, tmp_path / "n.toml")
    assert load_nominal(tmp_path / "n.toml").controller == LAUNCHER.controller


@pytest.mark.parametrize(("change", "expected"), [
    (('"bending1"', '"bending2"'), "controller.filters[0].follow = 'bending2': expected a mode of this file: "
                                   '"slosh1" or "slosh2" or "bending1"'),
    (("follow_range = 0.3", "follow_range = 1.0"), "controller.filters[0].follow_range = 1.0: expected a share below "),
    (('follow = "bending1"', ""), "key 'controller.filters[0].follow_range' without follow"),
    (('kind = "notch"', 'kind = "lowpass"'), "unknown key 'controller.filters[0].depth_damping'")])
def test_a_wrong_follow_is_named(tmp_path, change, expected):
    text = load_text()
    assert change[0] in text
    assert expected in refused(tmp_path / "n.toml", text.replace(*change))


def load_text() -> str:
    with open(load_nominal("cr826_max_q").path) as file:
        return file.read()


def test_a_campaign_draws_the_modes_and_follows_them():
    drawn = drawn_modes(LAUNCHER, 7)
    assert drawn.bending[0].frequency != LAUNCHER.bending[0].frequency and drawn.slosh[0] == LAUNCHER.slosh[0]
    row = Flyer(LAUNCHER)(flight_job(LAUNCHER, 7))
    again = Flyer(LAUNCHER)(flight_job(LAUNCHER, 7))
    assert row == again and row["lost"] == 0


def test_modes_without_a_sigma_are_not_drawn():
    known = dataclasses.replace(LAUNCHER, slosh=LAUNCHER.slosh[:1], bending=())
    assert drawn_modes(known, 7).slosh == known.slosh

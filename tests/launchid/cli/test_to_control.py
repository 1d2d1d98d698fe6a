"""What was identified as python-control's systems: poles, responses, covariance, refusals."""

import numpy as np
import pytest

import launchid
from launchid.log.log import flown_log
from sim.flight import fly_whole
from sim.nominal import load_nominal

pytest.importorskip("control")


@pytest.fixture(scope="module")
def found():
    return launchid.identify(flown_log(fly_whole(load_nominal("constant"), 1)), window=5.0, formulation="integral")


def test_the_systems_are_the_windows(found):
    window = [e for e in found.estimates if e.valid][-1]
    plant = found.to_control()
    assert plant.t == 0.5 * (window.t_start + window.t_end)
    assert np.sort(plant.state_space.poles().real) == pytest.approx([-window.a6**0.5, window.a6**0.5])
    omega = np.array([0.5, 3.0, 10.0])
    expected = window.k1 / (-omega**2 - window.a6)
    assert plant.transfer_function(1j * omega) == pytest.approx(expected)
    assert plant.state_space(1j * omega)[0, 0] == pytest.approx(expected)
    assert plant.state_space.input_labels == ["beta"] and plant.state_space.output_labels == ["theta", "theta_dot"]


def test_its_covariance_is_the_estimates(found):
    window = next(e for e in found.estimates if e.valid)
    plant = found.to_control(window.t_start)
    assert np.sqrt(np.diag(plant.covariance)) == pytest.approx([window.a6_std, window.k1_std])
    assert plant.covariance[0, 1] == pytest.approx(window.a6_k1_corr * window.a6_std * window.k1_std)


def test_a_time_without_a_valid_window_is_refused(found):
    with pytest.raises(launchid.InputError, match="no window is valid at 1000 s"):
        found.to_control(1000.0)


def test_terms_of_no_linear_plant_are_refused():
    flight = flown_log(fly_whole(load_nominal("constant"), 1))
    found = launchid.identify(flight, window=20.0, formulation="integral", library="sin(theta),beta")
    with pytest.raises(launchid.UsageError, match="sin"):
        found.to_control()

"""a6 and k1 leave the profile steadily: windows and the tracked estimate hold them where such a drift is declared."""

import dataclasses

import numpy as np
import pytest

from launchid_core import Config, Estimate, Estimator
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal, nominal_lines
from sim.onboard import onboard_model
from sim.sections import Profile

SEEDS = range(3)
RATES = {"both": (0.1, 0.1), "a6": (0.2, 0.0), "k1": (0.0, -0.2)}  # 1/min


def drifting(nominal: Nominal, a6_rate: float, k1_rate: float) -> Nominal:
    """The vehicle whose a6 and k1 leave the nominal's at these rates [1/min]."""
    assert nominal.simulation is not None
    t = np.linspace(0.0, nominal.simulation.duration, 141)
    a6, k1 = nominal.vehicle.at(t)
    return dataclasses.replace(nominal, vehicle=Profile(t, a6 * (1.0 + a6_rate * t / 60.0),
                                                        k1 * (1.0 + k1_rate * t / 60.0)))


def estimates(nominal: Nominal, vehicle: Nominal, seed: int) -> list[Estimate]:
    config = Config(window=5.0, sample_period=0.01, formulation="filtered", model=onboard_model(nominal))
    return Estimator(config).replay(fly_whole(vehicle, seed).samples())


def errors(vehicle: Nominal, found: list[Estimate]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of a6 and k1 over their standard deviations, of valid windows (n, 2) and of the tracked estimate."""
    windows, tracked = [], []
    for each in found:
        for at, t, into in ((each, (each.t_start + each.t_end) / 2.0, windows), (each.tracked, each.t_end, tracked)):
            a6, k1 = (float(x[0]) for x in vehicle.vehicle.at(np.array([t])))
            if at.valid:
                into.append([(at.a6 - a6) / at.a6_std, (at.k1 - k1) / at.k1_std])
    return np.array(windows), np.array(tracked)


@pytest.mark.parametrize("rates", RATES.values(), ids=RATES)
@pytest.mark.parametrize("name", ["constant", "vega_like"])
def test_intervals_hold_a_drift_that_the_range_allows(name, rates):
    nominal = load_nominal(name)
    vehicle = drifting(nominal, *rates)
    found = [estimates(nominal, vehicle, seed) for seed in SEEDS]
    assert np.mean([each.valid for flight in found for each in flight]) > 0.9
    for error in map(np.concatenate, zip(*(errors(vehicle, flight) for flight in found), strict=True)):
        assert np.all(np.mean(np.abs(error) < 1.96, axis=0) > 0.85)
        assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 1.3)
        assert np.max(np.abs(error)) < 4.5


def test_a_window_without_drift_declared_does_not_hold_one():
    nominal = dataclasses.replace(load_nominal("constant"), a6_drift=0.0, k1_drift=0.0)
    vehicle = drifting(nominal, 0.2, 0.0)
    windows, _ = errors(vehicle, estimates(nominal, vehicle, 0))
    assert np.sqrt(np.mean(windows**2)) > 2.0


def test_a_drift_too_slow_to_matter_leaves_the_window_as_it_is():
    """The law of the limit: a declared spread that goes to 0 is no drift."""
    nominal = load_nominal("constant")
    still, slow = (dataclasses.replace(nominal, a6_drift=rate, k1_drift=rate) for rate in (0.0, 1e-7))
    pairs = zip(estimates(still, nominal, 1), estimates(slow, nominal, 1), strict=True)
    windows = [(a, b) for a, b in pairs if a.valid][:3]  # the members of the tracker differ later
    assert windows
    for a, b in windows:
        assert b.a6 == pytest.approx(a.a6, abs=0.2 * a.a6_std)
        assert b.a6_std == pytest.approx(a.a6_std, rel=0.02)


def test_where_the_vehicle_moves_a_declared_drift_hardly_widens_windows():
    nominal = load_nominal("vega_like")
    still = dataclasses.replace(nominal, a6_drift=0.0, k1_drift=0.0)
    with_drift, without = (np.median([e.a6_std / abs(e.a6) for e in estimates(each, nominal, 2) if e.valid])
                           for each in (nominal, still))
    assert with_drift < 1.1 * without


def test_the_drift_rates_of_a_nominal_default_to_its_range_over_the_flight():
    nominal = load_nominal("constant")
    assert nominal.drift_rates() == pytest.approx((0.25 * 60.0 / 70.0,) * 2)
    assert dataclasses.replace(nominal, k1_drift=0.02).drift_rates()[1] == 0.02
    assert dataclasses.replace(nominal, uncertainty=None).drift_rates() == (0.0, 0.0)


def test_a_nominal_file_keeps_its_drift_rates(tmp_path):
    path = tmp_path / "nominal.toml"
    path.write_text("\n".join(nominal_lines(dataclasses.replace(load_nominal("constant"), a6_drift=0.1), path)))
    assert load_nominal(path).drift_rates() == pytest.approx((0.1, 0.25 * 60.0 / 70.0))
    path.write_text(path.read_text().replace("a6_drift = 0.1", "a6_drift = -0.1"))
    with pytest.raises(InputError, match=r"uncertainty\.a6_drift"):
        load_nominal(path)

"""Slosh and bending on board: a6 and k1 beside them, and their own frequency and size."""

import dataclasses
import functools
import math

import numpy as np
import pytest

from launchid.report.identification import modes_json
from launchid_core import Config, Estimate, Estimator, Oscillator
from sim.effects import from_text
from sim.errors import InputError
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model
from sim.sections import Bending, InTime, Slosh, constant

CONSTANT = load_nominal("constant")
A6, K1 = 0.9, 1.1  # of the nominal's
SLOSH = Slosh(constant(3.5), constant(0.05), constant(0.01))
BENDING = Bending(constant(20.0), constant(0.02), constant(0.01))
UNKNOWN = {"frequency_sigma": 0.1}


def with_modes(seconds: float = 40.0, **sections) -> Nominal:
    simulation = dataclasses.replace(CONSTANT.simulation, duration=seconds)
    return dataclasses.replace(CONSTANT, simulation=simulation, **sections)


@functools.cache
def flown(nominal: Nominal, seed: int) -> Flight:
    return fly_whole(nominal, seed, a6_factor=A6, k1_factor=K1)


def estimates(flight: Flight, declared: Nominal) -> list[Estimate]:
    config = Config(window=5.0, formulation="filtered", model=onboard_model(declared, flight.period))
    return Estimator(config).replay(flight.rows())


def errors(found: list[Estimate]) -> np.ndarray:
    """Errors of a6 and k1 in standard deviations, by window; NaN where it was refused."""
    return np.array([((e.a6 - 2.0 * A6) / e.a6_std, (e.k1 + 7.0 * K1) / e.k1_std) for e in found])


def well_told(found: list[Estimate]) -> None:
    off = errors(found)
    assert np.isfinite(off).all(), [e.status.name for e in found]
    assert np.abs(off).max() < 4.5 and np.sqrt(np.mean(off**2)) < 1.5, off


# ---- the answer


def test_known_modes_mislead_nobody_and_cost_little():
    nominal = with_modes(slosh=(SLOSH,), bending=(BENDING,))
    calm = [e.k1_std for e in estimates(flown(with_modes(), 5), with_modes())]
    for seed in (5, 6):
        found = estimates(flown(nominal, seed), nominal)
        well_told(found)
        assert np.median([e.k1_std for e in found]) < 1.3 * np.median(calm)
        assert [mode.name for mode in found[-1].modes] == ["slosh1", "bending1"]
        assert found[-1].modes[0].frequency == 3.5 and found[-1].modes[0].frequency_std == 0.0


@pytest.mark.parametrize("off", [0.08, -0.08])
def test_a_bending_mode_that_is_off_is_found(off):
    true = dataclasses.replace(BENDING, frequency=constant(20.0 * (1.0 + off)), gain=constant(0.02 * (1.0 - 3.0 * off)))
    declared = dataclasses.replace(BENDING, gain_sigma=0.5, **UNKNOWN)
    found = estimates(flown(with_modes(bending=(true,)), 7), with_modes(bending=(declared,)))
    well_told(found)
    for e in found[2:]:  # 15 s: it has been excited
        (mode,) = e.modes
        assert abs(mode.frequency - true.frequency.value[0]) < 4.0 * mode.frequency_std and mode.frequency_std < 0.2
        assert abs(mode.size - true.gain.value[0]) < 4.0 * mode.size_std and mode.size_std < 0.002


def test_a_slosh_that_is_off_is_found():
    true = dataclasses.replace(SLOSH, frequency=constant(3.75), coupling=constant(0.06))
    declared = dataclasses.replace(SLOSH, coupling_sigma=0.5, **UNKNOWN)
    found = estimates(flown(with_modes(60.0, slosh=(true,)), 8), with_modes(60.0, slosh=(declared,)))
    well_told(found)
    (mode,) = found[-1].modes
    assert abs(mode.frequency - 3.75) < 3.0 * mode.frequency_std and mode.frequency_std < 0.2
    assert abs(mode.size - 0.06) < 3.0 * mode.size_std and mode.size_std < 0.015


def test_a_mode_that_is_declared_and_absent_gets_no_size():
    calm = np.median([e.k1_std for e in estimates(flown(with_modes(), 9), with_modes())])
    for section, mode, wider in (("slosh", SLOSH, 2.0), ("bending", BENDING, 1.3)):
        sigma = {"coupling_sigma" if section == "slosh" else "gain_sigma": 0.5, **UNKNOWN}
        found = estimates(flown(with_modes(), 9), with_modes(**{section: (dataclasses.replace(mode, **sigma),)}))
        well_told(found)
        (told,) = found[-1].modes
        assert abs(told.size) < 4.0 * told.size_std and told.frequency_std == pytest.approx(0.1 * told.frequency)
        assert np.median([e.k1_std for e in found]) < wider * calm


@pytest.mark.parametrize("sections", [{"slosh": (SLOSH,)}, {"bending": (BENDING,)}], ids=["slosh", "bending"])
def test_a_mode_that_is_not_declared_is_seen(sections):
    """The positive control."""
    found = estimates(flown(with_modes(**sections), 5), with_modes())
    assert np.mean([e.valid for e in found]) < 0.5


# ---- the laws


def test_the_effect_of_the_same_numbers_is_the_same_model():
    as_effects = with_modes(effects=(from_text("bending:frequency=20,gain=0.02,damping_ratio=0.01"),
                                     from_text("slosh:frequency=3.5,coupling=0.05,damping_ratio=0.01")))
    assert onboard_model(as_effects) == onboard_model(with_modes(slosh=(SLOSH,), bending=(BENDING,)))


def test_a_frequency_over_time_is_followed():
    swept = dataclasses.replace(BENDING, frequency=InTime((0.0, 40.0), (18.0, 24.0)))
    nominal = with_modes(bending=(swept,))
    found = estimates(flown(nominal, 5), nominal)
    well_told(found)
    assert found[3].modes[0].frequency == pytest.approx(21.0)


def test_a_gyro_that_sees_another_bending_than_the_attitude_sensor():
    seen = dataclasses.replace(BENDING, gyro_gain=constant(-0.01), gain_sigma=0.5, **UNKNOWN)
    nominal = with_modes(bending=(seen,))
    found = estimates(flown(nominal, 5), nominal)
    well_told(found)
    assert found[-1].modes[0].size == pytest.approx(0.02, abs=4.0 * found[-1].modes[0].size_std)


def test_in_json_a_mode_has_its_numbers_by_name():
    nominal = with_modes(10.0, slosh=(dataclasses.replace(SLOSH, **UNKNOWN),), bending=(BENDING,))
    said = modes_json(estimates(flown(nominal, 5), nominal)[-1])
    assert list(said) == ["slosh1", "bending1"] and list(said["slosh1"]) == [
        "frequency", "frequency_std", "coupling", "coupling_std"]
    assert said["bending1"]["gain"] == 0.02 and said["bending1"]["gain_std"] == 0.0


def test_what_the_modes_share_with_a6_and_k1_is_told():
    """A larger k1 in size makes more of the rate of the same nozzle, as a larger gain does."""
    nominal = with_modes(10.0, bending=(dataclasses.replace(BENDING, **UNKNOWN, gain_sigma=0.5),))
    for seed in (100, 101, 102):
        e = estimates(flown(nominal, seed), nominal)[-1]
        (mode,), covariance = e.modes, e.modes_covariance
        assert covariance.shape == (4, 4) and not covariance.flags.writeable
        assert np.linalg.eigvalsh(covariance).min() > 0.0
        assert covariance[2, 2] == pytest.approx(mode.frequency_std**2)
        assert 0.0 < covariance[3, 3] <= mode.size_std**2 * (1.0 + 1e-9)   # and what the frequency's doubt makes of it
        std = np.sqrt(np.diag(covariance))
        assert 0.05 < covariance[1, 3] / (std[1] * std[3]) < 0.4


# ---- degenerate cases


def test_known_modes_share_nothing():
    nominal = with_modes(10.0, slosh=(SLOSH,), bending=(BENDING,))
    e = estimates(flown(nominal, 5), nominal)[-1]
    assert e.modes_covariance.shape == (6, 6) and not e.modes_covariance[2:].any()
    assert estimates(flown(with_modes(10.0), 5), with_modes(10.0))[-1].modes_covariance.shape == (0, 0)


def test_a_gap_begins_a_mode_anew():
    nominal = with_modes(slosh=(SLOSH,), bending=(BENDING,))
    rows = flown(nominal, 5).rows()
    config = Config(window=5.0, formulation="filtered", model=onboard_model(nominal))
    found = Estimator(config).replay(np.concatenate([rows[:1200], rows[1300:]]))
    well_told([found[0], found[1], *found[3:]])


def test_a_mode_of_no_size_is_none():
    assert onboard_model(with_modes(slosh=(dataclasses.replace(SLOSH, coupling=constant(0.0)),))).modes == ()


def test_too_many_modes_are_one_line():
    effects = (from_text("slosh:frequency=3.5,coupling=0.05"),) * 3
    with pytest.raises(InputError, match="at most 3"):
        onboard_model(with_modes(slosh=(SLOSH,), effects=effects))


@pytest.mark.parametrize("wrong", [{"kind": "flutter"}, {"t": ()}, {"frequency": (0.0,)}, {"size": (math.nan,)},
                                   {"damping_ratio": (-0.1,)}, {"frequency_sigma": -1.0}], ids=str)
def test_wrong_numbers_of_a_mode_are_named(wrong):
    given = {"kind": "slosh", "t": (0.0,), "frequency": (3.5,), "size": (0.05,), "damping_ratio": (0.01,)}
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Oscillator(**given | wrong)

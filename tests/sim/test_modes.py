"""[[slosh]] and [[bending]] of a nominal: flown as the effects of the same numbers, read and written."""

import dataclasses
import math

import numpy as np
import pytest

from sim.effects import from_text
from sim.errors import InputError
from sim.flight import fly_whole, prepare
from sim.nominal import load_nominal, rewrite_nominal, write_nominal
from sim.sections import Bending, InTime, Nominal, Slosh, constant

SIMULATION = load_nominal("constant").simulation
assert SIMULATION is not None
CONSTANT = dataclasses.replace(load_nominal("constant"), simulation=dataclasses.replace(SIMULATION, duration=12.0))
SLOSH = Slosh(constant(3.5), constant(0.05), constant(0.01))
BENDING = Bending(constant(20.0), constant(0.02), constant(0.01))
AS_EFFECTS = ("slosh:frequency=3.5,coupling=0.05,damping_ratio=0.01",
              "bending:frequency=20,gain=0.02,damping_ratio=0.01")


def flown(nominal: Nominal, seed: int = 3) -> np.ndarray:
    return fly_whole(nominal, seed).rows()


@pytest.mark.parametrize("section, mode, text", [("slosh", SLOSH, AS_EFFECTS[0]), ("bending", BENDING, AS_EFFECTS[1])])
def test_a_mode_flies_as_the_effect_of_the_same_numbers(section, mode, text):
    declared = dataclasses.replace(CONSTANT, **{section: (mode,)})
    effect = dataclasses.replace(CONSTANT, effects=(from_text(text),))
    assert np.array_equal(flown(declared), flown(effect), equal_nan=True)
    assert not np.array_equal(flown(declared), flown(CONSTANT), equal_nan=True)


def test_several_modes_fly_at_once():
    others = (dataclasses.replace(SLOSH, frequency=constant(5.0)),
              dataclasses.replace(BENDING, frequency=constant(35.0)))
    nominal = dataclasses.replace(CONSTANT, slosh=(SLOSH, others[0]), bending=(BENDING, others[1]))
    effects = tuple(map(from_text, (AS_EFFECTS[0], AS_EFFECTS[0].replace("3.5", "5"), AS_EFFECTS[1],
                                    AS_EFFECTS[1].replace("20", "35"))))
    np.testing.assert_allclose(flown(nominal), flown(dataclasses.replace(CONSTANT, effects=effects)), atol=1e-12)


def test_a_number_over_time_that_does_not_change_is_the_constant():
    still = dataclasses.replace(SLOSH, frequency=InTime((0.0, 10.0), (3.5, 3.5)))
    assert np.array_equal(flown(dataclasses.replace(CONSTANT, slosh=(still,))),
                          flown(dataclasses.replace(CONSTANT, slosh=(SLOSH,))), equal_nan=True)


def test_a_frequency_over_time_is_flown():
    """Free bending, started by a command, crosses zero as often as its frequency says at each time."""
    swept = Bending(InTime((0.0, 40.0), (10.0, 20.0)), constant(0.02), constant(0.0))
    nominal = dataclasses.replace(load_nominal("constant"), bending=(swept,))
    vehicle, steps = prepare(nominal, 0, "flight", None, 1.0, 1.0)
    assert vehicle.tuning is not None and vehicle.tuning.shape == (1, 3, steps)
    assert math.sqrt(vehicle.tuning[0, 0, 20000]) == pytest.approx(15.0)


def test_the_gyro_has_a_gain_of_its_own():
    plain = fly_whole(dataclasses.replace(CONSTANT, bending=(BENDING,)), 3, "ideal")
    seen = {}
    for gain, gyro in ((0.02, 0.01), (0.0, 0.02), (0.02, 0.0)):
        mode = dataclasses.replace(BENDING, gain=constant(gain), gyro_gain=constant(gyro))
        seen[gain, gyro] = fly_whole(dataclasses.replace(CONSTANT, bending=(mode,)), 3, "ideal")
    calm = fly_whole(CONSTANT, 3, "ideal")
    early = slice(0, 300)  # the loop has hardly answered
    for (gain, gyro), flight in seen.items():
        theta, rate = (getattr(plain, name)[early] - getattr(calm, name)[early] for name in ("theta", "theta_dot"))
        assert np.ptp(flight.theta[early] - calm.theta[early]) == pytest.approx(gain / 0.02 * np.ptp(theta), abs=1e-5)
        assert np.ptp(flight.theta_dot[early] - calm.theta_dot[early]) == pytest.approx(
            gyro / 0.02 * np.ptp(rate), abs=3e-4)


TEXT = """name = "modes"
[vehicle]
a6 = 2.0
k1 = -7.0
[sensors]
period = 0.01
theta_std = 1e-4
theta_dot_std = 1e-4
beta_std = 1e-4
# the first tank
[[slosh]]
frequency = {t = [0.0, 60.0], value = [3.0, 4.0]}
coupling = 0.05
coupling_sigma = 0.5
[[bending]]
frequency = 20
gain = 0.02
gyro_gain = -0.01
frequency_sigma = 0.1
"""


def test_modes_are_read_and_written_back(tmp_path):
    path = tmp_path / "modes.toml"
    path.write_text(TEXT)
    nominal = load_nominal(path)
    assert nominal.slosh == (Slosh(InTime((0.0, 60.0), (3.0, 4.0)), constant(0.05), coupling_sigma=0.5),)
    assert nominal.bending == (Bending(constant(20.0), constant(0.02), gyro_gain=constant(-0.01), frequency_sigma=0.1),)
    write_nominal(nominal, tmp_path / "anew.toml")
    again = load_nominal(tmp_path / "anew.toml")
    assert (again.slosh, again.bending) == (nominal.slosh, nominal.bending)
    more = dataclasses.replace(nominal, bending=(*nominal.bending, BENDING))
    rewrite_nominal(more, tmp_path / "more.toml")
    text = (tmp_path / "more.toml").read_text()
    assert "# the first tank" in text and load_nominal(tmp_path / "more.toml").bending == more.bending
    assert "modes: slosh, bending" in nominal.summary()


@pytest.mark.parametrize("old, new, said", [
    ("frequency = 20", "frequency = -1", "bending[0].frequency = -1.0: expected a number above 0"),
    ("frequency = 20\n", "", "key 'bending[0].frequency' is missing"),
    ("gain = 0.02", "gains = 0.02", "unknown key 'bending[0].gains'"),
    ("coupling = 0.05", "coupling = 11", "slosh[0].coupling = 11.0"),
    ("value = [3.0, 4.0]", "value = [3.0]", "increasing times"),
    ("t = [0.0, 60.0]", "t = [60.0, 0.0]", "increasing times"),
    ("gyro_gain = -0.01", "gyro_gain = {t = [0.0, 1.0], value = [0.0, 1.0]}", "the same share of gain"),
    ("coupling_sigma = 0.5", "coupling_sigma = -0.5", "at least 0"),
    ("[[bending]]", "[bending]", "[[bending]] tables"),
    ("[[bending]]", "[[bending]]\n" * 4, "missing"),
])
def test_wrong_modes_are_one_line(old, new, said, tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(InputError) as error:
        load_nominal(path)
    assert said in str(error.value) or "at most 3" in str(error.value)

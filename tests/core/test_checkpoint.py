"""A saved state: from every sample of three windows it goes on to the same bits; anything else is refused by name."""

import dataclasses
import zlib

import numpy as np
import pytest
from cut import fed
from hypothesis import given
from hypothesis import strategies as hs
from shortened import CALM, WINDY

from launchid.robustness.level import ranged_model
from launchid_core import Config, Estimator, Sample, Status, checkpoint
from sim.effects import from_text
from sim.flight import fly
from sim.nominal import load_nominal
from sim.onboard import onboard_model

PERIOD = 0.01
WINDOW = 0.25           # s: 25 samples, no multiple of the filter's blocks of ten
THREE_WINDOWS = 75      # samples
BEFORE = 630            # samples: control is lost at 6 s, found within the three windows or before, sized after them
FORMER_LAYOUT = bytes.fromhex("96bd1afd7e577a24ae06e6d04e9b42c9")  # of "integral", as long, before memory was one table
LOST = from_text("control_loss:fraction=0.4,time=6")


def config(**choices) -> Config:
    return Config(**{"window": WINDOW, "sample_period": PERIOD} | choices)


CONFIGS = {
    "integral": config(compression=2, seed=7, library="linear"),
    "difference": config(formulation="difference", library="lpv"),
    "measured": config(formulation="measured", compression=2, seed=3),
    "calm": config(formulation="filtered", model=onboard_model(CALM)),
    "range": config(formulation="filtered", model=ranged_model(load_nominal("vega_like"))),
    "terms": config(formulation="filtered", model=onboard_model(CALM), library="quadratic"),
    "wind": config(formulation="filtered", model=onboard_model(WINDY)),
}


@pytest.fixture(scope="module")
def samples() -> dict[str, list[Sample]]:
    """Flights that lose control efficiency, by the name of their configuration."""
    def flown(nominal, suite: str) -> list[Sample]:
        return [sample for sample, _ in zip(fly(nominal, seed=3, suite=suite, effects=[LOST], period=PERIOD),
                                            range(1000), strict=False)]

    return {name: flown(load_nominal("vega_like") if name == "range" else WINDY if name == "wind" else CALM,
                        "ideal" if name == "measured" else "flight") for name in CONFIGS}


def words(estimator: Estimator) -> str:
    """Everything that leaves an estimator, with every bit that a repr keeps."""
    estimate = estimator.estimate()
    numbers = None if estimate is None else [
        value.tolist() if isinstance(value, np.ndarray) else value
        for value in (getattr(estimate, field.name) for field in dataclasses.fields(estimate))]
    return repr((numbers, estimator.changes(), estimator.noise_levels, estimator.counts))


@pytest.mark.parametrize("name", CONFIGS)
def test_from_every_sample_of_three_windows_it_goes_on_to_the_same_bits(name, samples):
    flight = samples[name][:BEFORE + THREE_WINDOWS + 10]
    one, other = fed(Estimator(CONFIGS[name]), flight[:BEFORE]), Estimator(CONFIGS[name])
    states = []
    for sample in flight[BEFORE:]:
        states.append(one.save())
        one.update(sample)
    end, said = one.save(), words(one)
    assert len(set(states)) == len(states)
    for k in range(0, THREE_WINDOWS, 1 if name in ("integral", "wind") else 7):  # 7: no divisor of a window or a block
        state = states[k]
        other.restore(state)  # over whatever the turn before left
        assert other.save() == state
        fed(other, flight[BEFORE + k:])
        assert other.save() == end, f"saved at sample {BEFORE + k}"
        assert words(other) == said
    if CONFIGS[name].formulation == "filtered":
        assert one.estimate().tracked is not None
        assert (one.estimate().uncertainty is not None) == (name == "range")
        assert one.changes() or name == "wind"


def test_what_is_saved_before_the_first_sample_is_a_reset():
    estimator = Estimator(CONFIGS["integral"])
    new = estimator.save()
    fed(estimator, [Sample(PERIOD * k, 0.1 * k, 0.0, 0.2) for k in range(60)])
    assert estimator.save() != new
    estimator.reset()
    assert estimator.save() == new


def test_save_changes_nothing_and_a_refused_restore_neither(samples):
    one, two = (fed(Estimator(CONFIGS["calm"]), samples["calm"][:333]) for _ in range(2))
    state = one.save()
    with pytest.raises(ValueError, match="not whole"):
        one.restore(state[:-1])
    with pytest.raises(ValueError, match="another window"):
        one.restore(Estimator(dataclasses.replace(CONFIGS["calm"], window=0.5)).save())
    assert one.save() == two.save() == state


# ---- what is refused


@given(end=hs.integers(0, 5000))
def test_bytes_that_are_not_whole_are_refused(end):
    estimator = Estimator(CONFIGS["integral"])
    state = estimator.save()
    with pytest.raises(ValueError, match=r"saved state: \d+ bytes"):
        estimator.restore(state[:min(end, len(state) - 1)])
    with pytest.raises(ValueError, match="expected"):
        estimator.restore(state + b"\0")


@given(bit=hs.integers(0, 10**9))
def test_every_flipped_bit_is_seen(bit):
    estimator = Estimator(CONFIGS["integral"])
    state = bytearray(estimator.save())
    state[bit // 8 % len(state)] ^= 1 << bit % 8
    with pytest.raises(ValueError, match="saved state"):
        estimator.restore(bytes(state))


@pytest.mark.parametrize("saved", [b"", b"launchid", b"\x80\x04K\x01.", b"x" * 4096])
def test_bytes_of_something_else_are_refused(saved):
    with pytest.raises(ValueError, match="do not begin as a saved estimator"):
        Estimator(CONFIGS["integral"]).restore(saved)


@pytest.mark.parametrize(("changed", "named"), [
    ({"window": 0.5}, "window"), ({"seed": 8}, "seed"), ({"library": "quadratic"}, "library"),
    ({"solver": "sr3"}, "solver"), ({"threshold": 0.25}, "threshold"), ({"theta_limit": 99.0}, "theta_limit"),
    ({"formulation": "difference"}, "formulation"), ({"model": dataclasses.replace(
        CONFIGS["calm"].model, theta_std=np.nextafter(CONFIGS["calm"].model.theta_std, 1.0))}, r"model\.theta_std")])
def test_another_configuration_is_refused_with_the_field_that_differs(changed, named):
    of = CONFIGS["calm" if "model" in changed else "integral"]
    with pytest.raises(ValueError, match=f"configuration with another {named}$"):
        Estimator(dataclasses.replace(of, **changed)).restore(Estimator(of).save())


def test_the_same_library_by_another_name_is_the_same_configuration():
    state = fed(Estimator(config(library="rigid-body")), [Sample(0.0, 0.1, 0.2, 0.3)]).save()
    other = Estimator(config(library=("theta", "beta")))
    other.restore(state)
    assert other.counts["ACCEPTED"] == 1


def signed(state: bytes) -> bytes:
    """The state with a checksum that fits."""
    return state[:-checkpoint.END.size] + checkpoint.END.pack(zlib.crc32(state[:-checkpoint.END.size]))


def with_header(state: bytes, place: int, value) -> bytes:
    header = list(checkpoint.HEADER.unpack_from(state))
    header[place] = value
    return signed(checkpoint.HEADER.pack(*header) + state[checkpoint.HEADER.size:])


@pytest.mark.parametrize(("place", "value", "said"), [
    (1, 1, "format 1, expected 2"), (3, b"0.0.1", r"of launchid 0\.0\.1, expected"), (4, b"\1" * 16, "layout"),
    (4, FORMER_LAYOUT, "saved state: its layout is another build's")])
def test_another_version_is_refused(place, value, said):
    estimator = Estimator(CONFIGS["integral"])
    with pytest.raises(ValueError, match=said):
        estimator.restore(with_header(estimator.save(), place, value))


def test_neither_while_an_update_runs():
    estimator = Estimator(CONFIGS["integral"])
    state = estimator.save()
    estimator._busy = True  # as a signal handler finds it
    with pytest.raises(RuntimeError, match="save: an update is running"):
        estimator.save()
    with pytest.raises(RuntimeError, match="restore: an update is running"):
        estimator.restore(state)
    estimator._busy = False
    assert estimator.update(Sample(0.0, 0.1, 0.2, 0.3)) is Status.ACCEPTED

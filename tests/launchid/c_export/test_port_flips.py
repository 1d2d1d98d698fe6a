"""The C estimator's state is damaged: no crash, nothing out of bounds, and it is found, forgotten or counts only.

The whole campaign, a million flips of each: `python -m pytest -m campaign tests/launchid/c_export/test_port_flips.py`.
"""

import subprocess
from pathlib import Path

import pytest
from ported import CC, SHARED, STRICT, as_text, filtered, flight, needs_compiler, regression, written

from launchid_core import Config

SANE = ("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
CHECKED = ("-O1", "-g", *SANE)
FORGOTTEN_WITHIN = 2   # windows that close after the flip
FLIPPED = {
    "filtered": filtered(window=0.5, ranged=True),
    "filtered-terms": filtered(window=0.5, library="quadratic"),
    "integral": regression("integral", library="rigid-body", window=0.5),
    "difference": regression("difference", library="linear", window=0.5),
}


def fates(folder: Path, config: Config, flips: int, flags: tuple[str, ...], seed: int = 1,
          kinds: tuple[str, ...] = ("bit",)) -> dict[str, int]:
    """The number of flips by their outcome, of the last of these kinds of damage."""
    written(folder, config)
    subprocess.run([str(CC), *STRICT, *flags, "-I.", str(SHARED / "port_flips.c"), "launchid.c", "-lm", "-o", "flips"],
                   cwd=folder, check=True)
    found: dict[str, int] = {}
    for kind in kinds:
        done = subprocess.run(["./flips", str(seed), str(flips), kind], cwd=folder, text=True, check=False,
                              input=as_text(flight()[1700:2400]), capture_output=True)
        assert (done.returncode, done.stderr) == (0, "")
        found = {word: int(count) for word, count in (line.split() for line in done.stdout.splitlines())}
        assert found["more"] == found["little"] == 0, kind
    return found


def assert_held(found: dict[str, int], flips: int) -> None:
    assert found["more"] == found["little"] == 0
    assert 1 <= found["windows"] <= FORGOTTEN_WITHIN
    assert found["anew"] + found["same"] + found["forgotten"] + found["flagged"] == flips
    assert min(found["anew"], found["forgotten"]) > flips // 20  # both happen
    assert found["same"] < flips // 10                           # counters alone


@needs_compiler
@pytest.mark.parametrize("name", ["filtered", pytest.param("integral", marks=pytest.mark.campaign)])
def test_a_flipped_bit_is_found_or_forgotten(name, tmp_path):
    assert_held(fates(tmp_path, FLIPPED[name], 1000, ("-O0", *SANE)), 1000)


@needs_compiler
@pytest.mark.campaign
@pytest.mark.parametrize(("flips", "flags"), [(1_000_000, ("-O2",)), (200_000, CHECKED)], ids=["million", "checked"])
@pytest.mark.parametrize("name", FLIPPED)
def test_a_million_flipped_bits(name, flips, flags, tmp_path):
    found = fates(tmp_path, FLIPPED[name], flips, flags, seed=2)
    print(name, found)
    assert_held(found, flips)


@needs_compiler
@pytest.mark.parametrize("name", ["integral", pytest.param("filtered", marks=pytest.mark.campaign)])
def test_words_that_are_damaged_together_are_found_or_forgotten(name, tmp_path):
    """A plain exclusive or of words sees neither the same bit in two of them nor two that are exchanged."""
    found = fates(tmp_path, FLIPPED[name], 500, ("-O0", *SANE), seed=3, kinds=("pair", "near", "swap", "zero"))
    assert found["anew"] > 50 and found["forgotten"] > 50


@needs_compiler
@pytest.mark.campaign
@pytest.mark.parametrize(("kind", "times"), [("pair", 20_000), ("near", 5_000), ("swap", 5_000), ("zero", 5_000)])
@pytest.mark.parametrize("name", FLIPPED)
def test_many_words_that_are_damaged_together(name, kind, times, tmp_path):
    found = fates(tmp_path, FLIPPED[name], times, CHECKED, seed=11, kinds=(kind,))
    print(name, kind, found)
    assert found["anew"] > times // 10 and found["forgotten"] > times // 50

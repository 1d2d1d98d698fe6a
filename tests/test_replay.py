"""Committed flights give the committed answers, bit for bit: a change of behaviour shows in review, cell by cell.

`python tests/replay/make.py` writes the answers anew; what changed is then a difference to be read and explained.

The regression formulations ask nothing of libm but roots, which IEEE 754 rounds correctly, so their bits are demanded
everywhere.  The filtered one asks for exp, log and erfc, whose last digit depends on libm and, within glibc, on the
processor (variants with and without fused multiply-add).  Where this machine's differ from those of the machine that
made the vectors (`libm.txt`), their numbers may differ by ELSEWHERE; words, counts and statuses may not.
"""

import math
from itertools import zip_longest

import numba
import pytest
from replay.make import FOLDER, LIBM, VECTORS, answers, cell, libm, read, samples_of, write

from launchid_core import Sample, Status

ELSEWHERE = 1e-9  # relative: without the compiler, so with numpy's exp and log, they differ by 3e-13


def is_number(text: str) -> bool:
    try:
        return "." in text or "e" in text or not math.isfinite(float(text))
    except ValueError:
        return False


def same(committed: str, here: str, tolerance: float) -> bool:
    """Equal, or two numbers within a relative tolerance."""
    if committed == here or not (tolerance and is_number(committed) and is_number(here)):
        return committed == here
    return math.isclose(float(committed), float(here), rel_tol=tolerance)


def differences(committed: list[dict[str, str]], here: list[dict[str, str]], tolerance: float = 0.0) -> list[str]:
    """What changed, a line a cell."""
    found = []
    for number, (was, now) in enumerate(zip_longest(committed, here, fillvalue={})):
        for column in dict.fromkeys([*was, *now]):
            if not same(was.get(column, ""), now.get(column, ""), tolerance):
                found.append(f"row {number + 2}, t = {was.get('t')}: {column} was {was.get(column, '')!r}, "
                             f"is {now.get(column, '')!r}")
    return found


@pytest.mark.parametrize("name", VECTORS)
def test_a_committed_flight_gives_the_committed_answers(name):
    vector, committed = VECTORS[name], read(name)
    at_home = libm() == LIBM.read_text(encoding="utf-8").strip() and not numba.config.DISABLE_JIT
    tolerance = 0.0 if vector.plain or at_home else ELSEWHERE
    here = [{column: text for column, text in row.items() if text}
            for row in answers(vector, samples_of(committed))]
    changed = differences(committed, here, tolerance)
    assert not changed, f"{name}.csv: {len(changed)} cells changed (`python tests/replay/make.py` writes them):\n" + \
        "\n".join(changed[:20])


def test_the_vectors_hold_what_they_are_for():
    seen = {name: {row["status"] for row in read(name)} for name in VECTORS}
    every = {status.name for status in Status} - {"BUSY"}
    assert seen["integral-faults"] | seen["filtered-faults"] >= every - {"RECOVERED"}
    closed = {name: [row for row in read(name) if row["status"] == "WINDOW_COMPLETE"] for name in VECTORS}
    assert all(any(row["estimate"] == "OK" for row in rows) for rows in closed.values())
    last = {name: rows[-1] for name, rows in closed.items()}
    assert int(last["filtered"]["changes"]) > 0 and last["filtered"]["tracked valid"] == "True"
    assert {"level a6 delta", "level k1 band"} <= set(last["filtered"])
    assert {"wind", "attitude_bias", "gyro_bias std"} <= set(last["wind"]) and last["wind"]["wind"] != "nan"
    assert int(last["filtered-faults"]["OUTLIER"]) > 0 and int(last["filtered-faults"]["RESTART"]) > 0


def test_every_vector_is_one_that_is_made():
    assert {path.stem for path in FOLDER.glob("*.csv")} == set(VECTORS)


def test_samples_read_back_to_their_bits(tmp_path, monkeypatch):
    sample = Sample(0.1, -0.0, 5e-324, 1.7976931348623157e308, math.nan, math.inf, 1.0 / 3.0)
    monkeypatch.setattr("replay.make.FOLDER", tmp_path)
    write("one", [{name: cell(value) for name, value in zip(Sample._fields, sample, strict=True)}])
    assert repr(samples_of(read("one"))[0]) == repr(sample)


@pytest.mark.parametrize(("was", "now", "tolerance", "changed"), [
    ("1.0", "1.0000000000000002", 0.0, True), ("1.0", "1.0000000000000002", 1e-6, False),
    ("1.0", "1.001", 1e-6, True), ("OK", "MODEL", 1e-6, True), ("12", "13", 1.0, True), ("nan", "nan", 0.0, False),
    ("nan", "1.0", 1e-6, True), ("0.5", "", 1e-6, True)])
def test_one_changed_cell_is_told(was, now, tolerance, changed):
    told = differences([{"t": "0.1", "a6": was}], [{"t": "0.1", "a6": now}], tolerance)
    assert told == ([f"row 2, t = 0.1: a6 was {was!r}, is {now!r}"] if changed else [])

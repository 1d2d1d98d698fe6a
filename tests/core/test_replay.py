"""Committed flights give the committed answers, bit for bit: a change of behaviour shows in review, cell by cell.

`python tests/replay/make.py` writes the answers anew; what changed is then a difference to be read and explained.

The bits are demanded on every machine, jitted or not: the core takes nothing from libm but what IEEE 754 rounds
correctly (`launchid_core/elementary.py`).
"""

import math
from itertools import zip_longest

import pytest
from replay.make import FOLDER, VECTORS, answers, cell, read, samples_of, write

from launchid_core import Sample, Status


def differences(committed: list[dict[str, str]], here: list[dict[str, str]]) -> list[str]:
    """The cells that changed, a line each."""
    found = []
    for number, (was, now) in enumerate(zip_longest(committed, here, fillvalue={})):
        for column in dict.fromkeys([*was, *now]):
            if was.get(column, "") != now.get(column, ""):
                found.append(f"row {number + 2}, t = {was.get('t')}: {column} was {was.get(column, '')!r}, "
                             f"is {now.get(column, '')!r}")
    return found


@pytest.mark.parametrize("name", VECTORS)
def test_a_committed_flight_gives_the_committed_answers(name):
    vector, committed = VECTORS[name], read(name)
    here = [{column: text for column, text in row.items() if text}
            for row in answers(vector, samples_of(committed))]
    changed = differences(committed, here)
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


@pytest.mark.parametrize(("was", "now", "changed"), [
    ("1.0", "1.0000000000000002", True), ("OK", "MODEL", True), ("12", "13", True), ("nan", "nan", False),
    ("nan", "1.0", True), ("0.5", "", True)])
def test_one_changed_cell_is_told(was, now, changed):
    told = differences([{"t": "0.1", "a6": was}], [{"t": "0.1", "a6": now}])
    assert told == ([f"row 2, t = 0.1: a6 was {was!r}, is {now!r}"] if changed else [])

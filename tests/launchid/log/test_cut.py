"""A log is cut in time alike by the command, a map and `read_log`; what is no time is told."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from every import every

import launchid
from launchid.log.cut import cut_log
from launchid.log.log import log_of
from launchid.main import main
from sim.errors import InputError, UsageError

T = np.arange(400) * 0.01
COLUMNS = {"t": T, "theta": 0.01 * np.sin(3.0 * T), "beta": 0.01 * np.cos(5.0 * T)}
MAP = """[time]
name = "t"
origin = "file"
[columns.theta]
from = "theta"
[columns.beta]
from = "beta"
[cut]
from = 1.0
to = 2.0
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.csv"
    rows = zip(*COLUMNS.values(), strict=True)
    path.write_text("\n".join([",".join(COLUMNS), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n")
    return path


def test_both_ends_are_in_and_a_row_without_a_stamp_goes_with_its_neighbours():
    t = T.copy()
    t[[50, 150, 350]] = math.nan
    cut = cut_log(log_of({**COLUMNS, "t": t}), 1.0, 2.0)
    assert (cut.t[0], cut.t[-1]) == (1.0, 2.0)
    assert len(cut.t) == 101 and np.isnan(cut.t).sum() == 1
    assert np.array_equal(cut.theta, COLUMNS["theta"][100:201])


def test_rows_out_of_order_are_cut_by_their_stamps():
    order = np.argsort(np.sin(np.arange(len(T)) * 7.0))
    cut = cut_log(log_of({name: x[order] for name, x in COLUMNS.items()}), 1.0, 2.0)
    assert sorted(cut.t.tolist()) == T[100:201].tolist()


def test_the_words_start_and_end_take_all_rows_and_are_a_choice():
    whole = log_of(COLUMNS)
    for words in (("start", None), (None, "end"), ("start", "end")):
        cut = cut_log(whole, *words)
        assert cut.is_same(whole) and cut.is_chosen
    assert not cut_log(whole).is_chosen


@every(("from_", "to", "error"), [
    (3.0, 2.0, UsageError), ("first", None, UsageError), (math.nan, None, UsageError), (None, "start", UsageError),
    (True, None, UsageError), (100.0, None, InputError), (None, -1.0, InputError)])
def test_what_is_no_time_of_the_log_is_one_line(from_, to, error):
    with pytest.raises(error, match=r"from|to|row"):
        cut_log(log_of(COLUMNS), from_, to)


def test_command_map_and_python_cut_alike(log, tmp_path):
    (tmp_path / "map.toml").write_text(MAP)
    cut = launchid.read_log(log, from_=1.0, to=2.0)
    assert launchid.read_log(log, map=tmp_path / "map.toml").is_same(cut)
    assert launchid.read_log(log, map=tmp_path / "map.toml", from_="start", to="end").is_same(launchid.read_log(log))
    assert len(launchid.read_log(log, map=tmp_path / "map.toml", to=1.5).t) == 51
    for words in (["--from", "1", "--to", "2"], ["--map", str(tmp_path / "map.toml")]):
        assert main(["identify", str(log), "--window", "1", "--json", str(tmp_path / "w.json"), *words]) == 0
        windows = json.loads((tmp_path / "w.json").read_text())["windows"]
        assert [window["t_start"] for window in windows] == [1.0]


def test_every_command_that_reads_a_log_takes_from_and_to(capsys):
    for command in ("identify", "nominal", "diagnose", "compare", "margins", "show", "uncertainty", "fit-lft", "watch",
                    "convert"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        said = capsys.readouterr().out
        assert "--from T|start" in said and "--to T|end" in said


def test_a_followed_log_is_cut(log, capsys):
    assert main(["watch", str(log), "constant", "--once", "--from", "1", "--to", "3.5", "--window", "1", "--json",
                 "-"]) == 0
    windows = json.loads(capsys.readouterr().out)
    assert windows["rows"]["read"] == 251
    assert windows["windows"][0]["t_start"] == 1.0

"""`launchid watch --map` and `--strict`: rows with other names and units, as `convert` makes them of the whole file."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from launchid.convert.columns import mapped
from launchid.convert.mapping import load_map
from launchid.convert.stream import MappedStream
from launchid.log.log import read_log, write_columns
from launchid.main import main
from launchid.watch.lines import Lines

MAP = """[time]
name = "stamp"
unit = "ms"

[file]
delimiter = ";"
decimal = ","

[columns.theta]
from = "pitch"
unit = "deg"

[columns.theta_dot]
from = "rate"

[columns.beta]
sum = ["left", "right"]
weights = [0.5, -0.5]

[columns.beta_cmd]
from = "asked"
"""
TURNS = """[time]
name = "stamp"

[columns.theta]
quaternion = ["qw", "qx", "qy", "qz"]
scale = -1.0

[columns.beta]
from = "nozzle"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A nominal of 6 s, its flight in foreign words, the map, and the log that `convert` makes with it."""
    path = tmp_path_factory.mktemp("mapped")
    text = (Path(__file__).resolve().parents[3] / "sim" / "data" / "nominal" / "constant.toml").read_text("utf-8")
    (path / "n.toml").write_text(text.replace("duration = 70.0", "duration = 6.0"), "utf-8")
    assert main(["simulate", str(path / "n.toml"), "--out", str(path / "log.csv"), "--seed", "3"]) == 0
    log = read_log(path / "log.csv")
    foreign = {"note": log.t, "asked": log.beta_cmd, "stamp": 1000.0 * log.t + 70000.0, "left": log.beta,
               "right": -log.beta, "pitch": np.degrees(log.theta), "rate": log.theta_dot}
    rows = [";".join(foreign), *(";".join(f"{x!r}".replace(".", ",") for x in row)
                                 for row in zip(*(x.tolist() for x in foreign.values()), strict=True))]
    (path / "foreign.csv").write_text("\n".join(rows) + "\n")
    (path / "map.toml").write_text(MAP)
    (path / "turns.toml").write_text(TURNS)
    assert main(["convert", str(path / "foreign.csv"), "--map", str(path / "map.toml"), "--out",
                 str(path / "converted.csv")]) == 0
    return path


def logs(lines: Lines, data: bytes, piece: int) -> dict[str, np.ndarray]:
    """The rows of a stream that comes in pieces."""
    found = [log for k in range(0, len(data), piece) for log in lines.logs(data[k:k + piece])]
    return {name: np.concatenate([getattr(log, name) for log in found]) for name in found[0].columns}


def test_a_foreign_csv_is_watched_as_its_conversion(folder, launchid):
    words = ("--nominal", folder / "n.toml", "--window", "1", "--once", "--json", "-")
    status, mapped_out, err = launchid("watch", folder / "foreign.csv", "--map", folder / "map.toml", *words)
    assert status == 0 and len(err.splitlines()) == 1, err
    status, plain, _ = launchid("watch", folder / "converted.csv", *words)
    assert status == 0 and json.loads(mapped_out) == json.loads(plain)
    assert len(json.loads(plain)["windows"]) == 6


@pytest.mark.parametrize("piece", [1000, 10**6])
def test_pieces_make_no_difference(folder, piece):
    lines = Lines("x", True, print, load_map(folder / "map.toml"))
    found = logs(lines, (folder / "foreign.csv").read_bytes(), piece)
    whole = read_log(folder / "converted.csv").measured()
    assert found.keys() == whole.keys()
    assert all(np.array_equal(found[name], whole[name]) for name in whole)


def test_turns_go_on_from_piece_to_piece(folder):
    """Three turns about the axis, in pieces of a few rows, the first of them without an attitude."""
    t = np.arange(0.0, 3.0, 0.01)
    angle = 0.3 + 2.0 * math.pi * t
    q = {"qw": np.cos(angle / 2.0), "qx": 0.0 * t, "qy": np.sin(angle / 2.0), "qz": 0.0 * t}
    q["qw"][:5] = math.nan
    columns = {"stamp": t, "nozzle": t, **q}
    whole = mapped("x", columns, load_map(folder / "turns.toml"))
    stream = MappedStream(load_map(folder / "turns.toml"))
    parts = [stream.log("x", {name: x[k:k + 7] for name, x in columns.items()}) for k in range(0, len(t), 7)]
    theta = np.concatenate([part.theta for part in parts])
    assert np.allclose(theta, whole["theta"], rtol=0.0, atol=1e-12, equal_nan=True)
    assert np.array_equal(np.concatenate([part.t for part in parts]), whole["t"])
    assert np.nanmin(theta) < -5.0 * math.pi and np.isnan(theta[:5]).all()


def test_a_file_of_another_format_needs_once_and_a_map(folder, launchid):
    scipy_io = pytest.importorskip("scipy.io")
    log = read_log(folder / "log.csv")
    scipy_io.savemat(folder / "log.mat", log.measured())
    (folder / "mat.toml").write_text('[time]\nname = "t"\n' + "".join(
        f'[columns.{name}]\nfrom = "{name}"\n' for name in ("theta", "theta_dot", "beta", "beta_cmd")))
    words = (folder / "log.mat", "--nominal", folder / "n.toml")
    status, _, err = launchid("watch", *words)
    assert status == 3 and len(err.splitlines()) == 1 and "format MAT" in err and "--map" in err
    status, _, err = launchid("watch", *words, "--map", folder / "mat.toml")
    assert status == 2 and len(err.splitlines()) == 1 and "--once" in err
    status, out, _ = launchid("watch", *words, "--map", folder / "mat.toml", "--once", "--json", "-")
    _, plain, _ = launchid("watch", folder / "log.csv", "--nominal", folder / "n.toml", "--once", "--json", "-")
    assert status == 0 and json.loads(out) == json.loads(plain)


def test_rows_that_the_map_cannot_take_are_left_out_and_counted(folder):
    lines = Lines("x", False, lambda text: None, load_map(folder / "turns.toml"))
    header = b"stamp,qw,qx,qy,qz,nozzle\n"
    found = logs(lines, b"0,1,0,0,0,0\n" + header + b"5,1,0,0,0,0\n6,1,0\n7,1,0,0,0,high\n", 10**6)
    assert lines.malformed == 2
    assert found["t"].tolist() == [0.0, 2.0] and math.isnan(found["beta"][1])


def test_strict_ends_with_what_the_data_check_finds(folder, launchid):
    log = read_log(folder / "log.csv").measured()
    write_columns(folder / "turned.csv", {**log, "beta": -log["beta"]})
    words = (folder / "turned.csv", "--nominal", folder / "n.toml", "--once", "--json", "-")
    status, out, err = launchid("watch", *words)
    assert status == 0 and json.loads(out)["windows"] and "opposite sign" in err
    status, out, err = launchid("watch", *words, "--strict")
    assert (status, out) == (3, "") and "opposite sign" in err.splitlines()[-1]
    status, _, err = launchid("watch", folder / "log.csv", *words[1:], "--strict")
    assert status == 0 and len(err.splitlines()) == 1

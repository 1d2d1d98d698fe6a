"""Flights as users have them: six formats into the same log, units, attitudes, clocks, and files that are broken."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shortened import short
from written import write_mcap, write_ulog

import launchid
from launchid.convert.columns import mapped, turned
from launchid.convert.mapping import Map, Source, load_map, map_for
from launchid.convert.readers import foreign_format
from launchid.log.log import read_log, write_columns
from launchid.main import main
from sim.errors import InputError
from sim.flight import fly_whole

ROOT = Path(__file__).resolve().parents[3]
MARGIN = 0.05   # rad: deflection of one actuator output of 1
START = 1_700_000_000_000_000_000   # ns: digits that a float would lose


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    """A flight of 12 s, as logged."""
    flight = fly_whole(short(12.0), 3)
    return {name: getattr(flight, name) for name in ("t", "theta", "theta_dot", "beta", "beta_cmd")}


@pytest.fixture(scope="module")
def log(columns, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("log") / "log.csv"
    write_columns(path, columns)
    return path


# ---- six formats


def to_csv(path: Path, c: dict[str, np.ndarray]) -> str:
    def cell(x: float) -> str:
        return repr(x).replace(".", ",")
    rows = [f"note;{cell(math.degrees(b))};{round(t * 1000)};{cell(q)};{cell(math.degrees(a))};{cell(u)}"
            for t, a, q, b, u in zip(*(x.tolist() for x in c.values()), strict=True)]
    path.write_text("\n".join(["remark;nozzle;ms;rate;pitch;cmd", *rows]))
    return """[file]
delimiter = ";"
decimal = ","
[time]
name = "ms"
unit = "ms"
[columns]
theta = {from = "pitch", unit = "deg"}
theta_dot = {from = "rate"}
beta = {from = "nozzle", unit = "deg"}
beta_cmd = {from = "cmd"}
"""


def to_mat(path: Path, c: dict[str, np.ndarray]) -> str:
    io = pytest.importorskip("scipy.io")
    io.savemat(path, {"flight": {"time": c["t"][:, None], "att": np.stack([0 * c["t"], c["theta"]], axis=1),
                                 "rate": np.degrees(c["theta_dot"]), "act": {"pos": c["beta"], "cmd": c["beta_cmd"]}},
                      "name": "a flight"})
    return """[time]
name = "flight/time"
[columns]
theta = {from = "flight/att[1]"}
theta_dot = {from = "flight/rate", unit = "deg/s"}
beta = {from = "flight/act/pos"}
beta_cmd = {from = "flight/act/cmd"}
"""


def to_hdf5(path: Path, c: dict[str, np.ndarray]) -> str:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["imu/t"], file["act/t"] = c["t"] + 100.0, c["t"] + 100.0
        file["imu/gyro"] = np.stack([0 * c["t"], -c["theta_dot"], 0 * c["t"]])   # as MATLAB 7.3 writes it: turned
        file["imu/pitch"] = c["theta"] * 1000.0
        file["act/stroke"] = (c["beta"] - 0.01) / 2.0
        file["act/asked"] = c["beta_cmd"]
        file["about"] = "a flight"
    return """[time]
name = "t"
[columns]
theta = {from = "imu/pitch", unit = "mrad"}
theta_dot = {from = "imu/gyro[1]", scale = -1}
beta = {from = "act/stroke", scale = 2.0, offset = 0.01}
beta_cmd = {from = "act/asked"}
"""


def to_parquet(path: Path, c: dict[str, np.ndarray]) -> str:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    stamps = pyarrow.array(START // 1000 + np.round(c["t"] * 1e6).astype(np.int64), pyarrow.timestamp("us"))
    parquet.write_table(pyarrow.table({
        "when": stamps, "pitch": c["theta"], "rates": list(np.stack([c["theta_dot"], 0 * c["t"]], axis=1)),
        "nozzle": c["beta"], "cmd": c["beta_cmd"], "mode": ["auto"] * len(c["t"])}), path)
    return """[time]
name = "when"
unit = "us"
[columns]
theta = {from = "pitch"}
theta_dot = {from = "rates[0]"}
beta = {from = "nozzle"}
beta_cmd = {from = "cmd"}
"""


def upright(theta: np.ndarray) -> np.ndarray:
    """(n, 4) w first: a launcher that stands upright (turned by -90 degrees about y) and is turned about y by theta."""
    angle = -math.pi / 2.0 + theta
    return np.stack([np.cos(angle / 2.0), 0 * angle, np.sin(angle / 2.0), 0 * angle], axis=1)


UPRIGHT = "[0.7071067811865476, 0.0, -0.7071067811865476, 0.0]"


def to_ulog(path: Path, c: dict[str, np.ndarray]) -> str:
    pytest.importorskip("pyulog")
    stamps = 5_000_000 + np.round(c["t"] * 1e6).astype(np.uint64)
    servos = np.stack([c["beta"] / MARGIN / 2.0 + 0.1, -c["beta"] / MARGIN / 2.0 + 0.1], axis=1)
    write_ulog(path, {"vehicle_attitude": {"timestamp": stamps, "q": upright(c["theta"])},
                      "vehicle_angular_velocity": {"timestamp": stamps,
                                                   "xyz": np.stack([0 * c["t"], c["theta_dot"]], axis=1)},
                      "actuator_servos": {"timestamp": stamps, "control": servos},
                      "asked": {"timestamp": stamps, "angle": c["beta_cmd"]}})
    return f"""[time]
name = "timestamp"
unit = "us"
[columns]
theta = {{quaternion = "vehicle_attitude/q", axis = "y", reference = {UPRIGHT}}}
theta_dot = {{from = "vehicle_angular_velocity/xyz[1]"}}
beta = {{sum = ["actuator_servos/control[0]", "actuator_servos/control[1]"], weights = [1, -1], scale = {MARGIN}}}
beta_cmd = {{from = "asked/angle"}}
"""


def to_mcap(path: Path, c: dict[str, np.ndarray]) -> str:
    pytest.importorskip("mcap")
    stamps = START + np.round(c["t"] * 1e9).astype(np.int64)
    q = upright(c["theta"])[:, [1, 2, 3, 0]]
    write_mcap(path, {"imu": {"timestamp": stamps, "q": q, "rate": c["theta_dot"]},
                      "act/main": {"timestamp": stamps, "angle": c["beta"], "asked": c["beta_cmd"]}})
    return f"""[time]
name = "log_time"
unit = "ns"
[columns]
theta = {{quaternion = "imu/motion.q", order = "xyzw", reference = {UPRIGHT}}}
theta_dot = {{from = "imu/motion.rate"}}
beta = {{from = "act/main/motion.angle"}}
beta_cmd = {{from = "act/main/motion.asked"}}
"""


FORMATS: dict[str, Callable[[Path, dict[str, np.ndarray]], str]] = {
    "CSV": to_csv, "MAT": to_mat, "HDF5": to_hdf5, "Parquet": to_parquet, "ULog": to_ulog, "MCAP": to_mcap}


def written(folder: Path, of: str, columns: dict[str, np.ndarray]) -> tuple[Path, Path]:
    flight, map_ = folder / "flight", folder / "map.toml"
    map_.write_text(FORMATS[of](flight, columns))
    return flight, map_


@pytest.mark.parametrize("of", FORMATS)
def test_a_flight_in_any_format_gives_the_log_and_its_estimates(tmp_path, columns, log, capsys, of):
    flight, map_ = written(tmp_path, of, columns)
    out = tmp_path / "out.csv"
    assert main(["convert", str(flight), "--map", str(map_), "--out", str(out)]) == 0
    assert "1200 rows over 11.99 s" in capsys.readouterr().err
    made = read_log(out)
    for name, x in columns.items():
        assert np.allclose(getattr(made, name), x, rtol=1e-12, atol=1e-9 if name == "t" else 1e-12), name
    expected = launchid.identify(log, "constant", window=4).report["windows"]
    for found in (launchid.identify(out, "constant", window=4), launchid.identify(
            launchid.read_log(flight, map=map_), "constant", window=4)):
        assert [w["k1"] for w in found.report["windows"]] == pytest.approx([w["k1"] for w in expected], rel=1e-6)
    assert foreign_format(str(flight)) == (None if of == "CSV" else of)


@pytest.mark.parametrize("of", FORMATS)
def test_what_a_file_holds_is_listed(tmp_path, columns, capsys, of):
    flight, map_ = written(tmp_path, of, columns)
    assert main(["convert", str(flight), "--list", "--map", str(map_)]) == 0
    listed = {line.split("  ")[0] for line in capsys.readouterr().out.splitlines()}
    of_map = load_map(map_)
    assert {name for source in of_map.sources for name in source.channels} <= listed


@pytest.mark.parametrize("of", [name for name in FORMATS if name != "CSV"])
def test_a_damaged_file_is_one_line(tmp_path, columns, capsys, of):
    flight, map_ = written(tmp_path, of, columns)
    data = flight.read_bytes()
    rng = np.random.default_rng(0)
    for k in range(12):
        broken = bytearray(data[:len(data) * k // 12 + 16])
        if k > 5:
            broken = bytearray(data)
            for place in rng.integers(16, len(data), 400):
                broken[place] ^= 0xFF
        flight.write_bytes(broken)
        capsys.readouterr()
        status = main(["convert", str(flight), "--map", str(map_), "--out", str(tmp_path / "out.csv")])
        err = capsys.readouterr().err
        assert status in (0, 3) and "Traceback" not in err
        assert len(err.splitlines()) == 1 or (status == 0 and "the file is damaged" in err.splitlines()[0])
        assert k > 5 or status == 3 or of == "ULog"   # which may end anywhere


def test_every_command_that_takes_a_log_takes_a_map(tmp_path, columns, capsys):
    flight, map_ = written(tmp_path, "CSV", columns)
    words = {"identify": [], "uncertainty": ["constant"], "diagnose": ["constant", "--strict"]}
    for command, more in words.items():
        assert main([command, str(flight), *more, "--map", str(map_), "--json", str(tmp_path / command)]) == 0
    assert main(["fit-lft", str(flight), "constant", "--map", str(map_), "--out", str(tmp_path / "new.toml")]) == 0


@pytest.mark.parametrize("of", [name for name in FORMATS if name not in ("CSV", "ULog")])
def test_without_a_map_the_format_is_named(tmp_path, columns, capsys, of):
    flight, _ = written(tmp_path, of, columns)
    assert main(["identify", str(flight)]) == 3
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1 and of in err and "--map" in err


# ---- attitudes


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton's product of quaternions (n, 4), w first."""
    w, x, y, z = np.moveaxis(p, -1, 0)
    a, b, c, d = np.moveaxis(q, -1, 0)
    return np.stack([w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c,
                     w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a], axis=-1)


def about(axis: int, angle: np.ndarray) -> np.ndarray:
    q = np.zeros((len(angle), 4))
    q[:, 0], q[:, 1 + axis] = np.cos(angle / 2.0), np.sin(angle / 2.0)
    return q


@given(axis=st.integers(0, 2), seed=st.integers(0, 10**6), sign=st.sampled_from([1.0, -1.0]))
def test_a_turn_about_an_axis_is_found_from_any_reference(axis, seed, sign):
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(-0.5, 0.7, 200))   # beyond a whole turn
    reference = rng.normal(size=4)
    q = sign * product(np.tile(reference, (200, 1)), about(axis, angle))
    found = turned(q, axis, tuple(reference))
    assert np.allclose(np.unwrap(found - angle), found[0] - angle[0], atol=1e-9)
    assert abs(math.remainder(found[0] - angle[0], 2.0 * math.pi)) < 1e-9
    assert np.allclose(turned(q, axis, None), angle - angle[0], atol=1e-9)


def test_an_attitude_that_is_no_number_is_not_measured():
    q = about(1, np.linspace(0.0, 1.0, 5))
    q[2, 1] = math.nan
    assert np.array_equal(np.isnan(turned(q, 1, None)), [False, False, True, False, False])
    assert np.isnan(turned(np.full((3, 4), math.nan), 1, None)).all()


# ---- one clock


def rows(t: np.ndarray, at: np.ndarray, values: np.ndarray, take: str = "nearest",
         within: float | None = None) -> np.ndarray:
    """The column theta_dot of a log on stamps t."""
    of = Map("m", (Source("theta", ("a/x",), (1.0,)), Source("theta_dot", ("b/x",), (1.0,), take=take, within=within)),
             "t", 1, False, "theta", {})
    return mapped("f", {"a/x": 0.0 * t, "a/t": t, "b/x": values, "b/t": at}, of)["theta_dot"]


@given(seed=st.integers(0, 10**6), rate=st.floats(0.05, 20.0), take=st.sampled_from(["nearest", "held"]))
def test_no_value_is_made_up_and_nearest_uses_each_once(seed, rate, take):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.005, 0.015, 100))
    at = np.cumsum(rng.uniform(0.5, 1.5, max(3, int(100 / rate))) * 0.01 * rate)
    values = np.arange(len(at)) + 1.0
    found = rows(t, at, values, take)
    known = np.isfinite(found)
    assert set(found[known]) <= set(values)
    stamps = at[(found[known] - 1).astype(int)]
    if take == "nearest":
        assert len(set(found[known])) == known.sum()
        assert (np.abs(stamps - t[known]) <= 0.5 * np.median(np.diff(t)) * (1 + 1e-6)).all()
    else:
        assert (stamps <= t[known] + 1e-6 * rate).all()


def test_a_slow_topic_leaves_rows_empty_and_a_command_is_held():
    t = np.arange(20) * 0.01
    at, values = np.arange(4) * 0.05, np.arange(4.0)
    assert np.array_equal(np.isfinite(rows(t, at, values)), np.arange(20) % 5 == 0)
    assert np.array_equal(rows(t, at, values, "held"), np.repeat(values, 5))
    assert np.allclose(rows(t, at, values, "linear")[:16], np.arange(16) / 5.0)
    assert np.isnan(rows(t, at, values, "linear")[16:]).all()


def test_a_gap_of_a_topic_is_a_gap_and_not_held_or_bridged():
    t = np.arange(100) * 0.01
    at = np.delete(t, slice(30, 60))
    for take, last in (("nearest", 29), ("held", 32), ("linear", 29)):
        found = rows(t, at, at, take)
        assert np.array_equal(np.flatnonzero(np.isnan(found)), np.arange(last + 1, 60)), take


def test_stamps_backward_repeated_and_none_are_kept_as_they_are():
    t = np.array([0.0, 0.01, 0.01, 0.005, math.nan, 0.02, 0.03])
    at = np.array([0.03, 0.0, 0.01, 0.02])
    found = rows(t, at, at)
    assert found[[0, 5, 6]].tolist() == [0.0, 0.02, 0.03] and np.isnan(found[4])
    with pytest.raises(InputError, match=r"no row has both theta \(0 to 0.03 s\) and theta_dot \(no stamps\)"):
        rows(t, np.full(3, math.nan), np.zeros(3))


def test_the_slower_of_theta_and_beta_is_the_clock_and_large_stamps_lose_no_digit():
    fast, slow = START + 2_500_001 * np.arange(400), START + 10_000_004 * np.arange(100)
    channels = {"a/t": fast.astype(np.uint64), "a/x": np.arange(400.0), "b/t": slow.astype(np.uint64),
                "b/x": np.arange(100.0)}
    of = Map("m", (Source("theta", ("a/x",), (1.0,)), Source("beta", ("b/x",), (1.0,))), "t", 10**9, True, None, {})
    made = mapped("f", channels, of)
    assert np.array_equal(made["t"], np.arange(100) * 10_000_004 / 1e9)
    assert np.array_equal(made["theta"], 4.0 * np.arange(100)) and np.array_equal(made["beta"], np.arange(100))


# ---- maps that are wrong

HEAD = '[time]\nname = "t"\n[columns]\n'


@pytest.mark.parametrize(("text", "mention"), [
    ("", "columns"), ("[columns]\ntheta = {from = 'x'}", "time.name"), (HEAD, "[columns] is empty"),
    (HEAD + "theta = 3", "a section"), (HEAD + "pitch = {from = 'x'}", "unknown key 'columns.pitch'"),
    (HEAD + "theta = {}", "no source"), (HEAD + "theta = {from = 'x', sum = ['y']}", "from and sum"),
    (HEAD + "theta = {from = 3}", "name of a channel"), (HEAD + "theta = {sum = []}", "list of channels"),
    (HEAD + "theta = {sum = ['x'], weights = [1, 2]}", "list of 1 numbers"),
    (HEAD + "theta_dot = {from = 'x', unit = 'deg'}", "one of rad/s, mrad/s, deg/s"),
    (HEAD + "theta = {from = 'x', scale = nan}", "a number"),
    (HEAD + "theta = {from = 'x', within = -1}", "at least 0"),
    (HEAD + "theta = {from = 'x', take = 'any'}", "nearest"),
    (HEAD + "theta = {quaternion = ['a', 'b']}", "four channels"),
    (HEAD + "theta = {quaternion = 'q', axis = 'up'}", "one of x, y, z"),
    (HEAD + "theta = {quaternion = 'q', reference = [0, 0, 0, 0]}", "not 0"),
    (HEAD + "theta = {quaternion = 'q', unit = 'deg'}", "a quaternion has no unit"),
    (HEAD + "theta_dot = {quaternion = 'q'}", "a quaternion is an attitude, theta_dot is not"),
    (HEAD + "theta = {quaternion = 'q', weights = [1]}", "columns.theta.weights belongs to sum, not to quaternion"),
    (HEAD + "theta = {from = 'x'}\n[file]\ndelimiter = 'ab'", "one character"),
    ('[time]\nname = "t"\nunit = "h"\n[columns]\ntheta = {from = "x"}', "one of s, ms, us, ns"),
    ('[time]\nname = "t"\nclock = "beta"\n[columns]\ntheta = {from = "x"}', "one of theta"), ("[", "TOML")])
def test_a_wrong_map_is_one_line(tmp_path, text, mention):
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_map(path)
    said = str(caught.value)
    assert len(said.splitlines()) == 1 and str(path) in said and (mention in said or mention == "TOML")


def test_a_channel_that_is_not_there_is_named_with_those_that_are_near(tmp_path, columns, capsys):
    flight, map_ = written(tmp_path, "CSV", columns)
    map_.write_text(map_.read_text().replace('"pitch"', '"pitsh"'))
    assert main(["convert", str(flight), "--map", str(map_), "--out", str(tmp_path / "out.csv")]) == 3
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1 and "'pitsh'" in err and "pitch" in err.split("there is")[1]


def test_convert_needs_map_and_out_or_list(tmp_path, columns, capsys):
    flight, map_ = written(tmp_path, "CSV", columns)
    for words in ([], ["--map", str(map_)], ["--out", str(tmp_path / "x.csv")]):
        assert main(["convert", str(flight), *words]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert main(["convert", str(flight), "--map", str(map_), "--out", str(flight)]) == 3
    assert "input" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "none"), "--list"]) == 3


def test_the_maps_of_the_page_are_maps(tmp_path):
    page = (ROOT / "docs" / "convert.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert len(blocks) >= 2
    for k, block in enumerate(blocks):
        (tmp_path / f"{k}.toml").write_text(block)
        (tmp_path / "f.csv").write_text("pitch_deg,servo_us\n0,1500\n1,1501\n")
        assert map_for(tmp_path / "f.csv", tmp_path / f"{k}.toml").sources

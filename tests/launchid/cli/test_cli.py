"""The command `launchid`: exit status, one line per error, JSON alone on stdout, the same bytes for the same input.

In process through `launchid.main.main`; a warning counts as a traceback.
"""

import json
import math
from pathlib import Path

import pytest
from every import every

from launchid.commands.identify import identify
from launchid.main import main

pytestmark = [pytest.mark.filterwarnings("error::RuntimeWarning"), pytest.mark.filterwarnings("error::UserWarning")]

ROOT = Path(__file__).resolve().parents[3]
WINDOW_KEYS = {"t_start", "t_end", "valid", "status", "a6", "k1", "a6_std", "k1_std", "a6_k1_corr", "a6_dot", "k1_dot",
               "a6_bound", "k1_bound", "condition", "terms"}
NUMBERS = WINDOW_KEYS - {"valid", "status", "terms"}
STATUSES = {"OK", "SHORT", "GAP", "RANK", "LOW_INFORMATION", "SATURATED", "NUMERICS"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A short nominal and its logs by either suite."""
    path = tmp_path_factory.mktemp("logs")
    text = (ROOT / "sim" / "data" / "nominal" / "constant.toml").read_text(encoding="utf-8")
    (path / "short.toml").write_text(text.replace("duration = 70.0", "duration = 12.0"), encoding="utf-8")
    for suite, period in (("flight", "0.01"), ("ideal", "0.01")):
        assert main(["simulate", str(path / "short.toml"), "--out", str(path / f"{suite}.csv"), "--suite", suite,
                     "--period", period, "--seed", "3"]) == 0
    return path


def strict_json(text: str) -> dict:
    """JSON proper: NaN and Infinity are none of it."""
    def refuse(word: str):
        raise AssertionError(f"{word} is no JSON")
    return json.loads(text, parse_constant=refuse)


def assert_one_line(err: str, *mentions: str) -> None:
    assert err.endswith("\n") and len(err.splitlines()) == 1, err
    assert err.startswith("launchid")
    assert "Traceback" not in err
    for mention in mentions:
        assert mention in err, err


def files(path: Path) -> set[str]:
    return {p.relative_to(path).as_posix() for p in path.rglob("*")}


# ---- simulate


@pytest.mark.parametrize(("suite", "period", "columns"), [
    ("flight", 0.01, "t,theta_ref,beta_cmd,beta,theta,theta_dot"),
    ("ideal", 0.001, "t,theta_ref,beta_cmd,beta,theta,theta_dot,theta_ddot")])
def test_simulate_writes_the_contract_s_log(launchid, folder, tmp_path, suite, period, columns):
    log = tmp_path / "log.csv"
    status, out, err = launchid("simulate", folder / "short.toml", "--out", log, "--suite", suite)
    assert (status, out) == (0, "")
    assert len(err.splitlines()) == 1
    lines = log.read_bytes().decode("utf-8").split("\n")
    assert lines[0] == columns
    assert lines[-1] == "" and len(lines) == 12.0 / period + 2
    cells = [line.split(",") for line in lines[1:-1]]
    assert [float(row[0]) for row in cells] == [round(k * period, 12) for k in range(len(cells))]
    assert all(repr(float(cell)) == cell for row in cells[::50] for cell in row)  # shortest round-trip numbers
    assert files(tmp_path) == {"log.csv"}


def test_simulate_writes_the_same_bytes_for_the_same_seed(launchid, folder, tmp_path):
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        launchid("simulate", folder / "short.toml", "--out", tmp_path / name, "--seed", seed)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes() != (tmp_path / "c").read_bytes()


# ---- identify


def test_identify_json_has_the_contract_s_keys(launchid, folder):
    status, out, err = launchid("identify", folder / "flight.csv", "--window", "1", "--json", "-")
    result = strict_json(out)
    assert status == 0
    assert {"windows", "samples"} <= set(result)
    assert result["samples"] == {"accepted": 1200, "rejected": {}}
    assert [(w["t_start"], w["t_end"]) for w in result["windows"]] == [(float(k), float(k + 1)) for k in range(12)]
    for window in result["windows"]:
        assert WINDOW_KEYS <= set(window)
        assert window["status"] in STATUSES and window["valid"] == (window["status"] == "OK")
        assert all(window[name] is None or math.isfinite(window[name]) for name in NUMBERS)
        assert set(window["terms"]) <= {"theta", "beta", "1", "theta_dot"}
    assert err == ""


def test_identify_finds_the_truth_on_ideal_sensors(launchid, folder):
    status, out, _ = launchid("identify", folder / "ideal.csv", "--window", "1", "--json", "-")
    assert status == 0
    window = strict_json(out)["windows"][8]
    assert window["a6"] == pytest.approx(2.0, rel=1e-9)
    assert window["k1"] == pytest.approx(-7.0, rel=1e-9)
    assert window["terms"] == {"theta": window["a6"], "beta": window["k1"]}


def test_invalid_window_is_null_in_json(launchid, tmp_path):
    log = tmp_path / "still.csv"
    log.write_text("t,theta,theta_dot,beta\n" + "".join(f"{k / 100},0,0,{k % 7 / 100}\n" for k in range(200)))
    status, out, _ = launchid("identify", log, "--window", "1", "--json", "-")
    windows = strict_json(out)["windows"]
    assert status == 0 and len(windows) == 2
    for window in windows:
        assert (window["valid"], window["status"], window["terms"]) == (False, "RANK", {})
        assert all(window[name] is None for name in NUMBERS - {"t_start", "t_end"})


@pytest.mark.parametrize("options", [
    ["--library", "sin(theta),beta,sign(theta_dot)", "--compression", "3", "--seed", "9"], ["--nominal", "constant"]])
def test_identify_gives_the_same_bytes_twice(launchid, folder, tmp_path, options):
    outputs = []
    for k in range(2):
        data = tmp_path / f"{k}.json"
        status, out, err = launchid("identify", folder / "flight.csv", *options, "--json", data)
        assert status == 0
        outputs.append((out, err, data.read_bytes()))
    assert outputs[0] == outputs[1]
    assert files(tmp_path) == {"0.json", "1.json"}
    assert strict_json(outputs[0][2].decode())["windows"]


HEAD = b"t,theta,beta\n"
ROWS = b"".join(b"%.2f,%.3f,%.3f\n" % (k / 100, math.sin(k / 9), math.cos(k / 5)) for k in range(200))


# ---- what is data, however bad


def test_bad_stamps_and_values_are_data_and_counted(launchid, tmp_path):
    rows = [[f"{k / 100:.2f}", f"{0.1 * math.sin(k / 9):.6f}", f"{0.1 * math.cos(k / 5):.6f}"] for k in range(300)]
    dirty = [list(row) for row in rows]
    dirty[50:50] = [list(rows[49])]                          # DT_ZERO
    dirty[100:100] = [["0.30", "0.1", "0.1"], ["0.20", "0.1", "0.1"]]  # DT_NEGATIVE, twice
    dirty[150:150] = [["1.465", "1e9", "0.1"]]               # RANGE
    dirty[200:200] = [["", "0.1", "0.1"], ["1.97", "nan", "0.1"], ["1.971", "0.1", "inf"], ["1e400", "0.1", "0.1"]]
    clean, bad = tmp_path / "clean.csv", tmp_path / "bad.csv"
    for path, table in ((clean, rows), (bad, dirty)):
        path.write_text("t,theta,beta\n" + "".join(",".join(row) + "\n" for row in table))
    _, expected, _ = launchid("identify", clean, "--json", "-")
    status, out, err = launchid("identify", bad, "--json", "-")
    result = strict_json(out)
    assert status == 0 and len(err.splitlines()) == 1 and "repeated stamps in 1 row" in err
    assert result["samples"]["accepted"] == 300
    assert result["samples"]["rejected"] == {"NONFINITE": 4, "RANGE": 1, "DT_ZERO": 1, "DT_NEGATIVE": 2}
    assert result["windows"] == strict_json(expected)["windows"]


# ---- wrong words


@every("words", [
    [], ["fly"], ["identify"], ["simulate", "constant"], ["identify", "LOG", "--colour", "red"],
    *(["identify", "LOG", option, value] for option, values in {
        "--formulation": ("weak", "filtered", "measured"), "--solver": ("omp", ""),
        "--library": ("nonsense", "", "theta^9"), "--window": ("soon", "0", "-1", "nan", "inf", "0.02", "1e9"),
        "--compression": ("0", "-2", "1.5", "x", "999"), "--threshold": ("-1", "nan", "inf", "x"),
        "--seed": ("-1", "x", "1.5", str(2**63))}.items() for value in values),
    ["identify", "LOG", "--plot", "OUT/figure.txt"],
    *(["simulate", "constant", "--out", "OUT/log.csv", option, value] for option, values in {
        "--suite": ("perfect", ""), "--period": ("0.0105", "-0.01", "nan", "inf", "x"), "--seed": ("-1", "x")}.items()
      for value in values),
    ["simulate", "constant", "--out", "OUT/log.csv", "--period", "0"],
    *(["plan", "constant", "--window", window, "--accuracy", accuracy, "--out", "OUT/new.toml"]
      for window, accuracy in (("5", "0"), ("5", "1"), ("5", "nan"), ("0", "0.01"), ("1e9", "0.01"))),
    *(["reproduce", "--out", "OUT/r", option, value] for option, value in (
        ("--case", "nope"), ("--case", ""), ("--seeds", "0"), ("--seeds", "-3"), ("--seeds", "x"))),
], ids=lambda words: " ".join(words) or "(nothing)")
def test_wrong_words_are_status_2_in_one_line(launchid, folder, tmp_path, words):
    log = tmp_path / "log.csv"
    log.write_bytes(HEAD + ROWS)
    words = [word.replace("LOG", str(log)) if word == "LOG" else word.replace("OUT", str(tmp_path)) for word in words]
    status, out, err = launchid(*words)
    assert (status, out) == (2, "")
    assert_one_line(err)
    assert files(tmp_path) == {"log.csv"}


def test_measured_needs_its_column(launchid, folder):
    status, _, err = launchid("identify", folder / "flight.csv", "--formulation", "measured")
    assert status == 2
    assert "theta_ddot" in err.splitlines()[-1]
    assert launchid("identify", folder / "ideal.csv", "--formulation", "measured")[0] == 0


# ---- outputs


@pytest.mark.parametrize("words", [
    ["simulate", "SHORT", "--out", "OUT/none/log.csv"], ["identify", "LOG", "--json", "OUT/none/x.json"],
    ["identify", "LOG", "--plot", "OUT/none/x.png"], ["simulate", "SHORT", "--out", "OUT/file/log.csv"],
    ["simulate", "SHORT", "--out", "OUT/folder"], ["identify", "LOG", "--json", "OUT/folder"],
    ["reproduce", "--case", "windowed", "--seeds", "1", "--out", "OUT/file"],
    ["reproduce", "--case", "windowed", "--seeds", "1", "--out", "OUT/file/below"]], ids=" ".join)
def test_output_that_cannot_be_written_is_status_3_and_leaves_nothing(launchid, folder, tmp_path, words):
    (tmp_path / "file").write_text("untouched")
    (tmp_path / "folder").mkdir()
    log = tmp_path / "log.csv"
    log.write_bytes(HEAD + ROWS)
    places = {"SHORT": folder / "short.toml", "LOG": log}
    status, out, err = launchid(*(places.get(word, word.replace("OUT", str(tmp_path))) for word in words))
    assert (status, out) == (3, "")
    assert_one_line(err, str(tmp_path))
    assert files(tmp_path) == {"file", "folder", "log.csv"}
    assert (tmp_path / "file").read_text() == "untouched"


def test_existing_output_is_replaced_whole_or_not_at_all(launchid, folder, tmp_path):
    target = tmp_path / "x.json"
    target.write_text("old")
    bad = tmp_path / "bad.csv"
    bad.write_bytes(HEAD)
    assert launchid("identify", bad, "--json", target)[0] == 3
    assert target.read_text() == "old"
    assert launchid("identify", folder / "flight.csv", "--json", target)[0] == 0
    assert strict_json(target.read_text())["windows"]


def test_a_figure_is_written_as_its_suffix_says_the_same_twice(launchid, folder, tmp_path):
    found = identify(folder / "flight.csv")
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        first, second = (tmp_path / f"{k}{suffix}" for k in range(2))
        found.plot(first)
        if suffix == ".png":
            assert launchid("identify", folder / "flight.csv", "--plot", second)[0] == 0
        else:
            found.plot(second)
        assert first.read_bytes().startswith(start) and first.read_bytes() == second.read_bytes()


# ---- reproduce


@pytest.mark.parametrize("names", ["a", pytest.param("ab", marks=pytest.mark.campaign)])
def test_reproduce_writes_the_same_bytes_twice(launchid, tmp_path, names):
    outputs = []
    for name in names:
        status, out, err = launchid("reproduce", "--case", "windowed", "--seeds", "1", "--out", tmp_path / name)
        assert status == 0 and err.splitlines()[-1].startswith("windowed: holds, 70 of 70 windows")
        assert "| windowed |" in out and "holds" in out
        outputs.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert outputs[0] == outputs[-1]
    assert {"table.md", "results.json"} <= set(outputs[0])
    assert any(name.endswith(".png") and data.startswith(b"\x89PNG") for name, data in outputs[0].items())
    rows = strict_json(outputs[0]["results.json"].decode())["windowed"]
    assert rows[0]["inside"] == rows[0]["counted"] == rows[0]["exact_support"] == 70
    assert rows[0]["worst_a6"] < 0.01 and rows[0]["worst_k1"] < 0.01
    assert rows[0]["verdict"] == "holds"


def test_confidence_case_draws_its_bands_and_margins(launchid, tmp_path):
    status, out, err = launchid("reproduce", "--case", "confidence", "--seeds", "5", "--out", tmp_path / "r")
    assert status == 0 and [line.split(":")[0] for line in err.splitlines() if ": done" in line] == [
        "confidence, constant", "confidence, vega_like"]
    assert "| constant | 5 |" in out and "| vega_like | 5 |" in out
    written = {path.name for path in (tmp_path / "r").iterdir()}
    assert {"confidence_constant.png", "margins_constant.png", "table.md"} <= written

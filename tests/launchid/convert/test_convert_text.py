"""The files of other people: tables of text wherever they begin, ArduPilot's logs, turns, and files that lie about
sizes.

Every table below is written from numbers that are known, and has to give them back.
"""

import json
import math
import os
import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest
from mutated import mutated
from written import write_mcap, write_ulog

from launchid.commands import convert as of_files
from launchid.convert.columns import turned
from launchid.convert.mapping import load_map
from launchid.convert.readers import foreign_format, read_channels
from launchid.log.log import read_log, write_columns
from launchid.main import main
from sim.errors import InputError

ROWS, PERIOD = 60, 0.008
T = np.round(PERIOD * np.arange(ROWS), 6)
THETA = np.round(0.05 * np.sin(3.0 * T) - 1e-5, 7)
BETA = np.round(0.02 * np.cos(2.0 * T), 7)
LOG = {"t": T, "theta": THETA, "beta": BETA}
MAP = '[time]\nname = "t"\n[columns]\ntheta = {from = "theta"}\nbeta = {from = "beta"}\n'
DIGITS = "9" * 400
BY_PLACE = '[time]\nname = "0"\n[columns]\ntheta = {from = "1"}\nbeta = {from = "2"}\n'


def table(delimiter: str = ",", header: str | None = "t,theta,beta", stamps: Callable[[float], str] = repr,
          decimal: str = ".", width: int = 0) -> str:
    """The log as text; `header` with commas, None: without one."""
    rows = [[stamps(t), *(repr(x).replace(".", decimal) for x in row)]
            for t, *row in zip(*(x.tolist() for x in LOG.values()), strict=True)]
    head = [] if header is None else [header.split(",")]
    return "".join(delimiter.join(cell.rjust(width) for cell in row) + "\n" for row in head + rows)


def interleaved() -> str:
    """One message a row: the nozzle 1.3 ms after each attitude."""
    lines = ["t,theta,beta"]
    for t, theta, beta in zip(*(x.tolist() for x in LOG.values()), strict=True):
        lines += [f"{t!r},{theta!r},", f"{t + 0.0013!r},,{beta!r}"]
    return "\n".join(lines) + "\n"


def date(form: str) -> Callable[[float], str]:
    return lambda t: form % (round(t * 1000) % 1000)


SETTINGS = "".join(f'"setting {k}",{k}\n' for k in range(24))
TABLES = {   # kind -> text, map
    "commas": (table(), MAP),
    "semicolons, which nobody names": (table(";"), MAP),
    "semicolons and decimal commas": (table(";", decimal=",", stamps=lambda t: repr(t).replace(".", ",")), MAP),
    "bars": (table("|"), MAP),
    "runs of blanks": (table(" ", width=15), MAP),
    "runs of blanks without a header": (table(" ", None, width=15), BY_PLACE),
    "numpy.savetxt": ("# " + table(" "), MAP),
    "no header": (table(header=None), BY_PLACE),
    "a header that is not to be used": (table(), BY_PLACE + "[file]\nheader = 0\n"),
    "settings before the header": (SETTINGS + table(), MAP),
    "the header's line is named": (SETTINGS + "t,theta,other\n" + table(), MAP + "[file]\nheader = 26\n"),
    "units below the header": (table().replace("\n", "\ns,rad,rad\n", 1), MAP),
    "commas and blanks": (table(", "), MAP),
    "a column of text and no header": ("".join(f"{line},auto\n" for line in table(header=None).splitlines()).replace(
        "0.0,-1e-05", "0,-1e-05", 1), BY_PLACE),
    "quotes": ('"' + table('","').replace("\n", '"\n"')[:-1], MAP),
    "a note of two lines": (table().replace("beta\n", 'beta,note\n', 1).replace("\n", ',"a\nb"\n').replace(
        'note,"a\nb"', "note", 1), MAP),
    "no stamps": (table(header="n,theta,beta", stamps=lambda t: "7"),
                  MAP.replace('name = "t"', f"period = {PERIOD}")),
    "ISO 8601": (table(stamps=date("2024-05-01 12:00:00.%03d")), MAP),
    "dates of another form": (table(stamps=date("01.05.2024 12-00-00.%03d")),
                              MAP.replace("[columns]", 'format = "%d.%m.%Y %H-%M-%S.%f"\n[columns]')),
    "dates of digits": (table(stamps=date("20240501120000.%03d")),
                        MAP.replace("[columns]", 'format = "%Y%m%d%H%M%S.%f"\n[columns]')),
    "one message a row": (interleaved(), MAP),
    "one message a row, and theta's clock": (interleaved(), MAP.replace("[columns]", 'clock = "theta"\n[columns]')),
}


def convert(folder: Path, data: str | bytes, of: str) -> int:
    (folder / "flight").write_bytes(data.encode() if isinstance(data, str) else data)
    (folder / "map.toml").write_text(of)
    return main(["convert", str(folder / "flight"), "--map", str(folder / "map.toml"), "--out", str(folder / "o.csv")])


def refusal(folder: Path, capsys: pytest.CaptureFixture, data: str | bytes, of: str = MAP) -> str:
    """The one line with which a file is not converted."""
    capsys.readouterr()
    assert convert(folder, data, of) == 3
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1 and not (folder / "o.csv").exists(), err
    return err


def listed(folder: Path, capsys: pytest.CaptureFixture, data: str | bytes | None = None) -> tuple[int, dict[str, str],
                                                                                                  str]:
    """Status, channel -> what is said of it, and what is said beside."""
    if data is not None:
        (folder / "flight").write_bytes(data.encode() if isinstance(data, str) else data)
    capsys.readouterr()
    status = main(["convert", str(folder / "flight"), "--list"])
    out, err = capsys.readouterr()
    assert status == 3 or out.strip()
    return status, dict(line.split("  ", 1) for line in out.splitlines()), err


# ---- tables


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_gives_back_its_numbers(tmp_path, kind):
    assert convert(tmp_path, *TABLES[kind]) == 0
    made = read_log(tmp_path / "o.csv")
    assert np.allclose(made.t, T, rtol=0.0, atol=1e-9)
    assert np.array_equal(made.theta, THETA) and np.array_equal(made.beta, BETA)


def test_a_first_row_of_numbers_is_no_header_and_no_column_vanishes(tmp_path, capsys):
    rows = [",".join(repr(0.1 * k * j) for j in range(5)) for k in range(9)]
    status, channels, err = listed(tmp_path, capsys, "\n".join(rows))
    assert status == 0 and list(channels) == ["0", "1", "2", "3", "4"] and "no header" in err
    assert all(what.startswith("9 rows, 0 .. ") for what in channels.values())
    assert "the map names none of them" in refusal(tmp_path, capsys, "\n".join(rows))


@pytest.mark.parametrize(("text", "mention"), [
    ("", "an empty file"), ("\n\n", "no row of numbers"), ("a,b\nc,d\n", "no row of numbers"),
    ("the quick\nbrown fox\n", "no row of numbers"), ("t,theta\n", "no row of numbers")])
def test_what_holds_no_table_is_refused_and_never_an_empty_list(tmp_path, capsys, text, mention):
    status, channels, err = listed(tmp_path, capsys, text)
    assert (status, channels) == (3, {}) and mention in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(("text", "mention"), [
    (table(stamps=lambda t: f"row {t}"), "channel 't', which * is there but holds no numbers ('row 0.0')"),
    (table(stamps=lambda t: ""), "channel 't', which * is there but is empty"),
    (table().replace("0.016", "0.016,1", 1), "line 4: 4 cells, expected 3 as in the header"),
    (table().replace("\n0.024,", "\n", 1), "line 5: 2 cells, expected 3 as in the header"),
    ("t, theta\n1, 2\n3, 4\n", "no channel 'beta', which * there is theta, t"),
    ("theta\n1,5\n2,5\n", "line 2: 2 cells, expected 1 as in the header"),
    (table().replace("0.04,", '0.04,"', 1), "line 7: a quote is opened and not closed"),
    ("a title\n" + table(header=None), "no header of its own"),
    (table(header="time,theta,beta"), "no channel 't'")])
def test_what_a_table_lacks_is_one_line(tmp_path, capsys, text, mention):
    if mention == "no header of its own":
        mention = "line 2: 3 cells, expected 1 as in line 1; [file] header = N"
    err = refusal(tmp_path, capsys, text)
    assert all(part in err for part in mention.split("*"))


def test_nothing_is_left_out_without_a_word(tmp_path, capsys):
    text = SETTINGS + table().replace("\n", "\ns,rad,rad\n", 1).replace("\n0.04,", "\nlate,")
    assert convert(tmp_path, text.replace("0.05,", "fault,"), MAP) == 0
    err = capsys.readouterr().err
    assert "lines 1 to 24 stand before the header in line 25" in err
    assert "line 26, between the header and the first row of numbers, is left out" in err
    assert "column t: 1 of 60 cells are no numbers ('late')" in err
    listed_ = listed(tmp_path, capsys, table().replace(",", ",auto,").replace("auto", "mode", 1))[1]
    assert any("holds no numbers ('auto')" in what for what in listed_.values())


@pytest.mark.parametrize(("of", "mention"), [
    (MAP + "[file]\nheader = -1", "0 for none"), (MAP + "[file]\nheader = true", "0 for none"),
    (MAP + '[file]\ndelimiter = ";"\ndecimal = ";"', "another character"),
    (MAP + "[file]\ndelimiter = '\"'", "one character"), (MAP + "[file]\nheader = 500", "is not among the first 61"),
    *((MAP.replace('name = "t"', line), mention) for line, mention in (
        ("period = 0", "at least 1e-06"), (f"period = {DIGITS}", "a number"),
        ('period = 0.1\nname = "t"', "leave one"), ("", "or a time.period"),
        ('period = 0.1\n[columns.gamma]\nfrom = "beta"\ntime = "t"', "leave one")))])
def test_a_wrong_word_about_the_text_or_its_period_is_one_line(tmp_path, capsys, of, mention):
    assert mention in refusal(tmp_path, capsys, table(), of)


def test_a_pipe_is_refused_before_it_is_read(tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe")
    assert main(["convert", str(tmp_path / "pipe"), "--list"]) == 3
    assert "not a regular file" in capsys.readouterr().err


# ---- turns


def test_an_attitude_of_0_to_360_degrees_is_continuous_and_its_jumps_are_told(tmp_path, capsys):
    theta = 350.0 + 30.0 * np.sin(20.0 * T)
    rows = [f"{t!r},{a % 360.0!r},{b!r}" for t, a, b in zip(T.tolist(), theta.tolist(), BETA.tolist(), strict=True)]
    of = MAP.replace('"theta"}', '"theta", unit = "deg"}')
    assert convert(tmp_path, "\n".join(["t,theta,beta", *rows]), of) == 0
    jumps = int(np.sum(np.abs(np.diff(theta % 360.0)) > 180.0))
    assert jumps > 1 and f"theta: {jumps} jumps of a turn" in capsys.readouterr().err
    made = read_log(tmp_path / "o.csv").theta
    assert np.allclose(made - made[0], np.radians(theta - theta[0]))


def rolling(roll: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """(n, 4) w first: a body that pitches about y and rolls about its own x, by integration of both rates."""
    q = np.zeros((len(roll), 4))
    q[0, 0] = 1.0
    for k in range(1, len(roll)):
        x, y = (roll[k] - roll[k - 1]) / 2.0, (pitch[k] - pitch[k - 1]) / 2.0
        w, a, b, c = q[k - 1]
        q[k] = [w - a * x - b * y, a + w * x - c * y, b + c * x + w * y, c + a * y - b * x]
        q[k] /= np.linalg.norm(q[k])
    return q


@pytest.mark.parametrize(("degrees", "is_told"), [(640.0, True), (-230.0, True), (20.0, True), (5.0, False),
                                                  (0.0, False)])
def test_a_body_that_turns_about_its_other_axes_is_told(tmp_path, capsys, degrees, is_told):
    t = np.arange(2000) * PERIOD
    pitch = 0.06 * np.sin(1.5 * t)
    q = rolling(np.radians(degrees) * t / t[-1], pitch)
    write_columns(tmp_path / "f.csv", {"t": t, **{f"q{k}": q[:, k] for k in range(4)}, "beta": 0.0 * t})
    of = MAP.replace('{from = "theta"}', '{quaternion = ["q0", "q1", "q2", "q3"]}')
    assert convert(tmp_path, (tmp_path / "f.csv").read_text(), of) == 0
    err = capsys.readouterr().err
    assert ("about its other axes" in err) == is_told
    if is_told:
        said = float(err.split("turns by ")[1].split(" degrees")[0])
        assert said == pytest.approx(abs(degrees), rel=0.02) and 'about "y"' in err
    wrong = np.max(np.abs(turned(q, 1, None) - pitch)) > 0.02 * np.ptp(pitch)
    assert wrong == (abs(degrees) > 100.0)


def test_clocks_that_do_not_overlap_are_refused_with_both_spans(tmp_path, capsys):
    h5py = pytest.importorskip("h5py")
    of = MAP.replace('"theta"}', '"imu/theta"}').replace('"beta"}', '"act/beta"}')
    for name, more in (("nearest", ""), ("held", ', take = "held"')):
        with h5py.File(tmp_path / "f.h5", "w") as file:
            file["imu/t"], file["imu/theta"] = T + 100.0, THETA
            file["act/t"], file["act/beta"] = T + 5000.0, BETA
        err = refusal(tmp_path, capsys, (tmp_path / "f.h5").read_bytes(), of.replace('beta"}', f'beta"{more}}}'))
        assert "theta (0 to 0.472 s) and beta (4900 to 4900.47 s)" in err, name


# ---- logs of autopilots, and MATLAB's


def dataflash(path: Path) -> None:
    """An ArduPilot log as its firmware writes it: formats, then messages of two instances of IMU."""
    def declared(kind: int, name: str, types: str, columns: str) -> bytes:
        size = 3 + sum({"Q": 8, "B": 1, "f": 4, "d": 8, "n": 4, "N": 16, "Z": 64}[each] for each in types)
        return struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, kind, size, *(
            each.encode() for each in (name, types, columns)))
    data = declared(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    data += declared(129, "ATT", "Qd", "TimeUS,Pitch") + declared(130, "IMU", "QBd", "TimeUS,I,GyrY")
    data += declared(131, "RCOU", "Qd", "TimeUS,C1") + declared(132, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    data += struct.pack("<BBBQB16s16s", 0xA3, 0x95, 132, 0, 130, b"s#E", b"F--")
    for k in range(ROWS):
        stamp = 5_000_000 + round(T[k] * 1e6)
        data += struct.pack("<BBBQd", 0xA3, 0x95, 129, stamp, math.degrees(THETA[k]))
        for instance in (0, 1):
            data += struct.pack("<BBBQBd", 0xA3, 0x95, 130, stamp, instance, (instance + 1) * BETA[k])
        data += struct.pack("<BBBQd", 0xA3, 0x95, 131, stamp, 1500.0 + 1000.0 * BETA[k])
    path.write_bytes(data)


ARDUPILOT = """[time]
name = "TimeUS"
unit = "us"
[columns]
theta = {from = "ATT/Pitch", unit = "deg"}
theta_dot = {from = "IMU.1/GyrY"}
beta = {from = "RCOU/C1", scale = 0.001, offset = -1.5}
"""


def test_an_ardupilot_log_gives_its_numbers(tmp_path, capsys):
    pytest.importorskip("pymavlink")
    dataflash(tmp_path / "log.bin")
    assert convert(tmp_path, (tmp_path / "log.bin").read_bytes(), ARDUPILOT) == 0
    made = read_log(tmp_path / "o.csv")
    assert np.allclose(made.t, T) and np.allclose(made.theta, THETA) and np.allclose(made.beta, BETA)
    assert np.allclose(made.theta_dot, 2.0 * BETA)
    status, channels, _ = listed(tmp_path, capsys)
    assert status == 0 and {"ATT/Pitch", "IMU/GyrY", "IMU.1/GyrY", "RCOU/TimeUS"} <= channels.keys()
    assert main(["identify", str(tmp_path / "log.bin")]) == 3
    assert "ArduPilot DataFlash; expected --map" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["4", "5"])
def test_a_mat_file_of_any_header_gives_its_numbers(tmp_path, form):
    io = pytest.importorskip("scipy.io")
    io.savemat(tmp_path / "f.mat", LOG, format=form)
    data = bytearray((tmp_path / "f.mat").read_bytes())
    if form == "5":
        data[:30] = b"written by some other program "
    (tmp_path / "flight").write_bytes(data)
    assert foreign_format(str(tmp_path / "flight")) == "MAT"
    assert convert(tmp_path, bytes(data), MAP) == 0
    assert np.array_equal(read_log(tmp_path / "o.csv").theta, THETA)


# ---- what a file declares


def hdf5_of(folder: Path, change: Callable) -> bytes:
    h5py = pytest.importorskip("h5py")
    (folder / "secret").write_bytes(np.arange(60.0).tobytes())
    with h5py.File(folder / "other.h5", "w") as file:
        file["beta"] = BETA
    with h5py.File(folder / "f.h5", "w") as file:
        file["t"], file["theta"] = T, THETA
        change(h5py, file, folder)
    return (folder / "f.h5").read_bytes()


def virtual(h5py, file, folder):
    layout = h5py.VirtualLayout(shape=(ROWS,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "beta", shape=(ROWS,))
    file.create_virtual_dataset("beta", layout)


def behind_links(h5py, file, folder):
    file["group"] = h5py.ExternalLink(str(folder / "other.h5"), "/")
    file["beta"] = h5py.SoftLink("/group/beta")


HDF5 = {
    "8 TB": (lambda h5py, file, folder: file.create_dataset("beta", (10**12,), "f8", chunks=(1024,)), "declares 1e+12"),
    "packed": (lambda h5py, file, folder: file.create_dataset("beta", (2**20, 2**20), "i1", chunks=(16, 16),
                                                              compression="gzip"), "declares 1.1e+12 numbers"),
    "external storage": (lambda h5py, file, folder: file.create_dataset("beta", (ROWS,), "f8", external=[
        (str(folder / "secret"), 0, 8 * ROWS)]), "keeps its numbers in other files"),
    "external link": (lambda h5py, file, folder: file.__setitem__("beta", h5py.ExternalLink(
        str(folder / "other.h5"), "beta")), "is a link into another file"),
    "virtual": (virtual, "keeps its numbers in other files"),
    "behind a soft link": (behind_links, "is a link to /group/beta"),
}


@pytest.mark.parametrize("kind", HDF5)
def test_an_hdf5_that_lies_is_refused_and_the_rest_of_it_read(tmp_path, capsys, kind):
    change, mention = HDF5[kind]
    data = hdf5_of(tmp_path, change)
    assert mention in refusal(tmp_path, capsys, data)
    status, channels, _ = listed(tmp_path, capsys)
    assert status == 0 and channels["theta"].startswith("60 rows") and mention in channels["beta"]
    assert convert(tmp_path, data, MAP.replace('beta = {from = "beta"}\n', "")) == 0   # what no map names is not read


def test_groups_without_an_end_are_refused_or_walked_once(tmp_path, capsys):
    def deep(h5py, file, folder):
        for _ in range(300):
            file = file.create_group("g")
    def circle(h5py, file, folder):
        file["beta"] = BETA
        file["g/again"] = file["/"]
    assert "groups within more than 100" in refusal(tmp_path, capsys, hdf5_of(tmp_path, deep))
    assert convert(tmp_path, hdf5_of(tmp_path, circle), MAP) == 0


def test_only_what_is_asked_for_is_read(tmp_path):
    pytest.importorskip("pyarrow")
    for write in (lambda path: path.write_text(table().replace("\n", ",9\n").replace("9", "more", 1)),
                  lambda path: write_ulog(path, {"x": {"timestamp": T.astype(np.uint64), "theta": THETA},
                                                 "y": {"timestamp": T.astype(np.uint64), "more": BETA}}),
                  lambda path: write_mcap(path, {"x": {"timestamp": T * 1e9, "theta": THETA},
                                                 "y": {"timestamp": T * 1e9, "more": BETA}})):
        write(tmp_path / "flight")
        every = read_channels(str(tmp_path / "flight"), {})
        wanted = frozenset(name for name in every if name.endswith("theta"))
        found = read_channels(str(tmp_path / "flight"), {}, wanted)
        assert len(wanted) == 1 and set(found) == wanted and len(every) > 2
        assert set(found.unread.values()) == {"not asked for"}


MCAP_MAP = '[time]\nname = "log_time"\nunit = "ns"\n[columns]\ntheta = {from = "imu/a"}\nbeta = {from = "imu/b"}\n'


def mcap_of(path: Path, messages: list[str]) -> bytes:
    writer_of = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        writer = writer_of.Writer(file)
        writer.start()
        schema = writer.register_schema(name="any", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic="/imu", message_encoding="json", schema_id=schema)
        for k, message in enumerate(messages):
            writer.add_message(channel_id=channel, log_time=k * 10**7, publish_time=0, data=message.encode())
        writer.finish()
    return path.read_bytes()


def test_chunks_and_messages_that_lie_are_refused(tmp_path, capsys):
    good = mcap_of(tmp_path / "f", [f'{{"a": {k}, "b": 0.1}}' for k in range(50)])
    place = 8
    while good[place] != 6:   # a chunk: its length, two times, and the size that it declares
        place += 9 + struct.unpack_from("<Q", good, place + 1)[0]
    for at, mention in ((place + 25, "a chunk of"), (place + 1, "cannot be read as MCAP")):
        data = bytearray(good)
        struct.pack_into("<Q", data, at, 2**62)
        assert mention in refusal(tmp_path, capsys, bytes(data), MCAP_MAP)
        assert listed(tmp_path, capsys)[0] == 3
    nested = mcap_of(tmp_path / "f", ["[" * 100_000 + "]" * 100_000] * 3)
    assert "cannot be read as MCAP" in refusal(tmp_path, capsys, nested, MCAP_MAP)
    many = mcap_of(tmp_path / "f", [json.dumps({f"x{k}_{j}": 1 for j in range(101)}) for k in range(100)])
    assert "more than 10000 fields" in refusal(tmp_path, capsys, many, MCAP_MAP)


def element(kind: int, body: bytes) -> bytes:
    """One of MAT version 5."""
    return struct.pack("<2I", kind, len(body)) + body


def array(kind: int, inner: bytes) -> bytes:
    """A variable `beta` of this class, 1 x 1."""
    return element(14, element(6, struct.pack("<2I", kind, 0)) + element(5, struct.pack("<2i", 1, 1))
                   + element(1, b"beta".ljust(8, b"\0")) + inner)


def nested_cells() -> bytes:
    cells = array(6, element(9, bytes(8)))
    for _ in range(300):
        cells = array(1, cells)
    return cells


@pytest.mark.parametrize("is_packed", [False, True])
@pytest.mark.parametrize(("variable", "mention"), [
    (lambda: array(6, element(0, bytes(8))), "without numbers of a known type"),   # each ended the process
    (lambda: array(6, b""), "without numbers of a known type"), (nested_cells, "cells within more than 100 others"),
    (lambda: element(14, element(6, struct.pack("<2I", 17, 0)) + element(1, b"beta".ljust(8, b"\0")) + element(
        1, b"MCOS".ljust(8, b"\0")) + element(1, b"table".ljust(8, b"\0"))), "")])
def test_what_ends_the_mat_library_is_refused_and_what_it_does_not_know_is_told(tmp_path, capsys, variable, mention,
                                                                               is_packed):
    io = pytest.importorskip("scipy.io")
    io.savemat(tmp_path / "f.mat", {"t": T, "theta": THETA})
    more = element(15, zlib.compress(variable())) if is_packed else variable()
    data = (tmp_path / "f.mat").read_bytes() + more
    if mention:
        assert mention in refusal(tmp_path, capsys, data)
    else:
        status, channels, _ = listed(tmp_path, capsys, data)
        assert status == 0 and channels["theta"].startswith("60 rows")
        assert "is a MATLAB object" in next(what for name, what in channels.items() if name.startswith("beta"))


# ---- anything


def damaged(seed: int, folder: Path) -> tuple[bytes, str]:
    """A file and a map of which one is damaged."""
    r = Random(seed)
    kinds = list(TABLES.values())
    text, of = kinds[seed % len(kinds)]
    what = seed % 4
    if what == 0:
        return mutated(seed), r.choice((MAP, BY_PLACE, of))
    data = bytearray(of.encode() if what == 1 else text.encode())
    for _ in range(r.choice((1, 2, 8, 40))):
        a = r.randrange(len(data))
        how = r.randrange(4)
        if how == 0:
            data[a] = r.randrange(256)
        elif how == 1:
            del data[a:a + r.choice((1, 5, 200))]
        elif how == 2:
            data[a:a] = data[r.randrange(len(data)):][:r.choice((1, 20, 400))]
        else:
            data[a:a] = r.choice((b"\n", b'"', b",", b";", b" ", b"1e308", b"nan", b"#", b"\0", b"-", b"9" * 30, b"[",
                                   b"\xff"))
        data = data or bytearray(b"\n")
    if what == 1:
        (folder / "map.toml").write_bytes(data)
        return text.encode(), ""
    return bytes(data), of


def survives(folder: Path, seed: int) -> bool:
    """A log that can be written, a list, or InputError in one line; no other error, no warning of Python."""
    data, of = damaged(seed, folder)
    (folder / "flight").write_bytes(data)
    if of:
        (folder / "map.toml").write_text(of)
    path = str(folder / "flight")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if seed % 5 == 0:
                assert of_files.channel_lines(path, {})[0]
            else:
                made = of_files.convert(path, load_map(folder / "map.toml"), ("t",))
                made.write(folder / "o.csv")
                assert "rows over" in made.summary() and all("\n" not in note for note in made.warnings)
    except InputError as error:
        assert str(error).startswith(str(folder)) and str(error).isprintable()
        return False
    return True


def test_damaged_tables_and_maps_give_a_log_or_a_line(tmp_path, capsys):
    survived = [survives(tmp_path, seed) for seed in range(100)]
    assert 20 < survived.count(True) < 80
    for k, text in enumerate((table(), "", "\0", "a\n1;2\n")):   # and the command says it
        capsys.readouterr()
        assert convert(tmp_path, text, MAP) == (3 if k else 0)
        assert len(capsys.readouterr().err.splitlines()) == 1

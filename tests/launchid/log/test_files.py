"""Output files: whole or not at all, in the place of files only, with nothing left behind.

Devices and FIFOs are private nodes in a temporary folder: a fault of what is tested may cost those and no others.
"""

import os
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from launchid.main import main
from sim.errors import InputError
from sim.files import atomic_path, write_text
from sim.nominal import built_in, load_nominal, write_nominal

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="POSIX nodes, links and modes")


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.csv"
    assert main(["simulate", "constant", "--out", str(path), "--period", "0.1"]) == 0
    return path


def figure(path: Path) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    from launchid.report.paper_figures import save
    save(pyplot.figure(), path)


WRITERS: dict[str, Callable[[Path], None]] = {
    "text": lambda path: write_text(path, ["whole\n"]),
    "nominal": lambda path: write_nominal(load_nominal("constant"), path),
    "figure": figure}


# ---- a log that is no file


def fed(fifo: Path, data: bytes) -> threading.Thread:
    os.mkfifo(fifo)
    thread = threading.Thread(target=lambda: fifo.write_bytes(data), daemon=True)
    thread.start()
    return thread


def identified(log: Path, capsys: pytest.CaptureFixture) -> str:
    capsys.readouterr()
    assert main(["identify", str(log), "--json", "-"]) == 0
    return capsys.readouterr().out


def test_a_log_is_read_from_a_process_s_output_and_from_standard_input(log, tmp_path, capsys):
    """The log is given as a shell does with `<(cat LOG)` and with `< LOG`; `--json /dev/stdout > FILE` must not put
    another file in FILE's place."""
    if not os.path.isdir("/dev/fd"):
        pytest.skip("no /dev/fd here")
    expected = identified(log, capsys)
    out, into = os.pipe()
    with subprocess.Popen(["cat", str(log)], stdout=into):
        os.close(into)
        assert identified(Path(f"/dev/fd/{out}"), capsys) == expected
        os.close(out)
    with log.open("rb") as file, (tmp_path / "out.txt").open("w") as out_file:
        done = subprocess.run([sys.executable, "-m", "sim", "identify", "-", "--json", "/dev/stdout"], stdin=file,
                              stdout=out_file, cwd=ROOT, check=False, timeout=300)
    text = (tmp_path / "out.txt").read_text()
    assert done.returncode == 0 and text.startswith(expected) and "samples accepted" in text
    before = log.read_bytes()
    with log.open("rb") as file:
        done = subprocess.run([sys.executable, "-m", "sim", "identify", "-", "--json", str(log)], stdin=file, cwd=ROOT,
                              text=True, capture_output=True, timeout=300, check=False)
    assert done.returncode == 3 and "input" in done.stderr and log.read_bytes() == before


def test_what_standard_input_lacks_is_one_line(log):
    done = subprocess.run([sys.executable, "-m", "sim", "identify", "-", "--quiet"], input=b"\x89PNG\r\n\x1a\n\xff",
                          cwd=ROOT, capture_output=True, timeout=300, check=False)
    err = done.stderr.decode()
    assert done.returncode == 3 and len(err.splitlines()) == 1 and err.startswith("launchid: -: "), err
    done = subprocess.run([sys.executable, "-m", "sim", "identify", "-"], cwd=ROOT, capture_output=True, timeout=300,
                          check=False, preexec_fn=lambda: os.close(0))
    assert done.returncode == 3 and b"closed" in done.stderr


def test_a_pipe_is_no_second_log_and_no_output_of_its_reader(tmp_path, log, capsys):
    pipe = tmp_path / "pipe"
    thread = fed(pipe, log.read_bytes())
    assert main(["diagnose", str(pipe), "constant", "--holdout", str(pipe)]) == 3
    assert "read once" in capsys.readouterr().err
    thread.join(10)
    pipe.unlink()
    thread = fed(pipe, log.read_bytes())
    assert main(["identify", str(pipe), "--json", str(pipe)]) == 3
    assert "input" in capsys.readouterr().err
    thread.join(10)
    assert stat.S_ISFIFO(pipe.lstat().st_mode)


# ---- what is no file is written through


def reader_of(fifo: Path) -> tuple[threading.Thread, list[bytes]]:
    got: list[bytes] = []
    thread = threading.Thread(target=lambda: got.append(fifo.read_bytes()), daemon=True)
    thread.start()
    return thread, got


@pytest.mark.parametrize("writer", WRITERS)
def test_a_fifo_is_written_through(tmp_path, writer):
    fifo = tmp_path / "pipe.png"
    os.mkfifo(fifo)
    thread, got = reader_of(fifo)
    WRITERS[writer](fifo)
    thread.join(10)
    plain = tmp_path / "plain.png"
    WRITERS[writer](plain)
    assert got == [plain.read_bytes()] and got[0]
    assert stat.S_ISFIFO(fifo.lstat().st_mode)
    assert {path.name for path in tmp_path.iterdir()} == {"pipe.png", "plain.png"}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_device_stays_a_device(tmp_path, writer):
    node = tmp_path / "null.png"
    try:
        os.mknod(node, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
        node.write_bytes(b"")
    except OSError as error:
        pytest.skip(f"no private device can be made or opened here ({error.strerror})")
    link = tmp_path / "link.png"
    link.symlink_to(node)
    for path in (node, link):
        WRITERS[writer](path)
        assert stat.S_ISCHR(node.lstat().st_mode) and node.lstat().st_rdev == os.makedev(1, 3)
    assert link.is_symlink()
    assert {path.name for path in tmp_path.iterdir()} == {"null.png", "link.png"}


def test_a_fifo_whose_reader_leaves_is_one_line(tmp_path):
    fifo = tmp_path / "pipe"
    os.mkfifo(fifo)
    thread = threading.Thread(target=lambda: os.close(os.open(fifo, os.O_RDONLY)), daemon=True)
    thread.start()
    with pytest.raises(InputError, match="cannot be written"):
        write_text(fifo, ["x" * 100] * 100_000)
    assert stat.S_ISFIFO(fifo.lstat().st_mode)


# ---- links


def test_behind_a_link_the_target_is_replaced_and_the_link_stays(tmp_path):
    (tmp_path / "far").mkdir()
    target, link, chain = tmp_path / "far" / "target", tmp_path / "link", tmp_path / "chain"
    target.write_text("old")
    link.symlink_to(target)
    chain.symlink_to("link")
    old = target.stat().st_ino
    write_text(chain, ["new"])
    assert target.read_text() == "new" and target.stat().st_ino != old
    assert link.is_symlink() and chain.is_symlink()


# ---- modes


@pytest.mark.parametrize("bits", [0o600, 0o640, 0o664, 0o755])
def test_the_mode_of_a_file_stays(tmp_path, bits):
    path = tmp_path / "x"
    path.write_text("old")
    path.chmod(bits)
    write_text(path, ["new"])
    assert (path.read_text(), mode(path)) == ("new", bits)


def test_a_read_only_file_is_refused_even_to_root(tmp_path, log, capsys):
    path = tmp_path / "kept.json"
    path.write_text("old")
    path.chmod(0o444)
    capsys.readouterr()
    assert main(["identify", str(log), "--json", str(path)]) == 3
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1 and "read-only" in err
    assert path.read_text() == "old"


# ---- the input is no output


@pytest.mark.parametrize("how", ["itself", "link", "hard link", "another spelling"])
def test_the_input_is_no_output(tmp_path, log, capsys, how):
    alias = tmp_path / "alias"
    if how == "link":
        alias.symlink_to(log)
    elif how == "hard link":
        os.link(log, alias)
    elif how == "another spelling":
        alias = tmp_path / ".." / tmp_path.name / log.name
    else:
        alias = log
    before = log.read_bytes()
    capsys.readouterr()
    assert main(["identify", str(log), "--json", str(alias)]) == 3
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1 and "input" in err
    assert log.read_bytes() == before


def test_neither_nominal_nor_its_profile_is_an_output(tmp_path, capsys):
    write_nominal(load_nominal("vega_like"), tmp_path / "n.toml")
    profile = tmp_path / "profile.csv"
    profile.write_bytes((built_in("vega_like").parents[1] / "profiles" / "vega_like.csv").read_bytes())
    text = (tmp_path / "n.toml").read_text().splitlines()
    text = [f'profile = "{profile.name}"' if line.startswith("profile") else line for line in text]
    (tmp_path / "n.toml").write_text("\n".join(text) + "\n")
    for path in (tmp_path / "n.toml", profile):
        before = path.read_bytes()
        assert main(["simulate", str(tmp_path / "n.toml"), "--out", str(path)]) == 3
        assert path.read_bytes() == before and "input" in capsys.readouterr().err


# ---- what a killed run leaves


KILLED = """
import sys, time
from sim.files import atomic_path
with atomic_path(sys.argv[1]) as path:
    path.write_text("half")
    print("written", flush=True)
    time.sleep(60)
"""


def writing(path: Path) -> subprocess.Popen:
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "written\n"
    return process


def test_a_link_under_a_hidden_name_is_nobody_s_leftover(tmp_path):
    """No run of ours leaves one: what it points at is not opened, and it stays."""
    (tmp_path / "victim").write_text("another's")
    os.mkfifo(tmp_path / "fifo")
    names = [f".x.json.{k:016x}.launchid" for k in range(3)]
    for name, target in zip(names, ("victim", "fifo", "nowhere"), strict=True):
        (tmp_path / name).symlink_to(tmp_path / target)
    write_text(tmp_path / "x.json", ["whole"])
    assert {path.name for path in tmp_path.iterdir()} == {"x.json", "victim", "fifo", *names}
    assert (tmp_path / "victim").read_text() == "another's"


def test_what_a_killed_run_left_goes_at_the_next_and_a_living_one_s_stays(tmp_path):
    path = tmp_path / "x.json"
    near = [tmp_path / name for name in (".x.json.swp", ".x.json.0123456789abcdef.launchid.bak", "x.json.launchid",
                                         ".0123456789abcdef.launchid")]
    for other in near:
        other.write_text("another's")
    killed, other, living = writing(path), writing(tmp_path / "y.csv"), writing(path)
    try:
        hidden = {p.name for p in tmp_path.iterdir() if p not in near}
        assert len(hidden) == 3 and not path.exists()
        for process in (killed, other):
            process.send_signal(signal.SIGKILL)
            process.wait(10)
        write_text(path, ["whole"])
        left = {p.name for p in tmp_path.iterdir() if p not in near}
        assert path.read_text() == "whole"
        assert len(left & hidden) == 1, "the living one's, and that alone"
        assert all(other.read_text() == "another's" for other in near)
    finally:
        living.kill()
        living.wait(10)
    write_text(path, ["again"])
    assert set(tmp_path.iterdir()) == {path, *near}


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "x"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_two_at_once_leave_one_whole(tmp_path):
    path = tmp_path / "x"

    def write(letter: str) -> None:
        for _ in range(50):
            write_text(path, [letter * 1000])

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "abcd"]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        if path.exists():
            assert len(set(path.read_text())) == 1
        time.sleep(0.001)
    assert list(tmp_path.iterdir()) == [path]

"""A full disk, a reader that leaves, an interrupt, a kill: nothing half written, nothing of before lost.

The full disk is a limit on the size of files (RLIMIT_FSIZE), which fails as a full one does: in the middle of a write.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from launchid.main import main

resource = pytest.importorskip("resource", reason="POSIX limits")

ROOT = Path(__file__).resolve().parents[3]


@contextlib.contextmanager
def room(size: int) -> Iterator[None]:
    """No file grows beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("made")
    text = (ROOT / "sim" / "data" / "nominal" / "constant.toml").read_text(encoding="utf-8")
    (path / "short.toml").write_text(text.replace("duration = 70.0", "duration = 12.0"), encoding="utf-8")
    assert main(["simulate", str(path / "short.toml"), "--out", str(path / "log.csv"), "--seed", "3"]) == 0
    return path


COMMANDS = {   # output's name -> words
    "new.csv": ["simulate", "SHORT", "--out", "OUT"],
    "x.json": ["identify", "LOG", "--json", "OUT"],
    "x.png": ["identify", "LOG", "--plot", "OUT"],
    "new.toml": ["plan", "SHORT", "--accuracy", "0.1", "--window", "5", "--out", "OUT"]}


def words_of(name: str, folder: Path, out: Path) -> list[str]:
    places = {"SHORT": folder / "short.toml", "LOG": folder / "log.csv", "OUT": out}
    return [str(places.get(word, word)) for word in COMMANDS[name]]


@pytest.mark.parametrize("name", [name if name == "x.json" else pytest.param(name, marks=pytest.mark.campaign)
                                  for name in COMMANDS])
def test_a_full_disk_leaves_what_was_there_and_says_so(tmp_path, capsys, folder, name):
    out = tmp_path / name
    words = words_of(name, folder, out)
    assert main(words) == 0  # and its kernels are kept
    whole = out.read_bytes()
    capsys.readouterr()
    for size in (0, 1, len(whole) // 2, len(whole) - 1):
        out.write_text("old")
        with room(size):
            assert main(words) == 3
        shown, err = capsys.readouterr()
        assert (shown, err) == ("", f"launchid: {out}: cannot be written (File too large)\n")
        assert out.read_text() == "old" and list(tmp_path.iterdir()) == [out]
    with room(len(whole)):
        assert main(words) == 0
    assert out.read_bytes() == whole


# ---- a reader that leaves


def launchid(*words: object, **options: object) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "sim", *map(str, words)], cwd=ROOT, stderr=subprocess.PIPE,
                            **options)  # type: ignore[call-overload]


@pytest.mark.parametrize("words", [["identify", "LOG", "--json", "-"], ["--help"]], ids=" ".join)
def test_a_reader_that_leaves_is_no_error(folder, words):
    """A reader such as `| head -1` reads a line and goes; here before the first byte."""
    read, write = os.pipe()
    os.close(read)
    quiet = ["--quiet"] * (words != ["--help"])
    process = launchid(*(folder / "log.csv" if word == "LOG" else word for word in words + quiet), stdout=write)
    os.close(write)
    _, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (0, b"")


# ---- an interrupt, a kill


def test_ctrl_c_while_a_pipe_is_waited_for_is_one_line(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    process = launchid("identify", tmp_path / "pipe", "--json", tmp_path / "x.json", stdout=subprocess.PIPE)
    with (tmp_path / "pipe").open("wb") as pipe:   # it reads now
        pipe.write(b"t,theta,beta\n0,1,2\n")
        pipe.flush()
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, b"", b"launchid: interrupted; files already written are whole\n")
    assert {path.name for path in tmp_path.iterdir()} == {"pipe"}


AGAIN = """
import sys
from launchid.main import main
words = sys.argv[1:]
assert main(words) == 0
print("ready", flush=True)
while True:
    for seed in "12":
        assert main([*words, "--seed", seed]) == 0
"""


@pytest.mark.parametrize(("number", "delays"), [
    (signal.SIGKILL, (0.11,)), (signal.SIGINT, (0.05,)),
    pytest.param(signal.SIGKILL, (0.02, 0.05, 0.23, 0.37), marks=pytest.mark.campaign)])
def test_a_run_that_ends_anywhere_leaves_a_whole_file(tmp_path, folder, number, delays):
    """The run is ended while it writes the same log over and over: the log is one of those whole, and nothing else
    stays."""
    out = tmp_path / "log.csv"
    words = ["simulate", str(folder / "short.toml"), "--out", str(out)]
    whole = set()
    for seed in "012":
        assert main([*words, "--seed", seed]) == 0
        whole.add(out.read_bytes())
    for delay in delays:
        out.unlink()
        process = subprocess.Popen([sys.executable, "-c", AGAIN, *words], cwd=ROOT, stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL)
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        time.sleep(delay)
        process.send_signal(number)
        try:
            process.wait(60)
        finally:
            process.kill()  # what no signal has ended would write for ever
        assert out.read_bytes() in whole
        if number is not signal.SIGKILL:
            assert list(tmp_path.iterdir()) == [out]
    assert main(words) == 0
    assert list(tmp_path.iterdir()) == [out], "what a killed run left has gone"

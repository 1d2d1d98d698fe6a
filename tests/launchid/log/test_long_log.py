"""A log of any length is read in the memory of its columns: measured as the peak of a process of its own."""

import contextlib
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="POSIX: peak memory of a process")

ROOT = Path(__file__).resolve().parents[3]
BLOCK_ROWS = 100_000
MULTIPLE = 1.25    # of the arrays' bytes: a column grows by a sixteenth at a time, and may be moved when it does
FIXED = 4 << 20    # bytes: rows that are text at a time, and what the allocator keeps
READ = """
import resource, sys
from launchid.log.log import OPTIONAL, REQUIRED, read_log
def peak():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
before = peak()
log = read_log(sys.argv[1])
arrays = {id(x): x.nbytes for x in (getattr(log, name) for name in REQUIRED + OPTIONAL)}
print(len(log.t), sum(arrays.values()), peak() - before)
"""


def read_through_a_pipe(folder: Path, header: str, row: str, blocks: int) -> tuple[int, int, int]:
    """Rows, bytes of the arrays, bytes by which the peak grew, of a log that is never on the disk."""
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    block = f"{row}\n".encode() * BLOCK_ROWS

    def feed() -> None:
        with contextlib.suppress(BrokenPipeError), pipe.open("wb") as file:
            file.write(f"{header}\n".encode())
            for _ in range(blocks):
                file.write(block)

    threading.Thread(target=feed, daemon=True).start()
    done = subprocess.run([sys.executable, "-c", READ, str(pipe)], cwd=ROOT, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    rows, arrays, grown = map(int, done.stdout.split())
    return rows, arrays, grown


@pytest.mark.parametrize(("header", "row", "arrays"), [
    ("t,theta,beta", "0.25,0.0123456789,-0.5", 4), ("t,theta,beta,theta_dot,beta_cmd,note", "1,0.25,2,,nan,x", 6)])
def test_memory_is_that_of_the_columns(tmp_path, header, row, arrays):
    """The known columns, and one of NaN for all that are not there."""
    rows, held, grown = read_through_a_pipe(tmp_path, header, row, 2)
    assert (rows, held) == (2 * BLOCK_ROWS, 8 * arrays * rows)
    assert grown <= MULTIPLE * held + FIXED

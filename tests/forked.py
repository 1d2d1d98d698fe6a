"""Processes that have imported numba already: a server, itself a new interpreter, forks one for each run.

Importing numba and compiling a first function takes a second and a half, of which nothing is the project's: a test that
needs many processes of this project on the same numba starts them here.  What numba reads from the environment when it
is imported is the server's; a test of that starts a process of its own.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

SERVER = """
import atexit, json, os, sys
import numba
numba.njit(lambda x: x + 1.0)(1.0)
for line in sys.stdin:
    code, words, folder, environment, out, err, waited = json.loads(line)
    if waited:
        print(os.waitstatus_to_exitcode(os.waitpid(waited, 0)[1]), flush=True)
        continue
    child = os.fork()
    if child:
        print(child, flush=True)
        continue
    for number, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    sys.path[:0] = environment["PYTHONPATH"].split(os.pathsep)
    sys.dont_write_bytecode = True
    sys.argv[1:] = words
    status = 1
    try:
        exec(compile(code, "<run>", "exec"), {"__name__": "__main__"})
        status = 0
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        if status:
            import traceback
            traceback.print_exc()
        sys.stderr.flush()
        os._exit(status)
"""


@cache
def _server() -> subprocess.Popen:
    variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR", "LAUNCHID_CACHE")}
    server = subprocess.Popen([sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                              env=variables, cwd=tempfile.gettempdir())
    atexit.register(server.communicate)  # which ends its input, and so the server
    return server


def _asked(*words: object) -> int:
    server = _server()
    assert server.stdin is not None and server.stdout is not None
    server.stdin.write(json.dumps(words) + "\n")
    server.stdin.flush()
    return int(server.stdout.readline())


class Forked:
    """A run of the server; as much of `subprocess.Popen` as its tests need."""

    def __init__(self, code: str, words: tuple[str, ...], folder: Path, environment: dict[str, str]) -> None:
        handle, self._out = tempfile.mkstemp(dir=folder)
        os.close(handle)
        self._err = f"{self._out}.err"
        self.pid = _asked(code, words, str(folder), environment, self._out, self._err, 0)
        self.returncode: int | None = None

    def kill(self) -> None:
        """Kill the process at once."""
        os.kill(self.pid, signal.SIGKILL)

    def communicate(self) -> tuple[str, str]:
        """The output of the process, at its end."""
        self.returncode = _asked("", (), "", {}, "", "", self.pid)
        return tuple(Path(path).read_text() if Path(path).exists() else "" for path in (self._out, self._err))

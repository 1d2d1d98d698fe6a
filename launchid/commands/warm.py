"""The command `launchid warm`: compiles what the commands need, a part in each process."""

import argparse
import multiprocessing
import os
import signal
import tempfile
import time
from multiprocessing import connection, sharedctypes
from pathlib import Path
from typing import Any

from launchid_core import cache_folder
from sim.errors import InputError

from ..cli.compilation import OFTEN, compile_formulation, cores
from ..cli.options import add_command
from ..cli.terminal import answer, say

UNKEPT = 9   # exit status of a part whose kernels cannot be kept
ROWS = 1200  # of the log on which the commands run: 12 s
PARTS = (  # the longest first; each ends on its own, and loads what another has compiled
    "filtered", "filtered backwards", "regressions", "diagnose LOG vega_like",
    "plan constant --accuracy 0.1 --window 5 --out OUT", "uncertainty LOG vega_like", "nominal LOG --out OUT",
    "simulate vega_like --effect gust:angle=0.01,time=2,duration=1 --out OUT", "margins LOG vega_like",
    "campaign vega_like --flights 2 --workers 1 --out OUT")


def add(commands: Any) -> None:
    """Add the command to the parser."""
    sub = add_command(commands, "warm", "compile what the commands need, on as many processes as cores",
                      "launchid warm")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid warm`."""
    begun = last = time.monotonic()
    waiting, running, done = list(PARTS), {}, 0
    compiled = sharedctypes.RawValue("i", 0)
    with tempfile.TemporaryDirectory() as folder:
        try:
            while waiting or running:
                while waiting and len(running) < cores():
                    process = multiprocessing.Process(target=compile_part, args=(waiting[0], folder, compiled))
                    process.start()
                    running[process.sentinel] = process, waiting.pop(0)
                for sentinel in connection.wait(list(running), OFTEN / 10.0):
                    process, part = running.pop(sentinel)
                    process.join()
                    if process.exitcode == UNKEPT:
                        raise InputError(f"{cache_folder()}: it cannot be written, is full, or others may write to it")
                    if process.exitcode:
                        raise InputError(f"warm: {part}: ended with {process.exitcode}")
                    done += 1
                now = time.monotonic()
                if now - last >= OFTEN:
                    last = now
                    say(f"launchid: {compiled.value} kernels compiled, {done} of {len(PARTS)} parts done in "
                        f"{now - begun:.0f} s ...")
        finally:
            for process, _ in running.values():
                process.kill()  # what it has compiled is kept
                process.join()
    answer(f"{compiled.value} kernels compiled in {time.monotonic() - begun:.0f} s")


def compile_part(part: str, folder: str, compiled: Any) -> None:
    """Compile a part, silently, and count its kernels."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    from launchid_core import FORMULATIONS, SOLVERS, compile_listeners

    def count(module: str, name: str) -> None:
        compiled.value += 1

    compile_listeners[:] = [count]
    formulation, *backwards = part.split()
    if formulation == "filtered":
        os._exit(0 if compile_formulation("filtered", backwards=bool(backwards)) else UNKEPT)
    elif part == "regressions":
        for other in FORMULATIONS:
            for solver in SOLVERS if other != "filtered" else ():
                compile_formulation(other, solver=solver)
    else:
        from ..cli.main import main
        own = Path(tempfile.mkdtemp(dir=folder))
        log, out = own / "log.csv", own / "out"
        main(["simulate", "vega_like", "--out", str(log)])
        log.write_text("".join(log.read_text().splitlines(keepends=True)[:ROWS]))
        words = [{"LOG": str(log), "OUT": str(out)}.get(word, word) for word in part.split()]
        os._exit(main(words))

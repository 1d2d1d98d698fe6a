"""Compile what the commands need, a part in each process: `launchid warm`."""

import argparse
import os
import signal
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from launchid_core import FORMULATIONS, SOLVERS, compile_listeners
from sim.errors import InputError

from ..cli.compilation import OFTEN, compile_formulation, cores, end_with_parent
from ..cli.options import add_command
from ..cli.run import run as run_command
from ..cli.terminal import answer, say
from . import campaign, diagnose, margins, nominal, plan, simulate, uncertainty

WARM_ROWS = 1200  # of the log on which the commands run: 12 s
UNKEPT = 9   # exit status of a part whose kernels cannot be kept
PARTS = (    # the longest first; each loads what another has compiled
    "filtered", "filtered backwards", "regressions", "diagnose LOG vega_like",
    "plan constant --accuracy 0.1 --window 5 --out OUT", "uncertainty LOG vega_like", "nominal LOG --out OUT",
    "simulate vega_like --effect gust:angle=0.01,time=2,duration=1 --out OUT", "margins LOG vega_like",
    "campaign vega_like --flights 2 --workers 1 --out OUT",
    "simulate vega_like --effect missing_term:term=theta^2,coefficient=1 --out OUT")

COMPILED = (campaign, diagnose, margins, nominal, plan, simulate, uncertainty)   # the commands of PARTS


def add(commands: Any) -> None:
    """Add `launchid warm` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "warm", "compile what the commands need, on as many processes as cores",
                      "launchid warm")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid warm` with its parsed arguments: compile all kernels, and print how many."""
    begun = time.monotonic()
    compiled = compile_parts(PARTS)
    answer(f"{compiled} kernels compiled in {time.monotonic() - begun:.0f} s")


def compile_parts(parts: Sequence[str]) -> int:
    """Compile parts (PARTS), as many at once as there are cores; return how many kernels.  InputError if one fails."""
    import multiprocessing
    from multiprocessing.connection import wait

    from launchid_core import Estimator, cache_folder  # noqa: F401  imported once, for all that are forked
    begun = last = time.monotonic()
    compiled = multiprocessing.Value("i", 0)
    waiting, running = list(parts), dict[Any, Any]()
    with tempfile.TemporaryDirectory() as folder:
        try:
            while waiting or running:
                while waiting and len(running) < cores():
                    process = multiprocessing.Process(target=compile_part, args=(waiting[0], folder, compiled),
                                                      name=waiting.pop(0))
                    process.start()
                    running[process.sentinel] = process
                for sentinel in wait(list(running), OFTEN / 10.0):
                    process = running.pop(sentinel)
                    process.join()
                    if process.exitcode == UNKEPT:
                        raise InputError(f"{cache_folder()}: it cannot be written, is full, or others may write to it")
                    if process.exitcode:
                        raise InputError(f"launchid {process.name}: ended with status {process.exitcode}")
                if time.monotonic() - last >= OFTEN:
                    last = time.monotonic()
                    say(f"launchid: {compiled.value} kernels compiled, {len(parts) - len(waiting) - len(running)} of "
                        f"{len(parts)} parts done in {last - begun:.0f} s ...")
        finally:
            for process in running.values():
                process.kill()  # what it has compiled is kept
                process.join()
    return compiled.value


def compile_part(part: str, folder: str, compiled: Any) -> None:
    """Compile a part in this process, count its kernels in `compiled`, print nothing; exit with the part's status."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)

    def count(module: str, name: str) -> None:
        with compiled.get_lock():
            compiled.value += 1

    compile_listeners[:] = [count]
    end_with_parent()
    if part.startswith("filtered"):
        os._exit(0 if compile_formulation("filtered", part.endswith("backwards"), is_whole=True) else UNKEPT)
    if part == "regressions":
        for formulation in FORMULATIONS:
            for solver in SOLVERS if formulation != "filtered" else ():
                compile_formulation(formulation, solver=solver)
        os._exit(0)
    own = Path(tempfile.mkdtemp(dir=folder))
    log, out = own / "log.csv", own / "out"
    run_command(COMPILED, ["simulate", "vega_like", "--out", str(log)])
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:WARM_ROWS]))
    os._exit(run_command(COMPILED, [{"LOG": str(log), "OUT": str(out)}.get(word, word) for word in part.split()]))

"""Announce and count the compilation of kernels, and start a second process that helps where a core is idle."""

import atexit
import dataclasses
import mmap
import os
import signal
import subprocess
import sys
import time
from typing import Any

from launchid_core import compile_listeners

from .terminal import say

OFTEN = 10.0  # s between two lines
HELPED = {"launchid_core.order": "filtered", "launchid_core.regression": "integral"}  # formulations worth a process
HELPER = "import sys; from launchid.cli.compilation import help_from_the_end; help_from_the_end(sys.argv[1])"


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def has_idle_core() -> bool:
    """Whether the load average leaves a core idle beside the one of this process."""
    return cores() > 1 and (not hasattr(os, "getloadavg") or os.getloadavg()[0] < cores() - 1)


class Compilation:
    """Listener that launchid_core calls for each kernel that it compiles: announces it, counts, starts one helper."""

    def __init__(self) -> None:
        self.said = mmap.mmap(-1, 1)  # shared with forked workers
        self.process, self.helper, self.is_quiet = os.getpid(), False, False
        self.kernels, self.begun = 0, time.monotonic()
        self.last = self.begun

    def __call__(self, module: str, name: str) -> None:
        """Count a compiled kernel; announce the first, and start the helper process if the module is worth it."""
        now = time.monotonic()
        if self.is_quiet:
            pass
        elif not self.said[0]:
            self.said[0] = 1
            self.begun = self.last = now
            say("launchid: compiling, once for this version on this machine (all at once: launchid warm) ...")
        if os.getpid() != self.process:
            return
        if now - self.last >= OFTEN and not self.is_quiet:
            self.last = now
            say(f"launchid: {self.kernels} kernels compiled in {now - self.begun:.0f} s ...")
        self.kernels += 1
        formulation = HELPED.get(".".join(module.split(".")[:2]))
        if formulation and not self.helper:
            self.helper = True
            if has_idle_core():
                helper = subprocess.Popen([sys.executable, "-c", HELPER, formulation], stdin=subprocess.DEVNULL,
                                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                atexit.register(helper.kill)  # nothing that it has compiled is lost


def announce() -> None:
    """Announce compilations on stderr from now on, and start a helper process where a core is idle."""
    compile_listeners.append(Compilation())


def hush() -> None:
    """Print nothing about compilations from now on (--quiet); a helper process is still started."""
    for listener in compile_listeners:
        if isinstance(listener, Compilation):
            listener.is_quiet = True


def compile_formulation(formulation: str, backwards: bool = False, is_whole: bool = False, **choices: Any) -> bool:
    """Compile what an estimator of the formulation needs, if it can be kept on disk; return whether it can.

    is_whole: "filtered" also with more terms, an unknown servo and a range; backwards: the last kernels first
    """
    from launchid_core import Config, precompile
    from sim.nominal import load_nominal
    from sim.onboard import onboard_model
    model = onboard_model(load_nominal("constant")) if formulation == "filtered" else None
    if model and is_whole:
        model = dataclasses.replace(model, delay_sigma=1e-3, sigma_t=(0.0,), sigma_a6=(0.3,), sigma_k1=(0.3,))
        choices["library"] = ("theta", "theta_dot", "beta")
    return precompile(Config(formulation=formulation, model=model, **choices), backwards)


def end_with_parent() -> None:
    """End this process, when it next compiles a kernel, if the process that started it has ended."""
    parent = os.getppid()

    def look(module: str, name: str) -> None:
        if os.getppid() != parent:
            os._exit(0)

    compile_listeners.append(look)


def help_from_the_end(formulation: str) -> None:
    """Compile a formulation's kernels in a helper process, from the last on, until all are compiled."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()
    compile_formulation(formulation, backwards=True)

"""One line when the first kernel is compiled, in this process or in one forked from it."""

import mmap

from launchid_core import compile_listeners

from .terminal import say


class Announcement:
    """An announcement that is made once."""

    def __init__(self) -> None:
        self.said = mmap.mmap(-1, 1)  # shared with forked workers

    def __call__(self, module: str, name: str) -> None:
        if self.said[0] == 0:
            self.said[0] = 1
            what = "estimator" if module.startswith("launchid_core") else "simulation"
            say(f"launchid: compiling the {what} (first use of this version on this machine, up to a minute) ...")


def announce() -> None:
    """Announce compilations on stderr from now on."""
    compile_listeners.append(Announcement())

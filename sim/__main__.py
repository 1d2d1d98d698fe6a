"""`python -m sim` is the command `launchid`, as a process of its own: it says when it has to compile first."""

import mmap
import sys

from launchid_core import compile_listeners

from .cli import main, say


class Announcement:
    """One line when the first kernel is compiled, in this process or in one forked from it."""

    def __init__(self) -> None:
        self.said = mmap.mmap(-1, 1)  # shared with forked workers

    def __call__(self, module: str, name: str) -> None:
        if self.said[0] == 0:
            self.said[0] = 1
            what = "estimator" if module.startswith("launchid_core") else "simulation"
            say(f"launchid: compiling the {what} (first use of this version on this machine, up to a minute) ...")


def command() -> int:
    """The console script."""
    compile_listeners.append(Announcement())
    return main()


if __name__ == "__main__":
    sys.exit(command())

"""The clock of the time limit: what a diagnosis takes, without what is compiled for its first time."""

import time

from numba.core import event

COMPILING = "numba:compile"


class Compiling(event.Listener):
    """Adds up the seconds in which numba compiles; what is compiled meanwhile counts once."""

    def __init__(self) -> None:
        self.depth, self.began, self.total = 0, 0.0, 0.0

    def on_start(self, event: event.Event) -> None:
        if self.depth == 0:
            self.began = time.monotonic()
        self.depth += 1

    def on_end(self, event: event.Event) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.total += time.monotonic() - self.began


_compiling = Compiling()
event.register(COMPILING, _compiling)


def now() -> float:
    """[s] that stands still while numba compiles; only differences mean anything."""
    return time.monotonic() - _compiling.total

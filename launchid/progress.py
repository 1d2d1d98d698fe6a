"""Progress of long runs: the work calls `report`, and listeners show it.

A command listens (`cli.terminal`), a caller of the Python functions hears nothing.  A listener is called with what is
being done, how much of it is done, and of how much (0: not known).
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")
listeners: list[Callable[[str, int, int], None]] = []


def report(what: str, done: int = 0, total: int = 0) -> None:
    """Tell every listener what is being done, and that `done` of `total` (0: not known) are done."""
    for listener in listeners:
        listener(what, done, total)


def each(items: Sequence[Item], what: str) -> Iterator[Item]:
    """Yield the items one by one, and report before each how many are done."""
    for done, item in enumerate(items):
        report(what, done, len(items))
        yield item


class Counter:
    """Counter of finished items of `total`, called by workers with how many are newly done; it reports progress."""

    def __init__(self, total: int, what: str) -> None:
        self.total, self.what, self.done = total, what, 0

    def __call__(self, newly: int) -> None:
        """Count `newly` more as done, and report it."""
        self.done += newly
        report(self.what, self.done, self.total)

"""How far a long run is: what does the work says it here, and who listens shows it.

A command listens (`cli.terminal`), a caller of the Python functions hears nothing.  A listener is called with what is
being done, how much of it is done, and of how much (0: not known).
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")
listeners: list[Callable[[str, int, int], None]] = []


def report(what: str, done: int = 0, total: int = 0) -> None:
    """Say what is being done, and that `done` of `total` are."""
    for listener in listeners:
        listener(what, done, total)


def each(items: Sequence[Item], what: str) -> Iterator[Item]:
    """Yield the items, saying before each how many are done."""
    for done, item in enumerate(items):
        report(what, done, len(items))
        yield item


class Counter:
    """A count that workers add to: called with how many are newly done."""

    def __init__(self, total: int, what: str) -> None:
        self.total, self.what, self.done = total, what, 0

    def __call__(self, newly: int) -> None:
        """Count so many more as done."""
        self.done += newly
        report(self.what, self.done, self.total)

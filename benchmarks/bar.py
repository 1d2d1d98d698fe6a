"""A progress bar on a terminal."""

import contextlib
import sys
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def bar(total: int) -> Iterator[Callable[[int], object]]:
    """tqdm's `update` on a terminal, if it is installed; else nothing that is seen."""
    try:
        from tqdm import tqdm
    except ImportError:
        yield lambda _: None
        return
    with tqdm(total=total, unit="flight", file=sys.stderr, disable=not sys.stderr.isatty()) as shown:
        yield shown.update

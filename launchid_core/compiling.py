"""The listeners that are called when a kernel is compiled, which takes seconds; the core itself prints nothing."""

from collections.abc import Callable

compile_listeners: list[Callable[[str, str], None]] = []  # called with module and name of each that is on no disk

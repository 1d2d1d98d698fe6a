"""Who wants to know when a kernel is compiled, which takes seconds.  The core itself says nothing."""

from collections.abc import Callable

compile_listeners: list[Callable[[str, str], None]] = []  # called with module and name of each that is on no disk

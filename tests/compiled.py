"""Kernels that only kernels call, compiled so that a test can call them too; kept on disk, so that one process does."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numba

from launchid_core.cache import kept_apart
from launchid_core.kernels import CHOICES


@cache
def compiled(kernel: Any) -> Callable[..., Any]:
    """An `inner` kernel with the wrapper that Python needs; un-jitted where numba is told not to compile."""
    function = getattr(kernel, "py_func", kernel)
    with kept_apart(function) as is_safe:
        numba.config.CACHE_DIR += "/called"  # numba takes a kernel without the wrapper for the same
        made: Callable[..., Any] = numba.njit(cache=is_safe, **CHOICES)(function)
    return made


def as_written(module: ModuleType) -> SimpleNamespace:
    """A module's kernels in Python, each calling the others so; of an `inner` one there is nothing that Python may
    call."""
    source, importing = Path(str(module.__file__)).read_text(encoding="utf-8"), "from ..kernels import inner\n"
    assert importing in source
    names: dict[str, Any] = {"__name__": module.__name__, "__package__": module.__package__}
    exec(source.replace(importing, "inner = lambda function: function\n"), names)
    return SimpleNamespace(**names)

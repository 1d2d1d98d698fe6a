"""Kernels that only kernels call, compiled so that a test can call them too; kept on disk, so that one process does."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba

from launchid_core.cache import kept_apart
from launchid_core.kernels import CHOICES


@cache
def compiled(kernel: Any) -> Callable[..., Any]:
    """An `inner` kernel with the wrapper that Python needs; un-jitted where numba is told not to compile."""
    function = getattr(kernel, "py_func", kernel)
    with kept_apart(function) as is_safe:
        made: Callable[..., Any] = numba.njit(cache=is_safe, **CHOICES)(function)
    return made

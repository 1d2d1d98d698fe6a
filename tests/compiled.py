"""Kernels that only kernels call, compiled so that a test can call them too."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba


@cache
def compiled(kernel: Any) -> Callable[..., Any]:
    """An `inner` kernel with the wrapper that Python needs; un-jitted where numba is told not to compile."""
    function = getattr(kernel, "py_func", kernel)
    made: Callable[..., Any] = numba.njit(error_model="numpy")(function)
    return made

"""The one decorator of every compiled function in this package, and what makes the simulator's.

Choices, each with its reason:

* kept on disk: a flight host must not compile twice (`kernel_cache`: where, and when it is compiled anew).
* ``error_model="numpy"``: a division by zero gives inf or NaN, which a status
  reports; the default would raise inside the flight loop.
* ``nogil=True``: two estimators may run in two threads.
* no ``fastmath``: sums keep their order, so the same input gives the same bits
  on every machine, un-jitted, and in a C port.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from .kernel_cache import keep

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(**choices: Any) -> Callable[[Function], Function]:
    """A decorator of kernels with the choices above and these."""
    jit = numba.njit(error_model="numpy", nogil=True, **choices)

    def decorate(function: Function) -> Function:
        made: Function = keep(jit(function))
        return made

    return decorate


kernel = compiled()

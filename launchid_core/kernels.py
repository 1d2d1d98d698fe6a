"""The decorators of every compiled function in this package, and where numba keeps what it compiled.

``kernel``   called from Python: an entry, or a function of numbers that kernels call too
``inner``    called by kernels only; from Python it would crash the process, and a test compiles its own

Choices, each with its reason:

* ``error_model="numpy"``: a division by zero gives inf or NaN, which a status reports; the default would raise inside
  the flight loop.
* ``nogil=True``: two estimators may run in two threads.
* ``_nrt=False``: without numba's run time nothing can be allocated: a kernel that would does not compile.  Nor are
  the references of arrays counted, which costs time in flight and, more, in compilation.
* ``cache=True``: a flight host must not compile twice, and what several entries call is compiled once.
* no ``fastmath``: sums keep their order, so the same input gives the same bits on every machine, un-jitted, and in a
  C port.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import event

from .cache import kept_apart
from .compiling import compile_listeners

_numba: Any = numba  # some of the choices are not in its types
Function = TypeVar("Function", bound=Callable[..., Any])
CHOICES: dict[str, Any] = {"error_model": "numpy", "nogil": True}


class _Teller(event.Listener):
    """A listener that tells `compile_listeners` when numba compiles one of our functions."""

    def __init__(self) -> None:
        self.ours: set[Callable[..., Any]] = set()

    def on_start(self, event: Any) -> None:
        """A compilation begins."""
        function = event.data["dispatcher"].py_func
        if function in self.ours:
            for listener in compile_listeners:
                listener(function.__module__, function.__name__)

    def on_end(self, event: Any) -> None:
        """A compilation ends, of which nobody is told."""


_teller = _Teller()
event.register("numba:compile", _teller)


def compiled(**choices: Any) -> Callable[[Function], Function]:
    """Return a decorator of kernels, with the choices above and these."""

    def decorate(function: Function) -> Function:
        with kept_apart(function) as is_safe:
            kernel: Function = _numba.njit(cache=is_safe, **CHOICES, **choices)(function)
        _teller.ours.add(function)
        return kernel

    return decorate


kernel = compiled(_nrt=False, no_cfunc_wrapper=True)
inner = compiled(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)

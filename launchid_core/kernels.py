"""The decorators of every compiled function in this package, why they are as they are, and what makes the simulator's.

``kernel``   an entry, called from Python (`step`, `report`)
``inner``    called by kernels only: no wrapper for Python, and machine code only inside the entries that call it
             (`parts`); a test that wants to call one compiles its own (`tests/compiled.py`)
``once``     an inner one with a single caller, into which the compiler is told to put it
``merged``   an inner one that numba itself puts into its caller, for the thin layers on the way to the work, each of
             which would otherwise hold all of it again; nothing in it may depend on a part being None
``shared``   plain Python when Python calls it, compiled into the kernels that call it: what cuts memory, what restarts

Choices, each with its reason:

* ``error_model="numpy"``: a division by zero gives inf or NaN, which a status reports; the default would raise inside
  the flight loop.
* ``nogil=True``: two estimators may run in two threads.
* ``_nrt=False``: without numba's run time nothing can be allocated: a kernel that would does not compile.  Nor are
  the references of arrays counted, which costs time in flight and, more, in compilation.
* kept on disk: a flight host must not compile twice (`kernel_cache`: where, and when it is compiled anew).
* no ``fastmath``: sums keep their order, so the same input gives the same bits on every machine, un-jitted, and in a
  C port.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from .kernel_cache import keep
from .parts import OF_A_PART, OF_AN_ENTRY, stand_in, widened

_numba: Any = numba  # some of the choices are not in its types
Function = TypeVar("Function", bound=Callable[..., Any])
_OF_A_PART: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **OF_A_PART}


def compiled(part: bool = False, **choices: Any) -> Callable[[Function], Function]:
    """A decorator of kernels that are kept on disk, with the choices above and these.

    part  what kernels call and Python cannot: no machine code of its own (`parts`)
    """
    jit = _numba.njit(error_model="numpy", nogil=True, **choices, **(_OF_A_PART if part else OF_AN_ENTRY))

    def decorate(function: Function) -> Function:
        made: Function = keep(jit(function))
        return widened(made) if part else made

    return decorate


kernel = compiled(_nrt=False)
inner = compiled(part=True, _nrt=False, forceinline=False)  # said, for numba takes it from the first caller
once = compiled(part=True, _nrt=False, forceinline=True)
merged = _numba.njit(error_model="numpy", nogil=True, _nrt=False, inline="always")


def shared(function: Function) -> Function:
    """Python calls the function itself, kernels an inner one of it."""
    stand_in(function, inner(function))
    return function

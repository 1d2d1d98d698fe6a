"""The decorators of every compiled function in this package, and why they are as they are.

``kernel``   an entry, called from Python (`step`, `report`)
``inner``    called by kernels only: without the wrapper that Python would need it compiles in half the time; a test
             that wants to call one compiles its own (`tests/compiled.py`)
``once``     an inner one with a single caller, into which the compiler is told to put it: no machine code of its own
``merged``   an inner one that numba itself puts into its caller, for the thin layers on the way to the work, each of
             which would otherwise hold all of it again; nothing in it may depend on a part being None
``shared``   plain Python when Python calls it, compiled into the kernels that call it: what cuts memory, what restarts

Choices, each with its reason:

* ``error_model="numpy"``: a division by zero gives inf or NaN, which a status reports; the default would raise inside
  the flight loop.
* ``nogil=True``: two estimators may run in two threads.
* ``_nrt=False``: without numba's run time nothing can be allocated: a kernel that would does not compile.  Nor are
  the references of arrays counted, which costs time in flight and, more, in compilation.
* ``cache=True`` of the entries alone: their machine code holds that of everything they call.
* no ``fastmath``: sums keep their order, so the same input gives the same bits on every machine, un-jitted, and in a
  C port.
"""

import numba
from numba.extending import register_jitable

_ALWAYS = {"error_model": "numpy", "nogil": True, "_nrt": False}
_INNER = {**_ALWAYS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

kernel = numba.njit(cache=True, **_ALWAYS)
inner = numba.njit(**_INNER)
once = numba.njit(forceinline=True, **_INNER)
merged = numba.njit(inline="always", **_ALWAYS)
shared = register_jitable(error_model="numpy", _nrt=False)


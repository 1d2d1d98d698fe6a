"""The decorators of the simulator's compiled functions; reasons as in `launchid_core.kernels`.

Kept apart because the core's is not public, and what never flies may change alone.

`inner` is for what a step calls.  Its two further choices, each with its reason:

* ``forceinline=True``: handing a `Vehicle` of twenty arrays to a function costs more than the step.
* ``_nrt=False``: without numba's run time no array's references are counted, which costs as much again
  (70 s of flight: 8.5 ms with, 5.5 ms without); what would allocate does not compile.
"""

import numba

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)
inner = numba.njit(cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False)

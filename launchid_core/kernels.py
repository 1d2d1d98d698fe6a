"""The one decorator of every compiled function in this package.

Choices, each with its reason:

* ``cache=True``: a flight host must not compile twice.  numba does not see an
  edit in *another* file, so developers clear the cache (README, "Developing").
* ``error_model="numpy"``: a division by zero gives inf or NaN, which a status
  reports; the default would raise inside the flight loop.
* ``nogil=True``: two estimators may run in two threads.
* no ``fastmath``: sums keep their order, so the same input gives the same bits
  on every machine, un-jitted, and in a C port.
"""

import numba

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)

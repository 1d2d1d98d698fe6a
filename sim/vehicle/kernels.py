"""The decorator of the simulator's compiled functions; reasons as in `launchid_core.kernels`.

Kept apart because the core's is not public, and what never flies may change alone.
"""

import numba

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)

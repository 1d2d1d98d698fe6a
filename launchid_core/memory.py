"""One block of memory for a whole state, cut into named arrays.

A call from Python into compiled code costs 0.2 microseconds an array, and the
filtered formulation has eighty of them.  They are therefore views of two flat
buffers, cut by the same function on both sides of the call; a C port's struct.

Each `take` returns the view at `at` and where the next one begins.
"""

from .kernels import kernel


@kernel
def take(buffer, at, n):
    """(n,) view"""
    return buffer[at:at + n], at + n


@kernel
def take2(buffer, at, n, m):
    """(n, m) view"""
    return buffer[at:at + n * m].reshape((n, m)), at + n * m


@kernel
def take3(buffer, at, n, m, k):
    """(n, m, k) view"""
    return buffer[at:at + n * m * k].reshape((n, m, k)), at + n * m * k

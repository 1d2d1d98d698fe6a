"""Random sub-sampling of a window's rows (the operator C of Navarro-Tapia et al., eq. 3).

The generator is Park & Miller's minimal standard (Comm. ACM 31, 1988; multiplier 48271): x <- 48271 x mod (2^31 - 1),
in integers, so every machine draws the same rows.  Assumption: sub-sampling needs no better generator.
"""

from ..kernels import inner

MULTIPLIER = 48271
MODULUS = 2147483647


def first_state(seed: int) -> int:
    """A generator state in 1..MODULUS-1 for any seed >= 0 (neighbouring seeds are spread first)."""
    x = (seed * 2654435761 + 1013904223) % (MODULUS - 1) + 1
    for _ in range(4):
        x = x * MULTIPLIER % MODULUS
    return x


@inner
def choose_rows(usable, n, p, state, kept):
    """Selection sampling (Knuth, TAOCP 2, 3.4.2, algorithm S): `p` of the usable rows, in order.

    usable (>=n,) in  1 where one of the n rows may be used;  state.random  inout  of the generator
    kept   (>=p,) out indices;  returns how many: min(p, usable rows)
    """
    left = 0
    for i in range(n):
        left += usable[i]
    count = 0
    number = state.random
    for i in range(n):
        if usable[i] == 1:
            number = number * MULTIPLIER % MODULUS
            if number * left < (p - count) * MODULUS:
                kept[count] = i
                count += 1
            left -= 1
    state.random = number
    return count

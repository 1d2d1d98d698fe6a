"""The errors of a right model's predictions: the variance that noise alone gives them, a horizon ahead."""

import numpy as np

from sim.vehicle.kernels import kernel

from .likelihood import N_CHANNELS, measure, propagate, reset


@kernel
def horizon_variances(f, block, q, c, r, p, resets, reset_variances, measured, spacing, ahead, variances):
    """variances (s, 3) out [rad^2, rad^2/s^2, rad^2] of measured less predicted, `ahead` rows after every `spacing`-th.

    f, block, q, c, r, p, resets, reset_variances   as `likelihood`
    measured (n, 3)   in   bool
    """
    n, m = len(measured), f.shape[1]
    d, new_d, fp, far = np.zeros(m), np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
    y, w, factor = np.zeros((N_CHANNELS, m)), np.zeros(N_CHANNELS), np.zeros((N_CHANNELS, N_CHANNELS))
    for k in range(n):
        if resets[k]:
            reset(p, d, reset_variances)
        for a in range(N_CHANNELS):
            measure(a, 0.0 if measured[k, a] else np.nan, c, d, p, r, y, w, factor)
        if k % spacing == 0 and k // spacing < len(variances):
            far[:, :] = p
            for j in range(ahead):
                propagate(block[min(k + j, n - 1)], f, q, d, new_d, far, fp)
                if k + j + 1 < n and resets[k + j + 1]:
                    reset(far, d, reset_variances)
            for a in range(N_CHANNELS):
                variances[k // spacing, a] = r[a]
                for i in range(m):
                    for j in range(m):
                        variances[k // spacing, a] += c[a, i] * far[i, j] * c[a, j]
        if k + 1 < n:
            propagate(block[k], f, q, d, new_d, p, fp)

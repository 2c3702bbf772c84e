"""Derivatives as differences, for tests of others."""

import numpy as np


def differences(of, t, h):
    """Central differences, extrapolated twice (Richardson): an error of h^6."""

    def central(step):
        return np.stack([(np.asarray(of(t + d)) - np.asarray(of(t - d))) / (2 * step) for d in step * np.eye(len(t))], -1)

    coarse, half, quarter = (central(h / 2**i) for i in range(3))
    once, again = (4 * half - coarse) / 3, (4 * quarter - half) / 3
    return (16 * again - once) / 15

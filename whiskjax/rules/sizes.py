"""Sizes of arrays: each one that a compiled function meets is compiled anew, so those that data happen to have are rounded up."""

import numpy as np
from jaxtyping import Int


def rounded(n: int, least: int = 2) -> int:
    """A size of at least n of which there are only a few: 8 to each doubling, `least` apart or more."""
    step = max(least, 2 ** max(0, int(np.log2(max(n, 1))) - 3))
    return int(-(-n // step) * step)


def filled(n: int) -> Int[np.ndarray, " rounded"]:
    """Indices 0 to n - 1, and then the last one again up to the rounded size."""
    return np.minimum(np.arange(rounded(n)), n - 1)

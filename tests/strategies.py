"""Where hypothesis looks: the whole Earth and all attitudes, a batch of fixed size at a time so that one compilation serves."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

BATCH = 8


def numbers(low, high, shape=(BATCH,)):
    """Arrays of numbers in [low, high], the ends included."""
    return hnp.arrays(np.float64, shape, elements=st.floats(low, high, allow_subnormal=False), fill=st.nothing())


def _with_corners(low, high, corners):
    return st.one_of(st.sampled_from(corners), st.floats(low, high, allow_subnormal=False))


def latitudes(shape=(BATCH,)):
    """Radians, both poles and the equator included."""
    half = np.pi / 2
    return hnp.arrays(np.float64, shape, elements=_with_corners(-half, half, [-half, half, 0.0, 1e-9 - half]), fill=st.nothing())


def longitudes(shape=(BATCH,)):
    """Radians, both sides of the date line included."""
    return hnp.arrays(np.float64, shape, elements=_with_corners(-np.pi, np.pi, [-np.pi, np.pi, 0.0]), fill=st.nothing())


def attitudes(shape=(BATCH,)):
    """Rotation vectors of every attitude, the identity and half turns included."""
    element = _with_corners(-np.pi, np.pi, [0.0, np.pi, -np.pi, 1e-5])
    return hnp.arrays(np.float64, (*shape, 3), elements=element, fill=st.nothing())

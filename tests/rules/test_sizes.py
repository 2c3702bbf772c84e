"""Sizes are rounded up, by little, to few."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from whiskjax.rules.sizes import filled, rounded


@given(st.integers(1, 10**7), st.integers(1, 64))
def test_a_size_is_large_enough_and_hardly_larger(n, least):
    assert n <= rounded(n, least) <= max(n * 9 / 8, n + least - 1) + 1e-9
    assert rounded(rounded(n, least), least) == rounded(n, least)


def test_there_are_eight_to_a_doubling():
    assert len({rounded(n) for n in range(1025, 2049)}) == 8


@given(st.integers(1, 3000))
def test_indices_are_all_there_and_then_the_last_one(n):
    index = filled(n)
    assert len(index) == rounded(n)
    np.testing.assert_array_equal(index[:n], np.arange(n))
    assert (index[n:] == n - 1).all()

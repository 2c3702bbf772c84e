"""A figure outside its band fails, and says where it stands."""

import math

import pytest

from tests.peers.figures import Figure, assert_inside, table


@pytest.mark.parametrize("value, inside", [(0.5, True), (2.0, False), (-0.1, False), (math.nan, False), (math.inf, False)])
def test_a_band_is_closed_and_holds_numbers_only(value, inside):
    figure = Figure("what is compared", value, "px", 1.0, "somebody asks")
    assert figure.is_inside is inside
    assert ("OUTSIDE" in table([("peer", figure)])) is not inside
    if not inside:
        with pytest.raises(AssertionError, match=r"what is compared.*0 to 1.*somebody asks"):
            assert_inside([figure])


def test_nothing_compared_is_no_success():
    with pytest.raises(AssertionError):
        assert_inside([])

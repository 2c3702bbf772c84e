"""Limits by map scale and terrain, as Table 7 of Wang et al. (2018) prints them."""

import dataclasses

import pytest

from whiskjax.estimate.map_limits import PROFILE, Limit, Standard


def test_limits_of_the_profile():
    assert PROFILE.limits[1000, "hilly"] == (0.5, 0.4)
    assert PROFILE.limits[5000, "alpine"] == (2.5, 2.5)
    assert len(PROFILE.limits) == 12
    own = dataclasses.replace(PROFILE, name="ours", limits={(1000, "hilly"): Limit(0.3, 0.3)})
    assert own.limits[1000, "hilly"].height_m == 0.3


@pytest.mark.parametrize("scale, terrain", PROFILE.limits)
def test_the_standard_of_a_map_is_named_and_has_its_limits(scale, terrain):
    limit = PROFILE.limits[scale, terrain]
    name = f"GB/T 23236, as printed in Wang et al. (2018), Table 7, 1:{scale}, {terrain}"
    assert PROFILE.standard(scale, terrain) == Standard(name, limit.planimetry_m, limit.height_m)

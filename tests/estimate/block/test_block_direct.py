"""Direct positioning against one intersection after the other."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj


@pytest.fixture(scope="module")
def direct(drawn):
    return wj.direct_positioning(drawn.sensor, drawn.block)


def test_strip_by_strip(drawn, direct):
    """Every pair of point and strip once; the coordinates are those that its own rays give."""
    block, strip = drawn.block, np.asarray(drawn.block.key("strip"))
    seen = {(p, s) for p, s in zip(block.point.tolist(), strip.tolist(), strict=True) if block.role[p] != "tie"}
    assert set(zip(direct.point.tolist(), direct.strip.tolist(), strict=True)) == seen
    assert len(direct.point) == len(seen) > (block.role != "tie").sum()
    assert direct.alone == direct.lost == 0
    for i in range(0, len(seen), 5):
        own = block.keep((block.point == direct.point[i]) & (strip == direct.strip[i]))
        zero = np.zeros(len(own), dtype=int)
        met = wj.intersect(drawn.sensor, own.shot, jnp.asarray(own.pixel_px), zero, jnp.asarray(own.sigma_px))
        np.testing.assert_allclose(direct.position_m[i], np.asarray(met.point_m)[0], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(direct.error_m, direct.position_m - block.position_m[direct.point])


def test_statistics(direct):
    for axis, found in enumerate(direct.statistics()):
        e = direct.error_m[:, axis]
        rmse = float(np.sqrt(np.mean(e**2)))
        assert found == pytest.approx((max(e), min(e), sum(e) / len(e), rmse, len(e)), rel=1e-12)


def test_ties_and_lone_rays(drawn):
    """With ties all points are met; a ray alone in its strip is counted, not used."""
    block = drawn.block
    strip = np.asarray(block.key("strip"))
    first = int(np.flatnonzero(block.role == "tie")[0])
    mine = np.flatnonzero((block.point == first) & (strip == strip[block.point == first][0]))
    found = wj.direct_positioning(drawn.sensor, block.keep(np.setdiff1d(np.arange(len(block)), mine[1:])), ties=True)
    pairs = len(np.unique(np.stack([block.point, strip]), axis=1).T)
    assert (len(found.point), found.alone, found.lost) == (pairs - 1, 1, 0)
    assert (first, strip[mine[0]]) not in zip(found.point, found.strip, strict=True)
    assert np.isnan(found.error_m[block.role[found.point] == "tie"]).all()
    assert found.statistics()[0].count == (block.role[found.point] != "tie").sum()


def test_blocks_without_strips_are_refused(drawn):
    block = drawn.block
    bare = dataclasses.replace(block, shot=wj.Shot(time_s=block.key("time_s"), view=block.key("view")))
    with pytest.raises(wj.WhiskjaxError, match="carry no strip"):
        wj.direct_positioning(drawn.sensor, bare)
    with pytest.raises(wj.WhiskjaxError, match="no control or check point is seen twice from one strip"):
        wj.direct_positioning(drawn.sensor, block.keep(block.role[block.point] == "tie"))

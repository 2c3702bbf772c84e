"""Tiles: every ray has one seat, and the windows reach over all stations that act."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from whiskjax.estimate.block.plan import plan


@st.composite
def blocks(draw):
    """Points that move along one or several segments of stations, seen a few times in each."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    acting = draw(st.sampled_from([1, 4]))
    segments = draw(st.lists(st.integers(acting, 40), min_size=1, max_size=4))
    rays = draw(st.integers(1, 400))
    points = draw(st.integers(1, rays))
    spread = draw(st.integers(0, 40))
    begin = np.cumsum([0, *segments])[:-1]
    point, segment = rng.integers(0, points, rays), rng.integers(0, len(segments), rays)
    longest = np.array(segments)[segment] - acting
    middle = rng.uniform(0, 1, (points, len(segments)))[point, segment]
    first = np.clip(np.rint(middle * longest + rng.integers(-spread, spread + 1, rays)), 0, longest).astype(int)
    return point, begin[segment] + first, acting, segments


@given(blocks())
def test_plan(block):
    point, first, acting, segments = block
    laid = plan(*block)
    chunks, units, *_ = laid.ray.shape
    taken = laid.ray >= 0
    np.testing.assert_array_equal(np.sort(laid.ray[taken]), np.arange(len(point)))
    assert laid.width <= sum(segments)
    # The window of a ray's unit holds the stations that act on it, and lies among the stations.
    start = np.broadcast_to(laid.start[:, :, None, None], laid.ray.shape)[taken]
    ray = laid.ray[taken]
    assert (start >= 0).all() and (start + laid.width <= sum(segments)).all()
    assert (start <= first[ray]).all() and (first[ray] + acting <= start + laid.width).all()
    # A ray sits where its point is.
    of_tile = laid.point[np.arange(chunks)[:, None], laid.tile]
    seat = np.broadcast_to(of_tile[:, :, None, :], laid.ray.shape)[taken]
    np.testing.assert_array_equal(seat, point[ray])
    # A point belongs to one tile, and everybody who is seen has a seat.
    seen = laid.point[laid.point >= 0]
    np.testing.assert_array_equal(np.sort(seen), np.unique(point))
    # Empty units have no rays; every pair of units of one tile is there once.
    for c in range(chunks):
        assert not taken[c, laid.units[c] :].any()
        pairs = {tuple(sorted(p)) for p in laid.pair[c, : laid.pairs[c]].tolist()}
        tile = laid.tile[c, : laid.units[c]]
        expected = {(a, b) for a in range(len(tile)) for b in range(a + 1, len(tile)) if tile[a] == tile[b]}
        assert pairs == expected and len(pairs) == laid.pairs[c]
    assert units >= laid.units.max()


@given(blocks())
def test_order_of_rays_does_not_matter_for_the_shape(block):
    point, first, acting, segments = block
    order = np.random.default_rng(0).permutation(len(point))
    assert plan(point[order], first[order], acting, segments).ray.shape == plan(*block).ray.shape

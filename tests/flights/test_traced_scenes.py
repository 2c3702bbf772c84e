"""The scenes as pure functions: traced they draw what the host draws, and have derivatives by the flown path."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.differences import differences
from whiskjax.flights import haian, songshan, tianshan

KEY = jax.random.key(4)
STRIPS = songshan.Scene("B", ties=0, pos_hz=5.0)
# With the steps of differences: m/s, rad, m, which move times by microseconds; and how many samples of POS go by in a line.
PATHS = {
    "haian": (haian.Path.draw(KEY), ("speed_mps", "heading_rad", "above_ground_m"), (0.1, 1e-6, 0.03), 200.0 / haian.LINES_HZ),
    "songshan": (songshan.Path.draw(KEY), ("speed_mps", "height_m"), (1e-4, 0.01), 5.0 * songshan.LINE_S),
}


@pytest.fixture(scope="module", params=["haian", "songshan"])
def scene(request):
    """Its name, its draw by key and path over points that stay where they are, and the numbers of its path with their steps."""
    path, names, steps, samples = PATHS[request.param]
    if request.param == "haian":
        points = jnp.asarray(haian.draw(KEY, path).point_m)
        draw = lambda key, path: haian.draw(key, path, point_m=points)
    else:
        whole = songshan.draw(KEY, STRIPS, path)
        points = jnp.asarray(whole.point_m[np.flatnonzero(whole.is_seen.sum(axis=1))[:8]])
        draw = lambda key, path: songshan.draw(key, STRIPS, path, point_m=points)
    numbers = lambda path: [getattr(path, name) for name in names]

    def at(value):
        return eqx.tree_at(numbers, path, list(value))

    return draw, at, np.array(numbers(path), dtype=float), np.array(steps), samples


def told(drawn):
    """All that is measured."""
    return drawn.exact_px, drawn.pixel_px, drawn.surveyed_m


def test_traced_it_draws_what_the_host_draws(scene):
    draw, at, value, *_ = scene
    host = told(draw(KEY, at(value)))
    keys = jnp.stack([jax.random.key(8), KEY])
    traced = jax.jit(jax.vmap(lambda key, v: told(draw(key, at(v))), in_axes=(0, None)))(keys, jnp.asarray(value))
    assert np.isfinite(host[0]).any()
    for a, b in zip(host, traced, strict=True):
        # 1e-9 m of ECEF rounding; a line is the time of the search, which ends within 1e-12 s.
        np.testing.assert_allclose(b[1], a, rtol=0, atol=1e-6)
        assert np.nanmax(np.abs(b[0] - b[1])) > 1e-3


def test_pixels_have_derivatives_by_the_path(scene):
    """Points on the ground stay; of the noise-free pixels, in the change over a step."""
    draw, at, value, step, samples = scene
    of = jax.jit(lambda y: draw(KEY, at(value + step * y)).exact_px)
    found = np.asarray(jax.jit(jax.jacfwd(of))(jnp.zeros(len(value))))
    expected = differences(of, np.zeros(len(value)), 0.5)
    at_sample = np.asarray(of(jnp.zeros(len(value))))[..., 1] * samples
    # Rates jump at samples of POS: exposures within a thousandth of an interval of one have two derivatives.
    seen = np.isfinite(expected) & (np.abs(at_sample - np.round(at_sample)) > 1e-3)[..., None, None]
    assert seen.any() and (np.nanmax(np.abs(found), axis=tuple(range(found.ndim - 1))) > 1e-3).all()
    size = np.nanmax(np.abs(expected))
    np.testing.assert_allclose(found[seen], expected[seen], rtol=0, atol=1e-6 * size)


def test_predicted_sigmas_have_derivatives_by_the_path():
    """Of a calibration of haian: those of data drawn anew along each path."""
    path, names, steps, _ = PATHS["haian"]
    numbers = lambda path: [getattr(path, name) for name in names]
    value, step, unknowns = np.array(numbers(path), dtype=float), np.array(steps), haian.unknowns()

    @jax.jit
    def of(y):
        drawn = haian.draw(KEY, eqx.tree_at(numbers, path, list(value + step * y)))
        sigma = wj.calibrate(drawn.sensor, drawn.observations(), unknowns, errors=haian.frame_errors()).estimate.sigma
        return sigma / np.array([x.sigma for x in unknowns])

    found = np.asarray(jax.jit(jax.jacfwd(of))(jnp.zeros(3)))
    expected = differences(of, np.zeros(3), 1.0)
    size = np.abs(expected).max(axis=0)
    assert (size[[0, 2]] > 1e-6).all()  # where north is, hardly matters
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * size.max())


@pytest.mark.parametrize("path", ["orbit", "race", "fly"])
def test_records_of_looks_have_derivatives_by_the_path(path):
    scene = tianshan.Scene(path, looks=5)

    def of(y):
        traced = dataclasses.replace(scene, off_nadir_rad=scene.off_nadir_rad + 0.01 * y[0], height_m=scene.height_m + 100 * y[1])
        recorded, pixel = tianshan.draw(KEY, traced)
        return jnp.concatenate([*jax.tree.leaves(recorded), pixel.ravel()])

    found, expected = jax.jit(jax.jacfwd(of))(jnp.zeros(2)), differences(of, np.zeros(2), 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(jax.jit(of)(jnp.zeros(2)), of(np.zeros(2)), rtol=1e-12, atol=1e-12)


def test_truths_are_drawn_from_their_priors():
    """The RMS of 2000 draws over their sigmas: 1 within four standard errors."""
    keys = jax.random.split(KEY, 2000)
    cases = [(haian.draw_truth, haian.PRIOR_SIGMA), (songshan.draw_truth, (np.ones(3), np.full(3, np.radians(1.0))))]
    for draw, sigma in cases:
        for drawn, expected in zip(jax.jit(jax.vmap(draw))(keys), sigma, strict=True):
            np.testing.assert_allclose(np.sqrt((np.asarray(drawn) ** 2).mean(axis=0)), expected, rtol=4 / np.sqrt(4000))


def test_a_statement_of_a_frame_that_no_record_holds():
    with pytest.raises(wj.WhiskjaxError, match="tianshan: of gimbal_roll no record holds turn y"):
        tianshan.draw(KEY, errors=[wj.FrameErrors("gimbal_roll", (0, 1e-3, 0))])

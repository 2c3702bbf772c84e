"""`adjust` as a pure function: under jit, vmap and every derivative, by every array that goes in.

One vector of amounts moves one kind of input each along a random direction; the answer is the unknown, all motions of stations
and all points, with the sigmas of the unknown and the points. Oracle: central differences of the same adjustments.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj

KINDS = ("pixels", "control points", "pixel sigmas", "sensor number", "prior sigma", "record", "sigma of the record")
STEP = 0.1  # of an amount; an amount is about what the sigma of the input is
PLACE_M = np.array([[0.0, 50.0, 900.0], [200.0, 60.0, 915.0], [400.0, 40.0, 890.0]])
ERRORS = (wj.FrameErrors("photo", turn_sigma_rad=(1e-3,) * 3, shift_sigma_m=(1.0,) * 3),)


@pytest.fixture(scope="module")
def scene():
    """Three frame images over three control and four tie points, all off by their sigmas; and directions to move inputs in."""
    rng = np.random.default_rng(4)
    point = np.column_stack([rng.uniform(-50, 450, 7), rng.uniform(-50, 150, 7), rng.uniform(0, 90, 7)])
    true = Rotation.from_euler("ZYX", rng.normal(0, 1, (3, 3)), degrees=True)
    image, seen = np.divmod(np.arange(21), 7)
    q = np.einsum("nji,nj->ni", true.as_matrix()[image], point[seen] - PLACE_M[image])
    pixel = np.array([2000.0, 1500.0]) - 3000.0 * q[:, :2] / q[:, 2:] * np.array([1.0, -1.0])
    pixel = pixel + 0.3 * rng.standard_normal(pixel.shape)
    role = np.array(["control"] * 3 + ["tie"] * 4)
    known = np.where(np.arange(7)[:, None] < 3, point + rng.normal(0, 0.02, (7, 3)), np.nan)
    block = wj.Block(
        wj.Shot(image=image), pixel, np.full((21, 2), 0.3), seen, known, np.broadcast_to(np.eye(3) * 0.02**2, (7, 3, 3)), role
    )
    recorded = true * Rotation.from_rotvec(rng.normal(0, 1e-3, (3, 3)))
    photo = wj.PosePerImage(PLACE_M + rng.normal(0, 1.0, (3, 3)), recorded.as_quat())
    sensor = wj.Sensor({"photo": photo}, wj.FrameCamera(3000.0, (2000.0, 1500.0)))
    pixels, points, sigmas = rng.normal(0, 0.3, (21, 2)), rng.normal(0, 0.02, (3, 3)), 0.1 * rng.uniform(0, 1, (21, 2))
    directions = pixels, points, sigmas, rng.normal(0, 1.0, (3, 3))
    return sensor, block, directions, point + rng.normal(0, 1.0, (7, 3))


def adjusted(scene, t):
    """The adjustment of inputs that were moved by t."""
    sensor, block, (pixels, points, sigmas, record), start = scene
    centre = sensor.camera.principal_point_px + 2.0 * t[3] * jnp.array([1.0, -0.5])
    sensor = eqx.tree_at(lambda s: s.camera.principal_point_px, sensor, centre)
    position = tuple(c + t[5] * record[:, i] for i, c in enumerate(sensor["photo"].position_m))
    sensor = eqx.tree_at(lambda s: s.links[0].position_m, sensor, position)
    moved = jnp.asarray(block.position_m).at[:3].add(t[1] * points)
    block = dataclasses.replace(
        block, pixel_px=block.pixel_px + t[0] * pixels, position_m=moved, sigma_px=block.sigma_px + t[2] * sigmas
    )
    focal = wj.Unknown("focal", "camera.focal_px", 3000.0, 3.0 + 0.5 * t[4])
    shift = (1.0, 1.0 + 0.3 * t[6], 1.0 - 0.2 * t[6])
    errors = (wj.FrameErrors("photo", turn_sigma_rad=(1e-3,) * 3, shift_sigma_m=shift),)
    return wj.adjust(sensor, block, [focal], errors=errors, start_m=start)


def numbers(found):
    """The unknown, the motions and the points, each in about its sigma, and the sigmas."""
    photo = found.sensor["photo"]
    motions = jnp.concatenate([photo.turn_rad.ravel() / 1e-3, photo.shift_m.ravel()])
    sigma = jnp.sqrt(jnp.diagonal(found.covariance_m2, axis1=1, axis2=2)).ravel()
    return jnp.concatenate([found.value / 3.0, motions, found.point_m.ravel() / 0.1, found.estimate.sigma / 3.0, sigma / 0.1])


@pytest.fixture(scope="module")
def answer(scene):
    """The numbers as a compiled function of the amounts."""
    return jax.jit(lambda t: numbers(adjusted(scene, t)))


@pytest.fixture(scope="module")
def amounts():
    return jnp.array([0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.5])


def test_compiled_it_is_what_it_is_eagerly(scene, answer, amounts):
    eager = adjusted(scene, np.asarray(amounts))
    np.testing.assert_allclose(answer(amounts), numbers(eager), rtol=0, atol=1e-8)
    traced = eqx.filter_jit(lambda t: adjusted(scene, t))(amounts)
    np.testing.assert_allclose(traced.estimate.covariance, eager.estimate.covariance, rtol=1e-8)
    np.testing.assert_allclose(traced.covariance_m2, eager.covariance_m2, rtol=1e-6, atol=1e-12)
    assert traced.cost == pytest.approx(eager.cost, rel=1e-9) and int(traced.freedom) == eager.freedom
    assert traced.is_sound == eager.is_sound and traced.warnings == eager.warnings


def test_a_batch_is_a_loop(answer, amounts):
    several = jnp.stack([amounts, -amounts, 0 * amounts])
    np.testing.assert_allclose(jax.jit(jax.vmap(answer))(several), [answer(t) for t in several], rtol=0, atol=1e-7)


def test_derivatives(answer, amounts):
    forward, reverse = (jax.jit(of(answer))(amounts) for of in (jax.jacfwd, jax.jacrev))

    def differences(step):
        return np.stack([(answer(amounts + step * e) - answer(amounts - step * e)) / (2 * step) for e in np.eye(len(KINDS))], -1)

    expected = (4 * differences(STEP / 2) - differences(STEP)) / 3  # Richardson
    largest = np.abs(expected).max(axis=0)
    off = np.abs(forward - expected).max(axis=0) / largest
    print("\nlargest deviation of the derivatives from differences, of the largest entry")
    for kind, d, e in zip(KINDS, off, np.abs(forward - reverse).max(axis=0) / largest, strict=True):
        print(f"{kind:16s} {d:.1e}   reverse from forward {e:.1e}")
    assert (np.abs(forward - reverse).max(axis=0) / largest < 1e-9).all()
    assert (largest > 1e-4).all() and (off < 1e-6).all()


def test_second_derivative(scene, amounts):
    unknown = lambda t: adjusted(scene, t).value[0] / 3.0
    slope = jax.jit(jax.grad(unknown))
    found = jax.jit(jax.hessian(unknown))(amounts)

    def differences(step):
        return np.stack([(slope(amounts + step * e) - slope(amounts - step * e)) / (2 * step) for e in np.eye(len(KINDS))])

    expected = (4 * differences(STEP / 2) - differences(STEP)) / 3
    off = np.abs(found - expected).max(axis=0) / np.abs(expected).max()
    print("\nhessian of the unknown from differences of the slope, of the largest entry")
    for kind, d in zip(KINDS, off, strict=True):
        print(f"{kind:16s} {d:.1e}")
    assert (off < 1e-4).all()


def test_what_is_searched_on_the_host_says_so(scene, amounts):
    sensor, block, *_ = scene

    def searched(pixel, **how):
        return wj.adjust(sensor, dataclasses.replace(block, pixel_px=pixel), errors=ERRORS, **how).cost

    for how in ({"blunders": wj.Blunders()}, {"reweigh": wj.Reweigh(priors=True)}):
        with pytest.raises(wj.WhiskjaxError, match="adjust: Blunders\\(\\) and Reweigh\\(\\) search on the host"):
            jax.jit(lambda pixel, how=how: searched(pixel, **how))(block.pixel_px)
    with pytest.raises(wj.WhiskjaxError, match=r"shot\.image is traced, but keys say what is computed"):
        jax.jit(
            lambda image: (
                wj.Block(
                    wj.Shot(image=image),
                    block.pixel_px,
                    block.sigma_px,
                    block.point,
                    block.position_m,
                    block.covariance_m2,
                    block.role,
                ).pixel_px
            )
        )(np.zeros(21, dtype=int))


def test_nothing_but_a_sigma_of_the_record_is_traced(scene):
    """No start is given; free poses are written down in the traced function; a sigma that turns out to be zero holds its axis."""
    sensor, block, *_ = scene

    def cost(sigma, free):
        told = wj.FrameErrors("photo", (1e-3,) * 3, (1.0, sigma, 0.8))
        nothing = [wj.FrameErrors("photo", (np.inf,) * 3, (np.inf,) * 3)] if free else []
        return wj.adjust(sensor, block, errors=[*nothing, told]).cost

    for free in (False, True):
        traced = jax.jit(lambda sigma, free=free: cost(sigma, free))
        assert float(traced(0.7)) == pytest.approx(cost(0.7, free), rel=1e-9)
        if not free:
            assert float(traced(0.0)) == pytest.approx(cost(0, free), rel=1e-9)

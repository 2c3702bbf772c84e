"""A location is a pure function: one small scene, a filter and a batch, and every way in that a derivative may come by."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.differences import differences

RNG = np.random.default_rng(5)
LOOKS = 7
TIME_S = np.linspace(0.2, 2.8, LOOKS)
RECORD = wj.Trajectory(
    np.arange(4.0),
    np.array([[-1500.0, 300, 2000], [-500, 250, 2010], [520, 260, 1995], [1480, 310, 2000]]),
    np.tile([0.0, 0, 0, 1], (4, 1)),
    max_gap_s=1.0,
)
TARGET_M = np.array([40.0, -30.0, 20.0])
BIAS = wj.Unknown("boresight x", "mount.angles_rad[0]", 0.0, 1e-3)
FOCAL = wj.Unknown("focal", "camera.focal_px", 1000.0, 0.5)
WAYS = ("pixels", "guess", "sensor number", "prior sigma", "record")
UNIT = (0.5, 5.0, 0.5, 0.3, 0.5)
INTO = [RNG.normal(size=(LOOKS, 2)), RNG.normal(size=3), RNG.normal(size=3), np.ones(()), RNG.normal(size=(4, 3))]
SIZE = np.array([0.5, 0.5, 1.0, 0.5, 0.5, 1.0, 1e-4])


def sensor(moved_m=0.0, lever_m=0.0):
    position = tuple(p + m for p, m in zip(RECORD.position_m, (moved_m + jnp.zeros((4, 3))).T, strict=True))
    record = eqx.tree_at(lambda link: link.position_m, RECORD, position)
    mount = wj.Mount(lever_arm_m=jnp.array([0.3, -0.2, 0.5]) + lever_m, angles_rad=[0.0, 0.0, 0.0])
    return wj.Sensor({"body": record, "mount": mount}, wj.FrameCamera(1000.0, (0.0, 0.0)))


SHOT = wj.Shot(time_s=TIME_S)
PIXEL_PX = np.asarray(wj.project(sensor(), SHOT, np.tile(TARGET_M, (LOOKS, 1)), throw=False).pixel_px)
PIXEL_PX = PIXEL_PX + 0.6 * RNG.normal(size=(LOOKS, 2))
ERRORS = (wj.FrameErrors("body", turn_sigma_rad=(2e-4, 2e-4, 3e-4), shift_sigma_m=(0.1, 0.1, 0.1)),)


def answer(t, method):
    """The target, its sigmas and the boresight in units of about a sigma, (7,)."""
    pixels, guess, lever, sigma, record = (a * u * d for a, u, d in zip(t, UNIT, INTO, strict=True))
    bias = wj.Unknown(BIAS.name, BIAS.where, 0.0, 1e-3 * jnp.exp(sigma))
    found = wj.locate(
        sensor(record, lever),
        wj.Looks(SHOT, PIXEL_PX + pixels, (0.6, 0.6)),
        guess=wj.Guess.around(TARGET_M + np.array([8.0, -5.0, 12.0]) + guess, (30.0, 30.0, 30.0)),
        surface=wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        errors=ERRORS,
        estimate=[bias],
        consider=[FOCAL],
        method=method,
    )
    sigma_m = jnp.sqrt(jnp.diagonal(found.covariance_enu_m2))
    return jnp.concatenate([found.point_m - TARGET_M, sigma_m, found.estimate.value[:1]]) / SIZE


ZERO = np.zeros(len(WAYS))


@pytest.fixture(scope="module", params=["iterated", "batch"])
def of(request):
    return lambda t: answer(t, request.param)


def test_jit_and_vmap_are_one_location_after_the_other(of):
    several = RNG.normal(size=(3, len(WAYS)))
    one_by_one = [of(t) for t in several]
    np.testing.assert_allclose(jax.jit(of)(several[0]), one_by_one[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(jax.jit(jax.vmap(of))(several), one_by_one, rtol=1e-8, atol=1e-8)


def test_derivatives_are_differences(of):
    expected = differences(jax.jit(of), ZERO, 0.1)
    forward, reverse = (np.asarray(jax.jit(jac(of))(ZERO)) for jac in (jax.jacfwd, jax.jacrev))
    largest = np.abs(expected).max(axis=0)
    print(f"\n{'by':16s}{'jacfwd':>12s}{'jacrev':>12s}   largest deviation from differences, of the largest entry")
    for i, way in enumerate(WAYS):
        off = [np.abs(found[:, i] - expected[:, i]).max() / largest[i] for found in (forward, reverse)]
        print(f"{way:16s}{off[0]:12.1e}{off[1]:12.1e}")
        assert max(off) < 1e-6, way
    assert (largest > 1e-3).all()


def test_second_derivatives_are_differences_of_first(of):
    def first(t):
        return of(t)[2]

    found = np.asarray(jax.jit(jax.hessian(first))(ZERO))
    expected = differences(jax.jit(jax.grad(first)), ZERO, 0.1)
    print(f"\nhessian of z: {np.abs(found - expected).max() / np.abs(expected).max():.1e} of the largest entry")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())

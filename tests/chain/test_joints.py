"""Derivatives at every joint against a chain that is perturbed there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.chain.test_bake import POINTS, SENSOR, SHOTS
from tests.derivatives import assert_derivatives
from whiskjax.algebra.vectors import stack
from whiskjax.chain.imaging import image

DISTORTED = wj.Sensor(
    dict(zip(SENSOR.names, SENSOR.links, strict=True)), wj.FrameCamera(1000.0, (0.0, 0.0), (-0.1, 0.02, 0.0, 1e-3, -1e-3))
)
SENSORS = {"line": SENSOR, "frame with distortion": DISTORTED}
MOTION = np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.7])


def moved_there(sensor, joint, motion):
    """The chain with one more link behind `joint`: a finite small motion, exp([turn]x) and shift."""
    links = {}
    for name, link in zip(sensor.names, sensor.links, strict=True):
        links[name] = link
        if name == joint:
            links["moved"] = wj.Correction(wj.Bias(), turn_rad=motion[None, :3], shift_m=motion[None, 3:])
    return wj.Sensor(links, sensor.camera)


@pytest.fixture(scope="module", params=SENSORS)
def swept(request):
    sensor = SENSORS[request.param]
    return sensor, jax.jit(lambda p: wj.joint_derivatives(sensor, SHOTS, p))(POINTS)


def test_the_pixel_is_the_projection(swept):
    sensor, found = swept
    np.testing.assert_allclose(stack(found.pixel), stack(image(sensor, SHOTS, POINTS)), rtol=0, atol=1e-9)


@pytest.mark.parametrize("joint", SENSOR.names)
def test_a_motion_at_a_joint_moves_the_pixel_as_a_perturbed_chain(swept, joint):
    sensor, found = swept
    follows = stack(found.follows(joint, wj.Motion(tuple(MOTION[:3]), tuple(MOTION[3:]))))

    def pixels(size):
        return stack(image(moved_there(sensor, joint, size * MOTION), SHOTS, POINTS))

    exact = jax.jit(lambda: jax.jvp(pixels, (jnp.zeros(()),), (jnp.ones(()),))[1])()
    assert np.abs(exact).max() > 1
    np.testing.assert_allclose(follows, exact, rtol=1e-10, atol=1e-8)


def test_the_derivative_at_the_earth_is_that_of_the_ground_point(swept):
    sensor, found = swept
    step = np.array([1.0, -2.0, 0.5])
    exact = jax.jvp(lambda *p: stack(image(sensor, SHOTS, p)), POINTS, tuple(np.full(6, s) for s in step))[1]
    got = np.stack([sum(h * s for h, s in zip(row, step, strict=True)) for row in found.derivatives["earth"]], -1)
    np.testing.assert_allclose(got, exact, rtol=1e-11, atol=1e-10)


def test_points_and_poses_are_those_of_the_chain(swept):
    sensor, found = swept
    for joint in sensor.names:
        inside = sensor.pose(SHOTS, joint).into(POINTS)
        np.testing.assert_allclose(stack(found.points[joint]), stack(inside), rtol=0, atol=1e-9)
        assert set(found.poses) == set(sensor.names)
    np.testing.assert_array_equal(stack(found.points["earth"]), stack(POINTS))


def test_an_encoder_error_is_a_motion_of_its_joint(swept):
    """Idea 5 of the design: the zero of the scan's encoder is a turn about x of the frame it leads to."""
    sensor, found = swept
    turned = stack(found.follows("scan", wj.Motion(turn=(1, 0, 0))))

    def pixels(zero):
        turn = wj.Turn("x", sensor["scan"].encoder, zero_rad=zero)
        links = {n: turn if n == "scan" else link for n, link in zip(sensor.names, sensor.links, strict=True)}
        return stack(image(wj.Sensor(links, sensor.camera), SHOTS, POINTS))

    exact = jax.jit(lambda: jax.jvp(pixels, (jnp.zeros(()),), (jnp.ones(()),))[1])()
    np.testing.assert_allclose(turned, exact, rtol=1e-10, atol=1e-8)


def test_derivatives_of_a_sweep():
    def f(x):
        found = wj.joint_derivatives(DISTORTED, wj.Shot(time_s=2.3, swing=1), tuple(x))
        return found.pixel, found.derivatives["earth"]

    x = [100.0, 20.0, 10.0]
    # Pixels over 3 m at 1 km, and their derivatives, which change by 1e-3 px/m.
    assert_derivatives(f, x, step=3.0, tolerance=[1e-9] * 2 + [1e-11] * 6)

"""Imaging along bent rays, both ways, for a gimballed frame camera and a line camera."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.chain.test_joints import moved_there
from tests.derivatives import assert_derivatives
from whiskjax.algebra.vectors import stack, unstack
from whiskjax.chain.address import make_room, parse, read
from whiskjax.chain.imaging import image
from whiskjax.earth.refraction import Refraction

TIME_S = np.linspace(0.0, 10.0, 11)
GROUND = wj.HeightSurface(1551.0)
N = 12
SHOTS = wj.Shot(time_s=np.linspace(0.5, 9.5, N))
PIXELS = np.random.default_rng(71).uniform(-500, 500, (N, 2))
ANGLES = [0.0, 45.0, 78.0, 80.0]


def sensor(off_nadir_deg, camera, refraction):
    """At 10 km and nearly level, a gimbal that looks to the left."""
    zero = 0 * TIME_S
    lat, lon = np.radians(43.3) + 3e-5 * TIME_S, np.radians(84.2) + zero
    body = wj.Trajectory.from_geodetic(TIME_S, lat, lon, 1e4 + zero, zero, zero + 0.001, zero + 0.3, max_gap_s=2.0)
    outer = wj.Encoder(TIME_S, np.radians(off_nadir_deg + np.linspace(-0.05, 0.05, 11)), 2.0, "outer")
    links = {"body": body, "arm": wj.Mount([0.5, 0.2, 1.0], [0.001, -0.002, 0.001]), "outer": wj.Turn("x", outer)}
    return wj.Sensor(links | {"camera_axes": wj.Axes("x -y -z")}, camera, refraction)


def with_air(sensor, refraction):
    """The same links and camera, in other air."""
    return wj.Sensor(dict(zip(sensor.names, sensor.links, strict=True)), sensor.camera, refraction)


def frame(off_nadir_deg, refraction):
    """Pixels of 10 urad, as in scenario tianshan."""
    return sensor(off_nadir_deg, wj.FrameCamera(1e5, (0.0, 0.0), (-0.01, 0.0, 0.0, 1e-4, 0.0)), refraction)


def line(off_nadir_deg, refraction):
    """A detector line across the flight."""
    return sensor(off_nadir_deg, wj.LineCamera(1e4, along="y", samples_px=(-600.0, 600.0)), refraction)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_frame_camera_finds_its_pixels_again(angle):
    bent = frame(angle, Refraction())
    point = wj.image_to_ground(bent, SHOTS, PIXELS, GROUND).point_m
    np.testing.assert_allclose(wj.project(bent, SHOTS, point).pixel_px, PIXELS, rtol=0, atol=1e-6)
    np.testing.assert_allclose(wj.ground_to_image(bent, SHOTS, point, clip=False).pixel_px, PIXELS, rtol=0, atol=1e-6)
    _, _, height = wj.ecef_to_geodetic(point)
    np.testing.assert_allclose(height, 1551.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize("angle", [45.0, 78.0])
def test_a_line_camera_finds_its_times_again(angle):
    bent = line(angle, Refraction())
    pixel = PIXELS * [1, 0]
    point = wj.image_to_ground(bent, SHOTS, pixel, GROUND).point_m
    found = wj.ground_to_image(bent, wj.Shot(), point, (0.0, 10.0))
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.time_s, SHOTS.time_s, rtol=0, atol=1e-9)


@pytest.mark.parametrize("slope", [-0.15, 1.0, 3.0])
def test_steep_ground_is_met_as_well(slope):
    """A plane of the ECEF world through the ground point, falling away from the platform or rising in front of it."""
    bent = frame(78.0, Refraction())
    shot, pixel = wj.Shot(time_s=5.0), PIXELS[0]
    point = np.asarray(wj.image_to_ground(bent, shot, pixel, GROUND).point_m)
    up = point / np.linalg.norm(point)
    towards = np.asarray(bent.pose(shot).origin_m) - point
    towards -= (towards @ up) * up
    # 300 m behind the point, where the height surface that the iteration might start from is far off.
    hill = wj.Plane(point - 300 * towards / np.linalg.norm(towards), up + slope * towards / np.linalg.norm(towards))
    met = wj.image_to_ground(bent, shot, pixel, hill).point_m
    assert np.linalg.norm(met - point) > 30
    np.testing.assert_allclose(wj.project(bent, shot, met).pixel_px, pixel, rtol=0, atol=1e-6)


@pytest.mark.parametrize("angle, shift", [(45.0, 1.1), (68.2, 9.9), (74.3, 27.0), (78.0, 62.0)])
def test_the_target_lies_nearer_than_a_straight_ray_says(angle, shift):
    """../shared/scenarios.md; the mount and the pitch turn the look by a tenth of a degree."""
    point, straight = (wj.image_to_ground(frame(angle, r), SHOTS, 0 * PIXELS, GROUND).point_m for r in (Refraction(), None))
    centre = wj.ray(frame(angle, None), SHOTS, 0 * PIXELS).origin_m
    nearer = np.linalg.norm(straight - centre, axis=-1) - np.linalg.norm(point - centre, axis=-1)
    np.testing.assert_allclose(nearer.mean() / np.sin(np.radians(angle)), shift, rtol=0.1)


def test_a_ray_leaves_the_camera_straight():
    for bent, straight in zip(*(wj.ray(frame(78.0, r), SHOTS, PIXELS) for r in (Refraction(), None)), strict=True):
        np.testing.assert_array_equal(jax.tree.leaves(bent), jax.tree.leaves(straight))


def test_without_refraction_nothing_is_added():
    """The same operations as a chain that never heard of it."""
    plain, points = frame(45.0, None), tuple(jnp.zeros(N) for _ in range(3))
    traced = str(jax.make_jaxpr(lambda p: image(plain, SHOTS, p))(points))
    by_hand = str(jax.make_jaxpr(lambda p: plain.camera.pixel(_inwards(plain, p)))(points))
    assert traced == by_hand


def _inwards(sensor, point):
    for link in sensor.links:
        point = link.pose(SHOTS).into(point)
    return point


@pytest.fixture(scope="module")
def nadir_and_oblique():
    """One camera that sees the ground at nadir and at 78 deg, far from its centre; the two ground points."""
    shot = wj.Shot(time_s=5.0)
    points = [wj.image_to_ground(frame(a, Refraction()), shot, np.zeros(2), GROUND).point_m for a in (0.0, 78.0)]
    return frame(39.0, Refraction()), shot, np.stack(points)


def test_derivatives_with_pose_scale_and_point(nadir_and_oblique):
    """Of the pixel, with the ground point, a shift and a turn of the platform, and the scale; at nadir, too."""
    base, shot, points = nadir_and_oblique

    def f(x):
        body = wj.Correction(wj.Bias(), turn_rad=x[None, 6:9], shift_m=x[None, 3:6])
        bent = with_air(base.after("body", "moved", body), Refraction(x[9]))
        return stack(image(bent, shot, unstack(x[:3])))

    step = [5.0] * 6 + [1e-4] * 3 + [0.05]
    # Pixels; 5 m at 10 km are 50 px.
    at = [np.concatenate([point, np.zeros(6), [1.0]]) for point in points]
    assert_derivatives(f, np.stack(at), step, tolerance=1e-5)


def test_derivatives_of_the_ground_point(nadir_and_oblique):
    base, shot, points = nadir_and_oblique

    def f(x):
        bent = with_air(base, Refraction(x[2]))
        return wj.image_to_ground(bent, shot, x[:2], wj.HeightSurface(x[3])).point_m

    # Metres: a pixel is 0.4 m off at 40 km and 2 m along the ground.
    pixels = np.asarray(wj.project(base, shot, points).pixel_px)
    at = np.concatenate([pixels, np.tile([1.0, 1551.0], (2, 1))], axis=1)
    assert_derivatives(f, at, step=[20.0, 20.0, 0.05, 20.0], tolerance=1e-5)


@pytest.fixture(scope="module", params=[45.0, 78.0])
def swept(request):
    bent = frame(request.param, Refraction())
    points = unstack(wj.image_to_ground(bent, SHOTS, PIXELS, GROUND).point_m)
    return request.param, bent, points, jax.jit(lambda p: wj.joint_derivatives(bent, SHOTS, p))(points)


def test_a_sweep_has_the_exact_derivative_by_the_ground_point(swept):
    _, bent, points, found = swept
    np.testing.assert_allclose(stack(found.pixel), PIXELS, rtol=0, atol=1e-6)
    step = np.array([1.0, -2.0, 0.5])
    exact = jax.jvp(lambda *p: stack(image(bent, SHOTS, p)), points, tuple(np.full(N, s) for s in step))[1]
    got = np.stack([sum(h * s for h, s in zip(row, step, strict=True)) for row in found.derivatives["earth"]], -1)
    np.testing.assert_allclose(got, exact, rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize("joint, part, allowed", [("outer", "turn", 1e-7), ("body", "turn", 1e-6), ("body", "shift", 3e-3)])
def test_motions_in_a_sweep_take_the_displacement_as_constant(swept, joint, part, allowed):
    """Exact for a turn about the camera; sweep.py says how far off a shift is."""
    _, bent, points, found = swept
    motion = np.array([3e-3, -2e-3, 5e-3, 0, 0, 0]) if part == "turn" else np.array([0, 0, 0, 1.0, -2.0, 0.7])

    def pixels(size):
        moved = with_air(moved_there(bent, joint, size * motion), bent.refraction)
        return stack(image(moved, SHOTS, points))

    exact = jax.jit(lambda: jax.jvp(pixels, (jnp.zeros(()),), (jnp.ones(()),))[1])()
    follows = stack(found.follows(joint, wj.Motion(tuple(motion[:3]), tuple(motion[3:]))))
    assert np.abs(follows - exact).max() < allowed * np.abs(exact).max()


def test_a_baked_sensor_images_alike():
    bent = frame(78.0, Refraction(1.1))
    points = wj.image_to_ground(bent, SHOTS, PIXELS, GROUND).point_m
    for free in ((), ("outer",), ("refraction", "camera")):
        sensor, shots = wj.bake(bent, SHOTS, free)
        np.testing.assert_allclose(wj.project(sensor, shots, points).pixel_px, PIXELS, rtol=0, atol=1e-6)


def test_the_scale_may_be_an_unknown():
    place = parse("refraction.scale")
    bent = make_room(frame(78.0, Refraction()), place)
    assert float(read(bent, place)) == 1.0
    assert not hasattr(make_room(bent, place), "scale")
    unknown = wj.Unknown("air", "refraction.scale", 1.0, 0.03)
    assert float(read(wj.assign(bent, [unknown], [1.2]), place)) == 1.2
    points = wj.image_to_ground(bent, SHOTS, PIXELS, GROUND).point_m
    moves = jax.jacfwd(lambda v: wj.project(wj.assign(bent, [unknown], v), SHOTS, points).pixel_px)(jnp.ones(1))[..., 0]
    # 62 m along the ground are 13 m across the ray, at 43 km 30 pixels of 10 urad.
    assert 25 < np.abs(moves).max() < 35
    with pytest.raises(wj.WhiskjaxError, match="the sensor has no refraction"):
        make_room(frame(78.0, None), place)


def test_it_stays_when_a_link_is_added():
    bent = frame(45.0, Refraction())
    assert bent.after("body", "bias", wj.Correction(wj.Bias())).refraction is bent.refraction
    assert bent["refraction"] is bent.refraction
    with pytest.raises(wj.WhiskjaxError, match="'refraction' cannot name a frame"):
        bent.after("body", "refraction", wj.Correction(wj.Bias()))


def test_a_ray_above_the_horizon_misses_the_ground():
    bent = frame(100.0, Refraction())
    with pytest.raises(wj.SensorError, match="the ray misses the ground"):
        wj.image_to_ground(bent, SHOTS, PIXELS, GROUND)


def test_a_local_world_has_no_air():
    poses = wj.PosePerImage(np.array([[0.0, 0.0, 1000.0]]), [[0.0, 0.0, 0.0, 1.0]])
    bent = wj.Sensor({"body": poses}, wj.FrameCamera(1000.0, (0.0, 0.0)), Refraction())
    with pytest.raises(wj.SensorError):
        wj.project(bent, wj.Shot(image=0), np.array([10.0, 0.0, 0.0]))


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_shapes(shape):
    bent = frame(60.0, Refraction())
    pixel = np.full((*shape, 2), 20.0)
    for shot in (wj.Shot(time_s=4.0), wj.Shot(time_s=np.full(shape, 4.0))):
        point = wj.image_to_ground(bent, shot, pixel, GROUND).point_m
        assert point.shape == (*shape, 3)
        assert wj.project(bent, shot, point).pixel_px.shape == (*shape, 2)


@pytest.mark.parametrize("angle", [45.0, 78.0])
def test_rays_of_many_looks_meet_where_the_bent_rays_come_from(angle):
    """Forward intersection goes through the sweep."""
    bent = frame(angle, Refraction())
    shot, spread = wj.Shot(time_s=np.array([0.5, 9.5])), 2
    target = wj.image_to_ground(bent, wj.Shot(time_s=5.0), np.zeros(2), GROUND).point_m
    pixel = wj.project(bent, shot, np.broadcast_to(target, (spread, 3))).pixel_px
    met = wj.intersect(bent, shot, pixel, np.zeros(spread, dtype=int))
    np.testing.assert_allclose(met.point_m[0], target, rtol=0, atol=1e-5)

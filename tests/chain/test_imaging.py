"""ray, project, image_to_ground and ground_to_image: round trips for every camera, batches, failures, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import BATCH, attitudes, latitudes, longitudes, numbers

R = wj.RESULTS
PIXEL = 1e-6  # px: ECEF is rounded to 1e-9 m, which is 1e-8 rad from 100 m, and a focal length has some thousand pixels
DEFORMATION = [[5.0, 9.0, 4.0, -2.0], [-3.0, 3.0, 2.0, 1.5]]
SAMPLES = np.linspace(0, 4000, 6)
CAMERAS = {
    "frame": wj.FrameCamera(3000.0, (2000.0, 1500.0)),
    "frame with distortion": wj.FrameCamera(3000.0, (2000.0, 1500.0), (-0.1, 0.03, 0.0, 1e-3, -5e-4)),
    "zoom": wj.FrameCamera(np.linspace(2000, 9000, BATCH), (2000.0, 1500.0), per_image=True),
    "line along x": wj.LineCamera(5000.0, 2000.0, offset_px=1000.0),
    "line along y, deformed": wj.LineCamera(
        5000.0, 2000.0, -700.0, -1.0, -1.0, deformation_px=DEFORMATION, half_width_px=2000.0, along="y"
    ),
    "line along x, in waves": wj.LineCamera(
        5000.0,
        2000.0,
        200.0,
        deformation_px=DEFORMATION,
        half_width_px=2000.0,
        wave_px=[[0.3, -2.0], [1.0, 0.4]],
        wavelength_px=700.0,
    ),
    "look table": wj.LookTable(SAMPLES, np.stack([(SAMPLES - 2000) / 5000, 0.02 + 1e-9 * SAMPLES**2, -1 + 1e-6 * SAMPLES], -1)),
}


@pytest.fixture(scope="module")
def there_and_back():
    """Pixel -> ray -> point on it -> pixel, for a camera whose poses are data."""

    @jax.jit
    def f(camera, position, quaternion, pixel, distance):
        poses = wj.PosePerImage(np.zeros((BATCH, 3)), np.tile([0.0, 0, 0, 1], (BATCH, 1)))
        fields = tuple(position.T), tuple(quaternion.T)
        poses = eqx.tree_at(lambda p: (p.position_m, p.quaternion), poses, fields)
        links = {"body": poses, "mount": wj.Mount([0.1, 0.2, -0.3], [0.01, -0.02, 0.03]), "axes": wj.Axes("y -z -x")}
        sensor, shot = wj.Sensor(links, camera), wj.Shot(image=np.arange(BATCH))
        ray = wj.ray(sensor, shot, pixel)
        point = ray.origin_m + distance[:, None] * ray.direction
        return ray, wj.project(sensor, shot, point)

    return f


@pytest.mark.parametrize("name", CAMERAS)
@given(latitudes(), longitudes(), numbers(0, 1e5), attitudes(), numbers(300, 3600), numbers(200, 2800), numbers(100, 1e5))
def test_a_pixel_comes_back_from_any_point_of_its_ray(there_and_back, name, lat, lon, height, turn, column, row, distance):
    camera = CAMERAS[name]
    pixel = np.stack([column, (row - 1500) / 500 if camera.is_line else row], -1)
    if isinstance(camera, wj.LookTable):
        pixel[:, 1] = 0.0  # beside the line, strips of two segments overlap at their corner
    position, quaternion = oracles.ecef(lat, lon, height), Rotation.from_rotvec(turn).as_quat()
    ray, back = there_and_back(camera, position, quaternion, pixel, distance)
    assert bool(jnp.all(ray.result == R.successful)) and bool(jnp.all(back.result == R.successful))
    np.testing.assert_allclose(np.linalg.norm(ray.direction, axis=-1), 1, rtol=0, atol=1e-15)
    arm = Rotation.from_rotvec(turn).apply([0.1, 0.2, -0.3])
    np.testing.assert_allclose(ray.origin_m, position + arm, rtol=0, atol=1e-8)
    np.testing.assert_allclose(back.pixel_px, pixel, rtol=0, atol=PIXEL)


# One instrument with every kind of link, whose parameters are data: derivatives with respect to everything.

TIME_S = np.linspace(0, 10, 21)
LAT, LON = 0.6 + 1e-6 * 11 * TIME_S, -1.2 + 2e-6 * TIME_S
ROLL, PITCH, HEADING = 0.02 * np.sin(TIME_S), 0.01 * np.cos(TIME_S), 0.8 + 0.003 * TIME_S
VELOCITY = np.tile([70.0, 60.0, -0.5], (21, 1))
BODY = wj.Trajectory.from_geodetic(
    TIME_S,
    LAT,
    LON,
    2000 + 0 * TIME_S,
    ROLL,
    PITCH,
    HEADING,
    velocity_ned_mps=VELOCITY,
    max_gap_s=1.0,
    delay_s=0.01,
    attitude_delay_s=0.02,
)
SCAN = wj.Encoder(TIME_S, np.linspace(-0.5, 0.5, 21), 1.0)
GROUND_M = 150.0
PLACES = {
    "pos delay_s": (lambda s: s["body"].delay_s, 0.01),
    "attitude delay_s": (lambda s: s["body"].attitude_delay_s, 0.01),
    "correction turn_rad": (lambda s: s["drift"].turn_rad, 1e-3),
    "correction shift_m": (lambda s: s["drift"].shift_m, 1.0),
    "lever_arm_m": (lambda s: s["platform"]["b"].lever_arm_m, 1.0),
    "angles_rad": (lambda s: s["platform"]["b"].angles_rad, 1e-3),
    "encoder delay_s": (lambda s: s["scan"].delay_s, 0.01),
    "zero_rad": (lambda s: s["scan"].zero_rad, 1e-3),
    "gain": (lambda s: s["scan"].gain, 1e-2),
    "polynomial_rad": (lambda s: s["scan"].polynomial_rad, 1e-2),
    "focal_px": (lambda s: s["camera"].focal_px, 10.0),
    "principal_sample_px": (lambda s: s["camera"].principal_sample_px, 1.0),
    "offset_px": (lambda s: s["camera"].offset_px, 1.0),
    "deformation_px": (lambda s: s["camera"].deformation_px, 1.0),
}
RICH = wj.Sensor(
    {
        "body": BODY,
        "drift": wj.Correction(wj.Drift(0.0, 10.0), jnp.full((2, 3), 1e-3), jnp.full((2, 3), 0.5)),
        "flu": wj.Axes("x -y -z"),
        "platform": wj.By("swing", {"a": wj.Mount(), "b": wj.Mount([0.1, 0.2, -1.0], [0.01, 0.02, 0.03])}),
        "scan": wj.Turn("x", SCAN, delay_s=0.03, zero_rad=0.002, gain=1.003, polynomial_rad=[0.01, -0.02]),
    },
    wj.LineCamera(
        8000.0, 2000.0, 300.0, deformation_px=jnp.asarray(DEFORMATION), half_width_px=2000.0, samples_px=(0.0, 4000.0), along="x"
    ),
)
SHOT = wj.Shot(time_s=4.3, swing=1)
SAMPLE = 1234.5


def leaves_of(sensor):
    return [where(sensor) for where, _ in PLACES.values()]


START = np.concatenate([np.ravel(leaf) for leaf in leaves_of(RICH)])
STEPS = np.concatenate([np.full(np.size(leaf), step) for leaf, (_, step) in zip(leaves_of(RICH), PLACES.values(), strict=True)])


def with_parameters(x):
    parts, k = [], 0
    for leaf in leaves_of(RICH):
        parts.append(x[k : k + np.size(leaf)].reshape(np.shape(leaf)))
        k += np.size(leaf)
    return eqx.tree_at(leaves_of, RICH, parts)


@pytest.fixture(scope="module")
def ground():
    return np.asarray(wj.image_to_ground(RICH, SHOT, [SAMPLE, 0.0], wj.HeightSurface(GROUND_M)).point_m)


def sees(sensor, x):
    answer = wj.ray(sensor, wj.Shot(time_s=x[0], swing=1), x[1:3])
    return answer.origin_m, answer.direction


def meets(sensor, x):
    return wj.image_to_ground(sensor, wj.Shot(time_s=x[0], swing=1), x[1:3], wj.HeightSurface(x[3])).point_m


def puts(sensor, x):
    return wj.project(sensor, wj.Shot(time_s=x[0], swing=1), x[4:7]).pixel_px


def finds(sensor, x):
    answer = wj.ground_to_image(sensor, wj.Shot(swing=1), x[4:7], (1.0, 9.0))
    return answer.pixel_px[0], answer.time_s


# Metres of the origin, and a direction that turns by 1e-2; metres on the ground 2 km away; pixels, 8000 to the radian; pixels and
# seconds, 20 to the radian.
DOORS = {
    "ray": (sees, [3e-8] * 3 + [1e-11] * 3),
    "image_to_ground": (meets, 3e-7),
    "project": (puts, 1e-6),
    "ground_to_image": (finds, [1e-6, 1e-9]),
}


@pytest.mark.parametrize("door", DOORS)
def test_derivatives_with_respect_to_every_parameter(door, ground):
    """Of time, pixel, height, ground point, delays, corrections, mount, encoder, camera and self-calibration."""
    f, tolerance = DOORS[door]
    x = np.r_[4.3, SAMPLE, 0.0, GROUND_M, ground, START]
    step = np.r_[0.01, 1.0, 1.0, 10.0, 1.0, 1.0, 1.0, STEPS]
    assert_derivatives(lambda v: f(with_parameters(v[7:]), v), x, step, tolerance)


def test_the_line_offset_of_ground_to_image_is_zero_and_the_pixel_the_one_that_looked(ground):
    found = wj.ground_to_image(RICH, wj.Shot(swing=1), ground, (1.0, 9.0))
    np.testing.assert_allclose(found.time_s, 4.3, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.pixel_px, [SAMPLE, 0.0], rtol=0, atol=PIXEL)


SHAPES = [(), (1,), (3, 2)]
SHORT = wj.Sensor({"body": BODY, "flu": wj.Axes("x -y -z")}, wj.LineCamera(8000.0, 2000.0))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_batches_agree_with_a_loop(shape):
    rng = np.random.default_rng(41)
    time, sample, height = rng.uniform(2, 8, shape), rng.uniform(0, 4000, shape), rng.uniform(0, 300, shape)
    pixel = np.stack([sample, np.zeros(shape)], -1)
    shot = wj.Shot(time_s=time)
    ray = wj.ray(SHORT, shot, pixel)
    ground = wj.image_to_ground(SHORT, shot, pixel, wj.HeightSurface(height))
    back = wj.project(SHORT, shot, ground.point_m)
    found = wj.ground_to_image(SHORT, wj.Shot(), ground.point_m, (1.0, 9.0))
    assert ray.origin_m.shape == ray.direction.shape == ground.point_m.shape == (*shape, 3)
    assert back.pixel_px.shape == found.pixel_px.shape == (*shape, 2)
    assert found.time_s.shape == shape
    for answer in (ray, ground, back, found):
        assert (answer.result == R.successful).shape == shape
    np.testing.assert_allclose(back.pixel_px, pixel, rtol=0, atol=PIXEL)
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=PIXEL)
    np.testing.assert_allclose(found.time_s, time, rtol=0, atol=1e-9)
    for i in np.ndindex(shape):
        one = wj.Shot(time_s=time[i])
        np.testing.assert_allclose(ray.direction[i], wj.ray(SHORT, one, pixel[i]).direction, rtol=0, atol=1e-14)
        alone = wj.image_to_ground(SHORT, one, pixel[i], wj.HeightSurface(height[i])).point_m
        np.testing.assert_allclose(ground.point_m[i], alone, rtol=0, atol=1e-8)


FRAME = wj.Sensor({"body": wj.PosePerImage(np.zeros((1, 3)), [[0.0, 0, 0, 1]])}, CAMERAS["frame"])


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_one_shot_serves_many_pixels(shape):
    """Every field of the answer has the batch shape of the pixels or points, also where the shot has none."""
    pixel = np.full((*shape, 2), 1000.0)
    shot = wj.Shot(image=0)
    ray = wj.ray(FRAME, shot, pixel)
    assert ray.direction.shape == (*shape, 3)
    assert ray.origin_m.shape == (*shape, 3)
    assert (ray.result == R.successful).shape == shape
    met = wj.image_to_ground(FRAME, shot, pixel, wj.Plane(np.array([0.0, 0, -50]), np.array([0.0, 0, 1])))
    assert met.point_m.shape == (*shape, 3) and (met.result == R.successful).shape == shape
    put = wj.ground_to_image(FRAME, shot, met.point_m)
    assert put.pixel_px.shape == (*shape, 2) and put.time_s.shape == shape and (put.result == R.successful).shape == shape


def test_a_frame_camera_images_a_ground_point_at_its_own_time():
    sensor = wj.Sensor({"body": BODY, "axes": wj.Axes("y x -z")}, wj.FrameCamera(1000.0, (500.0, 500.0), size_px=(1001, 1001)))
    shot = wj.Shot(time_s=np.array([3.0, 4.0]))
    pixel = np.array([[400.0, 300.0], [0.0, 1000.0]])
    point = wj.image_to_ground(sensor, shot, pixel, wj.HeightSurface(0.0)).point_m
    found = wj.ground_to_image(sensor, shot, point)
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=PIXEL)
    np.testing.assert_array_equal(found.time_s, [3.0, 4.0])
    # The same points half a second later are off the second frame.
    late = wj.ground_to_image(sensor, wj.Shot(time_s=np.array([3.5, 6.0])), point, throw=False)
    assert [bool(r) for r in late.result == R.outside_swath] == [False, True]
    assert np.isnan(late.pixel_px[1]).all() and np.isnan(late.time_s[1]) and np.isfinite(late.pixel_px[0]).all()
    unclipped = wj.ground_to_image(sensor, wj.Shot(time_s=6.0), point[1], clip=False)
    assert np.isfinite(unclipped.pixel_px).all()


ABOVE = {"time outside": 99.0, "no time": np.nan}


@pytest.mark.parametrize("case", ABOVE)
def test_a_failing_shot_is_nan_or_an_error(case, ground):
    shot = wj.Shot(time_s=np.array([4.0, ABOVE[case]]), swing=1)
    doors = {
        "ray": lambda **k: wj.ray(RICH, shot, [[SAMPLE, 0.0]] * 2, **k),
        "project": lambda **k: wj.project(RICH, shot, [ground] * 2, **k),
        "image_to_ground": lambda **k: wj.image_to_ground(RICH, shot, [[SAMPLE, 0.0]] * 2, wj.HeightSurface(0.0), **k),
    }
    for name, door in doors.items():
        answer = door(throw=False)
        *values, result = answer
        np.testing.assert_array_equal(np.asarray(result == R.time_outside_trajectory), [False, True])
        for value in values:
            assert np.isfinite(value[0]).all() and np.isnan(value[1]).all()
        with pytest.raises(wj.SensorError, match=rf"{name}: 1 of 2 \(.*nothing is extrapolated.*index \(1,\)"):
            door()


def test_a_point_behind_the_camera_is_refused(ground):
    above = 2 * np.asarray(wj.ray(RICH, SHOT, [SAMPLE, 0.0]).origin_m) - ground
    with pytest.raises(wj.SensorError, match="project: the point lies behind the camera"):
        wj.project(RICH, SHOT, above)


def test_a_ray_that_misses_the_earth_is_refused():
    with pytest.raises(wj.SensorError, match="image_to_ground: the ray misses the ground"):
        wj.image_to_ground(RICH, SHOT, [SAMPLE, -1e6], wj.HeightSurface(0.0))


@pytest.mark.parametrize(
    "door", [wj.ray, lambda *a, **k: wj.image_to_ground(*a, wj.HeightSurface(0.0), **k)], ids=["ray", "image_to_ground"]
)
def test_no_number_is_no_pixel(door):
    answer = door(RICH, SHOT, [np.nan, 0.0], throw=False)
    assert bool(answer.result != R.successful)
    with pytest.raises(wj.SensorError):
        door(RICH, SHOT, [np.nan, 0.0])


@pytest.mark.parametrize("bad", [[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]])
def test_no_number_is_no_point(bad):
    answer = wj.project(RICH, SHOT, bad, throw=False)
    assert bool(answer.result != R.successful) and np.isnan(answer.pixel_px).all()


@pytest.mark.parametrize(
    "door, value, message",
    [
        (lambda v: wj.ray(RICH, SHOT, v), np.zeros(3), r"ray: pixel_px has shape \(3,\), expected \(\.\.\., 2\)"),
        (lambda v: wj.project(RICH, SHOT, v), np.zeros((3, 2)), r"project: point_m has shape \(3, 2\), expected \(\.\.\., 3\)"),
        (
            lambda v: wj.ground_to_image(RICH, SHOT, v, (1.0, 9.0)),
            np.zeros(()),
            r"ground_to_image: point_m has shape \(\), expected \(\.\.\., 3\)",
        ),
    ],
)
def test_the_wrong_shape_is_refused(door, value, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        door(value)


def test_failures_do_not_poison_the_derivatives_of_the_rest(ground):
    """The sum over the good ones has finite derivatives although other lanes of the batch fail."""
    points = jnp.stack([jnp.asarray(ground), -jnp.asarray(ground), 2 * jnp.asarray(ground)])
    times = jnp.array([4.3, 77.0, 4.3])
    axes, camera = wj.Axes("y x -z"), wj.FrameCamera(1000.0, (0.0, 0.0), (-0.1, 0.0, 0.0, 0.0, 0.0))

    def total(angles):
        sensor = wj.Sensor({"body": BODY, "mount": wj.Mount(angles_rad=angles), "axes": axes}, camera)
        put = wj.project(sensor, wj.Shot(time_s=times), points, throw=False)
        good = put.result == R.successful
        return jnp.sum(jnp.where(good[:, None], put.pixel_px, 0.0)), good

    gradient, good = jax.jit(jax.grad(total, has_aux=True))(jnp.zeros(3))
    assert [bool(g) for g in good] == [True, False, False]
    assert np.isfinite(gradient).all() and np.abs(gradient).max() > 1


@given(st.integers(0, 5))
def test_two_heights_of_one_ray_lie_on_it(seed):
    rng = np.random.default_rng(seed)
    shot, pixel = wj.Shot(time_s=rng.uniform(2, 8), swing=1), [rng.uniform(0, 4000), 0.0]
    ray = wj.ray(RICH, shot, pixel)
    for height in (0.0, 1000.0):
        point = wj.image_to_ground(RICH, shot, pixel, wj.HeightSurface(jnp.asarray(height))).point_m
        away = np.asarray(point) - np.asarray(ray.origin_m)
        np.testing.assert_allclose(np.cross(away, ray.direction), 0, rtol=0, atol=1e-8)
        assert abs(oracles.exact_height(point) - height) < 4e-9

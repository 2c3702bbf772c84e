"""Second and higher derivatives of imaging: right through undistorting, the search for the time and the bending of rays."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.derivatives import assert_second_derivatives
from whiskjax.earth.refraction import Refraction

TIME_S = np.linspace(0.0, 10.0, 21)
SHOT = wj.Shot(time_s=4.3)
GROUND_M = 150.0
SAMPLES = np.linspace(0.0, 4000.0, 6)
CAMERAS = {
    "frame": wj.FrameCamera(3000.0, (10.0, -20.0), (-0.1, 0.03, 0.001, 1e-3, -2e-3)),
    "line": wj.LineCamera(
        8000.0, 2000.0, 300.0, deformation_px=[[5.0, 90.0, 4, -2], [-3.0, 3, 20, 1.5]], half_width_px=2000.0, samples_px=(0, 4000)
    ),
    "line in waves": wj.LineCamera(
        8000.0, 2000.0, 300.0, samples_px=(0, 4000), wave_px=[[3.0, 20.0], [-9.0, 15.0]], wavelength_px=1500.0
    ),
    "table": wj.LookTable(SAMPLES, np.stack([(SAMPLES - 2000) / 5000, 0.02 + 1e-9 * SAMPLES**2, -1 + 1e-6 * SAMPLES], -1)),
}
# What of a camera is differentiated, and over which steps: the image moves by some tens of pixels.
PARTS = {
    "frame": (lambda c: (c.focal_px, c.principal_point_px, c.distortion), [10.0, 10.0, 10.0, 0.1, 0.3, 1.0, 0.03, 0.03]),
    "line": (lambda c: (c.focal_px, c.offset_px, c.deformation_px), [10.0, 10.0, *[10.0] * 8]),
    "line in waves": (lambda c: (c.focal_px, c.wave_px), [10.0] * 5),
    "table": (lambda c: (), []),
}
MOUNT_RAD = [0.01, 0.02, 0.03]


def instrument(name, air=None):
    """At 2 km, turning and climbing; line cameras behind a scan mirror."""
    waves = 0.02 * np.sin(TIME_S), 0.01 * np.cos(TIME_S), 0.8 + 0.003 * TIME_S
    lat, lon = 0.6 + 1.1e-5 * TIME_S, -1.2 + 2e-6 * TIME_S
    links = {
        "body": wj.Trajectory.from_geodetic(TIME_S, lat, lon, 2000 + 0 * TIME_S, *waves, max_gap_s=1.0),
        "flu": wj.Axes("x -y -z"),
        "mount": wj.Mount([0.1, 0.2, -1.0], MOUNT_RAD),
    }
    if name != "frame":
        links["scan"] = wj.Turn("x", wj.Encoder(TIME_S, np.linspace(-0.5, 0.5, 21), 1.0))
    return wj.Sensor(links, CAMERAS[name], air)


def doors(name, pixel, air=None, only_search=False):
    """All doors, or the time of exposure alone, by pixel, ground point, height, mount, camera (and air); where, and the steps."""
    base, (parts, steps) = instrument(name, air), PARTS[name]
    start = np.concatenate([[], *(np.ravel(part) for part in parts(base.camera))])
    point = np.asarray(wj.image_to_ground(base, SHOT, pixel, wj.HeightSurface(GROUND_M)).point_m)
    where = lambda s: (*parts(s.camera), s["mount"].angles_rad, *(() if air is None else (s.refraction.scale,)))

    def f(v):
        sizes = np.cumsum([np.size(part) for part in where(base)])
        values = [part.reshape(np.shape(old)) for part, old in zip(jnp.split(v[6:], sizes[:-1]), where(base), strict=True)]
        sensor = eqx.tree_at(where, base, values)
        if name == "frame":
            found = wj.ground_to_image(sensor, SHOT, v[2:5]).pixel_px
        else:
            imaged = wj.ground_to_image(sensor, wj.Shot(), v[2:5], (1.0, 9.0))
            found = imaged.pixel_px[0], imaged.time_s
        if only_search:
            return found[-1]
        ground = wj.image_to_ground(sensor, SHOT, v[:2], wj.HeightSurface(v[5])).point_m
        return found, ground, wj.ray(sensor, SHOT, v[:2]).direction, wj.project(sensor, SHOT, v[2:5]).pixel_px

    more = ([], []) if air is None else ([1.0], [0.1])
    x = np.concatenate([pixel, point, [GROUND_M], start, MOUNT_RAD, more[0]])
    return f, x, np.concatenate([[10.0] * 6, steps, [0.01] * 3, more[1]])


PIXELS = {"frame": [700.0, -500.0], "line": [1234.5, 0.0], "table": [1234.5, 0.0]}


@pytest.mark.parametrize("name", ["frame", "line"])
def test_second_derivatives_of_the_four_doors(name):
    f, x, step = doors(name, PIXELS[name])
    assert_second_derivatives(f, x, step)


def test_second_derivatives_of_the_search_along_a_look_table():
    f, x, step = doors("table", PIXELS["table"], only_search=True)
    assert_second_derivatives(f, x, step)


def nadir():
    """The pixel that looks straight down."""
    sensor = instrument("frame")
    lat, lon, _ = wj.ecef_to_geodetic(sensor.pose(SHOT).origin_m)
    return np.asarray(wj.project(sensor, SHOT, wj.geodetic_to_ecef(lat, lon, GROUND_M)).pixel_px)


def test_second_derivatives_along_bent_rays():
    """Of a frame camera, at nadir, too."""
    (f, x, step), (_, down, _) = (doors("frame", pixel, Refraction()) for pixel in (PIXELS["frame"], nadir()))
    assert_second_derivatives(f, np.stack([x, down]), step)


def test_second_derivatives_of_the_search_along_bent_rays():
    f, x, step = doors("line", PIXELS["line"], Refraction(), only_search=True)
    assert_second_derivatives(f, x, step)


def test_second_derivatives_without_distortion_and_on_the_axis():
    """Where nothing is to undo, coefficients of zero still have derivatives."""

    def f(v):
        camera = wj.FrameCamera(v[2], v[3:5], v[5:10])
        return jnp.stack(camera.direction((v[0], v[1]))[:2])

    zero, some = np.zeros(5), [-0.1, 0.03, 0.001, 1e-3, -2e-3]
    places = [[10.0, -20.0], [700.0, -500.0]]
    x = [[*place, 3000.0, 10.0, -20.0, *k] for place in places for k in (zero, some)]
    assert_second_derivatives(f, x, [30.0, 30.0, 30.0, 30.0, 30.0, 0.1, 0.3, 1.0, 0.03, 0.03], reverse=True)


def nested(f, order):
    """The derivative of a function of one number, forward and reverse by turns."""
    for i in range(order):
        f = jax.jacfwd(f) if i % 2 else jax.grad(f)
    return f


def test_undistorting_has_the_derivatives_of_the_inverse_series():
    """r + k r^3 = d has the inverse d - k d^3 + 3 k^2 d^5 - ... (reversion of series): derivatives 1, 0 and -6 k at 0."""
    k = -0.3

    def radius(d):
        return wj.FrameCamera(1.0, (0.0, 0.0), (k, 0.0, 0.0, 0.0, 0.0)).direction((d, 0.0 * d))[0]

    derivatives = jax.jit(lambda d: [nested(radius, order)(d) for order in (1, 2, 3)])(0.0)
    np.testing.assert_allclose(derivatives, [1, 0, -6 * k], rtol=1e-12, atol=1e-12)


def test_the_time_of_exposure_has_all_derivatives_by_the_focal_length():
    """Level and even flight: x = f (X - v t) / h is imaged at the line's place o when t = (X - o h / f) / v."""
    time, place, height, speed = np.arange(7.0), 60.0, 1000.0, 50.0
    track = np.stack([speed * time, 0 * time, height + 0 * time], -1)
    body = wj.Trajectory(time, track, np.tile([0.0, 0, 0, 1], (7, 1)), max_gap_s=2.0)

    def exposed(point, focal):
        sensor = wj.Sensor({"body": body}, wj.LineCamera(focal, offset_px=place, along="y"))
        return wj.ground_to_image(sensor, wj.Shot(), point, (0.0, 6.0), throw=False).time_s

    points, focal = np.array([[150.0, 30.0, 0.0], [170.0, -20.0, 10.0]]), 1000.0
    one = lambda point: jnp.stack([nested(lambda f: exposed(point, f), order)(focal) for order in (1, 2, 3)])
    got = jax.jit(jax.vmap(one))(points)
    drop = height - points[:, 2]
    expected = np.outer(place * drop / speed, [focal**-2, -2 * focal**-3, 6 * focal**-4])
    np.testing.assert_allclose(got, expected, rtol=1e-9)

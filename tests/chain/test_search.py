"""Ground to image: against brentq, how it converges, what it flags. (Its derivative: test_imaging.py.)"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import whiskjax as wj
from tests.chain.test_papers import collinearity
from whiskjax.chain import bracket, search, walk
from whiskjax.chain.imaging import image, into_camera

R = wj.RESULTS
PIXEL = 1e-6
N = 40
SWINGS = [0, 1]


def seen(flown, swing, seed=51):
    """Times, samples and ground points of pixels spread over a swing."""
    rng = np.random.default_rng(seed)
    time = flown.start_s[swing] + 0.003 + 2.994 * (np.arange(N) + rng.uniform(0, 1, N)) / N
    pixel = np.stack([rng.uniform(-990, 990, N), np.zeros(N)], -1)
    height = jnp.asarray(rng.uniform(8, 12, N))
    point = wj.image_to_ground(flown.sensor, wj.Shot(time_s=time, swing=swing), pixel, wj.HeightSurface(height)).point_m
    return time, pixel, np.asarray(point)


def window(flown, swing):
    return flown.start_s[swing], flown.start_s[swing] + 3.0


@pytest.mark.parametrize("swing", SWINGS, ids=["left", "right"])
def test_the_time_is_the_root_that_brentq_finds_in_the_textbook_formula(swings, swing):
    _, _, points = seen(swings, swing)
    found = wj.ground_to_image(swings.sensor, wj.Shot(swing=swing), points, window(swings, swing))
    for i in range(0, N, 4):
        # Ten line widths to both sides; the line rate is 6300 lines a second.
        near = float(found.time_s[i]) + np.array([-1.6e-3, 1.6e-3])
        root = brentq(lambda t, p=points[i]: collinearity(swings, t, p, swing == 0)[1], *near, xtol=1e-14, rtol=1e-15)
        assert abs(float(found.time_s[i]) - root) < 2e-10
        np.testing.assert_allclose(
            found.pixel_px[i], [collinearity(swings, root, points[i], swing == 0)[0], 0], rtol=0, atol=PIXEL
        )


@pytest.mark.parametrize("swing", SWINGS, ids=["left", "right"])
def test_ground_to_image_inverts_image_to_ground(swings, swing):
    time, pixel, points = seen(swings, swing)
    found = wj.ground_to_image(swings.sensor, wj.Shot(swing=swing), points, window(swings, swing))
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=PIXEL)
    np.testing.assert_allclose(found.time_s, time, rtol=0, atol=2e-10)


def test_kinks_of_linearly_interpolated_pos_do_not_stop_it(rough_swings):
    """Newton cycles at such kinks."""
    _, pixel, points = seen(rough_swings, 1)
    found = wj.ground_to_image(rough_swings.sensor, wj.Shot(swing=1), points, window(rough_swings, 1))
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=PIXEL)


@pytest.mark.parametrize("width_s", [1.0, 0.1, 1e-2, 1e-3, 1e-4])
def test_a_narrow_window_does_no_harm(swings, width_s):
    """Once the miss is rounding, further steps must not throw the time away."""
    n = 4000
    rng = np.random.default_rng(53)
    time = rng.uniform(1.0, 2.0, n)
    pixel = np.stack([rng.uniform(-990, 990, n), np.zeros(n)], -1)
    points = wj.image_to_ground(swings.sensor, wj.Shot(time_s=time, swing=0), pixel, wj.HeightSurface(10.0)).point_m
    before = width_s * rng.uniform(0.02, 0.98, n)
    found = wj.ground_to_image(swings.sensor, wj.Shot(swing=0), points, (time - before, time - before + width_s))
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=PIXEL)


def strip(wave_rad, view_deg):
    """A three-line camera over 11.4 km of a strip: 60 m/s, 2450 m, 26000 px focal length (scenario songshan)."""
    time = np.arange(0, 1901) / 10
    waves = [wave_rad * np.sin(2 * np.pi * time / period + period) for period in (3.1, 7.7, 20.0)]
    body = wj.Trajectory.from_geodetic(
        time, 0.6 + 60 * time / 6.36e6, np.full_like(time, 1.9), np.full_like(time, 2450.0), *waves, max_gap_s=1.0
    )
    camera = wj.LineCamera(26000.0, 16378.0, offset_px=26000 * np.tan(np.radians(view_deg)), along="y")
    return wj.Sensor({"body": body, "flu": wj.Axes("x -y -z")}, camera)


@pytest.mark.parametrize("view_deg", [27.0, 0.0, -14.0])
@pytest.mark.parametrize("wave_deg", [0.0, 0.1])
def test_a_whole_strip_of_a_three_line_camera_is_searched(wave_deg, view_deg):
    sensor = strip(np.radians(wave_deg), view_deg)
    rng = np.random.default_rng(55)
    n = 300
    time, sample = rng.uniform(1, 189, n), rng.uniform(0, 32756, n)
    pixel = np.stack([sample, np.zeros(n)], -1)
    points = wj.image_to_ground(
        sensor, wj.Shot(time_s=time), pixel, wj.HeightSurface(jnp.asarray(rng.uniform(100, 1500, n)))
    ).point_m
    found = wj.ground_to_image(sensor, wj.Shot(), points, (0.0, 190.0))
    # A line every 1.3 ms moves 0.077 m; the point is imaged on its line, at the time when it was seen.
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=1e-4)
    np.testing.assert_allclose(found.time_s, time, rtol=0, atol=1e-6)


def test_a_success_lies_on_the_line_however_rough_the_flight():
    """With attitude waves of degrees a point may be seen more than once; whatever is returned as found must be found."""
    sensor = strip(np.radians(2.0), 27.0)
    rng = np.random.default_rng(57)
    n = 300
    pixel = np.stack([rng.uniform(0, 32756, n), np.zeros(n)], -1)
    points = wj.image_to_ground(sensor, wj.Shot(time_s=rng.uniform(20, 170, n)), pixel, wj.HeightSurface(300.0)).point_m
    found = wj.ground_to_image(sensor, wj.Shot(), points, (0.0, 190.0), clip=False, throw=False)
    offset = np.asarray(found.pixel_px[:, 1])[np.asarray(found.result == R.successful)]
    assert len(offset) > n / 2
    np.testing.assert_allclose(offset, 0, rtol=0, atol=1e-4)


@pytest.fixture(scope="module")
def after(swings):
    """Line offsets in pixels when a bracket over the whole swing is closed in so many steps, and Newton takes one more."""

    @jax.jit
    def after(steps, point):
        def offset(t):
            return image(swings.sensor, wj.Shot(swing=0, time_s=t), point)[1]

        def miss(t):
            shot = wj.Shot(swing=0, time_s=t)
            return swings.sensor.camera_at(shot).miss(into_camera(swings.sensor, shot, point))

        ends = (jnp.full(point[0].shape, end) for end in window(swings, 0))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(bracket, "MOST_STEPS", steps)
            pairs = [value for end in ends for value in (end, miss(end))]
            t = bracket.close(miss, bracket.between(*pairs), pairs[1] * pairs[3] <= 0).near
        value, rate = jax.jvp(offset, (t,), (jnp.ones_like(t),))
        return jnp.abs(offset(t - value / rate))

    return after


def test_a_swing_takes_four_steps(swings, after):
    """design.md: 5 evaluations (the two ends and 3 steps) leave 4e-4 px, 6 are exact."""
    _, _, points = seen(swings, 0)
    point = tuple(points.T)
    assert float(after(2, point).max()) > 1e-3
    assert float(after(3, point).max()) < 4e-4
    assert float(after(4, point).max()) < 1e-8


def test_what_has_not_converged_says_so(swings, monkeypatch):
    _, _, points = seen(swings, 0)
    monkeypatch.setattr(walk, "MOST_STEPS", 0)
    time, result = jax.jit(lambda p: search.exposure_time(swings.sensor, wj.Shot(swing=0), p, *window(swings, 0), True))(
        tuple(points.T)
    )
    offset = jnp.abs(image(swings.sensor, wj.Shot(swing=0, time_s=time), tuple(points.T))[1])
    lost = result == R.not_converged
    assert bool(jnp.any(lost)) and bool(jnp.all(lost | ((result == R.successful) & (offset < PIXEL))))


def test_points_outside_the_swath_are_flagged(swings):
    _, _, points = seen(swings, 0)
    # One that falls beside the detector, one that lies above the aircraft, and one on the image.
    time, pixel = np.array([1.5, 1.5]), np.array([[1500.0, 0.0], [0.0, 0.0]])
    beside, middle = np.asarray(
        wj.image_to_ground(swings.sensor, wj.Shot(time_s=time, swing=0), pixel, wj.HeightSurface(10.0)).point_m
    )
    answer = wj.ground_to_image(
        swings.sensor, wj.Shot(swing=0), np.stack([beside, 1.002 * middle, points[N // 2]]), (0.0, 3.0), throw=False
    )
    flags = [bool(f) for f in answer.result == R.successful]
    assert flags == [False, False, True]
    assert bool((answer.result == R.outside_swath)[0])
    assert np.isnan(answer.time_s[:2]).all() and np.isnan(answer.pixel_px[:2]).all()
    unclipped = wj.ground_to_image(swings.sensor, wj.Shot(swing=0), beside, (0.0, 3.0), clip=False)
    np.testing.assert_allclose(unclipped.pixel_px, [1500.0, 0.0], rtol=0, atol=PIXEL)
    # A point of the last quarter, in a window that ends before.
    with pytest.raises(wj.SensorError, match="not seen within the given time window"):
        wj.ground_to_image(swings.sensor, wj.Shot(swing=0), points[-1], (0.0, 2.0))


def test_a_window_that_the_trajectory_does_not_cover_is_refused(swings):
    _, _, points = seen(swings, 0)
    with pytest.raises(wj.SensorError, match="nothing is extrapolated"):
        wj.ground_to_image(swings.sensor, wj.Shot(swing=0), points[:2], (-1.0, 3.0))
    with pytest.raises(wj.SensorError, match="in a gap"):
        wj.ground_to_image(swings.sensor, wj.Shot(swing=0), points[:2], (0.0, 3.25))


def test_each_point_may_have_its_own_window(swings):
    time, pixel, points = seen(swings, 0)
    found = wj.ground_to_image(swings.sensor, wj.Shot(swing=0), points[5:9], (time[5:9] - 0.02, time[5:9] + 0.03))
    np.testing.assert_allclose(found.pixel_px, pixel[5:9], rtol=0, atol=PIXEL)


def test_a_line_camera_needs_a_window_and_a_frame_camera_none(swings):
    with pytest.raises(wj.WhiskjaxError, match=r"window_s=\(start, stop\)"):
        wj.ground_to_image(swings.sensor, wj.Shot(swing=0), np.zeros(3))
    frame = wj.Sensor({"body": swings.sensor["body"]}, wj.FrameCamera(1000.0, (0.0, 0.0)))
    with pytest.raises(wj.WhiskjaxError, match="leave window_s out"):
        wj.ground_to_image(frame, wj.Shot(time_s=1.0), np.zeros(3), (0.0, 1.0))


def test_a_deformed_detector_is_found_over_a_wide_swing(swings):
    """The self-calibration cubics of 10 px must not hide points that are 100 deg away at the other end of the swing."""
    deformation = jnp.array([[1.0, 2.0, 1.0, -1.0], [-3.0, 3.0, 2.0, 1.5]])
    camera = wj.LineCamera(10750.0, deformation_px=deformation, half_width_px=1000.0, samples_px=(-1000.0, 1000.0))
    sensor = wj.Sensor(dict(zip(swings.sensor.names, swings.sensor.links, strict=True)), camera)
    time, sample = np.array([0.02, 0.05, 1.5, 2.95, 2.98]), np.array([-990.0, 990.0, 0.0, 950.0, -950.0])
    pixel = np.stack([sample, np.zeros(5)], -1)
    points = wj.image_to_ground(sensor, wj.Shot(time_s=time, swing=0), pixel, wj.HeightSurface(10.0)).point_m
    found = wj.ground_to_image(sensor, wj.Shot(swing=0), points, (0.0, 3.0))
    np.testing.assert_allclose(found.pixel_px, pixel, rtol=0, atol=PIXEL)
    np.testing.assert_allclose(found.time_s, time, rtol=0, atol=1e-9)

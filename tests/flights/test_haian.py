"""The simulated whiskbroom against the figures that the paper prints (bands of scenarios.md)."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.chain.samples import ecef_samples
from whiskjax.flights import haian

# Bands of the seed-to-seed spread before calibration: mean y, mean x, std x of L1 and R1 (px).
BANDS = {"L1": ((-518.3, -516.3), (-89.5, -86.5), (8.7, 10.8)), "R1": ((507.0, 509.1), (-90.4, -88.0), (5.7, 7.1))}


@pytest.mark.parametrize("seed", range(5))
def test_residuals_before_calibration(seed):
    flight = haian.simulate(seed)
    observations = flight.observations()
    found = wj.project(flight.sensor, observations.shot, observations.point_m)
    residual = observations.pixel_px - np.asarray(found.pixel_px)
    images = np.asarray(observations.images)
    for name, (mean_y, mean_x, std_x) in BANDS.items():
        x, y = residual[(images == name)].T
        assert mean_y[0] < y.mean() < mean_y[1]
        assert mean_x[0] < x.mean() < mean_x[1]
        assert std_x[0] < x.std(ddof=1) < std_x[1]


def test_the_other_order_parts_left_and_right():
    """With Ry(pitch) Rx(scan) the mean x of left and right differ by about 10.8 px (the paper: 0.6)."""
    differences = []
    for scan_first in (True, False):
        flight = haian.simulate(0, scan_first=scan_first)
        observations = flight.observations()
        found = wj.project(flight.sensor, observations.shot, observations.point_m)
        x = (observations.pixel_px - np.asarray(found.pixel_px))[:, 0]
        images = np.asarray(observations.images)
        differences.append(x[images == "L1"].mean() - x[images == "R1"].mean())
    assert differences[1] - differences[0] == pytest.approx(8.0, abs=3.0)


def test_what_the_scenario_says_of_the_flight():
    flight = haian.simulate(0)
    roles = np.asarray(flight.points.roles)
    image = flight.measurements.image
    counts = [(int((image == i).sum()), int((roles[image == i] == "check").sum())) for i in range(6)]
    assert counts == [(75, 10), (75, 10), (16, 16), (22, 22), (21, 21), (22, 22)]
    time = np.asarray(flight.sensor["body"].knots.time_s)
    assert int((np.diff(time) > 0.02).sum()) == 5, "six segments of POS"
    lat, lon, height = wj.ecef_to_geodetic(flight.points.position_m)
    assert np.abs(np.asarray(height) - 10).max() < 2.3
    np.testing.assert_allclose(np.degrees([lat.mean(), lon.mean()]), [32.5, 120.5], atol=0.01)


def test_interpolating_200_hz_costs_little():
    """scenarios.md: linear interpolation at 200 Hz leaves at most 0.0044 px."""
    rng, path = np.random.default_rng(0), haian.Path.draw(jax.random.key(0))
    t = rng.uniform(0, 3, 400)
    exact = wj.PosePerImage(*ecef_samples(*path.navigation(t, np.full_like(t, 1.5)))[:2])
    _, *dense = path.recorded(2000.0)
    pixel = np.stack([rng.uniform(-1000, 1000, 400), np.zeros(400)], -1)
    shot = wj.Shot(time_s=t, image=np.arange(400), swing=0)
    ground = wj.image_to_ground(haian.sensor(exact, *dense), shot, pixel, wj.HeightSurface(10.0)).point_m
    back = wj.project(haian.sensor(*path.recorded()), shot, ground).pixel_px
    worst = np.abs(np.asarray(back) - pixel).max()
    assert 1e-5 < worst < 0.0060


def test_seeds_differ_and_repeat():
    a, b, c = haian.simulate(4), haian.simulate(4), haian.simulate(5)
    np.testing.assert_array_equal(a.points.position_m, b.points.position_m)
    np.testing.assert_array_equal(a.measurements.line_px, b.measurements.line_px)
    assert np.abs(a.measurements.line_px - c.measurements.line_px).max() > 1

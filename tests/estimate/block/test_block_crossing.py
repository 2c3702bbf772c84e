"""Rays of line cameras where the fitted point crosses the line."""

import dataclasses

import numpy as np
from scipy.optimize import brentq

import whiskjax as wj
from whiskjax.estimate.block.crossing import at_crossing


def offset(sensor, block, ray, point_m, time_s):
    """Line offset of a ray's point at a time."""
    shot = wj.Shot(time_s=np.array([time_s]), view=block.key("view")[[ray]], strip=block.key("strip")[[ray]])
    return float(wj.project(sensor, shot, point_m[block.point[ray]][None]).pixel_px[0, 1])


def test_times_are_those_of_the_crossing(drawn, adjusted):
    """The root of the line offset in time, by scipy; the measurement stays where it is on the ground."""
    block, point = drawn.block, adjusted.point_m
    found = at_crossing(adjusted.sensor, block, point)
    before, after = np.asarray(block.key("time_s")), np.asarray(found.key("time_s"))
    assert np.abs(after - before).max() > 1e-4
    for ray in range(0, len(block), len(block) // 6):
        at = [offset(adjusted.sensor, block, ray, point, before[ray] + step) for step in (-0.02, 0.02)]
        root = brentq(lambda t, ray=ray: offset(adjusted.sensor, block, ray, point, t), before[ray] - 0.02, before[ray] + 0.02)
        rate = (at[1] - at[0]) / 0.04
        assert abs(after[ray] - root) * abs(rate) < 0.01  # px; one Newton step
        assert abs(found.pixel_px[ray, 1] - rate * (root - before[ray])) < 0.05
    np.testing.assert_array_equal(found.pixel_px[:, 0], block.pixel_px[:, 0])
    for name in ("point", "sigma_px", "role"):
        np.testing.assert_array_equal(getattr(found, name), getattr(block, name))


def test_a_ray_keeps_its_time_where_nothing_is_recorded(drawn, adjusted):
    """The first ray comes to lie at the very beginning of the strip, and its point before it."""
    time = np.array(drawn.block.key("time_s"))
    first = int(np.argmin(time))
    time[first] = 0.0
    block = dataclasses.replace(drawn.block, shot=dataclasses.replace(drawn.block.shots(), time_s=time))
    point = adjusted.point_m.copy()
    ahead = offset(adjusted.sensor, block, first, point, 0.0)
    later = offset(adjusted.sensor, block, first, point, 1.0)
    along = np.asarray(adjusted.sensor["body"].pose(wj.Shot(time_s=0.0)).matrix)[:, 0]
    # Metres that bring the crossing a second before the strip.
    point[block.point[first]] -= along * 60.0 * (1.0 + ahead / (ahead - later))
    found = at_crossing(adjusted.sensor, block, point)
    assert np.asarray(found.key("time_s"))[first] == 0.0
    np.testing.assert_array_equal(found.pixel_px[first], block.pixel_px[first])

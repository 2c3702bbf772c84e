"""What coordinates mean: positions, level axes, heights and plans of an Earth-fixed world against pyproj, and of a flat one."""

import numpy as np
import pyproj
import pytest

import whiskjax as wj
from whiskjax.earth.world import WGS84, World

LAT_DEG, LON_DEG, HEIGHT_M = 34.5, 113.0, 812.25
TO_ECEF = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
POINT_M = np.array(TO_ECEF.transform(LON_DEG, LAT_DEG, HEIGHT_M))
FLAT = World("local", (48.6, 7.7, 140.0))
LOCAL_M = np.array([[100.0, -20.0, 31.5], [50.0, 60.0, 33.5]])


def test_a_position_is_written_in_the_coordinates_of_its_world():
    found = WGS84.position(POINT_M)
    assert list(found) == ["lat_deg", "lon_deg", "height_m"]
    np.testing.assert_allclose([found["lat_deg"], found["lon_deg"]], [LAT_DEG, LON_DEG], rtol=0, atol=1e-13)
    assert found["height_m"] == pytest.approx(HEIGHT_M, abs=1e-8)
    assert FLAT.position(LOCAL_M[0]) == {"x_m": 100.0, "y_m": -20.0, "z_m": 31.5}
    assert FLAT.is_flat and not WGS84.is_flat


def test_heights_and_surfaces_of_one_height():
    np.testing.assert_allclose(WGS84.height_m(POINT_M[None]), HEIGHT_M, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(FLAT.height_m(LOCAL_M), [31.5, 33.5])
    for world, point, up in ((WGS84, POINT_M, WGS84.from_enu(POINT_M[None])[0, :, 2]), (FLAT, LOCAL_M[0], np.array([0, 0, 1.0]))):
        height = float(world.height_m(point[None])[0]) - 100.0
        met = world.surface(height).intersect(tuple(point), tuple(-up))[0]
        np.testing.assert_allclose(np.stack(met), point - 100.0 * up, rtol=0, atol=1e-7)


def test_a_plan_is_east_and_north_of_the_middle():
    """100 m along a parallel and a meridian, by pyproj's geodesics, are 100 m east and north of the plan but for curvature."""
    geod = pyproj.Geod(ellps="WGS84")
    ends = [geod.fwd(LON_DEG, LAT_DEG, azimuth, 100.0)[:2] for azimuth in (90.0, 270.0, 0.0, 180.0)]
    points = np.array([TO_ECEF.transform(lon, lat, 0.0) for lon, lat in ends])
    plan = WGS84.plan_m(np.concatenate([points, [[np.nan] * 3]]))
    np.testing.assert_allclose(plan[:4], [[100, 0], [-100, 0], [0, 100], [0, -100]], rtol=0, atol=2e-3)
    assert np.isnan(plan[4]).all()
    np.testing.assert_array_equal(FLAT.plan_m(LOCAL_M), LOCAL_M[:, :2])


def test_level_axes():
    axes = WGS84.from_enu(POINT_M[None])[0]
    higher = np.array(TO_ECEF.transform(LON_DEG, LAT_DEG, HEIGHT_M + 1.0)) - POINT_M
    np.testing.assert_allclose(axes[:, 2], higher, rtol=0, atol=1e-8)
    np.testing.assert_allclose(axes, wj.enu_rotation(np.radians(LAT_DEG), np.radians(LON_DEG)), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(FLAT.from_enu(LOCAL_M), [np.eye(3)] * 2)

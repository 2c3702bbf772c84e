"""Flight.block: every measurement with its shot, every point with its role, what is known of it and nothing else."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.files.made_up import frames, scanner
from tests.oracles import ecef_from_ned, geodetic
from whiskjax.flights.flight import Measurements, Points

FLIGHTS = {"lines": scanner, "frames": frames}


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(request):
    return FLIGHTS[request.param]()


def test_all_rays_see_their_points(flight):
    """The points of these flights lie where they are seen, ties included."""
    block = flight.block()
    assert list(block.role) == ["control", "check", "tie", "control", "control"]
    assert len(block) == len(flight.measurements)
    seen = wj.project(flight.sensor, block.shot, flight.points.position_m[block.point])
    np.testing.assert_allclose(seen.pixel_px, block.pixel_px, rtol=0, atol=1e-5)
    # The made-up sigmas: 0.5 along lines or rows, 0.25 along samples or columns.
    np.testing.assert_array_equal(block.sigma_px, np.broadcast_to([0.25, 0.5], (len(block), 2)))


def test_rays_keep_the_keys_of_their_images(flight):
    block = flight.block()
    image = flight.measurements.image
    np.testing.assert_array_equal(block.key("image"), image)
    assert list(block.images) == [flight.images[i].name for i in image]
    for key, names in flight.sensor.key_names().items():
        assert [names[i] for i in block.key(key)] == [flight.images[i].key(key) for i in image]
    assert (block.key("time_s") is not None) == flight.is_line


def test_points_are_known_by_role(flight):
    """Coordinates somebody gave for a tie point are not taken; names and indices are those of the flight."""
    assert np.isfinite(flight.points.position_m).all()
    block = flight.block()
    known = block.role != "tie"
    np.testing.assert_array_equal(block.position_m[known], flight.points.position_m[known])
    assert np.isnan(block.position_m[~known]).all()
    assert list(block.points) == list(flight.points.names)
    assert block.point_label(2) == "point p2"


def test_covariance_is_that_of_east_north_up(flight):
    sigma = np.array([0.01, 0.02, 0.05])
    n = len(flight.points.names)
    points = dataclasses.replace(flight.points, sigma_enu_m=np.broadcast_to(sigma, (n, 3)))
    block = dataclasses.replace(flight, points=points).block()
    expected = np.broadcast_to(np.diag(sigma**2), (n, 3, 3))
    if flight.world.kind == "wgs84":
        lat, lon, _ = geodetic(points.position_m)
        # East, north and up as columns in north, east, down.
        axes = ecef_from_ned(lat, lon).as_matrix() @ np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
        expected = axes @ expected @ np.swapaxes(axes, 1, 2)
    known = block.role != "tie"
    np.testing.assert_allclose(block.covariance_m2[known], expected[known], rtol=0, atol=1e-12)


def test_a_point_that_nobody_sees_stays(flight):
    points = flight.points
    more = Points(
        ["unseen", *points.names],
        np.concatenate([[[np.nan] * 3], points.position_m]),
        np.concatenate([np.zeros((1, 3)), points.sigma_enu_m]),
        ["tie", *points.roles],
    )
    measured = dataclasses.replace(flight.measurements, point=flight.measurements.point + 1)
    block = dataclasses.replace(flight, points=more, measurements=measured).block()
    assert list(block.points) == ["unseen", *points.names]
    np.testing.assert_array_equal(block.point, measured.point)
    assert 0 not in block.point


def test_a_flight_without_measurements_is_no_block(flight):
    none = Measurements(*(np.zeros(0, dtype) for dtype in (int, int, float, float, float, float)))
    with pytest.raises(wj.WhiskjaxError, match="no rays"):
        dataclasses.replace(flight, measurements=none).block()

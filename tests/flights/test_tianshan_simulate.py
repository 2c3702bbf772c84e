"""The looks of `tianshan` as a flight: the same answer as with its records, in memory and on disk."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.flights import tianshan

LOOKS = 12


@pytest.fixture(scope="module", params=["orbit", "race", "fly"])
def pair(request, tmp_path_factory):
    """A scene, its flight, and what was read back."""
    scene = tianshan.Scene(path=request.param, looks=LOOKS)
    flight = tianshan.simulate(4, scene)
    return scene, flight, wj.read_flight(wj.write_flight(flight, tmp_path_factory.mktemp("tianshan") / "flight"))


def located(sensor, looks, noise):
    return wj.locate(sensor, looks, surface=wj.HeightSurface(1000.0), sigma_enu_m=np.full(3, 1500.0), errors=noise)


def test_is_the_run_of_its_key(pair):
    """Records and readings aligned with the looks are what trajectory and encoders give at their samples."""
    scene, flight, back = pair
    recorded, pixel = tianshan.draw(jax.random.key(4), scene)
    aligned = wj.Looks(wj.Shot(time_s=tianshan.time_s(scene)), pixel, np.full(2, 2.0))
    expected = located(tianshan.sensor(recorded), aligned, tianshan.frame_errors())
    # 1e-9 m of ECEF rounding in each recorded position, spread by the weak geometry of 12 looks.
    for f, limit_m in ((flight, 1e-7), (back, 1e-6)):
        found = located(f.sensor, f.looks([0])[0], f.errors)
        np.testing.assert_allclose(found.point_m, expected.point_m, rtol=0, atol=limit_m)
        np.testing.assert_allclose(found.covariance_enu_m2, expected.covariance_enu_m2, rtol=1e-9)


def test_without_errors_the_target_is_in_the_principal_point(pair):
    """The geometry of the scene, apart from its noise: the true records see the target at (0, 0)."""
    scene, flight, _ = pair
    true = tianshan.sensor(tianshan.true_records(scene))
    seen = wj.project(true, wj.Shot(time_s=tianshan.time_s(scene)), flight.points.position_m[0]).pixel_px
    np.testing.assert_allclose(seen, 0.0, rtol=0, atol=1e-5)


def test_one_check_point_seen_in_every_image(pair):
    scene, flight, _ = pair
    assert list(flight.points.names) == ["target"] and list(flight.points.roles) == ["check"]
    assert [image.time_s for image in flight.images] == tianshan.time_s(scene).tolist()
    looks, index = flight.looks([0])
    np.testing.assert_array_equal(index, np.arange(LOOKS))
    assert len(looks) == LOOKS


def test_looks_are_sorted_by_time(pair):
    _, flight, _ = pair
    m, order = flight.measurements, np.random.default_rng(0).permutation(LOOKS)
    mixed = type(m)(**{name: values[order] for name, values in vars(m).items()})
    looks, index = type(flight)(**{**vars(flight), "measurements": mixed}).looks([0])
    straight, _ = flight.looks([0])
    np.testing.assert_array_equal(order[index], np.arange(LOOKS))
    np.testing.assert_array_equal(looks.pixel_px, straight.pixel_px)
    np.testing.assert_array_equal(looks.shot.time_s, straight.shot.time_s)

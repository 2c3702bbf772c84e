"""Location on real flights: the issue's bands, and forward intersection as the oracle."""

import numpy as np
import pytest

import whiskjax as wj
from tests.real import convert_ign_frame as ign
from tests.real import reach_location
from tests.real.sets import data_folder, missing


@pytest.fixture(scope="module")
def reached(tmp_path_factory):
    for name in ("misb_uas", "ign_frame"):
        if why := missing(data_folder() / name):
            pytest.skip(why)
    return reach_location.reach(data_folder(), tmp_path_factory.mktemp("location"))


def test_figures(reached):
    assert len(reached.figures) == 5
    assert not [f"{f.what}: {f.reached:g} {f.unit}, asked {f.asked_text}" for f in reached.figures if not f.is_met]


def test_a_look_beyond_the_record_is_left_out_and_said(reached):
    """With the delays calibrated the last packet's attitude would have been recorded after the end."""
    said = [note for note in reached.notes if "196 to 243, calibrated" in note]
    assert any("1 of 48 looks were left out" in note for note in said), said


def test_a_surveyed_point_is_where_its_rays_intersect(source_of, tmp_path):
    """The same rays by least squares without any prior, started where they come closest."""
    ign.convert(source_of("ign_frame"), tmp_path / "ign")
    flight = wj.read_flight(tmp_path / "ign")
    found, _ = reach_location.locate_surveyed(flight, "batch")
    looks, _ = flight.looks([list(flight.points.names).index(reach_location.SURVEYED)])
    index = np.zeros(len(looks), dtype=int)
    rays = wj.intersect(flight.sensor, looks.shot, looks.pixel_px, index, np.broadcast_to(looks.sigma_px, (len(looks), 2)))
    np.testing.assert_allclose(found.point_m, rays.point_m[0], rtol=0, atol=1e-4)
    np.testing.assert_allclose(
        found.world_from_enu @ found.covariance_enu_m2 @ found.world_from_enu.T, rays.covariance_m2[0], rtol=0, atol=1e-7
    )

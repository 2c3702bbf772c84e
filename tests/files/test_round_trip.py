"""What is written is read back: the same numbers, the same images, the same unknowns."""

import dataclasses

import equinox as eqx
import jax
import numpy as np
import pytest

import whiskjax as wj
from tests.files import made_up
from whiskjax.earth.refraction import Refraction

# ECEF coordinates and degrees both round to 1e-9 m: a few of those, seen from 3000 m with 10,000 px focal length, are 2e-8 px.
# What is local is written exactly, but for angles in flight.toml, one rounding of float64.
TOLERANCE_PX = {"haian": 3e-8, "scanner": 3e-8, "frames": 1e-9}


@pytest.fixture(scope="module", params=list(TOLERANCE_PX))
def pair(request, haian, written):
    """A flight, what was read back, and its name."""
    flight = {"haian": lambda: haian, "scanner": made_up.scanner, "frames": made_up.frames}[request.param]()
    return flight, wj.read_flight(written[request.param]), request.param


def images_of(flight):
    """The pixels of all measured points, image by image: cameras that differ in kind cannot share a batch."""
    m, out = flight.measurements, np.full((len(flight.measurements), 2), np.nan)
    most = np.bincount(m.image).max()
    for i in np.unique(m.image):
        index = np.flatnonzero(m.image == i)
        padded = np.resize(index, most)
        keys = {k: flight.key_index(flight.images[i], k) for k in ("swing", "view")}
        shot = dataclasses.replace(flight.shot(m.image[padded], m.line_px[padded]), **keys)
        pixel = wj.project(flight.sensor, shot, flight.points.position_m[m.point[padded]]).pixel_px
        out[index] = pixel[: len(index)]
    return out


def test_images_are_identical(pair):
    flight, back, name = pair
    assert np.abs(images_of(back) - images_of(flight)).max() < TOLERANCE_PX[name]


def test_sensor_keeps_its_structure(pair):
    """Static fields too: structural zeros, orders, signs, gaps; and every number, to rounding."""
    flight, back, _ = pair
    assert jax.tree.structure(flight.sensor) == jax.tree.structure(back.sensor)
    for a, b in zip(jax.tree.leaves(flight.sensor), jax.tree.leaves(back.sensor), strict=True):
        np.testing.assert_allclose(b, a, rtol=2e-15, atol=5e-9)


def test_the_rest_is_equal(pair):
    flight, back, name = pair
    for field in ("name", "world", "epoch", "reference_point", "notes"):
        assert getattr(back, field) == getattr(flight, field)
    assert list(back.unknowns) == list(flight.unknowns)
    assert tuple(back.errors) == tuple(flight.errors)
    for a, b in zip(flight.errors, back.errors, strict=True):
        # What is zero stays structural, and costs nothing.
        assert jax.tree.structure(a) == jax.tree.structure(b)
        assert jax.tree.leaves(a) == jax.tree.leaves(b)
    assert list(back.points.names) == list(flight.points.names)
    assert list(back.points.roles) == list(flight.points.roles)
    np.testing.assert_allclose(back.points.position_m, flight.points.position_m, rtol=0, atol=0 if name == "frames" else 6e-9)
    np.testing.assert_array_equal(back.points.sigma_enu_m, flight.points.sigma_enu_m)
    for field in dataclasses.fields(flight.measurements):
        np.testing.assert_array_equal(getattr(back.measurements, field.name), getattr(flight.measurements, field.name))
    for a, b in zip(flight.images, back.images, strict=True):
        assert dataclasses.replace(a, lines=None) == dataclasses.replace(b, lines=None)
        if a.lines is not None:
            np.testing.assert_array_equal(a.lines.line, b.lines.line)
            np.testing.assert_array_equal(a.lines.time_s, b.lines.time_s)


def test_refraction_is_written_and_read_back(haian, tmp_path):
    bent = eqx.tree_at(lambda s: s.refraction, haian.sensor, Refraction(1.02, 0.65), is_leaf=lambda x: x is None)
    flight = dataclasses.replace(haian, sensor=bent)
    back = wj.read_flight(wj.write_flight(flight, tmp_path / "bent"))
    assert float(back.sensor["refraction"].scale) == 1.02 and back.sensor["refraction"].wavelength_um == 0.65
    assert np.abs(images_of(back) - images_of(flight)).max() < TOLERANCE_PX["haian"]
    # 2200 m up and 50 deg off nadir the ray is bent by a sixth of a pixel of 93 urad.
    assert 0.1 < np.abs(images_of(flight) - images_of(haian)).max() < 0.5


def test_an_empty_table_is_the_standard_and_none_is_straight(copy_of):
    folder = copy_of("haian")
    assert wj.read_flight(folder.path).sensor.refraction is None
    refraction = wj.read_flight(folder.toml("[pos]", "[refraction]\n\n[pos]").path).sensor["refraction"]
    assert float(refraction.scale) == 1.0 and refraction.wavelength_um == 0.55


def test_a_local_world_has_no_refraction(copy_of, tmp_path):
    copy_of("frames").toml("[pos]", "[refraction]\n\n[pos]").refused("flight.toml: refraction", "a local world does not have")
    frames = made_up.frames()
    bent = eqx.tree_at(lambda s: s.refraction, frames.sensor, Refraction(), is_leaf=lambda x: x is None)
    with pytest.raises(wj.FlightError, match="a local world does not have"):
        wj.write_flight(dataclasses.replace(frames, sensor=bent), tmp_path / "bent")

"""What is written is read back: the same numbers, the same images, the same unknowns."""

import dataclasses

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests.files import made_up

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

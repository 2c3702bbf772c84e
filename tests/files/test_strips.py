"""Strips and views of a block: numbered as the page says, and refused by name."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.files import made_up
from whiskjax.flights import songshan


def named(flight, **keys):
    """The flight with other keys of its images: one list of names for each key."""
    images = [
        dataclasses.replace(image, **{key: names[i] for key, names in keys.items()}) for i, image in enumerate(flight.images)
    ]
    return dataclasses.replace(flight, images=images)


@pytest.fixture(scope="module")
def strips():
    """A block of two strips, its tie points few."""
    return songshan.simulate(songshan.Scene("B", ties=20, pos_hz=20.0), 1)


def test_rays_carry_strips_where_no_link_asks(strips):
    assert "strip" not in strips.sensor.key_names()
    block = strips.block()
    assert list(strips.strips) == ["east", "west"]
    of_image = [strips.images[i].strip for i in strips.measurements.image]
    assert [strips.strips[i] for i in block.key("strip")] == of_image
    np.testing.assert_array_equal(
        block.key("strip"), songshan.simulate_block(songshan.Scene("B", ties=20, pos_hz=20.0), 1).block.key("strip")
    )


def test_numbers_follow_the_images(strips):
    """The first name that appears is 0, whatever it is called."""
    other = named(strips, strip=["z", "z", "a", "a", "a", "z"])
    assert list(other.strips) == ["z", "a"]
    np.testing.assert_array_equal(other.block().key("strip"), np.array([0, 0, 1, 1, 1, 0])[other.measurements.image])


def test_strips_of_some_images_are_no_strips():
    flight = made_up.scanner()
    assert set(flight.block().key("strip")) == {0}
    some = named(flight, strip=["1", None])
    assert some.block().key("strip") is None and list(some.strips) == []


def test_strips_that_links_ask_for_keep_their_numbers():
    flight = songshan.simulate(songshan.Scene("B", ties=20, pos_hz=20.0, drift=True), 1)
    assert list(flight.strips) == list(flight.sensor.key_names()["strip"])
    back = named(flight, strip=["west"] * 3 + ["east"] * 3)
    np.testing.assert_array_equal(back.block().key("strip"), 1 - flight.block().key("strip"))


@pytest.mark.parametrize("key", ["view", "strip"])
def test_a_name_that_the_sensor_lacks(key):
    flight = songshan.simulate(songshan.Scene("B", ties=20, pos_hz=20.0, drift=True), 1)
    names = [image.key(key) for image in flight.images]
    for wrong in ("sideways", None):
        with pytest.raises(wj.FlightError) as caught:
            named(flight, **{key: [*names[:4], wrong, names[5]]}).block()
        message = str(caught.value)
        assert "image west-nadir" in message and key in message and names[0] in message
        assert wrong is None or "'sideways'" in message

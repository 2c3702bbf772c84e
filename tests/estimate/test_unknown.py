"""One number to be estimated: its place in degrees or in radians, and what cannot be meant."""

import dataclasses
import math

import pytest

import whiskjax as wj


@pytest.mark.parametrize("where", ["sensor.angles_{}[0]", "platform.left.angles_{}[2]", "scan.zero_{}"])
def test_a_place_in_degrees_has_its_numbers_in_degrees(where):
    """The form of flight.toml and of results, numbers included, is the same unknown as the form in radians."""
    shown = wj.Unknown("x", where.format("deg"), 2.7, 0.03)
    inside = wj.Unknown("x", where.format("rad"), math.radians(2.7), math.radians(0.03))
    assert shown == inside
    assert wj.Unknown("x", where.format("deg"), scale=0.5) == wj.Unknown("x", where.format("rad"), scale=math.radians(0.5))
    assert [place.text for place in inside.places] == [where.format("deg")]
    assert dataclasses.replace(shown, sigma=0.1).mean == inside.mean  # turned into radians once only


def test_several_places_are_written_alike():
    both = wj.Unknown("x", ("a.zero_deg", "b.zero_deg"), scale=90.0)
    assert both == wj.Unknown("x", ("a.zero_rad", "b.zero_rad"), scale=math.pi / 2)
    with pytest.raises(wj.WhiskjaxError, match="write all in degrees, or all in radians"):
        wj.Unknown("x", ("a.zero_deg", "b.zero_rad"), scale=1.0)


@pytest.mark.parametrize(
    "given, message",
    [
        ({"name": 5}, "Unknown: name is a int, but str is expected"),
        ({"where": 5}, "Unknown x: where is a int"),
        ({"where": ()}, "where is empty"),
        ({"where": (5,)}, "5 is no place in a sensor"),
        ({"mean": "0", "sigma": 1.0}, "Unknown x: mean has dtype"),
        ({"mean": 0.0, "sigma": [1.0, 2.0]}, r"Unknown x: sigma has shape \(2,\)"),
        ({"scale": 1j}, "Unknown x: scale has dtype complex"),
        ({"mean": 90.0, "sigma": 0.1}, "Unknown x: mean is 90, beyond .*radians are expected, not degrees"),
    ],
)
def test_what_is_no_unknown_is_refused(given, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.Unknown(**({"name": "x", "where": "sensor.angles_rad[0]"} | given))


def test_a_list_of_unknowns_is_a_list_of_unknowns():
    sensor = wj.Sensor({"body": wj.Mount()}, wj.FrameCamera(1000.0, (0.0, 0.0)))
    one = wj.Unknown("x", "body.lever_arm_m[0]", scale=1.0)
    for wrong, message in (
        (one, r"unknowns is one Unknown.*\[x\]"),
        (["x"], r"unknowns\[0\] is a str"),
        (5, "unknowns is a int"),
    ):
        with pytest.raises(wj.WhiskjaxError, match=f"assign: {message}"):
            wj.assign(sensor, wrong, [0.0])

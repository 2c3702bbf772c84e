"""[[error]] in flight.toml: what is wrong is named by file and key, and what is left out means what the page says."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.files import made_up

NAMED = "error[2] (frame 'wave')"
# What stands in the made-up scanner's third statement, what takes its place, and what the message must hold.
WRONG = {
    "frame": ('frame = "wave"', 'frame = "wafe"', ("error[2].frame", "'wafe'", "did you mean 'wave'", "body, drift, wave")),
    "no frame": ('frame = "wave"', "", ("error[2].frame: this key is missing",)),
    "odd key": (
        'frame = "wave"',
        'frame = "wave"\nturn_sigmas_deg = 1',
        (f"{NAMED}.turn_sigmas_deg: no such key", "'turn_sigma_deg'", "anew"),
    ),
    "two sigmas": (
        "shift_sigma_m = [0.05, 0.05, 0.08]",
        "shift_sigma_m = [0.05, 0.05]",
        (f"{NAMED}.shift_sigma_m: a list of 3", "[0.05, 0.05]"),
    ),
    "negative": ("[0.05, 0.05, 0.08]", "[0.05, -0.05, 0.08]", (f"{NAMED}.shift_sigma_m[1]", "greater than or equal to 0")),
    "no number": ("[0.05, 0.05, 0.08]", "[0.05, nan, 0.08]", (f"{NAMED}.shift_sigma_m[1]", "not nan")),
    "negative time": ("[60.0, 60.0, ", "[60.0, -1.0, ", (f"{NAMED}.correlation_s[1]", "greater than or equal to 0")),
    "three times": ("120.0, 0.0, 0.0, 0.0]", "120.0]", (f"{NAMED}.correlation_s", "a list of 6")),
    "no sigma": (
        "turn_sigma_deg = [0.005, 0.0, 0.01]\nshift_sigma_m = [0.05, 0.05, 0.08]",
        "",
        (NAMED, "turn_sigma_deg, shift_sigma_m or both"),
    ),
    "text": ("[60.0, 60.0, 120.0, 0.0, 0.0, 0.0]", '"slow"', (f"{NAMED}.correlation_s", "'slow'")),
    "a key that no shot has": ('anew = "strip"', 'anew = "leg"', (f"{NAMED}.anew", "'strip'")),
    "axes": ('anew = "strip"', 'axes = "enu"', (f"{NAMED}.axes", "'frame' or 'level'")),
    "a sigma that weighs nothing": ("[0.05, 0.05, 0.08]", "[0.05, 1e-30, 0.08]", (NAMED, "the sigma of shift y is 1e-30")),
}


@pytest.mark.parametrize("case", WRONG)
def test_one_wrong_key(copy_of, case):
    old, new, parts = WRONG[case]
    # The chain also says frame = "...", so the edit is made behind the tables' headings.
    folder = copy_of("scanner")
    head, *tables = (folder.path / "flight.toml").read_text().split("[[error]]")
    assert old in tables[2]
    tables[2] = tables[2].replace(old, new, 1)
    (folder.path / "flight.toml").write_text("[[error]]".join([head, *tables]))
    folder.refused("flight.toml: ", *parts)


def test_what_is_left_out(copy_of):
    """White, anew for the flight as a whole, in the frame's own axes; sigmas of zero are structural."""
    folder = copy_of("scanner")
    white, constant, wandering = wj.read_flight(folder.path).errors
    assert white.is_white and (white.anew, white.axes) == ("flight", "frame") and white.acting == (0, 2, 3, 4)
    assert constant.memory == ("constant",) * 6 and constant.axes == "level"
    np.testing.assert_allclose(wandering.sigma, [*np.radians([0.005, 0.0, 0.01]), 0.05, 0.05, 0.08], rtol=1e-15)
    assert [float(t) for t in wandering.correlation_s] == [60.0, 60.0, 120.0, 0.0, 0.0, 0.0]


def test_free_poses_are_written(copy_of):
    folder = copy_of("frames")
    text = (folder.path / "flight.toml").read_text()
    assert "shift_sigma_m = [inf, inf, inf]" in text and 'anew = "image"' in text
    assert any(all(one.free) for one in wj.read_flight(folder.path).errors)


def test_no_errors(copy_of):
    folder = copy_of("scanner")
    head, *tables = (folder.path / "flight.toml").read_text().split("[[error]]")
    rest = tables[-1][tables[-1].find("\n[") + 1 :] if "\n[" in tables[-1] else ""
    (folder.path / "flight.toml").write_text(head + rest)
    assert wj.read_flight(folder.path).errors == ()


def test_a_frame_that_the_sensor_lacks_is_not_written(tmp_path):
    flight = made_up.scanner()
    wrong = [*flight.errors, wj.FrameErrors("nowhere", shift_sigma_m=(1.0, 1.0, 1.0))]
    with pytest.raises(wj.FlightError, match="no frame named 'nowhere'"):
        wj.write_flight(dataclasses.replace(flight, errors=wrong), tmp_path / "f")
    assert not list(tmp_path.iterdir())

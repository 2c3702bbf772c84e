"""[pos_errors] in flight.toml: what is wrong is named by file and key, and what is left out means what the page says."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.files import made_up

# What stands in the made-up scanner's file, what takes its place, and what the message must hold.
WRONG = {
    "link": ('link = "wave"', 'link = "wafe"', ("pos_errors.link", "'wafe'", "did you mean 'wave'", "body, drift, wave")),
    "a mount": ('link = "wave"', 'link = "arm"', ("pos_errors", "arm is a Mount", "Correction")),
    "no link": ('link = "wave"', "", ("pos_errors.link: this key is missing",)),
    "odd key": (
        'link = "wave"',
        'link = "wave"\nturn_sigmas_deg = 1',
        ("pos_errors.turn_sigmas_deg: no such key", "'turn_sigma_deg'", "observed"),
    ),
    "two sigmas": (
        "shift_sigma_m = [0.05, 0.05, 0.08]",
        "shift_sigma_m = [0.05, 0.05]",
        ("pos_errors.shift_sigma_m: a list of 3", "[0.05, 0.05]"),
    ),
    "negative": ("[0.05, 0.05, 0.08]", "[0.05, -0.05, 0.08]", ("pos_errors.shift_sigma_m[1]", "greater than or equal to 0")),
    "no time": ("[60.0, 60.0, 120.0]", "[60.0, 0.0, 120.0]", ("pos_errors.turn_correlation_s[1]", "greater than 0")),
    "no sigma": ("turn_sigma_deg = [0.005, 0.0, 0.01]", "", ("pos_errors.turn_sigma_deg: this key is missing",)),
    "all zero": (
        "turn_sigma_deg = [0.005, 0.0, 0.01]\nshift_sigma_m = [0.05, 0.05, 0.08]",
        "turn_sigma_deg = [0.0, 0.0, 0.0]\nshift_sigma_m = [0.0, 0.0, 0.0]",
        ("pos_errors", "all sigmas are zero", "leave pos_errors out"),
    ),
    "memory without nodes": ('link = "wave"', 'link = "bias"', ("pos_errors", "bias has no nodes in time")),
    "text": ("[60.0, 60.0, 120.0]", '"slow"', ("pos_errors.turn_correlation_s", "'slow'")),
}


@pytest.mark.parametrize("case", WRONG)
def test_one_wrong_key(copy_of, case):
    old, new, parts = WRONG[case]
    # The chain also says link = "...", so the edit is made behind the table's heading.
    folder = copy_of("scanner")
    head, table = (folder.path / "flight.toml").read_text().split("[pos_errors]")
    assert old in table
    (folder.path / "flight.toml").write_text(f"{head}[pos_errors]{table.replace(old, new, 1)}")
    folder.refused("flight.toml: ", *parts)


def test_what_is_left_out(copy_of):
    folder = copy_of("scanner")
    text = (folder.path / "flight.toml").read_text()
    errors = wj.read_flight(folder.path).pos_errors
    assert errors is not None and errors.observed and errors.shift_correlation_s is None
    np.testing.assert_allclose(errors.sigma, [*np.radians([0.005, 0.0, 0.01]), 0.05, 0.05, 0.08], rtol=1e-15)
    head, table = text.split("[pos_errors]")
    (folder.path / "flight.toml").write_text(head + table[table.find("\n[", 1) + 1 if "\n[" in table[1:] else len(table) :])
    assert wj.read_flight(folder.path).pos_errors is None


def test_a_link_that_the_sensor_lacks_is_not_written(tmp_path):
    flight = made_up.scanner()
    wrong = dataclasses.replace(flight.pos_errors, link="nowhere")
    with pytest.raises(wj.FlightError, match="no frame named 'nowhere'"):
        wj.write_flight(dataclasses.replace(flight, pos_errors=wrong), tmp_path / "f")
    assert not list(tmp_path.iterdir())

"""Recordings that contradict themselves: refused by line and column where nobody can have flown them, else noted."""

import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from whiskjax.files import cautions
from whiskjax.files.navigation import Samples
from whiskjax.files.tables import Table

ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")


def place(folder, line):
    """ECEF position of one record."""
    lat, lon, height = (float(folder.cell("pos.csv", line, name)) for name in ("lat_deg", "lon_deg", "height_m"))
    return oracles.ecef(np.radians(lat), np.radians(lon), height)


def test_a_record_of_zeros(folder):
    for name in ("lat_deg", "lon_deg", "height_m", *ATTITUDE):
        folder.cell("pos.csv", 300, name, "0")
    folder.refused("pos.csv, line 300, column lat_deg, lon_deg: both are exactly 0, while line 2 has 32.", "taken out")


def test_a_record_far_away(folder):
    away = folder.cell("pos.csv", 300, "lat_deg", "0").cell("pos.csv", 300, "lon_deg", "1e-9")
    distance = [f"{np.linalg.norm(place(away, 300) - place(away, line)) / 1e3:,.0f} km from line {line}" for line in (299, 301)]
    folder.refused("pos.csv, line 300, column lat_deg, lon_deg: 0, 1e-9: line 300 lies", *distance, "0.005 s before it")


CELLS = {
    "height -9999": ("height_m", "-9999", ("column height_m: '-9999' lies outside -5000 to 1e+08", "metres above the ellipsoid")),
    "height 0": ("height_m", "0", ("column height_m: 0: line 300 lies 30", "m from line 299", "and 30", "m from line 301")),
    "height in feet": ("height_m", "9842.5", ("column height_m: 9842.5: line 300 lies 68", "no platform can fly")),
    "latitude mistyped": ("lat_deg", "32.51", ("column lat_deg: 32.51: line 300 lies 1116 m from line 299",)),
    "heading 0": ("heading_deg", "0", ("column heading_deg: 0: line 300 is turned by", "against line 299")),
    "pitch -90.3": ("pitch_deg", "-90.3", ("column pitch_deg: -90.3: line 300 is turned by",)),
}


@pytest.mark.parametrize("case", CELLS)
def test_one_wrong_cell(folder, case):
    column, value, parts = CELLS[case]
    folder.cell("pos.csv", 300, column, value).refused(f"pos.csv, line 300, {parts[0]}", *parts[1:])


def test_records_before_the_first_fix(folder):
    rows = folder.rows("pos.csv")
    for row in rows[1:40]:
        row[3] = "-100"
    folder.store("pos.csv", rows).refused(
        "pos.csv, line 41, column height_m: 30", "line 41 lies 31", "m from line 40, 0.005 s before"
    )


def with_velocities(folder, made):
    """The haian POS with velocities, by differences of its own positions, then made into something else."""
    rows = folder.rows("pos.csv")
    table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    time, lat, lon, height = table[:, 0], *np.radians(table[:, 1:3].T), table[:, 3]
    rate = np.gradient(oracles.ecef(lat, lon, height), time, axis=0)
    velocity = made(oracles.ecef_from_ned(lat, lon).inv().apply(rate))
    names = ["vn_mps", "ve_mps", "vd_mps"]
    cells = [[*row, *map(repr, v)] for row, v in zip(rows[1:], velocity.tolist(), strict=True)]
    return folder.store("pos.csv", [[*rows[0], *names], *cells])


def test_velocities_of_the_positions_are_taken(folder):
    flight = wj.read_flight(with_velocities(folder, lambda v: v).path)
    assert flight.sensor["body"].velocity_mps is not None and "velocities" not in flight.notes


@pytest.mark.parametrize(
    "made, message",
    [
        (lambda v: v * 3.6, "they seem to be in km/h"),
        (lambda v: v[:, [1, 0, 2]], "those along east and north are exchanged"),
        (lambda v: v * [1, -1, 1], "along east it has the opposite sign"),
        (lambda v: 0 * v, "the velocities are 0 m/s"),
    ],
)
def test_velocities_that_are_not(folder, made, message):
    with_velocities(folder, made).refused("pos.csv, line ", "column vn_mps, ve_mps, vd_mps: ", message)


def test_positions_in_a_map_are_not_ecef(folder):
    rows = folder.rows("pos.csv")
    rows[0][1:4] = ["x_m", "y_m", "z_m"]
    for row in rows[1:]:
        row[1:4] = ["682345.1", "3597012.4", row[3]]
    folder.store("pos.csv", rows)
    folder.refused("pos.csv, line 2, column x_m, y_m, z_m", "km from the Earth's centre", "(3846 of 3846 lines)")


def test_points_at_zero(folder):
    for name in ("lat_deg", "lon_deg", "height_m"):
        folder.cell("points.csv", 5, name, "0")
    folder.refused("points.csv, line 5, column lat_deg, lon_deg: both are exactly 0, while line 2 has")


def test_a_code_among_angles(folder):
    folder.cell("encoders.csv", 9, "scan_deg", "-9999").refused(
        "encoders.csv, line 9, column scan_deg: -9999 lies far from all others", "leave the cell blank"
    )


# Odd, and said in the notes.


def note_of(folder):
    return wj.read_flight(folder.path).notes.split("\n")[-1]


def test_a_small_spike_is_noted_once(copy_of, tmp_path):
    folder = copy_of("haian")
    height = float(folder.cell("pos.csv", 300, "height_m"))
    folder.cell("pos.csv", 300, "height_m", str(height + 9.0))
    note = note_of(folder)
    assert note == "pos.csv, line 300: the position is 9 m beside the line between its neighbours, and back."
    again = wj.read_flight(wj.write_flight(wj.read_flight(folder.path), tmp_path / "again"))
    assert again.notes.count(note) == 1


def test_an_encoder_that_drops_out_is_noted(folder):
    before, after = (float(folder.cell("encoders.csv", line, "scan_deg")) for line in (8, 10))
    folder.cell("encoders.csv", 9, "scan_deg", "0")
    assert note_of(folder).startswith(f"encoders.csv, line 9: scan_deg is {abs(before + after) / 2:.3g} deg beside the line")


def pos(position_m, velocity_mps, **columns):
    """A POS table of 20 Hz in a local world, and its samples."""
    n = len(position_m)
    level = np.tile([0, 0, 0, 1.0], (n, 1))
    return Table("pos.csv", columns, range(2, n + 2)), np.arange(n) / 20, Samples(position_m, level, velocity_mps)


def test_navigation_that_has_not_settled_is_noted():
    """As the first 15 s of a real flight: positions creep at half the speed. What came after is right."""
    t = np.arange(2000) / 20
    speed = np.where(t < 15, 100.0, 200.0)
    position = np.stack([np.cumsum(speed) / 20, 0 * t, 2e4 + 0 * t], -1)
    (note,) = cautions.of_positions(*pos(position, np.tile([200.0, 0, 0], (2000, 1))), 1.0)
    assert note.startswith("pos.csv, line 2: over the next 10 s the velocities lead 1e+03 m away from the positions")
    assert cautions.of_positions(*pos(position[400:], np.tile([200.0, 0, 0], (1600, 1))), 1.0) == []


@pytest.mark.parametrize("heading, noted", [(90.0, False), (120.0, False), (270.0, True), (0.0, True), (-270.0, False)])
def test_a_platform_that_flies_where_it_does_not_head_is_noted(heading, noted):
    t = np.arange(2000) / 20
    position = np.stack([60 * t, 0 * t, 1000 + 0 * t], -1)
    found = cautions.of_positions(*pos(position, None, heading_deg=np.full(2000, heading)), 1.0)
    assert [("course is 90 deg and its heading" in note) for note in found] == [True] * noted


def test_a_pose_far_from_the_others_is_noted():
    position = np.random.default_rng(1).normal(0, 500, (9, 3)) + [4e6, 3e6, 4e6]
    table = Table("poses.csv", {}, range(2, 11))
    assert cautions.of_poses(table, position) == []
    position[4] *= 1.1
    (note,) = cautions.of_poses(table, position)
    assert note.startswith("poses.csv, line 6: this pose lies 640 km from the middle of the others")


def test_lines_that_take_a_thousand_times_as_long_are_noted():
    columns = {"line": np.array([0.0, 10, 20, 0, 10]), "time_s": np.array([-9999.0, 1, 2, 5, 6])}
    (note,) = cautions.of_lines(Table("lines.csv", columns, range(2, 7)), [[0, 1, 2], [3, 4]])
    assert note == "lines.csv, line 3, column time_s: a line before it takes 1e+03 s, of all others 0.1 s."


def test_a_rate_of_lines_that_leaps_within_an_image_is_noted():
    columns = {"line": np.array([0.0, 1000, 6000, 0, 10]), "time_s": np.array([0.0, 2.5, 2.6, 5, 5.01])}
    (note,) = cautions.of_lines(Table("lines.csv", columns, range(2, 7)), [[0, 1, 2], [3, 4]])
    assert note.startswith("lines.csv, line 4, column time_s: a line before it takes 2e-05 s, and 0.0025 s earlier in the same")


def test_lines_that_take_no_time_are_noted():
    columns = {"line": np.array([0.0, 6000]), "time_s": np.array([0.0, 0.0026])}
    (note,) = cautions.of_lines(Table("lines.csv", columns, range(2, 4)), [[0, 1]])
    assert note == "lines.csv, line 3, column time_s: a line takes 4.33e-07 s; are the times in seconds?"


def test_healthy_flights_have_no_notes(written):
    for name, folder in written.items():
        notes = wj.read_flight(folder).notes
        assert "beside" not in notes and "velocities" not in notes, f"{name}: {notes}"

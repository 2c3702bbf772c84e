"""Converters on other rows than those at hand: nothing is dropped uncounted, and every folder is one that can be read."""

import csv
import shutil

import numpy as np
import pytest

import whiskjax as wj
from tests.real import convert_clarreo, convert_ign_frame, convert_misb_uas, convert_rtk_drone


@pytest.fixture
def edited(source_of, tmp_path):
    """A function that copies a set and rewrites one of its tables; gives the copy's folder."""

    def edit(name, table, change):
        folder = tmp_path / "source"
        shutil.copytree(source_of(name), folder)
        with (folder / table).open(newline="") as file:
            rows = list(csv.DictReader(file))
        header, rows = list(rows[0]), change(rows)
        with (folder / table).open("w", newline="") as file:
            writer = csv.DictWriter(file, header)
            writer.writeheader()
            writer.writerows(rows)
        return folder

    return edit


def test_ties_without_partner_stay_in(edited, tmp_path):
    """Half the measurements, so that some points keep one ray; and one of a point that the set does not have."""
    source = edited("ign_frame", "tie_obs.csv", lambda rows: [*rows[::2], rows[0] | {"point": "nowhere"}])
    made = convert_ign_frame.convert(source, tmp_path / "flight")
    assert made.left_out == ("measurements of tie points whose image or point is not in the set: 1",)
    flight = wj.read_flight(made.folder)
    ties = np.asarray(flight.points.roles)[flight.measurements.point] == "control"
    with (source / "tie_obs.csv").open() as file:
        assert ties.sum() == sum(1 for _ in file) - 2


def test_packets_in_gaps_are_not_observations(edited, tmp_path):
    def change(rows):
        del rows[100:110]
        rows[20]["rel_az"] = ""
        rows[30]["time_us"] = rows[29]["time_us"]
        return rows

    source = edited("misb_uas", "truck.csv", change)
    made = convert_misb_uas.convert(source / "truck.csv", tmp_path / "flight")
    flight = wj.read_flight(made.folder)
    images, observed = len(flight.images), len(flight.measurements)
    assert "packets with blank cells: 1" in made.left_out
    assert "packets not later than the one before: 1" in made.left_out
    # Two packets at each end of the record and of the gap of 2.2 s lie within 0.3 s of where nothing was recorded.
    assert images - observed == 8
    assert any(text.endswith(": 8") for text in made.left_out)


def test_frames_and_looks_that_are_blank_are_counted(edited, tmp_path):
    def change(rows):
        rows = rows[1::2]
        rows[3]["az_rad"] = ""
        for row in rows[10:15]:
            row["ellipsoid_pix1_lat_deg"] = row["ellipsoid_pix1_lon_deg"] = ""
        return rows

    source = edited("clarreo_gimbal_pushbroom", "frames.csv", change)
    made = convert_clarreo.convert(source, tmp_path / "flight")
    frames, incomplete = convert_clarreo.usable(source)
    blank = sum(row[f"ellipsoid_pix{n}_lat_deg"] == "" for row in frames.cells for n in (1, 2, 3))
    assert incomplete == 1 and blank >= 5
    assert made.left_out == ("frames with blank telemetry: 1", f"looks that miss the ellipsoid (blank): {blank}")
    assert len(wj.read_flight(made.folder).measurements) == 3 * len(frames) - blank


def test_marks_in_images_without_course_are_counted(edited, tmp_path):
    """The first mark loses its image's course."""
    image = "29"

    def change(rows):
        return [row | ({"course_deg": ""} if row["image_no"] == image else {}) for row in rows]

    source = edited("rtk_drone_nadir", "cameras.csv", change)
    made = convert_rtk_drone.convert(source, tmp_path / "flight")
    with (source / "gcp_obs.csv").open(newline="") as file:
        marks = list(csv.DictReader(file))
    lost = sum(row["image_no"] == image for row in marks)
    assert lost > 0
    assert any(text.startswith("marks in such images") and text.endswith(f": {lost}") for text in made.left_out)
    flight = wj.read_flight(made.folder)
    assert len(flight.measurements) == len(marks) - lost
    assert made.left_out[0] in flight.notes

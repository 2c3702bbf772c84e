"""Converters on other rows than those at hand: nothing is dropped uncounted, and every folder is one that can be read."""

import csv
import shutil

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.real import convert_clarreo, convert_ign_frame, convert_misb_uas, convert_rtk_drone, convert_sxb_frame
from tests.real.sets import Rows


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


def test_ties_of_the_producer_can_be_ties(source_of, tmp_path):
    """As ties they have no coordinates, and their rays, with the given poses, meet as closely as those of control do."""
    source = source_of("ign_frame")
    made = convert_ign_frame.convert(source, tmp_path / "flight", tie_role="tie")
    flight = wj.read_flight(made.folder)
    assert np.isnan(flight.points.position_m[np.asarray(flight.points.roles) == "tie"]).all()
    block = flight.block()
    role, count = np.unique(block.role, return_counts=True)
    assert dict(zip(role, count, strict=True)) == {"check": 1, "tie": 1803}
    assert len(block) == len(Rows(source / "tie_obs.csv")) + len(Rows(source / "gcp_obs.csv"))
    ties = block.keep(block.role[block.point] == "tie")
    assert len(ties) == len(Rows(source / "tie_obs.csv"))
    # Ties come before the surveyed point, so that their indices have no hole.
    found = wj.intersect(flight.sensor, ties.shot, jnp.asarray(ties.pixel_px), ties.point, jnp.asarray(ties.sigma_px))
    column, row = np.sqrt((np.asarray(found.residual_px) ** 2).mean(axis=0))
    assert column < 0.147 and row < 0.174


def resected(source):
    """Poses (centre in metres, omega, phi, kappa in degrees) of each photo from its control points, residuals in pixels.

    Collinearity on the numbers as they stand in the set, from its coarse starts, by scipy.
    """
    surveyed, marks, photos = (Rows(source / f"{name}.csv") for name in ("gcp", "gcp_obs", "eo_start"))
    place = dict(zip(surveyed.texts("point"), surveyed.numbers("x", "y", "z"), strict=True))
    columns = ("xc", "yc", "zc", "omega_deg", "phi_deg", "kappa_deg")
    focal, principal = 123.9392 / 0.006, np.array([26.577, 38.811]) / 0.006
    size = np.array([100.0, 100, 100, 5, 5, 5])
    poses, residuals = [], []
    for image, start in zip(photos.texts("image"), photos.numbers(*columns), strict=True):
        seen = marks.among(image=[image])
        point, pixel = np.array([place[name] for name in seen.texts("point")]), seen.numbers("col", "row")

        def residual(u, start=start, point=point, pixel=pixel):
            pose = start + size * u
            x, y, z = ((point - pose[:3]) @ Rotation.from_euler("XYZ", pose[3:], degrees=True).as_matrix()).T
            return (pixel - principal - focal * np.stack([-x, y], axis=-1) / z[:, None]).ravel()

        solved = least_squares(residual, np.zeros(6), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert solved.success
        poses.append(start + size * solved.x)
        residuals.append(solved.fun.reshape(-1, 2))
    return dict(zip(columns, np.transpose(poses), strict=True)), residuals


def test_photos_resected_by_scipy_see_their_control_points(source_of, edited, tmp_path):
    """The folder with scipy's poses leaves scipy's residuals; 0.67 px over all photos, where marks are said to be good to 0.5."""
    poses, residuals = resected(source_of("sxb_frame"))
    assert all(len(r) > 3 for r in residuals)
    assert all(np.sqrt((r**2).mean()) < 0.9 for r in residuals)
    residuals = np.concatenate(residuals)
    assert np.sqrt((residuals**2).mean()) < 0.68

    def change(rows):
        return [row | {name: repr(float(column[i])) for name, column in poses.items()} for i, row in enumerate(rows)]

    made = convert_sxb_frame.convert(edited("sxb_frame", "eo_start.csv", change), tmp_path / "flight")
    flight = wj.read_flight(made.folder)
    observed = flight.observations()
    seen = wj.project(flight.sensor, observed.shot, observed.point_m)
    np.testing.assert_allclose(observed.pixel_px - np.asarray(seen.pixel_px), residuals, rtol=0, atol=1e-6)


def test_five_photos_are_a_block(source_of, tmp_path):
    source = source_of("sxb_frame")
    made = convert_sxb_frame.convert(source, tmp_path / "flight")
    assert made.left_out == ()
    block = wj.read_flight(made.folder).block()
    control, ties = np.flatnonzero(block.role == "control"), np.flatnonzero(block.role == "tie")
    assert (len(control), len(ties), len(block.role)) == (11, 365, 376)
    marks = Rows(source / "gcp_obs.csv")
    of_control = np.isin(block.point, control)
    assert (of_control.sum(), len(block)) == (len(marks), len(marks) + len(Rows(source / "tie_obs.csv")))
    # Corners of pixels in the set, centres inside.
    np.testing.assert_allclose(block.pixel_px[of_control], marks.numbers("col", "row") - 0.5, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(block.sigma_px, np.where(of_control, 0.5, 1.0)[:, None] * np.ones(2))
    assert list(np.asarray(block.images)[of_control]) == marks.texts("image")
    assert list(np.asarray(block.points)[block.point[of_control]]) == marks.texts("point")
    sigma = Rows(source / "gcp.csv").numbers("sx", "sy", "sz")
    np.testing.assert_allclose(block.covariance_m2[control], sigma[:, :, None] ** 2 * np.eye(3), rtol=0, atol=1e-15)
    # Every tie point has a partner.
    assert np.bincount(block.point)[ties].min() == 3


def test_measurements_of_photos_and_points_not_there_are_counted(edited, tmp_path):
    source = edited("sxb_frame", "gcp_obs.csv", lambda rows: [*rows, rows[0] | {"point": "nowhere"}])
    photos = source / "eo_start.csv"
    photos.write_text("\n".join(line for line in photos.read_text().splitlines() if not line.startswith("9111")) + "\n")
    lost = [sum(i == "9111" for i in Rows(source / f"{name}_obs.csv").texts("image")) for name in ("gcp", "tie")]
    made = convert_sxb_frame.convert(source, tmp_path / "flight")
    assert made.left_out == (
        f"measurements of control points whose image or point is not in the set: {lost[0] + 1}",
        f"measurements of tie points whose image is not in the set: {lost[1]}",
    )
    flight = wj.read_flight(made.folder)
    assert len(flight.block()) == 31 + 1149 - sum(lost)
    assert all(text in flight.notes for text in made.left_out)


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

"""Every form in which positions, attitudes and pixels may be written, against scipy and pyproj."""

import tempfile
from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import whiskjax as wj
from whiskjax.chain.samples import matrices_from_quaternions, quaternions_from_matrices
from whiskjax.earth.world import World
from whiskjax.files.navigation import Samples, navigation_columns, sample_texts, samples
from whiskjax.files.sheet import open_sheet
from whiskjax.files.tables import table_text

TO_ECEF = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
ENU_FROM_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
angle, turn = st.floats(-180, 180), st.floats(-360, 360)


def parsed(columns, world, angles):
    """What the columns of a table mean: positions, rotations, velocities."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pos.csv").write_text(table_text(columns))
        sheet = open_sheet(Path(folder), "pos.csv", "the test")
        found = samples(sheet.parse(navigation_columns(sheet, world, angles)), world, angles)
    return found.position_m, matrices_from_quaternions(found.quaternion), found.velocity_mps


def text(**columns):
    return {name: [repr(float(value))] for name, value in columns.items()}


def ecef_from_enu(lat, lon):
    return (Rotation.from_euler("z", 90 + lon, degrees=True) * Rotation.from_euler("x", 90 - lat, degrees=True)).as_matrix()


@given(st.floats(-90, 90), angle, st.floats(-400, 9000), turn, turn, turn)
def test_roll_pitch_heading(lat, lon, height, roll, pitch, heading):
    at = text(lat_deg=lat, lon_deg=lon, height_m=height, roll_deg=roll, pitch_deg=pitch, heading_deg=heading)
    position, rotation, _ = parsed(at, "wgs84", "roll_pitch_heading")
    np.testing.assert_allclose(position[0], TO_ECEF.transform(lon, lat, height), rtol=0, atol=5e-9)
    ned_from_body = Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True).as_matrix()
    np.testing.assert_allclose(rotation[0], ecef_from_enu(lat, lon) @ ENU_FROM_NED.T @ ned_from_body, rtol=0, atol=3e-15)
    local = text(x_m=1, y_m=2, z_m=3, roll_deg=roll, pitch_deg=pitch, heading_deg=heading)
    position, rotation, _ = parsed(local, "local", "roll_pitch_heading")
    np.testing.assert_allclose(position[0], [1, 2, 3])
    np.testing.assert_allclose(rotation[0], ENU_FROM_NED @ ned_from_body, rtol=0, atol=3e-15)


@given(st.floats(-89.9, 89.9), angle, turn, turn, turn, st.floats(-5, 5))
def test_opk(lat, lon, omega, phi, kappa, convergence):
    """Omega, phi, kappa turn the camera in the grid of a map, whose north is `convergence` off the true one."""
    opk = {"omega_deg": omega, "phi_deg": phi, "kappa_deg": kappa}
    grid_from_camera = Rotation.from_euler("XYZ", [omega, phi, kappa], degrees=True).as_matrix()
    _, rotation, _ = parsed(text(x_m=0, y_m=0, z_m=0, **opk), "local", "opk")
    np.testing.assert_allclose(rotation[0], grid_from_camera, rtol=0, atol=3e-15)
    at = text(lat_deg=lat, lon_deg=lon, height_m=10, **opk)
    _, rotation, _ = parsed(at, "wgs84", "opk")
    np.testing.assert_allclose(rotation[0], ecef_from_enu(lat, lon) @ grid_from_camera, rtol=0, atol=3e-15)
    _, rotation, _ = parsed(at | text(convergence_deg=convergence), "wgs84", "opk")
    c, s = np.cos(np.radians(convergence)), np.sin(np.radians(convergence))
    enu_from_grid = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(rotation[0], ecef_from_enu(lat, lon) @ enu_from_grid @ grid_from_camera, rtol=0, atol=3e-15)


def test_grid_north_lies_where_the_convergence_says():
    """A camera whose y axis points to grid north: its azimuth is the convergence, as pyproj gives it for Lambert-93."""
    lon, lat = 4.653190, 43.760495
    lambert = pyproj.Proj("EPSG:2154")
    convergence = lambert.get_factors(lon, lat).meridian_convergence
    x, y = lambert(lon, lat)
    north = lambert(x, y + 10, inverse=True)
    azimuth, _, _ = pyproj.Geod(ellps="GRS80").inv(lon, lat, *north)
    at = text(lat_deg=lat, lon_deg=lon, height_m=0, omega_deg=0, phi_deg=0, kappa_deg=0, convergence_deg=convergence)
    _, rotation, _ = parsed(at, "wgs84", "opk")
    enu = ecef_from_enu(lat, lon).T @ rotation[0] @ [0, 1, 0]
    assert np.degrees(np.arctan2(enu[0], enu[1])) == pytest.approx(azimuth, abs=1e-4)


@given(st.floats(-90, 90), angle, st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_velocities(lat, lon, v):
    at = text(lat_deg=lat, lon_deg=lon, height_m=10, roll_deg=1, pitch_deg=2, heading_deg=3)
    _, _, velocity = parsed(at | text(vn_mps=v[0], ve_mps=v[1], vd_mps=v[2]), "wgs84", "roll_pitch_heading")
    np.testing.assert_allclose(velocity[0], ecef_from_enu(lat, lon) @ [v[1], v[0], -v[2]], rtol=0, atol=3e-15)
    _, _, velocity = parsed(at | text(vx_mps=v[0], vy_mps=v[1], vz_mps=v[2]), "wgs84", "roll_pitch_heading")
    np.testing.assert_allclose(velocity[0], v)


pitches = st.sampled_from([-90.0, -89.9999999, -90.3, 0.0, 30.0, 90.0, 135.0, -200.0, 360.0])


@given(st.floats(-90, 90), angle, st.floats(-400, 9000), turn, pitches, turn)
def test_written_attitudes_are_read_back(lat, lon, height, roll, pitch, heading):
    """All over the Earth and at every attitude: straight up and down, past nadir, on the back."""
    position = np.array([TO_ECEF.transform(lon, lat, height)])
    rotation = (
        ecef_from_enu(lat, lon) @ ENU_FROM_NED.T @ Rotation.from_euler("ZYX", [heading, pitch, roll], degrees=True).as_matrix()
    )
    velocity = np.array([[3.0, -2.0, 60.0]])
    given_samples = Samples(position, quaternions_from_matrices(rotation[None]), velocity)
    back, turned, moving = parsed(dict(sample_texts(given_samples, World())), "wgs84", "roll_pitch_heading")
    np.testing.assert_allclose(back, position, rtol=0, atol=8e-9)
    np.testing.assert_allclose(turned[0], rotation, rtol=0, atol=1e-14)
    np.testing.assert_allclose(moving, velocity, rtol=0, atol=1e-11)
    back, turned, moving = parsed(dict(sample_texts(given_samples, World("local"))), "local", "quaternion")
    np.testing.assert_array_equal(back, position)
    np.testing.assert_allclose(turned[0], rotation, rtol=0, atol=2e-15)
    np.testing.assert_array_equal(moving, velocity)


def test_ecef_positions_with_angles(copy_of, haian):
    """x, y, z in a wgs84 world are ECEF, and roll, pitch, heading refer to the local level there."""
    folder = copy_of("haian")
    body = haian.sensor["body"]
    rows = folder.rows("pos.csv")
    position = np.stack([np.asarray(c) for c in body.position_m], axis=-1)
    cartesian = [[row[0], *map(repr, p.tolist()), *row[4:]] for row, p in zip(rows[1:], position, strict=True)]
    folder.store("pos.csv", [["time_s", "x_m", "y_m", "z_m", *rows[0][4:]], *cartesian])
    back = wj.read_flight(folder.path).sensor["body"]
    for a, b in zip((*body.position_m, *body.quaternion), (*back.position_m, *back.quaternion), strict=True):
        np.testing.assert_allclose(b, a, rtol=0, atol=3e-15 if abs(a[0]) <= 1 else 0)


@pytest.mark.parametrize("first", [0.5, 1.0])
def test_first_pixel_centre(copy_of, first):
    """Files that count from 1, or give the first pixel's corner 0, mean the same flight when every pixel number is shifted."""
    for name, edits in {
        "scanner": [("observations.csv", "line"), ("observations.csv", "sample"), ("lines.csv", "line"), ("looks.csv", "sample")],
        "frames": [("observations.csv", "line"), ("observations.csv", "sample")],
    }.items():
        folder = copy_of(name)
        before = wj.read_flight(folder.path)
        folder.toml("first_pixel_centre = 0.0", f"first_pixel_centre = {first}")
        for file, column in edits:
            rows = folder.rows(file)
            k = rows[0].index(column)
            folder.store(file, [rows[0], *([*r[:k], repr(float(r[k]) + first), *r[k + 1 :]] for r in rows[1:])])
        if name == "scanner":
            folder.toml("principal_sample_px = 512.5", f"principal_sample_px = {512.5 + first}")
            folder.toml("samples_px = [0.0, 1023.0]", f"samples_px = [{first}, {1023 + first}]")
            prior = f"prior_mean = {512.0 + first}\nprior_sigma = 2.0"
            folder.toml('where = "camera.fore.focal_px"\nscale = 2.0', f'where = "camera.fore.principal_sample_px"\n{prior}')
        else:
            for _ in range(2):
                folder.toml("[2000.25, 1500.5]", f"[{2000.25 + first}, {1500.5 + first} ]")
        after = wj.read_flight(folder.path)
        for field in ("line_px", "sample_px"):
            a, b = getattr(before.measurements, field), getattr(after.measurements, field)
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)
        for a, b in zip(before.images, after.images, strict=True):
            if a.lines is not None:
                np.testing.assert_allclose(b.lines.line, a.lines.line, rtol=0, atol=1e-12)
        if name == "scanner":
            assert after.unknowns[1].mean == 512.0
            cameras = [(f.sensor["camera"]["fore"], f.sensor["camera"]["aft look"]) for f in (before, after)]
            np.testing.assert_allclose(cameras[1][0].principal_sample_px, cameras[0][0].principal_sample_px)
            np.testing.assert_allclose(cameras[1][0].samples_px, cameras[0][0].samples_px)
            np.testing.assert_allclose(cameras[1][1].sample_px, cameras[0][1].sample_px, rtol=0, atol=1e-12)
        else:
            a, b = (f.sensor["camera"]["left"].principal_point_px for f in (before, after))
            np.testing.assert_allclose(b, a)


def test_accuracies_are_left_out_and_said_so(folder):
    folder.add_column("pos.csv", "sigma_n_m", "0.05").add_column("pos.csv", "sigma_e_m", "0.05")
    notes = wj.read_flight(folder.path).notes
    assert "pos.csv: sigma_n_m, sigma_e_m left out" in notes and "Simulated after Jin" in notes


def test_blank_encoder_cells(folder, haian):
    """A blank means that this encoder was not sampled then: two clocks in one file."""
    rows = folder.rows("encoders.csv")
    k = rows[0].index("pitch_deg")
    for i, row in enumerate(rows[1:]):
        row[k] = "" if i % 2 else row[k]
    folder.store("encoders.csv", rows).toml('encoder = "pitch"', 'encoder = "pitch"\nmax_gap_s = 0.03')
    flight = wj.read_flight(folder.path)
    kept = flight.sensor["pitch"].encoder
    whole = haian.sensor["pitch"].encoder
    np.testing.assert_array_equal(kept.knots.time_s, whole.knots.time_s[::2])
    np.testing.assert_allclose(kept.angle_rad, whole.angle_rad[::2], rtol=0, atol=1e-14)
    assert len(flight.sensor["scan"].encoder.angle_rad) == len(whole.angle_rad)


def test_numbers_that_share(folder):
    """One unknown in two places, in degrees, with the prior in degrees."""
    text = 'where = "platform.left.angles_deg[0]"'
    flight = wj.read_flight(
        folder.toml(text, 'where = ["platform.left.angles_deg[0]", "sensor.angles_deg[0]"]')
        .toml('where = "sensor.angles_deg[0]"', 'where = "scan.zero_deg"')
        .path
    )
    shared = next(u for u in flight.unknowns if not isinstance(u.where, str))
    assert shared.where == ("platform.left.angles_rad[0]", "sensor.angles_rad[0]")
    assert shared.sigma == pytest.approx(np.radians(5.0), rel=1e-15)
    folder.toml('"sensor.angles_deg[0]"]', '"sensor.lever_arm_m[0]"]').refused("share one number, but differ in unit")

"""SBET records, made by hand from the published layout."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles
from whiskjax.files.sbet import read_sbet


def record_bytes(rows):
    """17 little-endian doubles a record."""
    return np.asarray(rows, dtype="<f8").tobytes()


@pytest.fixture
def sbet(folder, haian):
    """The haian folder with its POS as an SBET file, the heading split into platform heading and wander angle."""
    rows = np.array([[float(cell) for cell in row] for row in folder.rows("pos.csv")[1:]])
    time, lat, lon, height, roll, pitch, heading = rows.T
    wander = np.linspace(-0.2, 0.3, len(rows))
    zero = np.zeros(len(rows))
    lat, lon, roll, pitch, heading = map(np.radians, (lat, lon, roll, pitch, heading))
    columns = [time, lat, lon, height, zero, zero, zero, roll, pitch, heading + wander, wander, *([zero] * 6)]
    records = np.stack(columns, axis=-1)
    (folder.path / "pos.csv").unlink()
    (folder.path / "flight.sbet").write_bytes(record_bytes(records))
    folder.toml("[pos]\n", '[pos]\nfile = "flight.sbet"\n')
    return folder, records


def test_the_same_trajectory(sbet, haian):
    folder, _ = sbet
    body, back = haian.sensor["body"], wj.read_flight(folder.path).sensor["body"]
    np.testing.assert_array_equal(back.knots.time_s, body.knots.time_s)
    np.testing.assert_allclose(np.array(back.position_m), np.array(body.position_m), rtol=0, atol=8e-9)
    np.testing.assert_allclose(np.array(back.quaternion), np.array(body.quaternion), rtol=0, atol=1e-15)


def test_a_pitch_beyond_nadir_and_a_roll_on_the_back(tmp_path):
    """Against scipy: every angle within a turn is a rotation."""
    angles = np.radians([[200.0, -90.3, 350.0], [-300.0, 180.0, -20.0], [10.0, 270.0, 200.0]])
    records = np.zeros((3, 17))
    records[:, 0], records[:, 1], records[:, 2] = [1.0, 2.0, 3.0], 0.5, 2.0
    records[:, 7:10] = angles
    (tmp_path / "a.sbet").write_bytes(record_bytes(records))
    found = read_sbet(tmp_path / "a.sbet")
    expected = oracles.ecef_from_ned(0.5, 2.0) * oracles.body_in_ned(*angles.T)
    assert (Rotation.from_quat(found.quaternion).inv() * expected).magnitude().max() < 1e-14


def test_a_record_of_zeros(sbet):
    folder, records = sbet
    here, there = oracles.ecef(*records[40, 1:4]), oracles.ecef(0.0, 0.0, 0.0)
    records[40, 1:10] = 0
    (folder.path / "flight.sbet").write_bytes(record_bytes(records))
    away = f"{np.linalg.norm(here - there) / 1e3:,.0f} km from record"
    folder.refused(f"flight.sbet, record 41, position: record 41 lies {away} 40, 0.005 s before it, and", f"{away[:-6]}record 42")


def test_a_height_that_is_a_code(sbet):
    folder, records = sbet
    records[40, 3] = -9999
    (folder.path / "flight.sbet").write_bytes(record_bytes(records))
    folder.refused("flight.sbet, record 41, height_m: -9999 is not possible")


def test_file_is_cut_off(sbet):
    folder, records = sbet
    (folder.path / "flight.sbet").write_bytes(record_bytes(records)[:-8])
    folder.refused("flight.sbet", "136 bytes")


def test_degrees_instead_of_radians(sbet):
    folder, records = sbet
    records[4, 1] = 32.5
    (folder.path / "flight.sbet").write_bytes(record_bytes(records))
    folder.refused("flight.sbet, record 5, lat_rad", "32.5", "radians")


def test_wrong_byte_order(sbet):
    folder, records = sbet
    (folder.path / "flight.sbet").write_bytes(records.astype(">f8").tobytes())
    folder.refused("flight.sbet, record 1", "little-endian")


def test_time_goes_back(sbet):
    folder, records = sbet
    records[7, 0] = records[5, 0]
    (folder.path / "flight.sbet").write_bytes(record_bytes(records))
    folder.refused("flight.sbet, record 8, time_s", "not later", "604800")


def test_missing(sbet):
    folder, _ = sbet
    (folder.path / "flight.sbet").unlink()
    folder.refused("flight.sbet does not exist", "[pos] file")

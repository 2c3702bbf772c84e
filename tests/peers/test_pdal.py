"""PDAL (ccf0ab70, BSD-3): the two SBET records of its test data, and what its SbetReaderTest prints of them.

Claim: a flight folder with that file has the positions and attitudes that PDAL prints, to the printed digits (5e-7 deg; PDAL's
own tolerance is 1e-4); true heading is platform heading less wander angle. The latitude of the first record is that of the bytes:
PDAL's test prints 32.545149, 7.5 m from the 32.545216 in the file.
"""

import functools
import shutil
import struct
import tempfile
from pathlib import Path

import numpy as np

import whiskjax as wj
from tests import oracles
from tests.peers.figures import Figure, assert_inside
from tests.real.sets import Rows, write_flight_folder

PEER = "PDAL"
FILE = "pdal_2-points.sbet"
TOML = f"""
format = 1
name = "two records"
epoch = "2012-01-01T00:00:00Z"
notes = NOTES
world = {{ kind = "wgs84", height_datum = "ellipsoidal" }}
pixel = {{ first_pixel_centre = 0.0 }}
pos = {{ file = "{FILE}", angles = "roll_pitch_heading", reference_point = "IMU", max_gap_s = 0.02 }}
chain = [ {{ frame = "body", link = "trajectory" }}, {{ frame = "optics", link = "axes", axes = "x -y -z" }} ]
camera = {{ kind = "frame", focal_px = 1000.0, principal_point_px = [0.0, 0.0] }}
"""


def read(folder: Path, scratch: Path) -> wj.Flight:
    """The file as a user reads it: in a flight folder, with one image of one point below."""
    expected = Rows(folder / "pdal_2-points_expected.csv")
    lat, lon = expected.numbers("lat_deg", "lon_deg")[1]
    tables = {
        "images.csv": {"image": ["a"], "time_s": expected.texts("time_s")[:1]},
        "points.csv": {"point": ["p"], "lat_deg": [lat], "lon_deg": [lon], "height_m": [0.0], "role": ["control"]},
        "observations.csv": {
            "image": ["a"],
            "point": ["p"],
            "line": [0.0],
            "sample": [0.0],
            "sigma_line_px": [1.0],
            "sigma_sample_px": [1.0],
        },
    }
    write_flight_folder(scratch, TOML, tables)
    shutil.copy(folder / FILE, scratch)
    return wj.read_flight(scratch)


@functools.cache
def poses(folder: Path):
    """Latitude, longitude, height and roll, pitch, heading of both records: ours and PDAL's, degrees and metres, (2, 6)."""
    expected = Rows(folder / "pdal_2-points_expected.csv")
    with tempfile.TemporaryDirectory() as scratch:
        flight = read(folder, Path(scratch))
    found = flight.sensor.pose(wj.Shot(time_s=expected.numbers("time_s")), "body")
    lat, lon, height = oracles.geodetic(found.origin_m)
    attitude = oracles.ecef_from_ned(lat, lon).inv().as_matrix() @ np.asarray(found.matrix)
    heading, pitch, roll = oracles.Rotation.from_matrix(attitude).as_euler("ZYX").T
    ours = np.stack([*np.degrees([lat, lon]), height, *np.degrees([roll, pitch, heading])], axis=-1)
    printed = expected.numbers("lat_deg", "lon_deg", "height_m", "roll_deg", "pitch_deg", "platform_heading_deg")
    printed[:, 5] -= expected.numbers("wander_deg")
    return ours, printed


def bytes_of_first_latitude(folder: Path) -> float:
    """The second double of the file, in degrees."""
    return float(np.degrees(struct.unpack_from("<d", (folder / FILE).read_bytes(), 8)[0]))


def figures(folder: Path) -> list[Figure]:
    """What is claimed."""
    ours, printed = poses(folder)
    off = np.abs(ours - printed)
    latitude = bytes_of_first_latitude(folder)
    six, digits = "PDAL prints six decimals", "PDAL prints all digits"
    return [
        Figure("longitudes of both records, latitude of the second", max(off[1, 0], *off[:, 1]), "deg", 5e-7, six),
        Figure("latitude of the first record, against the bytes", abs(ours[0, 0] - latitude), "deg", 1e-12, "rounding"),
        Figure("the same, against what PDAL's test prints", off[0, 0], "deg", 6.8e-5, "7.5 m inside PDAL's tolerance", 6.6e-5),
        Figure("heights", off[:, 2].max(), "m", 1e-8, digits),
        Figure("roll and pitch", off[:, 3:5].max(), "deg", 5e-7, six),
        Figure("heading, platform heading less wander", off[:, 5].max(), "deg", 1e-6, "two numbers of six decimals"),
    ]


def test_figures(peer_values):
    assert_inside(figures(peer_values))

"""GeoJSON and KML of located targets, parsed back with json and xml and measured with PROJ."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from pyproj import Geod
from scipy.stats import chi2

from tests.oracles import ecef
from whiskjax.files.located import LocatedTarget, error_ellipse, write_geojson, write_kml
from whiskjax.rules import WhiskjaxError

GEOD = Geod(ellps="WGS84")
KML = "{http://www.opengis.net/kml/2.2}"


def target(lon=87.5, lat=43.6, height=12.0, major=30.0, minor=2.0, azimuth=25.0, **changes):
    """A target whose ellipse of one sigma has these half-axes (m) and this azimuth of the major one (deg)."""
    a = np.radians(azimuth)
    axes = np.array([[np.sin(a), np.cos(a), 0], [-np.cos(a), np.sin(a), 0], [0, 0, 1]])
    covariance = axes.T @ np.diag([major**2, minor**2, 25.0]) @ axes
    return LocatedTarget(**{"name": "T1", "lat_deg": lat, "lon_deg": lon, "height_m": height} | {
        "covariance_enu_m2": covariance, "ce90_m": 1.65 * major, "le90_m": 8.2} | changes)  # fmt: skip


TRACK = np.array([[87.1, 43.2, 5000.0], [87.2, 43.25, 5010.0], [87.3, 43.2, 5005.5]])


def features(path, located):
    collection = json.loads(write_geojson(path / "t.geojson", located).read_text("utf-8"), parse_constant=pytest.fail)
    assert collection["type"] == "FeatureCollection"
    return collection["features"]


def area(ring):
    """Twice the signed area (shoelace): positive counter-clockwise."""
    x, y = np.array(ring).T
    return np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])


def coordinates(element):
    return [[float(c) for c in triple.split(",")] for triple in element.find(f".//{KML}coordinates").text.split()]


def test_geojson_holds_the_target_its_ellipse_and_the_track(tmp_path):
    t = target(
        properties={"looks_used": np.int64(40), "convergence_deg": np.float64(31.5), "verdict": "sound", "x_m": np.nan},
        track=TRACK,
    )
    point, ellipse, line = features(tmp_path, [t])
    assert point["geometry"] == {"type": "Point", "coordinates": [87.5, 43.6, 12.0]}
    figures = point["properties"]
    assert figures["part"] == "target" and figures["name"] == "T1" and figures["height_m"] == 12.0
    assert figures["ce90_m"] == t.ce90_m and figures["le90_m"] == 8.2 and figures["sigma_u_m"] == 5.0
    assert figures["sigma_e_m"] == pytest.approx(np.hypot(30 * np.sin(np.radians(25)), 2 * np.cos(np.radians(25))))
    assert figures["looks_used"] == 40 and figures["convergence_deg"] == 31.5 and figures["verdict"] == "sound"
    assert figures["x_m"] is None
    assert ellipse["geometry"]["type"] == "Polygon" and ellipse["properties"]["probability"] == 0.9
    assert line["geometry"] == {"type": "LineString", "coordinates": TRACK.tolist()}
    assert line["properties"] == {"part": "platform track", "name": "T1", "looks": 3}
    # RFC 7946, 4: the coordinate reference system is always WGS-84 and is not stated.
    assert "crs" not in (tmp_path / "t.geojson").read_text("utf-8")


@pytest.mark.parametrize("lon, lat", [(87.5, 43.6), (-70.0, -33.0), (0.0, 0.0), (15.0, 84.0), (-179.99999, -16.0)])
@pytest.mark.parametrize("azimuth", [0.0, 25.0, 90.0, 160.0])
def test_ellipse_by_geodesics(lon, lat, azimuth):
    """Half-axes to 1e-4 along the geodesic, the azimuths to 0.01 degrees; chi-square with two degrees of freedom."""
    ring, half = error_ellipse(target(lon, lat, azimuth=azimuth))
    root = np.sqrt(chi2.ppf(0.9, 2))
    assert half["semi_major_m"] == pytest.approx(30 * root) and half["semi_minor_m"] == pytest.approx(2 * root)
    quarter = (len(ring) - 1) // 4
    for vertex, length, direction in ((0, 30 * root, azimuth), (quarter, 2 * root, azimuth - 90)):
        there, _, distance = GEOD.inv(lon, lat, *ring[vertex])
        assert distance == pytest.approx(length, rel=1e-4)
        assert (there - direction + 90) % 180 - 90 == pytest.approx(0, abs=0.01)
        _, _, across = GEOD.inv(*ring[vertex], *ring[vertex + 2 * quarter])
        assert across == pytest.approx(2 * length, rel=1e-4)
    assert (half["azimuth_deg"] - azimuth + 90) % 180 - 90 == pytest.approx(0, abs=1e-6)


def test_ellipse_in_space():
    """Of a target high up, large: every vertex, put back at its height in the plane, is an error of the 90 % ellipse."""
    t = target(height=3000.0, major=800.0, minor=150.0)
    ring, _ = error_ellipse(t)
    lon, lat = np.radians(ring).T
    origin, up = ecef(np.radians(43.6), np.radians(87.5), 3000.0), ecef(np.radians(43.6), np.radians(87.5), 3001.0)
    up = up - origin
    on_ground, above = ecef(lat, lon, 3000.0), ecef(lat, lon, 3001.0)
    normal = above - on_ground
    # Along each vertex' own vertical back into the plane.
    x = on_ground + normal * (((origin - on_ground) @ up) / (normal @ up))[:, None] - origin
    east = np.array([-np.sin(np.radians(87.5)), np.cos(np.radians(87.5)), 0])
    en = np.stack([x @ east, x @ np.cross(up, east)], axis=-1)
    squared = np.einsum("vi,vi->v", en, np.linalg.solve(np.asarray(t.covariance_enu_m2)[:2, :2], en.T).T)
    np.testing.assert_allclose(squared, chi2.ppf(0.9, 2), rtol=1e-6)


@pytest.mark.parametrize("azimuth", [0.0, 60.0, 90.0, 135.0])
def test_rings_are_closed_and_right_handed(azimuth, tmp_path):
    _, ellipse = features(tmp_path, [target(azimuth=azimuth)])
    (ring,) = ellipse["geometry"]["coordinates"]
    assert ring[0] == ring[-1] and len(ring) >= 4
    assert area(np.array(ring) - ring[0]) > 0


@pytest.mark.parametrize("lon", [179.9999, -179.9999, 180.0, -180.0])
def test_an_ellipse_over_the_antimeridian_is_cut(lon, tmp_path):
    t = target(lon, -16.0, azimuth=70.0, track=[[179.9, -16.5, 5e3], [-179.9, -16.3, 5.2e3], [179.8, -16.1, 5e3]])
    point, ellipse, line = features(tmp_path, [t])
    assert abs(point["geometry"]["coordinates"][0]) == abs(lon)
    assert ellipse["geometry"]["type"] == "MultiPolygon"
    rings = [np.array(polygon[0]) for polygon in ellipse["geometry"]["coordinates"]]
    assert len(rings) == 2
    for ring in rings:
        assert (ring[0] == ring[-1]).all() and area(ring - ring[0]) > 0
        assert np.abs(ring[:, 0]).max() == 180 and np.ptp(ring[:, 0]) < 1
    # Nothing is lost: both parts together have the area of the same ellipse elsewhere.
    _, uncut = features(tmp_path, [target(20.0, -16.0, azimuth=70.0)])
    (whole,) = uncut["geometry"]["coordinates"]
    areas = [area(ring - ring[0]) for ring in (*rings, np.array(whole))]
    assert areas[0] + areas[1] == pytest.approx(areas[2], rel=1e-4)
    assert line["geometry"]["type"] == "MultiLineString"
    parts = line["geometry"]["coordinates"]
    assert parts == [
        [[179.9, -16.5, 5e3], [180.0, -16.4, 5100.0]],
        [
            [-180.0, -16.4, 5100.0],
            [-179.9, -16.3, 5.2e3],
            [-180.0, pytest.approx(-16.3 + 0.2 / 3), pytest.approx(5200 - 200 / 3)],
        ],
        [[180.0, pytest.approx(-16.3 + 0.2 / 3), pytest.approx(5200 - 200 / 3)], [179.8, -16.1, 5e3]],
    ]
    document = ElementTree.parse(write_kml(tmp_path / "t.kml", [t])).getroot()
    geometries = document.findall(f".//{KML}MultiGeometry")
    assert [len(g) for g in geometries] == [2, 3]


def test_kml_is_clamped_to_the_ground_and_says_the_height(tmp_path):
    t = target(name="Gate <3> & dome", properties={"convergence_deg": 31.5, "nees": np.nan}, track=TRACK)
    document = ElementTree.parse(write_kml(tmp_path / "t.kml", [t, target(name="T2")])).getroot()
    assert document.tag == f"{KML}kml"
    folders = document.findall(f"{KML}Document/{KML}Folder")
    assert [f.findtext(f"{KML}name") for f in folders] == ["Gate <3> & dome", "T2"]
    placemarks = folders[0].findall(f"{KML}Placemark")
    assert [p.findtext(f"{KML}name") for p in placemarks] == [
        "Gate <3> & dome", "Gate <3> & dome: error ellipse", "Gate <3> & dome: platform track"]  # fmt: skip
    for placemark, kind in zip(placemarks, ("Point", "Polygon", "LineString"), strict=True):
        # The schema (OGC 07-147r2, 9.11) fixes the order.
        tags = [child.tag.removeprefix(KML) for child in placemark]
        assert tags == ["name", "description", "styleUrl", "ExtendedData", kind]
        shape = placemark.find(f"{KML}{kind}")
        assert shape.findtext(f"{KML}altitudeMode") == "clampToGround"
        assert "12.000 m above the WGS-84 ellipsoid" in placemark.findtext(f"{KML}description")
        assert all(len(position) == 2 for position in coordinates(shape)), "an altitude would be read as one above the geoid"
    data = {d.get("name"): d.findtext(f"{KML}value") for d in placemarks[0].findall(f".//{KML}Data")}
    assert float(data["ce90_m"]) == t.ce90_m and data["convergence_deg"] == "31.5" and data["nees"] == ""
    assert coordinates(placemarks[0]) == [[87.5, 43.6]]
    np.testing.assert_allclose(coordinates(placemarks[2]), TRACK[:, :2], rtol=0, atol=1e-10)


def test_both_formats_draw_one_ellipse(tmp_path):
    t = target()
    _, ellipse = features(tmp_path, [t])
    placemarks = ElementTree.parse(write_kml(tmp_path / "t.kml", [t])).getroot().findall(f".//{KML}Placemark")
    np.testing.assert_allclose(coordinates(placemarks[1]), ellipse["geometry"]["coordinates"][0], rtol=0, atol=1e-9)


def test_one_look_has_a_place_and_no_track(tmp_path):
    *_, platform = features(tmp_path, [target(track=TRACK[:1])])
    assert platform["geometry"] == {"type": "Point", "coordinates": TRACK[0].tolist()}
    assert len(features(tmp_path, [target(), target(track=np.zeros((0, 3)))])) == 4
    assert features(tmp_path, []) == []


def test_an_ellipse_around_a_pole_is_refused(tmp_path):
    with pytest.raises(WhiskjaxError, match="pole"):
        write_geojson(tmp_path / "t.geojson", [target(lat=89.9999, minor=10.0)])
    assert not (tmp_path / "t.geojson").exists()
    # Beside the pole it is an ellipse like any other.
    ring, _ = error_ellipse(target(lat=89.99))
    assert GEOD.inv(87.5, 89.99, *ring[0])[2] == pytest.approx(30 * np.sqrt(chi2.ppf(0.9, 2)), rel=1e-4)


def test_a_line_for_an_ellipse(tmp_path):
    """A covariance with a zero axis gives a ring without area, not a refusal."""
    _, ellipse = features(tmp_path, [target(minor=0.0)])
    assert ellipse["properties"]["semi_minor_m"] == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    "changes, match",
    [
        ({"lat_deg": 91.0}, "T1.*latitude 91"),
        ({"lon_deg": 200.0}, "longitude 200"),
        ({"height_m": np.nan}, "height nan"),
        ({"track": [[87.0, 95.0, 1.0]]}, "latitude 95"),
        ({"track": TRACK[:, :2]}, "shape"),
        ({"covariance_enu_m2": -np.eye(3)}, "covariance"),
        ({"covariance_enu_m2": np.eye(2)}, "covariance"),
        ({"covariance_enu_m2": np.full((3, 3), np.nan)}, "covariance"),
        ({"properties": {"ce90_m": 3.0}}, "ce90_m"),
        ({"name": "a\x00b"}, "printable"),
    ],
)
def test_what_is_no_target_is_refused(changes, match):
    with pytest.raises(WhiskjaxError, match=match):
        target(**changes)

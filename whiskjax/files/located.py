"""Located targets for people's maps: GeoJSON (RFC 7946) and KML 2.2 (OGC 07-147r2).

Each target is a point with its figures, the ellipse on the ground that holds the target with 90 %, and the platform's track over
the looks. An ellipse or track that crosses the antimeridian is cut there, as RFC 7946 (3.1.9) wants it; an ellipse around a pole
is refused, because neither format has a form for it.

GeoJSON heights are above the ellipsoid, like ours. KML altitudes are above the EGM96 geoid, which whiskjax does not carry: there
everything is clamped to the ground, and the ellipsoidal height stands in the description, never as an altitude.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from ..earth.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from ..earth.frames import enu_rotation
from ..rules import Numbers, WhiskjaxError
from .plain_names import has_odd

PROBABILITY = 0.9
# Quantile of chi-square with two degrees of freedom: the ellipse's half-axes in sigmas.
_SIGMAS = math.sqrt(-2 * math.log(1 - PROBABILITY))
_VERTICES = 72
_KML = "http://www.opengis.net/kml/2.2"


@dataclass(frozen=True)
class LocatedTarget:
    """A target that was located, in the units of maps.

    **Arguments:**

    - `name`: what people call it.
    - `lat_deg`, `lon_deg`, `height_m`: geodetic position (WGS-84), height above the ellipsoid.
    - `covariance_enu_m2`: of the position, in east, north, up, (3, 3).
    - `ce90_m`, `le90_m`: circular and linear error (`whiskjax.estimate.accuracy`).
    - `properties`: further figures, by names that end in their unit; one that is not finite is written as null.
    - `track`: longitude and latitude in degrees and ellipsoidal height in metres of the platform at the looks, (n, 3).

    **Raises:** `WhiskjaxError` where a value is no position or no covariance, a text holds a character that no map can show, or a
    property has the name of a figure that is written anyway.
    """

    name: str
    lat_deg: float
    lon_deg: float
    height_m: float
    covariance_enu_m2: Float[Numbers, "3 3"]
    ce90_m: float
    le90_m: float
    properties: Mapping[str, float | int | str | bool | None] = field(default_factory=dict)
    track: Float[Numbers, "n 3"] | None = None

    def __post_init__(self):
        track = np.zeros((0, 3)) if self.track is None else np.asarray(self.track, dtype=float)
        if track.ndim != 2 or track.shape[1] != 3:
            raise WhiskjaxError(
                f"{self.name}: the track has the shape {track.shape}; longitude, latitude, height (n, 3) are expected"
            )
        for lon, lat, height in [(self.lon_deg, self.lat_deg, self.height_m), *track.tolist()]:
            if not (abs(lon) <= 180 and abs(lat) <= 90 and math.isfinite(height)):
                raise WhiskjaxError(
                    f"{self.name}: longitude {lon}, latitude {lat}, height {height} is no position; degrees within ±180 and ±90 "
                    "and metres are expected"
                )
        c = np.asarray(self.covariance_enu_m2, dtype=float)
        if c.shape != (3, 3) or not np.isfinite(c).all() or np.linalg.eigvalsh(c)[0] < -1e-9 * np.trace(c):
            raise WhiskjaxError(f"{self.name}: covariance_enu_m2 is no covariance (3, 3): {c.tolist()}")
        texts = [self.name, *(f"{name} {value}" for name, value in self.properties.items())]
        if odd := [text for text in texts if has_odd(text)]:
            raise WhiskjaxError(f"{odd[0]!r} holds characters that no map file can; use printable ones")
        if taken := sorted({*_figures(self), "part"} & {*self.properties}):
            raise WhiskjaxError(f"{self.name}: {', '.join(taken)} is written from the target itself; rename the property")


def write_geojson(path: str | Path, located: Sequence[LocatedTarget]) -> Path:
    """Write targets as a GeoJSON FeatureCollection: up to three features each, told apart by the property `part`.

    **Arguments:**

    - `path`: the file; one that exists is replaced.
    - `located`: the targets, in the order in which they are written.

    **Returns:** the path.

    **Raises:** `WhiskjaxError` where an error ellipse goes around a pole.
    """
    features = [feature for target in located for feature in _features(target)]
    lines = ",\n".join(json.dumps(feature, allow_nan=False, ensure_ascii=False) for feature in features)
    path = Path(path)
    path.write_text(f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n', encoding="utf-8", newline="\n")
    return path


def write_kml(path: str | Path, located: Sequence[LocatedTarget]) -> Path:
    """Write targets as KML: a folder each, everything clamped to the ground.

    Arguments, returns and raises as `write_geojson`.
    """
    root = ElementTree.Element("kml", xmlns=_KML)
    document = ElementTree.SubElement(root, "Document")
    style = _element(document, "Style", id="outline")
    _element(_element(style, "LineStyle"), "width", "2")
    _element(_element(style, "PolyStyle"), "fill", "0")
    for target in located:
        folder = _element(document, "Folder")
        _element(folder, "name", target.name)
        for feature in _features(target):
            _placemark(folder, target, feature)
    ElementTree.indent(root)
    path = Path(path)
    path.write_bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return path


def _placemark(folder: ElementTree.Element, target: LocatedTarget, feature: dict[str, Any]) -> None:
    """One feature; the schema fixes the order of what a placemark holds."""
    figures, geometry = feature["properties"], feature["geometry"]
    placemark = _element(folder, "Placemark")
    _element(placemark, "name", target.name if figures["part"] == "target" else f"{target.name}: {figures['part']}")
    _element(placemark, "description", f"Target {target.height_m:.3f} m above the WGS-84 ellipsoid. Drawn on the ground.")
    _element(placemark, "styleUrl", "#outline")
    extended = _element(placemark, "ExtendedData")
    for name, value in figures.items():
        _element(_element(extended, "Data", name=name), "value", "" if value is None else str(value))
    kind, coordinates = geometry["type"], geometry["coordinates"]
    if kind.startswith("Multi"):
        placemark, kind = _element(placemark, "MultiGeometry"), kind.removeprefix("Multi")
    else:
        coordinates = [coordinates]
    for part in coordinates:
        shape = _element(placemark, kind)
        if kind != "Point":
            _element(shape, "tessellate", "1")
        _element(shape, "altitudeMode", "clampToGround")
        if kind == "Polygon":
            shape, (part,) = _element(_element(shape, "outerBoundaryIs"), "LinearRing"), part
        positions = [part] if kind == "Point" else part
        _element(shape, "coordinates", " ".join(f"{lon:.10f},{lat:.10f}" for lon, lat, *_ in positions))


def _element(parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _figures(target: LocatedTarget) -> dict[str, Any]:
    sigma = np.sqrt(np.maximum(np.diagonal(np.asarray(target.covariance_enu_m2, dtype=float)), 0.0)).tolist()
    own = {"name": target.name, "height_m": target.height_m, "ce90_m": target.ce90_m, "le90_m": target.le90_m}
    return own | dict(zip(("sigma_e_m", "sigma_n_m", "sigma_u_m"), sigma, strict=True))


def _features(target: LocatedTarget) -> list[dict[str, Any]]:
    """GeoJSON features of one target, coordinates in the order longitude, latitude, height."""
    ring, half_axes = error_ellipse(target)
    position = np.array([target.lon_deg, target.lat_deg, target.height_m])
    features = [
        _feature(_geometry(position[None], "Point"), {"part": "target"} | _figures(target) | dict(target.properties)),
        _feature(_geometry(ring, "Polygon"), {"part": "error ellipse", "name": target.name} | half_axes),
    ]
    if target.track is not None and len(track := np.asarray(target.track, dtype=float)):
        geometry = _geometry(track, "LineString" if len(track) > 1 else "Point")
        features.append(_feature(geometry, {"part": "platform track", "name": target.name, "looks": len(track)}))
    return features


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": {k: _value(v) for k, v in properties.items()}}


def _value(value: Any) -> Any:
    """A figure as JSON has it: numpy's numbers as Python's, and null where there is no number."""
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def error_ellipse(target: LocatedTarget) -> tuple[Float[np.ndarray, "m 2"], dict[str, float]]:
    """The ellipse of 90 % of the horizontal covariance, in the plane east, north through the target.

    **Returns:** longitude and latitude in degrees of its vertices, counter-clockwise from the end of the major axis, closed, the
    longitude continued beyond ±180; and probability, half-axes in metres and azimuth of the major axis in degrees, by name.

    **Raises:** `WhiskjaxError` where it goes around a pole.
    """
    variance, axes = np.linalg.eigh(np.asarray(target.covariance_enu_m2, dtype=float)[:2, :2])
    minor, major = _SIGMAS * np.sqrt(np.maximum(variance, 0.0))
    east, north = axes[:, 1]
    # A quarter turn to the left of the major axis, so that the vertices run counter-clockwise.
    t = 2 * np.pi * np.arange(_VERTICES + 1) / _VERTICES
    along, left = major * np.cos(t), minor * np.sin(t)
    enu = np.stack([east * along - north * left, north * along + east * left, np.zeros_like(t)], axis=-1)
    lat_rad, lon_rad = math.radians(target.lat_deg), math.radians(target.lon_deg)
    point = geodetic_to_ecef(lat_rad, lon_rad, target.height_m)
    lat, lon, _ = ecef_to_geodetic(np.asarray(point) + enu @ np.asarray(enu_rotation(lat_rad, lon_rad)).T)
    lon = np.unwrap(np.degrees(np.asarray(lon)), period=360)
    if abs(lon[-1] - lon[0]) > 180:
        raise WhiskjaxError(f"{target.name}: the error ellipse ({major:.0f} m) goes around a pole, which no map format can hold")
    ring = np.stack([lon, np.degrees(np.asarray(lat))], axis=-1)
    ring[-1] = ring[0]
    azimuth = math.degrees(math.atan2(east, north)) % 180
    names = ("probability", "semi_major_m", "semi_minor_m", "azimuth_deg")
    return ring, dict(zip(names, (PROBABILITY, float(major), float(minor), azimuth), strict=True))


def _geometry(points: Float[np.ndarray, "n k"], kind: str) -> dict[str, Any]:
    """A GeoJSON geometry, cut where it crosses the antimeridian."""
    points = np.array(points)
    points[:, 0] = np.unwrap(points[:, 0], period=360)
    parts = _cut(points, closed=kind == "Polygon")
    # 1e-10 degrees are a hundredth of a millimetre.
    lists = [[[round(float(c), 10) for c in point] for point in part] for part in parts]
    if kind == "Point":
        return {"type": kind, "coordinates": lists[0][0]}
    shapes = [[part] for part in lists] if kind == "Polygon" else lists
    return {"type": kind, "coordinates": shapes[0]} if len(shapes) == 1 else {"type": f"Multi{kind}", "coordinates": shapes}


def _cut(points: Float[np.ndarray, "n k"], closed: bool) -> list[Float[np.ndarray, "m k"]]:
    """Parts on either side of the antimeridian, each within ±180; the longitudes given are continuous.

    A closed ring must be convex, as an ellipse is (but for the last metres beside a pole): what lies on one side is one ring.
    """
    west = np.floor((points[:, 0] + 180) / 360)
    with_ends, world = [points[0]], [west[0]]
    for a, b, v, w in zip(points[:-1], points[1:], west[:-1], west[1:], strict=True):
        if v != w:
            edge = 360 * max(v, w) - 180
            crossing = a + (edge - a[0]) / (b[0] - a[0]) * (b - a)
            crossing[0] = edge
            with_ends += [crossing, crossing]
            world += [v, w]
        with_ends.append(b)
        world.append(w)
    array, world = np.array(with_ends), np.array(world)
    array[:, 0] -= 360 * world
    if closed and len(sides := np.unique(world)) > 1:
        rings = [array[world == side] for side in sides]
        return [ring if (ring[0] == ring[-1]).all() else np.concatenate([ring, ring[:1]]) for ring in rings]
    return np.split(array, np.flatnonzero(np.diff(world)) + 1)

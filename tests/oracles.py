"""What the tests compare with: pyproj, scipy and textbook numpy, nothing of whiskjax."""

import numpy as np
from pyproj import Transformer
from scipy.spatial.transform import Rotation

_FORWARD = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
_BACK = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


def ecef(lat_rad, lon_rad, height_m):
    """ECEF (..., 3) by PROJ."""
    lat, lon, height = np.broadcast_arrays(lat_rad, lon_rad, np.asarray(height_m, dtype=float))
    return np.stack(_FORWARD.transform(lon, lat, height, radians=True), axis=-1)


def geodetic(point_m):
    """Latitude, longitude in radians and height in metres by PROJ."""
    lon, lat, height = _BACK.transform(*np.moveaxis(np.asarray(point_m), -1, 0), radians=True)
    return lat, lon, height


def exact_height(point_m):
    """Geodetic height by the textbook's iteration of the latitude, in extended precision where the machine has it.

    PROJ's height is good to micrometres beside a pole, which is coarser than what is tested with this.
    """
    x, y, z = np.moveaxis(np.asarray(point_m, dtype=np.longdouble), -1, 0)
    a, f = np.longdouble(6378137), 1 / (np.longdouble(298257223563) / 10**9)
    e2, p = f * (2 - f), np.hypot(x, y)
    lat = np.arctan2(z, p * (1 - e2))
    for _ in range(12):
        n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
        lat = np.arctan2(z + e2 * n * np.sin(lat), p)
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    return (p * np.cos(lat) + z * np.sin(lat) - a * a / n).astype(float)


def ecef_from_ned(lat_rad, lon_rad):
    """Rotation, by two turns: about z by the longitude, then about y from the z axis to down."""
    lat, lon = np.broadcast_arrays(lat_rad, lon_rad)
    return Rotation.from_euler("ZY", np.stack([lon, -lat - np.pi / 2], axis=-1))


def body_in_ned(roll_rad, pitch_rad, heading_rad):
    """Rz(heading) Ry(pitch) Rx(roll), active."""
    return Rotation.from_euler("ZYX", np.stack(np.broadcast_arrays(heading_rad, pitch_rad, roll_rad), axis=-1))


def about(axis, angle_rad):
    """Active rotation about one axis by each of the angles."""
    return Rotation.from_rotvec(np.multiply.outer(np.asarray(angle_rad), np.eye(3)["xyz".index(axis)]))


def split(array):
    """The components along the last axis, of an array of any kind (a tracer, too)."""
    return tuple(array[..., i] for i in range(array.shape[-1]))


def array(components):
    """Components (some of them plain numbers) as one array."""
    return np.stack(np.broadcast_arrays(*[np.asarray(c, dtype=float) for c in components]), axis=-1)


def matrix(rows):
    """A matrix of components as one array (..., 3, 3)."""
    return np.stack(np.broadcast_arrays(*[array(row) for row in rows]), axis=-2)

"""POS records made ready for interpolation, once, on the host (numpy, never traced)."""

import numpy as np
from jaxtyping import Float

from ..earth.ellipsoid import ECCENTRICITY2, LAT_FIRST, SEMI_MAJOR_M
from ..rules import Arrays, WhiskjaxError

# Any roll, pitch or heading is a rotation, and a heading may run on through north; but beyond two turns degrees were meant.
ATTITUDE_RAD = 4 * np.pi
TURNS = "of a heading that runs on take out whole turns"


def unit_quaternions(quaternion_xyzw: Float[np.ndarray, "n 4"], whose: str) -> Float[np.ndarray, "n 4"]:
    """Normalised.

    **Raises:** `WhiskjaxError`, beginning with `whose` and the row, where a quaternion is nowhere near unit length.
    """
    length = np.linalg.norm(quaternion_xyzw, axis=-1, keepdims=True)
    if not (length > 0.5).all():
        raise WhiskjaxError(f"{whose} {int(np.argmin(length))} has length {length.min():.3g}, not 1")
    return quaternion_xyzw / length


def sign_continuous(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """The same attitudes, each quaternion with the sign nearer to the one before: q and -q are one attitude."""
    flips = np.einsum("ni,ni->n", q[1:], q[:-1]) < 0
    sign = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return q * sign[:, None]


def relative_turns(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n-1 3"]:
    """Rotation vector from each sign-continuous quaternion to the next, in the body frame: q[i+1] = q[i] exp(turn / 2)."""
    (x, y, z, w), (u, v, s, c) = q[:-1].T, q[1:].T
    vector = np.stack([w * u - x * c - y * s + z * v, w * v - y * c - z * u + x * s, w * s - z * c - x * v + y * u], axis=-1)
    scalar = w * c + x * u + y * v + z * s
    length = np.linalg.norm(vector, axis=-1)
    angle = 2 * np.arctan2(length, scalar)
    factor = np.where(length > 1e-9, angle / np.where(length > 1e-9, length, 1.0), 2.0)
    return vector * factor[:, None]


def quaternions_from_matrices(rotation: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 4"]:
    """Unit quaternions (x, y, z, w) of rotation matrices, by the largest of the four squared components (Shepperd 1978)."""
    r = np.asarray(rotation, dtype=np.float64)
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    squares = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=-1)
    a, b, c = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    d, e, f = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], d, e, a], axis=-1),
            np.stack([d, squares[..., 1], f, b], axis=-1),
            np.stack([e, f, squares[..., 2], c], axis=-1),
            np.stack([a, b, c, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.take_along_axis(rows, np.argmax(squares, axis=-1)[..., None, None], axis=-2)[..., 0, :]
    return best / np.linalg.norm(best, axis=-1, keepdims=True)


def matrices_from_quaternions(quaternion_xyzw: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotation matrices of unit quaternions (x, y, z, w)."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion_xyzw, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def ned_from_body_matrices(roll_rad, pitch_rad, heading_rad) -> Float[np.ndarray, "n 3 3"]:
    """Rz(heading) Ry(pitch) Rx(roll)."""
    (sr, cr), (sp, cp), (sh, ch) = ((np.sin(a), np.cos(a)) for a in map(np.asarray, (roll_rad, pitch_rad, heading_rad)))
    rows = [
        [ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr],
        [sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def ecef_from_ned_matrices(lat_rad, lon_rad) -> Float[np.ndarray, "n 3 3"]:
    """Columns north, east, down in ECEF."""
    (s, c), (sl, cl) = ((np.sin(a), np.cos(a)) for a in map(np.asarray, (lat_rad, lon_rad)))
    rows = [[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, np.zeros_like(c), -s]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def ecef_samples(lat_rad, lon_rad, height_m, roll_rad, pitch_rad, heading_rad, velocity_ned_mps=None):
    """ECEF positions (n, 3), quaternions ecef_from_body (n, 4) and ECEF velocities (n, 3) or None, of geodetic POS records.

    **Raises:** `WhiskjaxError` for float32, shapes that differ, a latitude beyond a pole or angles that can only be degrees.
    """
    arrays = Arrays("Trajectory.from_geodetic")

    def take(name, value, within_rad=None, meaning=""):
        return np.asarray(arrays.take(name, value, "n", absolute=True, finite=True, within_rad=within_rad, meaning=meaning))

    lat = take("lat_rad", lat_rad, np.pi / 2, LAT_FIRST)
    lon, height = take("lon_rad", lon_rad, 2 * np.pi), take("height_m", height_m)
    roll, pitch = take("roll_rad", roll_rad, ATTITUDE_RAD, TURNS), take("pitch_rad", pitch_rad, ATTITUDE_RAD, TURNS)
    heading = take("heading_rad", heading_rad, ATTITUDE_RAD, TURNS)
    s, c = np.sin(lat), np.cos(lat)
    n = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY2 * s * s)
    position = np.stack(
        [(n + height) * c * np.cos(lon), (n + height) * c * np.sin(lon), (n * (1 - ECCENTRICITY2) + height) * s], -1
    )
    to_ecef = ecef_from_ned_matrices(lat, lon)
    quaternion = quaternions_from_matrices(to_ecef @ ned_from_body_matrices(roll, pitch, heading))
    ned = arrays.take("velocity_ned_mps", velocity_ned_mps, "n 3", optional=True, absolute=True, finite=True)
    velocity = None if ned is None else np.einsum("nij,nj->ni", to_ecef, np.asarray(ned))
    return position, quaternion, velocity

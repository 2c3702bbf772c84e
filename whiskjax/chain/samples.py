"""POS records made ready for interpolation, once: on the host, in numpy, unless they are traced."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

from ..earth.ellipsoid import ECCENTRICITY2, LAT_FIRST, SEMI_MAJOR_M
from ..rules import Arrays, WhiskjaxError, arrays_of, is_traced, plain
from .rotations import Quaternion, quaternion_product

# Any roll, pitch or heading is a rotation, and a heading may run on through north; but beyond two turns degrees were meant.
ATTITUDE_RAD = 4 * np.pi
TURNS = "of a heading that runs on take out whole turns"

# Records that are worked on at once: what they need in between stays in the processor's cache.
_BLOCK = 1 << 14


def blocks(n: int, size: int = _BLOCK) -> Iterator[slice]:
    """Slices that cover n records, for work whose temporaries would not fit into memory, or the cache, at once."""
    return (slice(start, min(start + size, n)) for start in range(0, n, size))


def by_blocks(of: Callable[..., Any], *records: Any) -> Any:
    """of(*records), each (n, ...), for one block of records after the other; at once where they are traced."""
    n, out = len(records[0]), None
    if any(map(is_traced, records)):
        return of(*records)
    for rows in blocks(n):
        value = of(*(record[rows] for record in records))
        out = np.empty((n, *value.shape[1:])) if out is None else out
        out[rows] = value
    return of(*records) if out is None else out


def unit_quaternions(quaternion_xyzw: Float[np.ndarray, "n 4"], whose: str) -> Float[np.ndarray, "n 4"]:
    """Normalised; those of unit length as they are.

    **Raises:** `WhiskjaxError`, beginning with `whose` and the row, where a quaternion is nowhere near unit length.
    """
    length = arrays_of(quaternion_xyzw).linalg.norm(quaternion_xyzw, axis=-1, keepdims=True)
    if is_traced(length):
        return quaternion_xyzw / length
    if not (length > 0.5).all():
        raise WhiskjaxError(f"{whose} {int(np.argmin(length))} has length {length.min():.3g}, not 1")
    return quaternion_xyzw if (np.abs(length - 1) < 1e-15).all() else quaternion_xyzw / length


def sign_continuous(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """The same attitudes, each quaternion with the sign nearer to the one before: q and -q are one attitude."""
    math = arrays_of(q)
    flips = math.einsum("ni,ni->n", q[1:], q[:-1]) < 0
    if math is np and not flips.any():
        return q
    sign = math.concatenate([math.ones(1), math.where(math.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return q * sign[:, None]


def relative_turns(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n-1 3"]:
    """Rotation vector from each sign-continuous quaternion to the next, in the body frame: q[i+1] = q[i] exp(turn / 2)."""

    def turns(before, after):
        math, (x, y, z, w), (u, v, s, c) = arrays_of(before), before.T, after.T
        vector = math.stack(
            [w * u - x * c - y * s + z * v, w * v - y * c - z * u + x * s, w * s - z * c - x * v + y * u], axis=-1
        )
        scalar = w * c + x * u + y * v + z * s
        squared = (vector * vector).sum(axis=-1)
        far = squared > 1e-18
        length = math.sqrt(math.where(far, squared, 1.0))
        return vector * math.where(far, 2 * math.arctan2(length, scalar) / length, 2.0)[:, None]

    return by_blocks(turns, q[:-1], q[1:])


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


def turned(axis: str, angle_rad: Float[np.ndarray, " n"]) -> Quaternion:
    """Quaternions of active rotations about x, y or z."""
    math, half = arrays_of(angle_rad), 0.5 * plain(angle_rad)
    return *(math.sin(half) if name == axis else 0 for name in "xyz"), math.cos(half)


def body_in_ned(roll_rad, pitch_rad, heading_rad) -> Quaternion:
    """Rz(heading) Ry(pitch) Rx(roll); any angles, a pitch beyond a right angle too."""
    return quaternion_product(quaternion_product(turned("z", heading_rad), turned("y", pitch_rad)), turned("x", roll_rad))


def ned_in_ecef(lat_rad, lon_rad) -> Quaternion:
    """Attitude of the local level: about z by the longitude, then about y from the z axis to down."""
    return quaternion_product(turned("z", lon_rad), turned("y", -plain(lat_rad) - np.pi / 2))


def quaternions_in_blocks(of: Callable[..., Quaternion], *records: Any) -> Float[np.ndarray, "n 4"]:
    """Unit quaternions of n records, the largest component of each positive.

    **Arguments:** `of`: from a block of the records, (m,) each, to the components of their quaternions.
    """

    def unit(*block):
        components = of(*block)
        math = arrays_of(components)
        q = math.stack(math.broadcast_arrays(*components), axis=1)
        largest = math.take_along_axis(q, math.abs(q).argmax(axis=1)[:, None], axis=1)
        return q / math.copysign(math.linalg.norm(q, axis=1, keepdims=True), largest)

    return by_blocks(unit, *records)


def ecef_from_ned_vectors(lat_rad, lon_rad, vector_ned: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors north, east, down at each place in ECEF."""
    (s, c), (sl, cl) = ((np.sin(a), np.cos(a)) for a in map(np.asarray, (lat_rad, lon_rad)))
    north, east, down = np.asarray(vector_ned, dtype=np.float64).T
    outward = -s * north - c * down
    return np.stack([cl * outward - sl * east, sl * outward + cl * east, c * north - s * down], axis=-1)


def ecef_samples(lat_rad, lon_rad, height_m, roll_rad, pitch_rad, heading_rad, velocity_ned_mps=None):
    """ECEF positions (n, 3), quaternions ecef_from_body (n, 4) and ECEF velocities (n, 3) or None, of geodetic POS records.

    Any roll, pitch and heading within a turn are a rotation: the pitch of a gimbal that passes nadir is beyond -90 deg.

    **Raises:** `WhiskjaxError` for float32, shapes that differ, a latitude beyond a pole or angles that can only be degrees.
    """
    arrays = Arrays("Trajectory.from_geodetic")

    def take(name, value, within_rad=None, meaning=""):
        return plain(arrays.take(name, value, "n", absolute=True, finite=True, within_rad=within_rad, meaning=meaning))

    lat = take("lat_rad", lat_rad, np.pi / 2, LAT_FIRST)
    lon, height = take("lon_rad", lon_rad, 2 * np.pi), take("height_m", height_m)
    roll, pitch = take("roll_rad", roll_rad, ATTITUDE_RAD, TURNS), take("pitch_rad", pitch_rad, ATTITUDE_RAD, TURNS)
    heading = take("heading_rad", heading_rad, ATTITUDE_RAD, TURNS)
    position = ecef_positions(lat, lon, height)
    attitude = lambda lat, lon, *angles: quaternion_product(ned_in_ecef(lat, lon), body_in_ned(*angles))
    quaternion = quaternions_in_blocks(attitude, lat, lon, roll, pitch, heading)
    ned = arrays.take("velocity_ned_mps", velocity_ned_mps, "n 3", optional=True, absolute=True, finite=True)
    velocity = None if ned is None else ecef_from_ned_vectors(lat, lon, np.asarray(ned))
    return position, quaternion, velocity


def ecef_positions(lat_rad, lon_rad, height_m) -> Float[np.ndarray, "n 3"]:
    """ECEF positions of geodetic ones."""

    def positions(lat, lon, height):
        math = arrays_of((lat, lon, height))
        s, c = math.sin(lat), math.cos(lat)
        n = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY2 * s * s)
        r = (n + height) * c
        return math.stack([r * math.cos(lon), r * math.sin(lon), (n * (1 - ECCENTRICITY2) + height) * s], axis=1)

    return by_blocks(positions, lat_rad, lon_rad, height_m)

"""Positions and attitudes in tables: every form in which they are written, as world positions and quaternions, and back."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.samples import (
    ecef_from_ned_matrices,
    ecef_samples,
    matrices_from_quaternions,
    ned_from_body_matrices,
    quaternions_from_matrices,
)
from ..earth.ellipsoid import ecef_to_geodetic
from ..rules import FlightError
from .names import listed
from .tables import Column, Sheet, Table, exact, rounded

GEODETIC = ("lat_deg", "lon_deg", "height_m")
CARTESIAN = ("x_m", "y_m", "z_m")
ATTITUDE = {
    "roll_pitch_heading": ("roll_deg", "pitch_deg", "heading_deg"),
    "opk": ("omega_deg", "phi_deg", "kappa_deg"),
    "quaternion": ("qx", "qy", "qz", "qw"),
}
VELOCITIES = (("vn_mps", "ve_mps", "vd_mps"), ("vx_mps", "vy_mps", "vz_mps"))

_DEGREES = "degrees are expected"
_SWAPPED = f"{_DEGREES}; are latitude and longitude swapped?"
_COLUMNS = {
    column.name: column
    for column in (
        Column("lat_deg", low=-90, high=90, hint=_SWAPPED),
        Column("lon_deg", low=-360, high=360, hint=_DEGREES),
        # From the deepest mine to any orbit that looks at the ground; 1e8 catches heights in millimetres.
        Column("height_m", low=-2e4, high=1e8, hint="metres above the ellipsoid are expected"),
        *(Column(name) for name in CARTESIAN),
        Column("roll_deg", low=-180, high=180, hint=_DEGREES),
        Column("pitch_deg", low=-90, high=90, hint=_DEGREES),
        Column("heading_deg", low=-360, high=360, hint=_DEGREES),
        *(Column(name, low=-360, high=360, hint=_DEGREES) for name in ATTITUDE["opk"]),
        Column("convergence_deg", required=False, low=-180, high=180, hint=_DEGREES),
        *(Column(name, low=-1.01, high=1.01, hint="a quaternion has length 1") for name in ATTITUDE["quaternion"]),
    )
}

# NED in a local world x east, y north, z up.
_LOCAL_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# East, north, up as columns in NED: the matrix is its own inverse.
_NED_FROM_ENU = _LOCAL_FROM_NED


class Samples(NamedTuple):
    """World position in metres (n, 3), quaternion world_from_body x, y, z, w (n, 4), world velocity (n, 3) or None."""

    position_m: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]
    velocity_mps: Float[np.ndarray, "n 3"] | None = None


def position_columns(sheet: Sheet, world: str, *, blank: bool = False) -> list[Column]:
    """The columns that hold the position: latitude, longitude, height, or x, y, z.

    **Raises:** `FlightError` where the header has neither, or both, or geodetic ones in a local world.
    """
    has = {form: [n for n in names if n in sheet.header] for form, names in (("g", GEODETIC), ("c", CARTESIAN))}
    if has["g"] and has["c"]:
        raise FlightError(
            f"{sheet.file}, line 1: positions are given twice, as {has['g'][0]} and as {has['c'][0]}; keep one form"
        )
    if has["g"] and world == "local":
        raise FlightError(f"{sheet.file}, line 1: {has['g'][0]} in a local world; {', '.join(CARTESIAN)} are expected")
    if not has["g"] and not has["c"]:
        forms = ", ".join(CARTESIAN) if world == "local" else f"{', '.join(GEODETIC)} or {', '.join(CARTESIAN)}"
        raise FlightError(f"{sheet.file}, line 1: the position is missing: {forms}; the header has {listed(sheet.header)}")
    names = GEODETIC if has["g"] else CARTESIAN
    return [Column(c.name, blank=blank, low=c.low, high=c.high, hint=c.hint) for c in (_COLUMNS[n] for n in names)]


def navigation_columns(sheet: Sheet, world: str, angles: str) -> list[Column]:
    """The columns of a POS or pose table, in the angle convention that flight.toml names.

    **Raises:** `FlightError` where the header has the angles of another convention.
    """
    for other, names in ATTITUDE.items():
        if other != angles and all(name in sheet.header for name in names):
            raise FlightError(
                f"{sheet.file}, line 1: the attitude is given as {', '.join(names)}, but [pos] angles is {angles!r}, which reads "
                f'{", ".join(ATTITUDE[angles])}; set angles = "{other}" in flight.toml'
            )
    columns = position_columns(sheet, world) + [_COLUMNS[name] for name in ATTITUDE[angles]]
    if angles == "opk" and world == "wgs84":
        columns.append(_COLUMNS["convergence_deg"])
    for names in VELOCITIES:
        columns += [Column(name, required=any(n in sheet.header for n in names)) for name in names]
    return columns


def is_ignored(name: str) -> bool:
    """Accuracies that a POS file may carry, and which nothing uses yet."""
    return name.startswith("sigma_")


def positions(table: Table) -> Float[np.ndarray, "n 3"]:
    """World positions of a table's rows; NaN where they are blank.

    **Raises:** `FlightError` where only a part of a position is blank.
    """
    names = GEODETIC if "lat_deg" in table else CARTESIAN
    values = np.stack([table[name] for name in names], axis=-1)
    blank = np.isnan(values)
    partly = blank.any(axis=1) & ~blank.all(axis=1)
    if partly.any():
        row = int(np.argmax(partly))
        table.fail(row, names[int(np.argmax(blank[row]))], "is blank while the rest of the position is given")
    if names is CARTESIAN:
        return values
    known, out = ~blank[:, 0], np.full(values.shape, np.nan)
    out[known] = positions_from_geodetic(*values[known].T)
    return out


def positions_from_geodetic(lat_deg, lon_deg, height_m) -> Float[np.ndarray, "n 3"]:
    """ECEF positions, on the host."""
    zero = np.zeros(np.shape(lat_deg))
    return ecef_samples(np.radians(lat_deg), np.radians(lon_deg), height_m, zero, zero, zero)[0]


def samples(table: Table, world: str, angles: str) -> Samples:
    """World positions, attitudes and velocities of a table's rows.

    **Raises:** `FlightError` for a quaternion whose length is not 1.
    """
    position = positions(table)
    a = [np.asarray(table[name]) for name in ATTITUDE[angles]]
    ned = _world_from_ned(table, position, world)
    if angles == "roll_pitch_heading":
        quaternion = quaternions_from_matrices(ned @ ned_from_body_matrices(*map(np.radians, a)))
    elif angles == "opk":
        grid = np.radians(table["convergence_deg"]) if "convergence_deg" in table else np.zeros(len(table))
        quaternion = quaternions_from_matrices(ned @ _NED_FROM_ENU @ _about(2, -grid) @ _from_opk(*map(np.radians, a)))
    else:
        quaternion = np.stack(a, axis=-1)
        wrong = np.abs(np.linalg.norm(quaternion, axis=-1) - 1) > 1e-3
        if wrong.any():
            row = int(np.argmax(wrong))
            table.fail(row, "qx, qy, qz, qw", f"the length of the quaternion is {np.linalg.norm(quaternion[row]):.4g}, not 1")
    return Samples(position, quaternion, _velocity(table, ned))


def _velocity(table: Table, world_from_ned: np.ndarray) -> Float[np.ndarray, "n 3"] | None:
    local, world = (all(name in table for name in names) for names in VELOCITIES)
    if local and world:
        raise FlightError(f"{table.file}, line 1: velocities are given twice, as vn_mps and as vx_mps; keep one form")
    if local:
        return np.einsum("...ij,...j->...i", world_from_ned, np.stack([table[n] for n in VELOCITIES[0]], axis=-1))
    return np.stack([table[n] for n in VELOCITIES[1]], axis=-1) if world else None


def _world_from_ned(table: Table, position: np.ndarray, world: str) -> np.ndarray:
    if world == "local":
        return np.broadcast_to(_LOCAL_FROM_NED, (len(position), 3, 3))
    if "lat_deg" in table:
        return ecef_from_ned_matrices(np.radians(table["lat_deg"]), np.radians(table["lon_deg"]))
    lat, lon, _ = geodetic(position)
    return ecef_from_ned_matrices(lat, lon)


def _about(axis: int, angle: np.ndarray) -> Float[np.ndarray, "n 3 3"]:
    """Active rotations about x, y or z."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((*np.shape(angle), 3, 3))
    out[..., axis, axis] = 1.0
    out[..., i, i] = out[..., j, j] = np.cos(angle)
    out[..., j, i] = np.sin(angle)
    out[..., i, j] = -out[..., j, i]
    return out


def _from_opk(omega_rad, phi_rad, kappa_rad) -> Float[np.ndarray, "n 3 3"]:
    """Rx(omega) Ry(phi) Rz(kappa)."""
    return _about(0, omega_rad) @ _about(1, phi_rad) @ _about(2, kappa_rad)


_ecef_to_geodetic = jax.jit(ecef_to_geodetic)


def geodetic(position_m: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Latitude, longitude in radians and height of ECEF positions; NaN stays NaN."""
    lat, lon, height = _ecef_to_geodetic(jnp.asarray(position_m))
    return np.asarray(lat), np.asarray(lon), np.asarray(height)


# The rounding of ECEF coordinates (a degree is 111 km) and of what is computed from them: a height that was 52.718 stays so.
_PLACE_DEG, _HEIGHT_M, _ANGLE_DEG, _SPEED_MPS = 2e-14, 4e-9, 1e-13, 1e-12


def position_texts(position_m: Float[np.ndarray, "n 3"], world: str) -> dict[str, list[str]]:
    """Position columns: geodetic in ECEF worlds, x, y, z in local ones."""
    if world == "local":
        return dict(zip(CARTESIAN, (exact(c) for c in position_m.T), strict=True))
    lat, lon, height = geodetic(position_m)
    place = [rounded(np.degrees(a), _PLACE_DEG) for a in (lat, lon)]
    return dict(zip(GEODETIC, (*place, rounded(height, _HEIGHT_M, 10)), strict=True))


def sample_texts(s: Samples, world: str) -> Mapping[str, list[str]]:
    """Columns of positions, attitudes and velocities: people's form in ECEF worlds, exact quaternions in local ones."""
    columns = position_texts(s.position_m, world)
    if world == "local":
        columns |= dict(zip(ATTITUDE["quaternion"], (exact(c) for c in s.quaternion.T), strict=True))
        velocity, names = s.velocity_mps, VELOCITIES[1]
    else:
        lat, lon, _ = geodetic(s.position_m)
        ned_from_world = np.swapaxes(ecef_from_ned_matrices(lat, lon), -1, -2)
        angles = _roll_pitch_heading(ned_from_world @ matrices_from_quaternions(s.quaternion))
        columns |= dict(zip(ATTITUDE["roll_pitch_heading"], (rounded(np.degrees(a), _ANGLE_DEG) for a in angles), strict=True))
        velocity, names = s.velocity_mps, VELOCITIES[0]
        velocity = None if velocity is None else np.einsum("nij,nj->ni", ned_from_world, velocity)
    if velocity is not None:
        columns |= dict(zip(names, (rounded(c, _SPEED_MPS) for c in velocity.T), strict=True))
    return columns


def _roll_pitch_heading(r: Float[np.ndarray, "n 3 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of ned_from_body; near pitch +-90 deg, where roll and heading are one, heading first and roll from what is left."""
    heading = np.arctan2(r[:, 1, 0], r[:, 0, 0])
    s, c = np.sin(heading), np.cos(heading)
    pitch = np.arctan2(-r[:, 2, 0], np.hypot(r[:, 0, 0], r[:, 1, 0]))
    roll = np.arctan2(s * r[:, 0, 2] - c * r[:, 1, 2], c * r[:, 1, 1] - s * r[:, 0, 1])
    return roll, pitch, heading

"""Positions and attitudes in tables: every form in which they are written, as world positions and quaternions, and back."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.places import HEIGHT_LIMITS_M
from ..chain.rotations import Quaternion, quaternion_product
from ..chain.samples import (
    body_in_ned,
    ecef_from_ned_matrices,
    ecef_from_ned_vectors,
    ecef_positions,
    matrices_from_quaternions,
    ned_in_ecef,
    quaternions_in_blocks,
    turned,
)
from ..earth.ellipsoid import SEMI_MAJOR_M, SEMI_MINOR_M, ecef_to_geodetic
from ..earth.world import CARTESIAN, GEODETIC, World
from ..rules import FlightError
from .names import listed
from .sheet import Sheet
from .tables import Column, Table, exact, rounded

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
        Column("height_m", low=HEIGHT_LIMITS_M[0], high=HEIGHT_LIMITS_M[1], hint="metres above the ellipsoid are expected"),
        *(Column(name) for name in CARTESIAN),
        # Every angle within a turn is a rotation: the pitch of a gimbal that passes nadir is beyond -90.
        *(Column(name, low=-360, high=360, hint=_DEGREES) for name in ATTITUDE["roll_pitch_heading"]),
        *(Column(name, low=-360, high=360, hint=_DEGREES) for name in ATTITUDE["opk"]),
        Column("convergence_deg", required=False, low=-180, high=180, hint=_DEGREES),
        *(Column(name, low=-1.01, high=1.01, hint="a quaternion has length 1") for name in ATTITUDE["quaternion"]),
    )
}

# Level axes in a local world x east, y north, z up. North, east, down: half a turn about the diagonal of x and y.
_LOCAL: dict[str, Quaternion] = {"roll_pitch_heading": (np.sqrt(0.5), np.sqrt(0.5), 0, 0), "opk": (0, 0, 0, 1)}


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


def positions(table: Table, world: str) -> Float[np.ndarray, "n 3"]:
    """World positions of a table's rows; NaN where they are blank.

    **Raises:** `FlightError` where only a part of a position is blank, and where it cannot be one: no latitude and longitude but
    zeros among others that are elsewhere, or x, y, z of a wgs84 world that are not ECEF.
    """
    names = GEODETIC if "lat_deg" in table else CARTESIAN
    blank = np.stack([np.isnan(table[name]) for name in names], axis=-1)
    partly = blank.any(axis=1) & ~blank.all(axis=1)
    if partly.any():
        row = int(np.argmax(partly))
        table.fail(row, names[int(np.argmax(blank[row]))], "is blank while the rest of the position is given")
    if names is GEODETIC:
        _refuse_zeros(table)
        lat, lon, height = (table[name] for name in names)
        return ecef_positions(np.radians(lat), np.radians(lon), height)
    position = np.stack([table[name] for name in names], axis=-1)
    if world == "wgs84":
        _refuse_what_is_not_ecef(table, position)
    return position


def _refuse_zeros(table: Table) -> None:
    """Zeros are what many recorders write before they know where they are."""
    lat, lon = table["lat_deg"], table["lon_deg"]
    zero = (lat == 0) & (lon == 0)
    elsewhere = np.maximum(np.abs(lat), np.abs(lon)) > 1
    if zero.any() and elsewhere.any():
        row, other = int(np.argmax(zero)), int(np.argmax(elsewhere))
        what = f"both are exactly 0, while line {table.lines[other]} has {lat[other]:.10g}, {lon[other]:.10g}"
        table.fail(row, "lat_deg, lon_deg", f"{what}; zeros that stand for missing data have to be taken out{_how_many(zero)}")


def _refuse_what_is_not_ecef(table: Table, position_m: np.ndarray) -> None:
    radius = np.linalg.norm(position_m, axis=1)
    low, high = SEMI_MINOR_M + HEIGHT_LIMITS_M[0], SEMI_MAJOR_M + HEIGHT_LIMITS_M[1]
    wrong = ~((radius >= low) & (radius <= high)) & ~np.isnan(radius)
    if wrong.any():
        row = int(np.argmax(wrong))
        table.fail(
            row,
            ", ".join(CARTESIAN),
            f"{', '.join(f'{c:.10g}' for c in position_m[row])} lies {radius[row] / 1e3:.6g} km from the Earth's centre, but "
            f'positions in a wgs84 world are ECEF; coordinates of a map belong into a world of kind = "local", or have to be '
            f"converted{_how_many(wrong)}",
        )


def _how_many(rows: np.ndarray) -> str:
    return f" ({rows.sum()} of {len(rows)} lines)" if rows.sum() > 1 else ""


def samples(table: Table, world: str, angles: str) -> Samples:
    """World positions, attitudes and velocities of a table's rows.

    **Raises:** `FlightError` for a position that cannot be one, and for a quaternion whose length is not 1.
    """
    position, n = positions(table, world), len(table)
    lat, lon = _lat_lon(table, position, world, angles)
    a = [np.asarray(table[name]) for name in ATTITUDE[angles]]
    if angles == "quaternion":
        quaternion = np.stack(a, axis=-1)
        length = np.linalg.norm(quaternion, axis=-1)
        wrong = np.abs(length - 1) > 1e-3
        if wrong.any():
            row = int(np.argmax(wrong))
            table.fail(row, "qx, qy, qz, qw", f"the length of the quaternion is {length[row]:.4g}, not 1")
    else:
        level, turn = {"roll_pitch_heading": (ned_in_ecef, body_in_ned), "opk": (_enu_in_ecef, _opk)}[angles]
        place = (lat, lon)
        if world == "local":
            place, level = (), lambda: _LOCAL[angles]
        elif angles == "opk":
            place = (lat, lon, np.radians(table["convergence_deg"]) if "convergence_deg" in table else np.zeros(n))
        k = len(place)
        quaternion = quaternions_in_blocks(
            lambda *r: quaternion_product(level(*r[:k]), turn(*map(np.radians, r[k:]))), *place, *a
        )
    return Samples(position, quaternion, _velocity(table, world, lat, lon))


def _lat_lon(table: Table, position: np.ndarray, world: str, angles: str) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude in radians, where attitudes or velocities refer to the level of a wgs84 world; else nothing."""
    if world == "local" or (angles == "quaternion" and VELOCITIES[0][0] not in table):
        return np.zeros(0), np.zeros(0)
    if "lat_deg" in table:
        return np.radians(table["lat_deg"]), np.radians(table["lon_deg"])
    lat, lon, _ = geodetic(position)
    return lat, lon


def _velocity(table: Table, world: str, lat: np.ndarray, lon: np.ndarray) -> Float[np.ndarray, "n 3"] | None:
    local, xyz = (all(name in table for name in names) for names in VELOCITIES)
    if local and xyz:
        raise FlightError(f"{table.file}, line 1: velocities are given twice, as vn_mps and as vx_mps; keep one form")
    if not local:
        return np.stack([table[n] for n in VELOCITIES[1]], axis=-1) if xyz else None
    north, east, down = (table[n] for n in VELOCITIES[0])
    if world == "local":
        return np.stack([east, north, -down], axis=-1)
    return ecef_from_ned_vectors(lat, lon, np.stack([north, east, down], axis=-1))


def _enu_in_ecef(lat_rad: np.ndarray, lon_rad: np.ndarray, grid_rad: np.ndarray) -> Quaternion:
    """The level axes of a map's grid: east, north, up, turned clockwise by the meridian convergence."""
    return quaternion_product(
        quaternion_product(turned("z", lon_rad + np.pi / 2), turned("x", np.pi / 2 - lat_rad)), turned("z", -grid_rad)
    )


def _opk(omega_rad, phi_rad, kappa_rad) -> Quaternion:
    """Rx(omega) Ry(phi) Rz(kappa)."""
    return quaternion_product(quaternion_product(turned("x", omega_rad), turned("y", phi_rad)), turned("z", kappa_rad))


_ecef_to_geodetic = jax.jit(ecef_to_geodetic)


def geodetic(position_m: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Latitude, longitude in radians and height of ECEF positions; NaN stays NaN."""
    lat, lon, height = _ecef_to_geodetic(jnp.asarray(position_m))
    return np.asarray(lat), np.asarray(lon), np.asarray(height)


# The rounding of ECEF coordinates (a degree is 111 km) and of what is computed from them: a height that was 52.718 stays so.
_PLACE_DEG, _HEIGHT_M, _ANGLE_DEG, _SPEED_MPS = 2e-14, 4e-9, 1e-13, 1e-12


def position_texts(position_m: Float[np.ndarray, "n 3"], world: World) -> dict[str, list[str]]:
    """Position columns: geodetic in ECEF worlds, x, y, z in local ones."""
    if world.is_flat:
        return dict(zip(CARTESIAN, (exact(c) for c in position_m.T), strict=True))
    lat, lon, height = geodetic(position_m)
    place = [rounded(np.degrees(a), _PLACE_DEG) for a in (lat, lon)]
    return dict(zip(GEODETIC, (*place, rounded(height, _HEIGHT_M, 10)), strict=True))


def sample_texts(s: Samples, world: World) -> Mapping[str, list[str]]:
    """Columns of positions, attitudes and velocities: people's form in ECEF worlds, exact quaternions in local ones."""
    columns = position_texts(s.position_m, world)
    if world.is_flat:
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

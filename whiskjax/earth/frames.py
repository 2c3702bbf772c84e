"""Local frames at a point of the ellipsoid: north-east-down (NED) and east-north-up (ENU)."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.angles import sincos
from ..algebra.vectors import Component, Mat3, stack
from ..rules import Arrays, Numbers, require_x64
from .ellipsoid import take_lat_lon


def ecef_from_ned(lat_rad: Component, lon_rad: Component) -> Mat3:
    """Rotation whose columns are north, east and down in ECEF, as components."""
    (s, c), (sl, cl) = sincos(lat_rad), sincos(lon_rad)
    return ((-s * cl, -sl, -c * cl), (-s * sl, cl, -c * sl), (c, 0, -s))


def ecef_from_enu(lat_rad: Component, lon_rad: Component) -> Mat3:
    """Rotation whose columns are east, north and up in ECEF, as components."""
    (s, c), (sl, cl) = sincos(lat_rad), sincos(lon_rad)
    return ((-sl, -s * cl, c * cl), (cl, -s * sl, c * sl), (0, c, s))


def ned_rotation(lat_rad: Float[Numbers, "..."], lon_rad: Float[Numbers, "..."]) -> Float[Array, "... 3 3"]:
    """Rotation matrix ecef_from_ned at a geodetic latitude and longitude in radians; columns north, east, down."""
    require_x64("ned_rotation")
    return _as_array(ecef_from_ned, *take_lat_lon(Arrays("ned_rotation"), lat_rad, lon_rad))


def enu_rotation(lat_rad: Float[Numbers, "..."], lon_rad: Float[Numbers, "..."]) -> Float[Array, "... 3 3"]:
    """Rotation matrix ecef_from_enu at a geodetic latitude and longitude in radians; columns east, north, up."""
    require_x64("enu_rotation")
    return _as_array(ecef_from_enu, *take_lat_lon(Arrays("enu_rotation"), lat_rad, lon_rad))


def _as_array(frame: Callable[[Component, Component], Mat3], lat_rad: Array, lon_rad: Array) -> Float[Array, "... 3 3"]:
    lat, lon = jnp.broadcast_arrays(lat_rad, lon_rad)
    return jnp.stack([stack(row) for row in frame(lat, lon)], axis=-2)

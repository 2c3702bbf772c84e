"""WGS-84: geodetic <-> earth-centred earth-fixed (ECEF) coordinates.

World frame: ECEF, EPSG:4978; geodetic latitude, longitude and ellipsoidal height, EPSG:4979. Constants: NIMA TR8350.2.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.angles import sincos
from ..algebra.vectors import Component, Vec3, stack, unstack
from ..rules import Arrays, Numbers, require_x64

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1 - FLATTENING)
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
_SECOND_ECCENTRICITY2 = ECCENTRICITY2 / (1 - ECCENTRICITY2)


def ecef_from_geodetic(lat_rad: Component, lon_rad: Component, height_m: Component) -> Vec3:
    """ECEF components in metres of geodetic components."""
    (s, c), (sl, cl) = sincos(lat_rad), sincos(lon_rad)
    n = SEMI_MAJOR_M / jnp.sqrt(1 - ECCENTRICITY2 * s * s)
    r = (n + height_m) * c
    return r * cl, r * sl, (n * (1 - ECCENTRICITY2) + height_m) * s


def _parametric(p: Component, z: Component) -> tuple[Component, Component]:
    """Sine and cosine of the geodetic latitude of a meridian-plane point, p >= 0.

    Bowring (1976): tan(phi) = (z + e'^2 b sin^3(beta)) / (p - e^2 a cos^3(beta)), tan(beta) = (1 - f) tan(phi), iterated on
    pairs (sine, cosine), so that nothing overflows at the poles. Each pass gains more than three digits from 5000 km below the
    surface to beyond geostationary orbit; three leave rounding.
    """
    s, c = SEMI_MAJOR_M * z, SEMI_MINOR_M * p
    for _ in range(3):
        w = jax.lax.rsqrt(s * s + c * c)
        s, c = s * w, c * w
        s, c = (
            z + _SECOND_ECCENTRICITY2 * SEMI_MINOR_M * s * s * s,
            p - ECCENTRICITY2 * SEMI_MAJOR_M * c * c * c,
        )
        s = (1 - FLATTENING) * s
    s = s / (1 - FLATTENING)
    w = jax.lax.rsqrt(s * s + c * c)
    return s * w, c * w


def _height(p: Component, z: Component, s: Component, c: Component) -> Component:
    return p * c + z * s - SEMI_MAJOR_M * jnp.sqrt(1 - ECCENTRICITY2 * s * s)


@jax.custom_jvp
def height_and_up(x: Component, y: Component, z: Component) -> tuple[Component, Component, Component, Component]:
    """Geodetic height in metres and the unit normal of the ellipsoid (up) of an ECEF point, without trigonometry.

    The derivative of the height is the normal, exactly; the normal's own derivative (the curvature of the Earth, 1.6e-7 a
    metre) is carried too, so that derivatives of any order exist.
    """
    p = jnp.sqrt(x * x + y * y)
    s, c = _parametric(p, z)
    at_pole = p == 0
    w = c / jnp.where(at_pole, 1.0, p)
    return _height(p, z, s, c), x * w, y * w, s


@height_and_up.defjvp
def _height_and_up_jvp(primals, tangents):
    x, y, z = primals
    dx, dy, dz = tangents
    height, ux, uy, uz = height_and_up(x, y, z)
    c2 = ux * ux + uy * uy
    rise = ux * dx + uy * dy + uz * dz
    # Up turns by the tangential displacement over the principal radii: meridian M + h, prime vertical N + h.
    root = jnp.sqrt(1 - ECCENTRICITY2 * uz * uz)
    prime_vertical = SEMI_MAJOR_M / root + height
    meridian = SEMI_MAJOR_M * (1 - ECCENTRICITY2) / (root * root * root) + height
    at_pole = c2 == 0
    c2_safe = jnp.where(at_pole, 1.0, c2)
    # East displacement e = (-uy dx + ux dy) / c along (-uy, ux, 0) / c; what is left of the tangential part is north.
    east_over_c2 = (-uy * dx + ux * dy) / c2_safe
    east = jnp.where(at_pole, 0.0, -uy * east_over_c2), jnp.where(at_pole, 0.0, ux * east_over_c2)
    north = dx - rise * ux - east[0], dy - rise * uy - east[1], dz - rise * uz
    dux = east[0] / prime_vertical + north[0] / meridian
    duy = east[1] / prime_vertical + north[1] / meridian
    return (height, ux, uy, uz), (rise, dux, duy, north[2] / meridian)


@jax.custom_jvp
def geodetic_from_ecef(x: Component, y: Component, z: Component) -> tuple[Component, Component, Component]:
    """Latitude, longitude in radians and height in metres of ECEF components.

    The derivative is the closed form dlat = north . dx / (M + h), dlon = east . dx / ((N + h) cos(lat)), dh = up . dx, finite
    everywhere. At a pole the longitude is not defined; it is returned as atan2(y, x), and its derivative as zero.
    """
    p = jnp.sqrt(x * x + y * y)
    s, c = _parametric(p, z)
    return jnp.arctan2(s, c), jnp.arctan2(y, x), _height(p, z, s, c)


@geodetic_from_ecef.defjvp
def _geodetic_from_ecef_jvp(primals, tangents):
    x, y, z = primals
    dx, dy, dz = tangents
    lat, lon, height = geodetic_from_ecef(x, y, z)
    (s, c), (sl, cl) = sincos(lat), sincos(lon)
    root = jnp.sqrt(1 - ECCENTRICITY2 * s * s)
    meridian = SEMI_MAJOR_M * (1 - ECCENTRICITY2) / (root * root * root) + height
    p = jnp.sqrt(x * x + y * y)
    at_pole = p == 0
    east = -sl * dx + cl * dy
    outward = cl * dx + sl * dy
    d_lat = (c * dz - s * outward) / meridian
    d_lon = jnp.where(at_pole, 0.0, east / jnp.where(at_pole, 1.0, p))
    return (lat, lon, height), (d_lat, d_lon, c * outward + s * dz)


def geodetic_to_ecef(
    lat_rad: Float[Numbers, "..."], lon_rad: Float[Numbers, "..."], height_m: Float[Numbers, "..."]
) -> Float[Array, "... 3"]:
    """ECEF position of a geodetic position (WGS-84).

    **Arguments:**

    - `lat_rad`, `lon_rad`: geodetic latitude and longitude in radians, shape (...).
    - `height_m`: ellipsoidal height in metres, shape (...).

    **Returns:** ECEF x, y, z in metres, shape (..., 3).

    **Raises:** `RuntimeError` where float64 is off; `WhiskjaxError` for float32, shapes that do not fit, or degrees.
    """
    require_x64("geodetic_to_ecef")
    arrays = Arrays("geodetic_to_ecef")
    lat, lon = take_lat_lon(arrays, lat_rad, lon_rad)
    return stack(ecef_from_geodetic(lat, lon, jnp.asarray(arrays.take("height_m", height_m, "...", absolute=True))))


LAT_FIRST = "latitude before longitude"


def take_lat_lon(arrays: Arrays, lat_rad: Numbers, lon_rad: Numbers) -> tuple[Array, Array]:
    """Geodetic latitude and longitude as somebody's arguments of these names, (...) each.

    **Raises:** `WhiskjaxError` where they are no angles in radians, float32, or latitude beyond a pole.
    """
    lat = arrays.take("lat_rad", lat_rad, "...", absolute=True, within_rad=math.pi / 2, meaning=LAT_FIRST)
    lon = arrays.take("lon_rad", lon_rad, "...", absolute=True, within_rad=2 * math.pi)
    return jnp.asarray(lat), jnp.asarray(lon)


def ecef_to_geodetic(
    point_ecef_m: Float[Numbers, "... 3"],
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """Geodetic position of an ECEF position (WGS-84).

    Good to rounding from 5000 km below the surface outwards; nearer the centre a geodetic latitude is not unique.

    **Arguments:**

    - `point_ecef_m`: ECEF x, y, z in metres, shape (..., 3).

    **Returns:** latitude and longitude in radians, ellipsoidal height in metres, each of shape (...).

    **Raises:** `RuntimeError` where float64 is off; `WhiskjaxError` for float32 or another shape.

    **Reference:** Bowring (1976), Survey Review 23, 323-327.
    """
    require_x64("ecef_to_geodetic")
    point = Arrays("ecef_to_geodetic").take("point_ecef_m", point_ecef_m, "... 3", absolute=True)
    return geodetic_from_ecef(*unstack(jnp.asarray(point)))

"""What coordinates mean: an Earth-fixed world on the ellipsoid, or a flat one, and what is level and up in it."""

import dataclasses
import math

import jax
import numpy as np
from jaxtyping import Array, Float

from ..rules import Arrays, FlightError, Numbers
from .ellipsoid import ecef_to_geodetic
from .frames import enu_rotation
from .surface import AbstractSurface, HeightSurface, Plane

# The columns in which a position is written.
GEODETIC = ("lat_deg", "lon_deg", "height_m")
CARTESIAN = ("x_m", "y_m", "z_m")


@dataclasses.dataclass(frozen=True)
class World:
    """What coordinates mean: ECEF WGS-84 ("wgs84"), or a local Cartesian frame x east, y north, z up ("local").

    A local world may state its geodetic origin: latitude and longitude in degrees, ellipsoidal height in metres.
    """

    kind: str = "wgs84"
    origin: tuple[float, float, float] | None = None
    height_datum: str = "ellipsoidal"

    def __post_init__(self):
        if self.kind not in ("wgs84", "local"):
            raise FlightError(f"the world is 'wgs84' or 'local', not {self.kind!r}")
        if self.origin is not None:
            place = "latitude and longitude in degrees, height in metres"
            lat, lon, _ = Arrays("World").take("origin", self.origin, "3", finite=True, meaning=place)
            if not (abs(lat) <= 90 and abs(lon) <= 360):
                raise FlightError(f"World: origin is latitude and longitude in degrees and height in metres, not {self.origin}")
        if self.height_datum != "ellipsoidal":
            raise FlightError(f"height_datum {self.height_datum!r}: heights are ellipsoidal; convert them with your geoid first")

    @property
    def is_flat(self) -> bool:
        """Whether east, north and up are the axes everywhere, and no point has a latitude."""
        return self.kind == "local"

    def from_enu(self, position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
        """Rotations that take east, north, up at world positions to the world's axes; any rotation where a position is NaN."""
        if self.is_flat or len(position_m) == 0:
            return np.broadcast_to(np.eye(3), (len(position_m), 3, 3))
        return np.asarray(_ecef_from_enu(np.nan_to_num(position_m, nan=6.4e6)))

    def height_m(self, position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Ellipsoidal heights of world positions; z of a local world."""
        return position_m[:, 2] if self.is_flat else np.asarray(_height_m(position_m))

    def surface(self, height_m: float) -> AbstractSurface:
        """All points of one height."""
        return Plane((0.0, 0.0, height_m), (0.0, 0.0, 1.0)) if self.is_flat else HeightSurface(height_m)

    def plan_m(self, position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """East and north of world positions: x and y of a local world, else from the middle of those that are numbers."""
        if self.is_flat:
            return position_m[:, :2]
        middle = np.nanmean(position_m, axis=0)
        return ((position_m - middle) @ self.from_enu(middle[None])[0])[:, :2]

    def position(self, point_m: Float[Numbers, "3"]) -> dict[str, float]:
        """One point in the coordinates of a flight's files: degrees and ellipsoidal metres, or local metres."""
        if self.is_flat:
            return dict(zip(CARTESIAN, np.asarray(point_m).tolist(), strict=True))
        lat, lon, height = ecef_to_geodetic(point_m)
        return dict(zip(GEODETIC, (math.degrees(lat), math.degrees(lon), float(height)), strict=True))


WGS84 = World()


@jax.jit
def _height_m(point_m: Float[Numbers, "n 3"]) -> Float[Array, " n"]:
    return ecef_to_geodetic(point_m)[2]


@jax.jit
def _ecef_from_enu(point_m: Float[Numbers, "n 3"]) -> Float[Array, "n 3 3"]:
    lat, lon, _ = ecef_to_geodetic(point_m)
    return enu_rotation(lat, lon)

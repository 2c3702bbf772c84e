"""Points with coordinates in another order or of another height, and single points and images that are wrong."""

import dataclasses
from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ..chain.samples import ecef_positions
from ..earth.ellipsoid import ecef_to_geodetic
from ..flights.flight import Flight, Measurements
from .remedy import Amount, Remedy, constant

_TABLE = "points.csv"
_ecef_to_geodetic = jax.jit(ecef_to_geodetic)


def point_remedies(flight: Flight) -> Iterator[Remedy]:
    """All that is tried of the points' coordinates."""
    columns = ("x_m", "y_m") if flight.world.is_flat else ("lat_deg", "lon_deg")
    names = "x and y" if flight.world.is_flat else "latitude and longitude"
    yield Remedy(
        f"{names} of points exchanged",
        "points",
        f"In the points' coordinates {names} stand in each other's place.",
        _exchanged,
        constant(f"{_TABLE}: exchange the columns {columns[0]} and {columns[1]}"),
    )
    yield Remedy(
        "height of points",
        "height",
        "Heights of the points refer to another surface than those of POS: mean sea level, say, where the ellipsoid is meant.",
        lambda f, v: _lifted(f, float(v or 0.0)),
        lambda v: f"{_TABLE}: add {v or 0.0:+.3f} m to {'z_m' if flight.world.is_flat else 'height_m'}",
        Amount("m", 60.0, 1e-2),
    )


def wrong_ones(kind: str, names: Sequence[str]) -> Iterator[Remedy]:
    """Single images or points left out. **Arguments:** `kind`: "image" or "point"; `names`: those that are suspected."""
    what = {
        "image": "All measurements of the image {} disagree with those of the others.",
        "point": "All measurements of the point {} disagree with those of the others.",
    }[kind]
    where = {
        "image": "images.csv, lines.csv or poses.csv: look at the time, the pose and the keys of image {}; observations.csv: or "
        "leave its lines out",
        "point": "points.csv: look at the coordinates and the name of point {}; observations.csv: or leave its lines out",
    }[kind]
    for name in names:
        yield Remedy(
            f"{kind} {name} is wrong",
            f"a wrong {kind}",
            what.format(name),
            lambda f, _, name=name: _without(f, kind, name),
            constant(where.format(name)),
            without=(kind, name),
            oddity=2,
            pairs=False,
        )


def _exchanged(flight: Flight, _: float | None) -> Flight:
    position = np.asarray(flight.points.position_m)
    if flight.world.is_flat:
        return _placed(flight, position[:, [1, 0, 2]])
    new = np.full_like(position, np.nan)
    known = np.isfinite(position).all(axis=1)
    lat, lon, height = (np.asarray(c) for c in _ecef_to_geodetic(jnp.asarray(position[known])))
    new[known] = ecef_positions(lon, lat, height)
    return _placed(flight, new)


def _lifted(flight: Flight, by_m: float) -> Flight:
    position = np.asarray(flight.points.position_m)
    return _placed(flight, position + by_m * flight.world.from_enu(position)[:, :, 2])


def _placed(flight: Flight, position_m: np.ndarray) -> Flight:
    return dataclasses.replace(flight, points=dataclasses.replace(flight.points, position_m=position_m))


def _without(flight: Flight, kind: str, name: str) -> Flight:
    m = flight.measurements
    names = [image.name for image in flight.images] if kind == "image" else list(flight.points.names)
    index = m.image if kind == "image" else m.point
    return dataclasses.replace(flight, measurements=chosen(flight, np.asarray(index) != names.index(name)))


def chosen(flight: Flight, keep: np.ndarray) -> Measurements:
    """Some of a flight's measurements, by mask."""
    m = flight.measurements
    return dataclasses.replace(m, **{field.name: np.asarray(getattr(m, field.name))[keep] for field in dataclasses.fields(m)})

"""Read a flight folder."""

import os
from collections.abc import Callable
from pathlib import Path

from ..earth.world import World
from ..flights.flight import Flight
from ..rules import FlightError, WhiskjaxError, need, require_x64
from .chain_from_toml import Source, sensor_from_toml
from .check import check_flight
from .errors import errors_from_toml
from .flight_toml import NAME, load_flight_toml
from .images import images_of
from .measured import measurements_of, points_of
from .plain_names import check_names
from .unknowns import unknowns_from_toml


def read_flight(folder: str | Path) -> Flight:
    """Read a flight folder; docs/flight-folder.md explains every file and key.

    **Arguments:**

    - `folder`: holds flight.toml and the tables that it needs.

    **Returns:** the flight, checked: every measurement has a shot, and every point lies in front of its camera. What the tables
    hold beyond what a flight keeps (accuracies of POS samples), and what is odd in them, is named in its notes.

    **Raises:** `FlightError` naming the file, the line and the column (or the key) and what was expected; `RuntimeError` where
    float64 is off; `ImportError` where the extra "files" is not installed.
    """
    require_x64("read_flight")
    need("read_flight", "folder", folder, (str, os.PathLike))
    flight, place = read_unchecked(folder)
    check_flight(flight, place)
    return flight


def read_unchecked(folder: str | Path) -> tuple[Flight, Callable[[int], str]]:
    """A flight as its folder holds it, whether its shots can have imaged its points or not; and where measurements stand.

    **Raises:** as `read_flight`, but not where a point lies behind the camera, beyond the horizon, or outside the record.
    """
    folder = Path(folder)
    toml = load_flight_toml(folder)
    lat_lon_height = toml.world.origin
    origin = None if lat_lon_height is None else (lat_lon_height[0], lat_lon_height[1], lat_lon_height[2])
    try:
        world = World(toml.world.kind, origin, toml.world.height_datum)
    except WhiskjaxError as error:
        raise FlightError(f"{NAME}: world: {error}") from error
    source = Source(folder, toml)
    sensor = sensor_from_toml(source)
    images = images_of(source, sensor)
    points, point_table = points_of(source)
    measurements, table = measurements_of(source, images, point_table)
    flight = Flight(
        name=toml.name,
        sensor=sensor,
        images=images,
        points=points,
        measurements=measurements,
        unknowns=unknowns_from_toml(toml.unknown, sensor, source.first_centre),
        errors=errors_from_toml(toml.error, sensor),
        world=world,
        epoch=toml.epoch,
        reference_point=toml.pos.reference_point,
        notes="\n".join([*([toml.notes] if toml.notes else []), *source.left_out]),
    )
    check_names(flight)
    return flight, lambda i: f"{table.place(i)} (image {table['image'][i]}, point {table['point'][i]})"

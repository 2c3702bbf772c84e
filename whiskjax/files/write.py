"""Write a flight folder: whole, or not at all."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..flights.flight import Flight
from ..rules import FlightError, need, need_flags, require_x64
from .chain_to_toml import Tables, camera_to_toml, chain_to_toml, focal_per_image, max_gap_s, refraction_to_toml
from .errors import errors_to_toml
from .flight_toml import NAME
from .images import LINES
from .measured import OBSERVATIONS, POINTS, SIGMA_LINE_PX, SIGMA_LINES, SIGMAS
from .names import listed
from .navigation import position_texts
from .plain_names import check_names
from .source import IMAGES
from .tables import exact, table_text, texts
from .toml_text import toml_text
from .units import floats
from .unknowns import unknown_to_toml
from .whole_folder import check_before, whole_folder

_SUFFIXES = (".csv", ".sbet", ".out")


def write_flight(flight: Flight, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write a flight folder that `read_flight` reads back.

    **Arguments:**

    - `flight`: what to write.
    - `folder`: is created, with its parents; an empty one is filled.
    - `overwrite`: replace a folder that is a flight folder and nothing else.

    **Returns:** the folder. Everything is written beside it first and then takes its place in one step (`whole_folder`), so that
    no half of a flight is ever seen or left.
    In ECEF worlds positions are written as latitude, longitude, height and attitudes as roll, pitch, heading, good to the
    rounding of float64 (some 1e-9 m); in local ones as x, y, z and quaternions, exactly.

    **Raises:** `FlightError` where the folder is in the way, or where a link or camera has no form on disk.
    """
    require_x64("write_flight")
    need_flags("write_flight", overwrite=overwrite)
    need("write_flight", "flight", flight, Flight)
    need("write_flight", "folder", folder, (str, os.PathLike))
    with flight_folder(folder, overwrite=overwrite) as new:
        write_files(flight, new)
    return Path(os.path.abspath(folder))


def write_files(flight: Flight, folder: Path) -> None:
    """Every file of a flight into a folder that is there."""
    for name, text in flight_files(flight).items():
        (folder / name).write_text(text, encoding="utf-8", newline="")


@contextlib.contextmanager
def flight_folder(folder: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A new folder for the files of a flight, which takes the place of `folder` when the block ends well.

    **Raises:** `FlightError`, before the block begins, where the folder is in the way.
    """
    check_flight_place(folder, overwrite=overwrite)
    with whole_folder(folder, lambda old: _refuse_to_destroy(old, overwrite)) as new:
        yield new


def check_flight_place(folder: str | Path, *, overwrite: bool = False) -> None:
    """Refuse a place where no flight can be written, or where it would destroy something.

    **Raises:** `FlightError`.
    """
    check_before(folder, lambda old: _refuse_to_destroy(old, overwrite))


def _refuse_to_destroy(folder: Path, overwrite: bool) -> list[str]:
    """What is kept of a flight that is replaced: nothing; **raises** where that would be a loss."""
    there = sorted(folder.iterdir())
    if not there:
        return []
    if not (folder / NAME).is_file():
        raise FlightError(f"{folder} is not empty and not a flight folder; give another name")
    if not overwrite:
        raise FlightError(
            f"{folder} holds a flight already; give another name, or replace it with overwrite=True (simulate: --force)"
        )
    others = [p.name for p in there if p.is_dir() or (p.name != NAME and p.suffix not in _SUFFIXES)]
    if others:
        raise FlightError(f"{folder} holds more than a flight ({listed(others)}), which replacing it would delete; move it away")
    return []


def flight_files(flight: Flight) -> dict[str, str]:
    """Every file of the folder as text, by name."""
    check_names(flight)
    tables = Tables()
    chain = chain_to_toml(flight, tables)
    camera = camera_to_toml(flight.sensor.camera, tables)
    tables.texts |= {
        IMAGES: _images(flight),
        POINTS: _points(flight),
        OBSERVATIONS: _observations(flight),
    }
    if flight.is_line:
        tables.texts[LINES] = _lines(flight)
    world: dict[str, Any] = {"kind": flight.world.kind, "height_datum": flight.world.height_datum}
    if flight.world.origin is not None:
        world["origin"] = floats(flight.world.origin)
    pos: dict[str, Any] = {"angles": "quaternion" if flight.world.is_flat else "roll_pitch_heading"}
    if flight.reference_point:
        pos["reference_point"] = flight.reference_point
    if (gap := max_gap_s(flight.sensor)) is not None:
        pos["max_gap_s"] = gap
    toml: dict[str, Any] = {"format": 1, "name": flight.name, "epoch": flight.epoch, "notes": flight.notes}
    toml = {key: value for key, value in toml.items() if value != ""} | {"world": world, "pixel": {"first_pixel_centre": 0.0}}
    toml |= {"pos": pos, "chain": chain, "camera": camera}
    optional = {
        "unknown": [unknown_to_toml(u) for u in flight.unknowns] or None,
        "error": errors_to_toml(flight) or None,
        "refraction": refraction_to_toml(flight),
    }
    toml |= {key: value for key, value in optional.items() if value is not None}
    return {NAME: toml_text(toml)} | tables.finished()


def _images(flight: Flight) -> str:
    images = flight.images
    columns = {"image": [image.name for image in images]}
    optional = {key: texts(getattr(image, key) for image in images) for key in ("view", "swing", "strip")}
    optional["time_s"] = exact([np.nan if image.time_s is None else image.time_s for image in images])
    optional["focal_px"] = focal_per_image(flight)
    optional |= {key: texts(getattr(image, key) for image in images) for key in ("rows", "columns")}
    return table_text(columns | {name: column for name, column in optional.items() if any(column)})


def _lines(flight: Flight) -> str:
    columns: dict[str, list[str]] = {"image": [], "line": [], "time_s": []}
    for image in flight.images:
        if image.lines is None:
            raise FlightError(f"image {image.name} has no line times, but the camera is a line camera")
        columns["image"] += [image.name] * image.lines.line.shape[0]
        columns["line"] += exact(image.lines.line)
        columns["time_s"] += exact(image.lines.time_s)
    return table_text(columns)


def _points(flight: Flight) -> str:
    points = flight.points
    sigma = dict(zip(SIGMAS, (exact(c) for c in np.asarray(points.sigma_enu_m).T), strict=True))
    position = position_texts(np.asarray(points.position_m), flight.world)
    return table_text({"point": list(points.names)} | position | sigma | {"role": list(points.roles)})


def _observations(flight: Flight) -> str:
    m = flight.measurements
    if not flight.is_line and m.is_in_lines.any():
        raise FlightError(f"measurement {int(np.argmax(m.is_in_lines))}: sigma_lines is of line cameras; give sigma_line_px")
    # Each sigma in the unit in which it was given: how many pixels a line is follows from the chain.
    sigmas = {SIGMA_LINE_PX: ~m.is_in_lines.all(), SIGMA_LINES: m.is_in_lines.any()}
    return table_text(
        {
            "image": texts(flight.images[i].name for i in m.image),
            "point": texts(flight.points.names[i] for i in m.point),
            "line": exact(m.line_px),
            "sample": exact(m.sample_px),
            **{name: exact(getattr(m, name)) for name, given in sigmas.items() if given},
            "sigma_sample_px": exact(m.sigma_sample_px),
        }
    )

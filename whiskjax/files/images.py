"""images.csv and lines.csv: which images there are, when they were exposed, and the keys of their shots."""

from typing import Any

import numpy as np

from ..chain.by import By
from ..chain.lines import LineTimes
from ..chain.sensor import Sensor
from ..chain.shot import KEYS
from ..chain.trajectory import PosePerImage
from ..flights.flight import Image
from ..rules import FlightError
from . import cautions
from .flight_toml import NAME
from .names import listed, meant
from .source import IMAGES, Source
from .tables import Column, Table, check_increasing

LINES = "lines.csv"


def images_of(source: Source, sensor: Sensor) -> list[Image]:
    """The images, with their times or their lines.

    **Raises:** `FlightError` for a swing, view or strip that the sensor does not have, for an image without the time that the
    chain needs, and for lines that do not increase.
    """
    table, keys, line_camera = source.images, sensor.key_names(), has_lines(sensor)
    lines = _lines(source) if line_camera else {}
    if not line_camera and (source.folder / LINES).exists():
        raise FlightError(f"{LINES} is given, but the camera is a frame camera, which has no lines; remove the file")
    timed_links = (name for name, link in zip(sensor.names, sensor.links, strict=True) if link.is_timed)
    timed = None if line_camera else next(timed_links, None)
    images = []
    for row, name in enumerate(table["image"]):
        key_of = {key: name if key == "image" else table.text(row, key) for key in KEYS}
        for key, value in key_of.items():
            _check_key(table, row, key, value, keys)
        time = table.number(row, "time_s")
        if timed and time is None:
            table.fail(row, "time_s", f"is blank, but the link {timed!r} changes with time: when was {name} exposed?")
        if line_camera and name not in lines:
            table.fail(row, "image", f"image {name!r} has no lines in {LINES}; a line camera needs at least two")
        columns, rows = (None if (n := table.number(row, size)) is None else int(n) for size in ("columns", "rows"))
        swing, view, strip = (key_of[key] for key in ("swing", "view", "strip"))
        images.append(Image(name, time, lines.get(name), swing, view, strip, columns, rows))
    _check_image_order(sensor, table)
    return images


def has_lines(sensor: Sensor) -> bool:
    """Whether the images are made of lines.

    **Raises:** `FlightError` where some cameras are line cameras and others are not.
    """

    def kinds(camera: Any) -> set[bool]:
        return set().union(*map(kinds, camera.options)) if isinstance(camera, By) else {camera.is_line}

    found = kinds(sensor.camera)
    if len(found) > 1:
        raise FlightError(f"{NAME}: camera: all options are frame cameras, or all are line cameras")
    return found.pop()


def _check_key(table: Table, row: int, key: str, name: str | None, keys: dict[str, tuple[str, ...]]) -> None:
    known = keys.get(key)
    if known is None:
        return
    if name is None:
        table.fail(row, key, f"is blank, but the sensor has one link or camera for each {key}; fill in {listed(known)}")
    if name not in known:
        table.fail(row, key, f"no {key} named {name!r}{meant(name, known)}; the sensor in {NAME} has {listed(known)}")


def _check_image_order(sensor: Sensor, table: Table) -> None:
    """Poses and zoom are stored in the order of images.csv; options told apart by image must follow the same order."""
    names = sensor.key_names().get("image")
    by_row = any(isinstance(link, PosePerImage) for link in sensor.links) or "focal_px" in table
    if names is not None and by_row and list(names) != table["image"]:
        raise FlightError(f"{NAME}: the options by image must be the images of {IMAGES}, in its order: {listed(table['image'])}")


def _lines(source: Source) -> dict[str, LineTimes]:
    """The line times of each image; lines in the numbering whose first one is 0."""
    columns = [Column("image", text=True), Column("line"), Column("time_s")]
    table = source.sheet(LINES, "a line camera").parse(columns)
    rows: dict[str, list[int]] = {}
    names = source.images["image"]
    for row, name in enumerate(table["image"]):
        if name not in names:
            table.fail(row, "image", f"no image named {name!r}{meant(name, names)}; {IMAGES} has {listed(names)}")
        rows.setdefault(name, []).append(row)
    out = {}
    for name, index in rows.items():
        if len(index) < 2:
            table.fail(index[0], "line", f"image {name} has a single line; at least two tell the times between them")
        for column in ("line", "time_s"):
            check_increasing(table, column, np.array(index), f"image {name}: ")
        out[name] = LineTimes(table["line"][index] - source.first_centre, table["time_s"][index], name)
    source.note(cautions.of_lines(table, rows.values()))
    return out

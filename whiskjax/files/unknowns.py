"""[[unknown]]: what is to be estimated, in the units of files and in those of the sensor."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..chain.address import is_in_degrees, make_room
from ..chain.sensor import Sensor
from ..estimate.unknown import Unknown, admit
from ..rules import FlightError, WhiskjaxError
from .flight_toml import NAME
from .units import degrees, file_words, inner_place, is_angle, is_pixel_place

if TYPE_CHECKING:
    from .schema import UnknownTable


def unknowns_from_toml(entries: "list[UnknownTable]", sensor: Sensor, first_centre: float) -> list[Unknown]:
    """The unknowns in radians and in the pixel numbering from 0, every place tried on the sensor.

    **Raises:** `FlightError` naming the entry whose place does not exist, is used twice, or shares a number with another unit.
    """
    out = []
    for i, entry in enumerate(entries):
        try:
            out.append(_unknown(entry, sensor, first_centre))
        except WhiskjaxError as error:
            where = ", ".join(entry.where)
            reason = file_words(str(error)).removeprefix(f"{where}: ")
            raise FlightError(f"{NAME}: unknown[{i}] ({entry.name}): where = {where}: {reason}") from error
    if out:
        try:
            admit(sensor, out)
        except WhiskjaxError as error:
            raise FlightError(f"{NAME}: {file_words(str(error))}") from error
    return out


def _unknown(entry: "UnknownTable", sensor: Sensor, first_centre: float) -> Unknown:
    places = [inner_place(text) for text in entry.where]
    first = places[0]
    if len({(is_angle(place), is_pixel_place(place)) for place in places}) > 1:
        raise FlightError("these places share one number, but differ in unit")
    factor = float(np.radians(1.0)) if is_angle(first) else 1.0
    offset = first_centre if is_pixel_place(first) else 0.0
    mean = None if entry.prior_mean is None else (entry.prior_mean - offset) * factor
    sigma, scale = (None if v is None else v * factor for v in (entry.prior_sigma, entry.scale))
    unknown = Unknown(entry.name, first if len(places) == 1 else tuple(places), mean, sigma, scale)
    for place in unknown.places:
        make_room(sensor, place)
    return unknown


def unknown_to_toml(unknown: Unknown) -> dict[str, Any]:
    """One entry of [[unknown]]."""
    where = [place.text for place in unknown.places]
    shown = degrees if is_in_degrees(where[0]) else float
    values = {"prior_mean": unknown.mean, "prior_sigma": unknown.sigma, "scale": unknown.scale}
    numbers = {key: shown(value) for key, value in values.items() if value is not None}
    return {"name": unknown.name, "where": where if len(where) > 1 else where[0]} | numbers

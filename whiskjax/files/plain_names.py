"""Names are text that people read, in files, terminals, pages and maps: what none of these can hold is refused at the door."""

import re
from collections.abc import Iterable, Mapping

from ..flights.flight import Flight
from ..rules import FlightError
from .flight_toml import NAME
from .measured import POINTS
from .source import IMAGES

# Control characters (a terminal obeys them, XML has none) but for tab and new line, halves of characters, and no characters.
_ODD = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def check_names(flight: Flight) -> None:
    """Refuse a flight one of whose names holds a character that cannot be shown.

    **Raises:** `FlightError` naming the file, the name and the character.
    """
    images = flight.images
    keys = {f"{key} of an image": {getattr(i, key) for i in images} - {None} for key in ("swing", "view", "strip")}
    options = [name for names in flight.sensor.key_names().values() for name in names]
    _check(IMAGES, {"image": [image.name for image in images], **keys})
    _check(POINTS, {"point": flight.points.names})
    unknowns = [unknown.name for unknown in flight.unknowns]
    own = {"name of the flight": [flight.name], "epoch": [flight.epoch], "reference_point": [flight.reference_point]}
    _check(NAME, own | {"frame": flight.sensor.names, "option": options, "unknown": unknowns})


def has_odd(text: str) -> bool:
    """Whether a text holds a character that cannot be shown."""
    return _ODD.search(text) is not None


def _check(file: str, names: Mapping[str, Iterable[str]]) -> None:
    for kind, these in names.items():
        for name in these:
            if found := _ODD.search(name):
                raise FlightError(
                    f"{file}: {kind} {name!r} holds the character U+{ord(found[0]):04X}, which no table, page or map can show; "
                    "remove it"
                )

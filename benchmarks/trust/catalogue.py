"""Every way to be wrong, of all verbs."""

import dataclasses
import sys
from collections.abc import Sequence

from . import block_ways, calibration_ways, target_ways
from .way import Way

# Ways of other shapes or other programs than the rest.
_LONG = {
    "calibrate": ("POS late", "attitude late", "scan read late", "index of", "turns in the other order", "axes y x -z", "copies"),
    "adjust": ("control listed twice", "each ray twice", "rays of half an image off, snooped", "rays scattered, 5 %, snooped"),
    "locate": (
        "clean, gated",
        "clean, race",
        "first five",
        "last 25",
        "last five",
        "looks scattered, 10 %, gated",
        "errors last",
    ),
}


def _marked(verb: str, ways: Sequence[Way]) -> tuple[Way, ...]:
    return tuple(dataclasses.replace(way, is_long=way.name.startswith(_LONG[verb])) for way in ways)


CATALOGUE: dict[str, tuple[Way, ...]] = {
    "calibrate": _marked("calibrate", (*calibration_ways.CLEAN, *calibration_ways.WAYS)),
    "adjust": _marked("adjust", (*block_ways.CLEAN, *block_ways.WAYS)),
    "locate": _marked("locate", (*target_ways.CLEAN, *target_ways.WAYS)),
}


def chosen(verbs: Sequence[str], names: Sequence[str], short: bool = False) -> list[Way]:
    """Ways of these verbs whose name begins with one of `names`; without names all of them, but for long ones of a short run."""
    ways = [way for verb in verbs for way in CATALOGUE[verb]]
    if not names:
        return [way for way in ways if not (short and way.is_long)]
    found = [way for way in ways if way.name.startswith(tuple(names))]
    if not found:
        sys.exit(f"no way begins with {', '.join(names)}; there are: {'; '.join(way.name for way in ways)}")
    return found

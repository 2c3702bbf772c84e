"""Every way to be wrong, of all verbs."""

import sys
from collections.abc import Sequence

from . import block_ways, calibration_ways, target_ways
from .way import Way

CATALOGUE: dict[str, tuple[Way, ...]] = {
    "calibrate": (*calibration_ways.CLEAN, *calibration_ways.WAYS),
    "adjust": (*block_ways.CLEAN, *block_ways.WAYS),
    "locate": (*target_ways.CLEAN, *target_ways.WAYS),
}


def chosen(verbs: Sequence[str], names: Sequence[str]) -> list[Way]:
    """Ways of these verbs whose name begins with one of `names`; without names all of them."""
    ways = [way for verb in verbs for way in CATALOGUE[verb]]
    found = [way for way in ways if way.name.startswith(tuple(names))] if names else ways
    if not found:
        sys.exit(f"no way begins with {', '.join(names)}; there are: {'; '.join(way.name for way in ways)}")
    return found

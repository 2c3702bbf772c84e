"""How accurate check points have to be for a map: limits by scale and terrain, as Wang et al. (2018) print them."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple


@dataclasses.dataclass(frozen=True)
class Standard:
    """Limits of the RMSE of check points in metres; None is no limit. In planimetry it is that of east and north together."""

    name: str
    planimetry_m: float | None = None
    height_m: float | None = None


class Limit(NamedTuple):
    """Largest RMSE of check points, metres: in planimetry and in height."""

    planimetry_m: float
    height_m: float


@dataclasses.dataclass(frozen=True)
class Profile:
    """A standard to be met: limits by map scale (1 to ...) and terrain. Make your own, or `dataclasses.replace` this one."""

    name: str
    limits: Mapping[tuple[int, str], Limit]

    def standard(self, scale: int, terrain: str) -> Standard:
        """What a map of this scale has to meet on this terrain; a `KeyError` where the profile has no such limit."""
        return Standard(f"{self.name}, 1:{scale}, {terrain}", *self.limits[scale, terrain])


_TERRAINS = ("flat", "hilly", "mountainous", "alpine")
_TABLE_7 = {  # flat ground has a second limit in height, 0.15 in brackets, at 1000 and 2000
    1000: ((0.5, 0.5, 0.7, 0.7), (0.28, 0.4, 0.6, 1.2)),
    2000: ((1.0, 1.0, 1.4, 1.4), (0.28, 0.4, 1.0, 1.5)),
    5000: ((1.75, 1.75, 2.5, 2.5), (0.3, 1.0, 2.0, 2.5)),
}
PROFILE = Profile(
    "GB/T 23236, as printed in Wang et al. (2018), Table 7",
    {(scale, ground): Limit(*pair) for scale, rows in _TABLE_7.items() for ground, *pair in zip(_TERRAINS, *rows, strict=True)},
)

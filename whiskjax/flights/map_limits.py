"""How accurate check points have to be for a map: limits by scale and terrain, as Wang et al. (2018) print them."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple


class Limit(NamedTuple):
    """Largest RMSE of check points, metres: in planimetry and in height."""

    planimetry_m: float
    height_m: float


@dataclasses.dataclass(frozen=True)
class Profile:
    """A standard to be met: limits by map scale (1 to ...) and terrain. Make your own, or `dataclasses.replace` this one."""

    name: str
    limits: Mapping[tuple[int, str], Limit]


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

"""One figure of a study: asked and reached, and what all of them say together."""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple


class Figure(NamedTuple):
    """One figure: what the paper prints (empty: nothing), the band (None: none), what was reached, in its unit."""

    section: str
    what: str
    unit: str
    paper: str
    low: float | None
    high: float | None
    reached: float

    @property
    def has_band(self) -> bool:
        """Whether something was asked."""
        return self.low is not None or self.high is not None

    @property
    def is_inside(self) -> bool:
        """Whether the figure lies in its band."""
        low, high = -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high
        return low <= self.reached <= high

    def as_row(self) -> dict[str, Any]:
        """As plain data, for results.json: None where nothing was reached, and of `is_inside` where nothing was asked."""
        reached = self.reached if math.isfinite(self.reached) else None
        return self._asdict() | {"reached": reached, "is_inside": self.is_inside if self.has_band else None}


def verdict_of(figures: Iterable[Figure], said: Callable[[Figure], str]) -> dict[str, Any]:
    """How many figures have a band, and which lie outside; `said` names one for people."""
    banded = [f for f in figures if f.has_band]
    outside = [said(f) for f in banded if not f.is_inside]
    return {
        "is_inside": not outside,
        "word": "as the bands ask" if not outside else "not in every band",
        "bands": len(banded),
        "bands_inside": len(banded) - len(outside),
        "outside": outside,
    }

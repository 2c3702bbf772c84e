"""One figure of a study: asked and reached."""

import math
from typing import NamedTuple


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

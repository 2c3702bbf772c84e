"""What whiskjax is held against: one figure, its band, and who says that it must lie in it."""

import dataclasses
import json
from collections.abc import Sequence


@dataclasses.dataclass(frozen=True)
class Figure:
    """One claim about one peer, in numbers.

    **Arguments:** `claim`: what is compared with what; `value`: the largest difference, or what is counted; `most`, `least`: the
    band; `source`: who sets the band.
    """

    claim: str
    value: float
    unit: str
    most: float
    source: str
    least: float = 0.0

    @property
    def is_inside(self) -> bool:
        """Whether the value lies in its band; what is no number does not."""
        return bool(self.least <= self.value <= self.most)

    @property
    def band(self) -> str:
        """The band, for people."""
        return f"{self.most:g}" if self.least == self.most else f"{self.least:g} to {self.most:g}"


def assert_inside(figures: Sequence[Figure]) -> None:
    """Fail with every figure that lies outside its band."""
    assert figures
    outside = [f"{f.claim}: {f.value:.6g} {f.unit}, band {f.band} ({f.source})" for f in figures if not f.is_inside]
    assert not outside, "\n".join(outside)


def as_json(figures: Sequence[tuple[str, Figure]]) -> str:
    """The same for programs."""
    rows = [
        {"set": peer, "what": f.claim, "value": f.value, "unit": f.unit, "low": f.least or None, "high": f.most}
        | {"is_inside": f.is_inside, "source": f.source}
        for peer, f in figures
    ]
    return json.dumps(rows, indent=1) + "\n"


def table(figures: Sequence[tuple[str, Figure]]) -> str:
    """Peer, claim, figure and band in columns, as text."""
    rows = [("peer", "claim", "figure", "unit", "band", "the band is", "")]
    rows += [(p, f.claim, f"{f.value:.3g}", f.unit, f.band, f.source, "" if f.is_inside else "OUTSIDE") for p, f in figures]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths[:-1]), *lines[1:]])

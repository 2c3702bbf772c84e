"""Figures that are asked of a correct implementation, beside those that whiskjax reaches."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path


@dataclasses.dataclass(frozen=True)
class Figure:
    """One figure of one set.

    **Arguments:** `asked`: the largest value allowed, or None for a figure that is only told; `exactly`: the one value allowed.
    """

    set: str
    what: str
    reached: float
    unit: str
    asked: float | None = None
    exactly: bool = False

    @property
    def is_met(self) -> bool:
        """Whether it is as good as asked."""
        if self.asked is None:
            return True
        return self.reached == self.asked if self.exactly else self.reached <= self.asked

    @property
    def asked_text(self) -> str:
        """What is asked, for people."""
        return "" if self.asked is None else f"{'' if self.exactly else '<= '}{self.asked:g}"


@dataclasses.dataclass(frozen=True)
class Reached:
    """The figures of a set, the folders that they come from, and sentences that belong beside them."""

    figures: Sequence[Figure]
    folders: Sequence[Path]
    notes: Sequence[str]


def table(figures: Sequence[Figure]) -> str:
    """Asked and reached, side by side, as text."""
    rows = [("set", "figure", "asked", "reached", "unit", "")]
    rows += [(f.set, f.what, f.asked_text, f"{f.reached:.3g}", f.unit, "" if f.is_met else "NOT MET") for f in figures]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [c.rjust(w) if i in (2, 3) else c.ljust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join([lines[0], "  ".join("-" * w for w in widths[:-1]), *lines[1:]])


def as_json(figures: Sequence[Figure]) -> str:
    """The same for programs."""
    rows = [
        {"set": f.set, "what": f.what, "value": f.reached, "unit": f.unit}
        | {"low": f.asked if f.exactly else None, "high": f.asked, "is_inside": bool(f.is_met)}
        for f in figures
    ]
    return json.dumps(rows, indent=1) + "\n"

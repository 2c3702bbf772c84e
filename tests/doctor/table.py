"""Whether the right remedy comes first."""

import dataclasses

from tests.doctor.spoils import Spoil, is_cure
from whiskjax.doctor.examine import examine


@dataclasses.dataclass(frozen=True)
class Row:
    """One mistake on one flight: what came first, and whether it was right; `is_told` where the data show the mistake at all."""

    scene: str
    mistake: str
    best: tuple[str, ...]
    is_right: bool
    is_told: bool
    factor: float
    given: float | None

    @property
    def text(self) -> str:
        mark = "right" if self.is_right else "WRONG"
        mark = mark if self.is_told else "-"
        given = "   none" if self.given is None else f"{self.given:7.2f}"
        return f"{self.scene:10} {self.mistake:28} {mark:5} {given} -> {self.factor:5.2f}  {', '.join(self.best[:6])}"


def diagnosed(scene: str, sound, spoil: Spoil) -> Row | None:
    """None where the mistake cannot be made."""
    flight = spoil.make(sound)
    if flight is None:
        return None
    found = examine(flight)
    best = tuple(each.name for each in found.best)
    right = any(is_cure(spoil, name) for name in best)
    told = found.as_given is None or found.as_given.place > 1 or not right
    # What the flight explains as it is, though nothing tried could better it, is no mistake that the data show.
    if found.as_given is not None and found.as_given.place == 1 and found.as_given.factor < 1.1:
        told = False
    return Row(scene, spoil.name, best, right, told, found.best[0].factor, found.as_given and found.as_given.factor)


def share(rows) -> tuple[int, int]:
    """In how many the right remedy is first, of how many."""
    told = [row for row in rows if row.is_told]
    return sum(row.is_right for row in told), len(told)

"""What every part of a sensor is: fields that hold numbers, which a place names."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Float


class AbstractPart(eqx.Module):
    """A link, a camera, or what one is made of. It answers for its own fields, so that nobody has to ask what kind it is."""

    # Fields that say what the part is, or where it is recorded: signs, sizes, sample times. They are no unknowns.
    given: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def may_hold(cls, field: str) -> bool:
        """Whether a field may hold an unknown, now or as one of the ints that stand for exact numbers: 0, or 1."""
        return field not in cls.given and not any(f.name == field and f.metadata.get("static") for f in dataclasses.fields(cls))

    def absent(self, field: str) -> Float[np.ndarray, "..."] | None:
        """What None in a field means, as an array that can hold an unknown; None where no number means the same."""
        return None

"""A remedy: one thing that people get wrong, undone."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from jaxtyping import Float

from ..flights.flight import Flight


@dataclasses.dataclass(frozen=True)
class Amount:
    """The number that a remedy estimates, where it has one.

    **Arguments:**

    - `unit`: for people; `shown` turns the number inside into theirs.
    - `sigma`: how far it may plausibly be from `mean`: the 1-sigma of a prior that keeps it from explaining what it cannot be.
    - `step`: for the derivative, taken by a difference; a step of it moves the image by little.
    - `guess`: where the search begins, from the flight and where its points are imaged in it as it stands, (n, 2) px.
    - `least`, `most`: beyond them the amount is never looked for.
    """

    unit: str
    sigma: float
    step: float
    mean: float = 0.0
    shown: Callable[[float], float] = float
    guess: Callable[[Flight, Float[Any, "n 2"]], float] | None = None
    least: float = -math.inf
    most: float = math.inf

    def inside(self, whitened: float) -> float:
        """The amount of a whitened number, (amount - mean) / sigma, between its limits."""
        return min(max(self.mean + self.sigma * whitened, self.least), self.most)


@dataclasses.dataclass(frozen=True)
class Remedy:
    """One thing that people get wrong, undone.

    **Arguments:**

    - `name`: for people and results, as "sign of roll".
    - `group`: what it is about; two remedies of one group are never tried together.
    - `sentence`: what would have been wrong.
    - `change`: from a flight and the amount (None without one) to the flight as it would be without the mistake.
    - `advice`: which line of flight.toml, or which column of which table, to change, and to what, by the amount.
    - `amount`: what is estimated along with it.
    - `without`: measurements of this ("image" or "point", name) are left out.
    - `oddity`: of remedies that explain the data alike the less odd is named first.
    - `pairs`: whether it is also tried together with others.
    """

    name: str
    group: str
    sentence: str
    change: Callable[[Flight, float | None], Flight]
    advice: Callable[[float | None], str]
    amount: Amount | None = None
    without: tuple[str, str] | None = None
    oddity: int = 1
    pairs: bool = True

    def apply(self, flight: Flight, value: float | None = None) -> Flight:
        """The flight without the mistake.

        **Arguments:** `value`: the amount, in the remedy's own unit (inside: metres, radians, pixels); by default its mean.
        """
        return self.change(flight, self.amount.mean if value is None and self.amount is not None else value)

    def also(self, other: "Remedy") -> "Remedy":
        """Both, this one first; of the two only one may have an amount.

        The amount goes to whichever of them has one.
        """
        amount = self.amount or other.amount
        first, second = (lambda v, r=r: v if r.amount is not None else None for r in (self, other))
        return Remedy(
            f"{self.name} and {other.name}",
            f"{self.group} + {other.group}",
            f"{self.sentence} {other.sentence}",
            lambda flight, v: other.change(self.change(flight, first(v)), second(v)),
            lambda v: f"{self.advice(first(v))}; {other.advice(second(v))}",
            amount,
            self.without or other.without,
            self.oddity + other.oddity,
            False,
        )


def constant(text: str) -> Callable[[float | None], str]:
    """Advice that no amount changes."""
    return lambda _: text


def degrees(value_rad: float) -> float:
    """An angle for people."""
    return math.degrees(value_rad)


AS_GIVEN = Remedy("as given", "nothing", "Nothing is changed.", lambda flight, _: flight, constant("nothing to change"), oddity=0)

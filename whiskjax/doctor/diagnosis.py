"""What the doctor found: remedies in the order in which they explain the data."""

import dataclasses
from collections.abc import Mapping, Sequence

from ..estimate.reason import Reason, by_weight, is_sound, warnings
from ..flights.flight import Flight
from .remedy import Remedy

# Residuals this many times as large as their sigmas are no noise any more.
NOISE = 3.0
# Remedies whose chi-squares differ by less are not told apart by the data.
ALIKE = 25.0


@dataclasses.dataclass(frozen=True)
class Finding:
    """A remedy, and how well it explains the data.

    - `remedy`: what would have been wrong; `advice`: the line of flight.toml or the column of a table to change.
    - `place`: 1 for the best; remedies that the data do not tell apart share one.
    - `residual_before_px`, `residual_after_px`: length of the median residual with the remedy, at the start values and fitted;
      None where no point is imaged.
    - `chi_square`, `freedom`: of the robust fit, with its priors; a blunder counts little.
    - `cost`: what ranks: the chi-square, what was left out or is not imaged, and by how much the sigmas grew.
    - `value`, `value_sigma`, `unit`: of what the remedy estimates, or None; `amount` the value as `remedy.apply` takes it.
    - `strays`: unknowns that end far from where the flight says they are, with how far, for people.
    """

    remedy: Remedy
    place: int
    advice: str
    residual_before_px: float | None
    residual_after_px: float | None
    chi_square: float
    freedom: int
    cost: float
    value: float | None = None
    value_sigma: float | None = None
    unit: str = ""
    amount: float | None = None
    strays: Sequence[str] = ()

    @property
    def name(self) -> str:
        """Of the remedy."""
        return self.remedy.name

    @property
    def factor(self) -> float:
        """How many times as large as their sigmas the residuals are."""
        return (max(self.chi_square, 0.0) / self.freedom) ** 0.5 if self.freedom > 0 else float("inf")

    @property
    def explains(self) -> bool:
        """Whether what is left looks like noise."""
        return self.factor <= NOISE

    def apply(self, flight: Flight) -> Flight:
        """The flight with this changed, ready to be written."""
        return self.remedy.apply(flight, self.amount)


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """What `examine` found.

    - `flight`: as it was given; `observations`: how many measurements were looked at, of how many with coordinates.
    - `findings`: in order, the best first; "as given" is among them where it could be tried at all.
    - `as_given`: that one, or None; `refused`: why remedies could not be tried, by their names.
    - `tried`: how many remedies and pairs of them were.
    """

    flight: Flight
    findings: Sequence[Finding]
    as_given: Finding | None
    observations: int
    of_observations: int
    tried: int
    refused: Mapping[str, str]
    remarks: Sequence[str] = ()

    @property
    def best(self) -> Sequence[Finding]:
        """Those that share the first place."""
        return [found for found in self.findings if found.place == 1]

    @property
    def is_sound(self) -> bool:
        """Whether the flight, as it was given, explains its measurements, and nothing else explains them better."""
        return is_sound(self.reasons)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what is wrong, or might be."""
        return warnings(self.reasons)

    @property
    def reasons(self) -> Sequence[Reason]:
        """What was found, in sentences."""
        return by_weight([*self._verdict(), *self._strays(), *(Reason("scope", "note", r, {}) for r in self.remarks)])

    def _verdict(self) -> list[Reason]:
        given, best = self.as_given, self.best
        found = []
        if given is not None and given.place == 1:
            told = f"residuals are {given.factor:.2g} times their sigmas ({self.tried} changes tried)"
            if given.explains:
                found.append(Reason("as given", "note", f"as given: nothing explains the data better; {told}", {}))
            else:
                text = f"nothing that was tried explains the data: as given, {told}"
                found.append(Reason("as given", "failure", text, {"factor": given.factor}))
            return found
        if not best:
            return [Reason("as given", "failure", "nothing could be tried: " + next(iter(self.refused.values()), ""), {})]
        names = " or ".join(each.name for each in best[:4]) + (f" ({len(best)} in all)" if len(best) > 4 else "")
        left = f"leaves residuals of {best[0].factor:.2g} times their sigmas"
        was = "could not even be tried" if given is None else f"{given.factor:.3g} times as given"
        word = "explains the data" if best[0].explains else "explains the data best, but not well"
        return [Reason("remedy", "failure", f"{names} {word}: it {left} ({was})", {"names": [each.name for each in best]})]

    def _strays(self) -> list[Reason]:
        found = []
        for each in self.best[:1]:
            for stray in each.strays:
                text = (
                    f"{each.name}: {stray}: an unknown that ends so far from its start often stands for axes or signs that differ"
                )
                found.append(Reason("stray", "caution", text, {}))
        return found

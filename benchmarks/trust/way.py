"""A way to be wrong: what is done to a scene whose truth is known, and who is to blame."""

import dataclasses
from collections.abc import Callable
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

import whiskjax as wj

Case = TypeVar("Case")
Kind = Literal["scored", "clean", "blind"]


class Judged(NamedTuple):
    """An answer beside the truth.

    - `reasons`: its verdict, or None where the verb refused the data, in words (`refusal`) or by a foreign error (`crashed`).
    - `names`, `error_sigmas`: of the unknowns, (estimate less truth) / predicted sigma.
    - `ground`, `ground_freedom`: joint chi-square of the ground points, of that many degrees of freedom.
    """

    reasons: tuple[wj.Reason, ...] | None
    names: tuple[str, ...] = ()
    error_sigmas: tuple[float, ...] = ()
    ground: float = 0.0
    ground_freedom: int = 0
    refusal: str = ""
    crashed: bool = False


class Spoiled(NamedTuple, Generic[Case]):
    """What a verb is given, and the names of which one has to be named."""

    case: Case
    culprits: tuple[str, ...] = ()


Spoil = Callable[[Any, np.random.Generator], Spoiled[Any]]


class Scene(Protocol[Case]):
    """A verb on data whose truth is known. All draws have one shape, so that nothing is compiled twice."""

    @property
    def verb(self) -> str: ...

    def draw(self, seed: int, noise: bool) -> Case:
        """Truth from the priors, errors as stated; without noise everything is exact, and the priors' means are the truth."""
        ...

    def judged(self, case: Case) -> Judged:
        """The verb's answer, beside the truth."""
        ...

    def misfit(self, case: Case) -> float:
        """Chi-square of residuals, priors and check points at the optimum, weighed as the case states."""
        ...


def nothing(case: Any, rng: np.random.Generator) -> Spoiled:
    """Clean data stay clean."""
    return Spoiled(case)


@dataclasses.dataclass(frozen=True)
class Way:
    """One way to be wrong, or none.

    - `kind`: "scored": a verdict has to notice; "clean": it has to be content; "blind": nothing in the data can tell, and a
      caution that names the number is all that can be asked.
    - `spoil`: of the case and a generator that is the same with noise and without.
    - `witness`: what the best test gains besides the shift of means, which is measured: of errors that are larger, smaller or
      more alike than stated, from the case without noise; `shifts`: whether means move at all.
    - `is_long`: it compiles programs of its own, and has no place in a short run.
    """

    name: str
    scene: Scene[Any]
    spoil: Spoil = nothing
    kind: Kind = "scored"
    witness: Callable[[Any], float] | None = None
    shifts: bool = True
    is_long: bool = False

    @property
    def verb(self) -> str:
        """What is asked to answer."""
        return self.scene.verb

"""Names for people beside arrays for computers."""

from collections.abc import Sequence
from typing import Any


class Labels:
    """Names of images, points or strips: any two are alike to a compiler, so that no name is part of what is compiled for.

    A static field of a pytree is compared whenever a compiled function is looked up; flights that differ in names alone would
    each be compiled anew.
    """

    def __init__(self, **names: Sequence[str]):
        self._names = {kind: tuple(str(name) for name in of) for kind, of in names.items()}

    def __getitem__(self, kind: str) -> tuple[str, ...]:
        return self._names[kind]

    def __repr__(self) -> str:
        return ", ".join(f"{len(of)} {kind}" for kind, of in self._names.items())

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, Labels)

    def __hash__(self) -> int:
        return hash(Labels)

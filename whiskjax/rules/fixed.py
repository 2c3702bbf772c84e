"""Arrays of the host that are part of what is compiled for: indices, roles, keys."""

from typing import Any

import numpy as np


class Fixed:
    """Host arrays as a static field of a pytree: two are alike where they hold the same, whoever made them.

    Numbers belong into leaves, which may be traced; what a computation branches on, or indexes with on the host, belongs here.
    """

    def __init__(self, **arrays: Any):
        self._arrays = {name: None if value is None else _held(value) for name, value in arrays.items()}
        self._hash: int | None = None

    def __getitem__(self, name: str) -> Any:
        return self._arrays[name]

    def changed(self, **arrays: Any) -> "Fixed":
        """The same with other arrays in some places."""
        return Fixed(**{**self._arrays, **arrays})

    def __repr__(self) -> str:
        return ", ".join(f"{name} {value.shape}" for name, value in self._arrays.items() if value is not None)

    def __eq__(self, other: Any) -> bool:
        if self is other:
            return True
        return isinstance(other, Fixed) and self._arrays.keys() == other._arrays.keys() and hash(self) == hash(other)

    def __hash__(self) -> int:
        if self._hash is None:
            parts = [
                (name, None if value is None else (value.shape, value.dtype.str, value.tobytes()))
                for name, value in self._arrays.items()
            ]
            self._hash = hash(tuple(parts))
        return self._hash


def _held(value: Any) -> np.ndarray:
    """A copy that nobody can write to."""
    array = np.array(value)
    array.setflags(write=False)
    return array

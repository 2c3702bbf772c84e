"""The one check of every array that enters a public class or function: numbers, shape and precision, refused in our own words."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .errors import WhiskjaxError
from .precision import is_traced


class Arrays:
    """Takes the arrays of one class or function, whose sizes have to fit each other.

    A shape is written as in jaxtyping: "n 3" (the same n in every array of one owner), "... 2" (any batch; the batches of one
    owner have to broadcast), "" (one number).

    **Arguments:** `owner`: the class or function, first word of every message.
    """

    def __init__(self, owner: str):
        self._owner = owner
        self._sizes: dict[str, tuple[int, str]] = {}
        self._batch: tuple[int, ...] = ()

    def take(self, name: str, value: Any, shape: str, *, absolute: bool = False, finite: bool = False, meaning: str = "") -> Any:
        """An argument as float64 (float32 where x64 is off): a JAX array as such, all else as a numpy array.

        **Arguments:**

        - `absolute`: coordinates, times or records, which float32 would spoil without saying so: it is refused.
        - `finite`: refuse what is infinite or not a number (not seen while tracing).
        - `meaning`: what the entries are, told where the shape is wrong ("k1, k2, k3, p1, p2").

        **Raises:** `WhiskjaxError` naming the owner, the argument and what was expected.
        """
        array = value if isinstance(value, jax.Array) else self._numbers(name, value)
        if jnp.issubdtype(array.dtype, jnp.floating):
            if absolute and array.dtype != jnp.float64:
                self._refuse(
                    name,
                    f"has dtype {array.dtype}: half a metre at the Earth's radius, hundredths of a second in a "
                    "week are lost in it; keep it in float64 from where it was read",
                )
        elif not jnp.issubdtype(array.dtype, jnp.integer):
            self._refuse(name, f"has dtype {array.dtype}; real numbers are expected")
        self._fit(name, tuple(array.shape), shape.split(), meaning)
        if finite and not is_traced(array) and not np.isfinite(np.asarray(array)).all():
            first = tuple(int(i) for i in np.argwhere(~np.isfinite(np.asarray(array)))[0])
            self._refuse(name, "is not a finite number" if first == () else f"holds no finite number at index {first}")
        if isinstance(array, jax.Array):
            return array.astype(float)
        return array.astype(jax.dtypes.canonicalize_dtype(np.float64))

    def _numbers(self, name: str, value: Any) -> np.ndarray:
        if value is None:
            self._refuse(name, "is None; numbers are expected")
        try:
            leaves = jax.tree.leaves(value)
            return jnp.asarray(value) if any(is_traced(leaf) for leaf in leaves) else np.asarray(value)
        except (TypeError, ValueError) as error:
            return self._refuse(name, f"cannot be read as an array of numbers: {value!r}"[:200], error)

    def _fit(self, name: str, found: tuple[int, ...], wanted: list[str], meaning: str) -> None:
        batched = wanted[:1] == ["..."]
        inner = wanted[1:] if batched else wanted
        split = len(found) - len(inner)
        told = f"expected ({', '.join(wanted)}{',' * (len(wanted) == 1)})" + (f": {meaning}" if meaning else "")
        if split < 0 or (split > 0 and not batched):
            self._refuse(name, f"has shape {found}, {told}")
        for size, dimension in zip(found[split:], inner, strict=True):
            if dimension.isdigit():
                if size != int(dimension):
                    self._refuse(name, f"has shape {found}, {told}")
                continue
            known, who = self._sizes.setdefault(dimension, (size, name))
            if size != known:
                self._refuse(name, f"has shape {found}, {told} with {dimension} = {known} as {who} has")
        try:
            self._batch = np.broadcast_shapes(self._batch, found[:split])
        except ValueError:
            self._refuse(name, f"has the batch shape {found[:split]}, which does not broadcast with {self._batch} of the others")

    def _refuse(self, name: str, what: str, cause: Exception | None = None):
        raise WhiskjaxError(f"{self._owner}: {name} {what}") from cause

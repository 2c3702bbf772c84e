"""The one check of every array that enters a public class or function: numbers, shape and precision, refused in our own words."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .errors import WhiskjaxError
from .precision import is_traced

# What a public argument may be given as: an array, a number, or numbers in tuples and lists.
Numbers: TypeAlias = ArrayLike | Sequence[float] | Sequence[Sequence[float]]


# Indices and counts are kept in 32 bits: beyond them, a number would come back as another one.
_LARGEST = 2**31 - 1


class Arrays:
    """Takes the arrays of one class or function, whose sizes have to fit each other.

    A shape is written as in jaxtyping: "n 3" (the same n in every array of one owner), "... 2" (any batch; the batches of one
    owner have to broadcast), "" (one number). Shapes and precision are seen while tracing; what numbers are is not.

    **Arguments:** `owner`: the class or function, first word of every message.
    """

    def __init__(self, owner: str):
        self._owner = owner
        self._sizes: dict[str, tuple[int, str]] = {}
        self._batch: tuple[int, ...] = ()
        self._batched = ""

    def take(
        self,
        name: str,
        value: Any,
        shape: str,
        *,
        optional: bool = False,
        absolute: bool = False,
        finite: bool = False,
        above: float | None = None,
        least: float | None = None,
        within_rad: float | None = None,
        meaning: str = "",
    ) -> Any:
        """An argument as float64 (float32 where x64 is off): a JAX array as such, all else as a numpy array.

        **Arguments:**

        - `optional`: None is left alone.
        - `absolute`: coordinates, times or records, which float32 would spoil without saying so: it is refused.
        - `finite`: refuse what is infinite or not a number.
        - `above`, `least`: refuse what is not larger than, or smaller than this number.
        - `within_rad`: an angle that is never further from zero than this; beyond it, it must have been given in degrees.
        - `meaning`: what the entries are, told where the shape or the unit is wrong ("k1, k2, k3, p1, p2").

        **Raises:** `WhiskjaxError` naming the owner, the argument and what was expected.
        """
        if optional and value is None:
            return None
        array = self._array(name, value)
        if np.issubdtype(array.dtype, np.timedelta64):  # which numpy counts among the integers, in whatever unit it has
            self.refuse(name, f"has dtype {array.dtype}; numbers are expected: divide by np.timedelta64(1, 's') for seconds")
        if jnp.issubdtype(array.dtype, jnp.floating):
            if absolute and jnp.finfo(array.dtype).bits < 64:
                self.refuse(
                    name,
                    f"has dtype {array.dtype}: half a metre at the Earth's radius, hundredths of a second in a "
                    "week are lost in it; keep it in float64 from where it was read",
                )
        elif not jnp.issubdtype(array.dtype, jnp.integer):
            self.refuse(name, f"has dtype {array.dtype}; real numbers are expected")
        self.fit(name, tuple(array.shape), shape, meaning)
        array = array.astype(jax.dtypes.canonicalize_dtype(np.float64), copy=False)
        if not is_traced(array) and (finite or above is not None or least is not None or within_rad is not None):
            self._ask(name, np.asarray(array), finite, above, least, within_rad, meaning)
        return array

    def take_whole(self, name: str, value: Any, shape: str, *, meaning: str = "an index") -> Any:
        """Whole numbers, as they are; `meaning` says what for."""
        array = self._array(name, value)
        if not jnp.issubdtype(array.dtype, jnp.integer) or np.issubdtype(array.dtype, np.timedelta64):
            self.refuse(name, f"has dtype {array.dtype}, but it is {meaning}: whole numbers are expected")
        if not is_traced(array) and array.size:
            for extreme in (int(np.asarray(array).min()), int(np.asarray(array).max())):
                if abs(extreme) > _LARGEST:
                    self.refuse(name, f"holds {extreme}, but it is {meaning}, and none is beyond {_LARGEST}")
        self.fit(name, tuple(array.shape), shape)
        return array

    def take_flags(self, name: str, value: Any, shape: str) -> Any:
        """True or False; numbers 0 and 1 are refused, since they also are indices."""
        array = self._array(name, value)
        if array.dtype != np.bool_:
            self.refuse(name, f"has dtype {array.dtype}; True or False is expected of each")
        self.fit(name, tuple(array.shape), shape)
        return array

    def take_choice(self, name: str, value: Any, n: int) -> np.ndarray:
        """Which of n: a mask (n,), or indices; as indices."""
        array = np.asarray(self._array(name, value))
        if array.dtype == np.bool_:
            self.fit(name, array.shape, str(n), "a mask, True for each that is meant")
            return np.flatnonzero(array)
        index = np.asarray(self.take_whole(name, array if array.size else array.astype(int), "chosen"))
        wrong = index[(index < -n) | (index >= n)]
        if wrong.size:
            self.refuse(name, f"holds the index {wrong[0]}, but there are {n}")
        return np.arange(n)[index]

    def fit(self, name: str, found: tuple[int, ...], shape: str, meaning: str = "") -> None:
        """Whether the shape of an array that was taken elsewhere fits those taken here.

        **Raises:** as `take`.
        """
        if shape == "..." and found in ((), self._batch):
            return
        wanted = shape.split()
        batched = wanted[:1] == ["..."]
        inner = wanted[1:] if batched else wanted
        split = len(found) - len(inner)
        told = f"expected ({', '.join(wanted)}{',' * (len(wanted) == 1)})" + (f": {meaning}" if meaning else "")
        if split < 0 or (split > 0 and not batched):
            self.refuse(name, f"has shape {found}, {told}")
        for size, dimension in zip(found[split:], inner, strict=True):
            if dimension.isdigit():
                if size != int(dimension):
                    self.refuse(name, f"has shape {found}, {told}")
                continue
            known, who = self._sizes.setdefault(dimension, (size, name))
            if size != known:
                self.refuse(name, f"has shape {found}, {told} with {dimension} = {known} as {who} has")
        try:
            batch = np.broadcast_shapes(self._batch, found[:split])
        except ValueError:
            self.refuse(
                name, f"has the batch shape {found[:split]}, which does not broadcast with {self._batch} of {self._batched}"
            )
        if batch != self._batch:
            self._batch, self._batched = batch, name

    def refuse(self, name: str, what: str, cause: Exception | None = None) -> Any:
        """**Raises:** `WhiskjaxError`: the owner, the argument, and what is wrong with it."""
        raise WhiskjaxError(f"{self._owner}: {name} {what}") from cause

    def _array(self, name: str, value: Any) -> Any:
        """The argument as an array of whatever it holds."""
        if isinstance(value, jax.Array):
            return value
        if value is None:
            self.refuse(name, "is None; numbers are expected")
        if isinstance(value, np.ma.MaskedArray) and value.mask.any():
            self.refuse(name, "is a masked array, and what lies under the mask would be read as numbers; take the others only")
        try:
            leaves = jax.tree.leaves(value) if isinstance(value, list | tuple) else []
            return jnp.asarray(value) if any(map(is_traced, leaves)) else np.asarray(value)
        except (TypeError, ValueError) as error:
            return self.refuse(name, f"cannot be read as an array of numbers: {value!r}"[:200], error)

    def _ask(
        self,
        name: str,
        array: np.ndarray,
        finite: bool,
        above: float | None,
        least: float | None,
        within_rad: float | None,
        meaning: str,
    ) -> None:
        """Refuse numbers that cannot be meant, naming the first."""

        def ask(fine: Any, say: Callable[[str], str]) -> None:
            if not fine.all():
                place = tuple(int(i) for i in np.argwhere(~fine)[0])
                number = f"{float(array[place]):g}"
                self.refuse(name, say(f"is {number}" if place == () else f"is {number} at index {place}"))

        if finite and not np.isfinite(array).all():
            place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            self.refuse(name, "is not a finite number" if place == () else f"holds no finite number at index {place}")
        if above is not None:
            ask(array > above, lambda found: f"{found}; it must be above {above:g}")
        if least is not None:
            ask(array >= least, lambda found: f"{found}; it must be {least:g} or more")
        if within_rad is not None:
            # Not a number is not the business of this question.
            far = np.abs(array) > within_rad * (1 + 1e-12)
            told = "radians are expected, not degrees (np.radians)" + (f"; {meaning}" if meaning else "")
            ask(~far, lambda found: f"{found}, beyond +-{within_rad:.4f}: {told}")

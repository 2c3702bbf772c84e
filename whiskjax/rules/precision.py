"""float64 where float32 would be wrong without saying so, and the difference between tracing and computing."""

from typing import Any

import jax
import jax.core
import jax.numpy as jnp
import numpy as np


def require_x64(what: str) -> None:
    """Refuse to work in float32.

    Absolute coordinates in float32 are wrong by 0.45 m (6.4e6 m at 24 bits) and epochs by minutes, silently.

    **Raises:** `RuntimeError` with the one line to paste.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            f"{what} needs float64: float32 would be wrong by half a metre without saying so. Paste this before the "
            'first use of jax:\n    import jax; jax.config.update("jax_enable_x64", True)'
        )


def is_traced(value: Any) -> bool:
    """Whether an array is a tracer, whose number is not known yet."""
    return isinstance(value, jax.core.Tracer)


def plain(array: Any) -> Any:
    """A numpy array, or what is traced."""
    return array if is_traced(array) else np.asarray(array)


def on_device(array: Any) -> Any:
    """An array where compiled functions find it again and again; unlike `jnp.asarray` it compiles nothing."""
    return array if is_traced(array) else jax.device_put(np.asarray(array))


def arrays_of(tree: Any) -> Any:
    """The module that reckons with these arrays: `jax.numpy` where one is traced, else `numpy`, which compiles nothing."""
    return jnp if any(map(is_traced, jax.tree.leaves(tree))) else np

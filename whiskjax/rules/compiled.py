"""Compiled functions: made quickly where there is little to compute, and well where there is much."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from .precision import arrays_of

# What the compiler leaves out: half of its time goes into code that is run a few times over a few hundred numbers.
_QUICKLY = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_use_fusion_emitters": False,
}
_OFTEN = _QUICKLY | {"xla_backend_optimization_level": 1}
_LITTLE = 4096


def compiled(of: Callable[..., Any], size: Callable[..., int], often: bool = False) -> Callable[..., Any]:
    """A function compiled when it is called, as `equinox.filter_jit` does; the numbers are the same to rounding.

    **Arguments:** `size`: of the arguments, how many numbers its loops run over; up to some thousands it is compiled in less than
    half of the time, and runs for milliseconds longer; `often`: it runs again and again, and is compiled so that it takes no
    longer, in half of the time.
    """
    options: Any = {"compiler_options": _OFTEN if often else _QUICKLY}
    quickly, well = eqx.filter_jit(of, **options), eqx.filter_jit(of)

    def call(*given: Any) -> Any:
        if arrays_of(given) is jnp:  # it becomes part of what is traced, compiled as that is
            return well(*given)
        return (quickly if size(*given) <= _LITTLE else well)(*given)

    return call

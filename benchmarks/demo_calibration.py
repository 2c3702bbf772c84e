"""CPU seconds of the bundled flight: the first calibration in a process, the next ones, and the derivative of all by all.

Run in a process of its own, without a persistent compilation cache:

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.demo_calibration
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import whiskjax as wj

_AGAIN, _STEP_M = 10, 0.05
# The derivative is a large program that runs for milliseconds.
_COMPILED: Any = {
    "xla_backend_optimization_level": 1,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_use_fusion_emitters": False,
}


def by_points(flight: wj.Flight) -> Callable[[Float[Array, " m"]], Float[Array, " k"]]:
    """What is estimated, in prior sigmas, as a function of shifts of the control points, three a point, in metres."""
    seen = flight.observations()
    control = np.flatnonzero(seen.is_control)
    size = np.array([x.size for x in flight.unknowns])

    def estimated(shift_m: Float[Array, " m"]) -> Float[Array, " k"]:
        point_m = jnp.asarray(seen.point_m).at[control].add(shift_m.reshape(-1, 3))
        moved = dataclasses.replace(seen, point_m=point_m)
        return wj.calibrate(flight.sensor, moved, flight.unknowns).estimate.value / size

    return estimated


def differences(of: Callable[[Array], Array], size: int, which: int) -> np.ndarray:
    """By one of the shifts, extrapolated from two steps (Richardson)."""
    along = np.zeros(size)
    along[which] = _STEP_M

    def of_step(times: float) -> np.ndarray:
        return np.asarray(of(jnp.asarray(times * along)) - of(jnp.asarray(-times * along))) / (2 * times * _STEP_M)

    return (4 * of_step(1.0) - of_step(2.0)) / 3


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    flight = wj.read_flight("examples/haian")
    seen = flight.observations()

    def took(of: Callable[[], Any]) -> float:
        start = time.process_time()
        jax.block_until_ready(of())
        return time.process_time() - start

    first, *again = (took(lambda: wj.calibrate(flight.sensor, seen, flight.unknowns).estimate.value) for _ in range(1 + _AGAIN))
    print(f"calibrate, first     {first:7.2f} CPU s")
    print(f"calibrate, again     {1e3 * np.median(again):7.1f} CPU ms")
    estimated = by_points(flight)
    of, jacobian = (jax.jit(f, compiler_options=_COMPILED) for f in (estimated, jax.jacrev(estimated)))
    shift = jnp.zeros(3 * int(seen.is_control.sum()))
    print(f"derivative, first    {took(lambda: jacobian(shift)):7.2f} CPU s")
    print(f"derivative, again    {1e3 * np.median([took(lambda: jacobian(shift)) for _ in range(_AGAIN)]):7.1f} CPU ms")
    found = np.asarray(jacobian(shift))
    which = np.linspace(0, found.shape[1] - 1, 12).astype(int)
    off = max(np.abs(differences(of, len(shift), k) - found[:, k]).max() for k in which)
    k, m = found.shape
    print(f"{k} unknowns by {m} coordinates, {len(which)} of them against differences: {off / np.abs(found).max():.1e}")


if __name__ == "__main__":
    main()

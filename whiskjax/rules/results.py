"""One enumeration of numerical failures for the whole library.

A member survives `jit` and `vmap` as an integer array; its value is the message. Doors (public functions) return it and,
outside `jit`, raise it unless `throw=False`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .errors import SensorError
from .precision import plain


class RESULTS(eqx.Enumeration):
    """How a computation ended; `RESULTS[item]` is the message."""

    successful = ""
    ray_misses_ground = "the ray misses the ground: it points above the horizon, or away from the surface"
    time_outside_trajectory = "the time lies outside the recorded samples, and nothing is extrapolated"
    time_in_gap = "the time lies in a gap of the recorded samples longer than max_gap_s, which is not bridged"
    unknown_key = "the shot's image, swing, view or strip index is not one that the sensor has"
    point_behind_camera = "the point lies behind the camera"
    no_focal_length = (
        "the focal length is not positive: the image is turned by 180 degrees or mirrored, or a sign of an axis is another"
    )
    outside_swath = "the point is not seen within the given time window or detector"
    line_stands_still = (
        "from line to line the image moves across the detector by less than a hundredth of a pixel: the line does not say where "
        "the point lies; give the sigma in pixels, or leave the measurement out"
    )
    seen_more_than_once = "the point is seen more than once within the given time window: give a narrower window"
    distortion_not_invertible = "the pixel lies outside the radius where the lens distortion can be undone"
    not_converged = "the iteration did not converge; look at the start values, the weights and blunders"
    depth_unobservable = (
        "the looks do not determine the distance: all come from one point, or nearly so, and the target lies anywhere on a line; "
        "add looks from elsewhere"
    )
    diverged = (
        "the filter diverged: it does not end where least squares of the same looks does; use the iterated filter or the batch, "
        "or a better first guess"
    )
    rank_deficient = "the observations and priors do not determine these unknowns"
    nonfinite = "a value became infinite or not a number"


def choose(condition: Bool[Array, "..."] | bool, chosen: RESULTS, otherwise: RESULTS) -> RESULTS:
    """`jnp.where` for results: element by element, where `RESULTS.where` takes one condition only."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), chosen, otherwise)


def first_failure(*results: RESULTS) -> RESULTS:
    """The first result that is not a success, element by element (shapes broadcast)."""
    found, *rest = results
    for result in rest:
        found = choose(is_successful(found), result, found)
    return found


def failure_if(condition: Bool[Array, "..."] | bool, failure: RESULTS) -> RESULTS:
    """`failure` where the condition holds, success elsewhere."""
    return choose(condition, failure, RESULTS.successful)


def is_successful(result: RESULTS) -> Bool[Array, "..."]:
    """Where the computation ended well."""
    return result == RESULTS.successful


def codes_of(result: RESULTS) -> Any:
    """The integers behind a result, of its shape; 0 is success."""
    return plain(jax.tree.leaves(result)[0])


def message_of(code: int) -> str:
    """The message of one integer code."""
    return RESULTS[jax.tree.map(lambda _: np.asarray(code, dtype=np.int32), RESULTS.successful)]


def raise_failures(result: RESULTS, doing: str) -> None:
    """Raise `SensorError` naming every kind of failure, its count and its first index; silent while tracing.

    **Arguments:**

    - `result`: any shape.
    - `doing`: what was attempted, for the message ("project").
    """
    if result.is_traced():
        return
    codes = codes_of(result)
    if not codes.any():
        return
    if codes.ndim == 0:
        raise SensorError(f"{doing}: {message_of(int(codes))}")
    kinds = []
    for code in np.unique(codes[codes != 0]):
        where = np.argwhere(codes == code)
        first = tuple(int(i) for i in where[0])
        kinds.append(f"{len(where)} of {codes.size} ({message_of(int(code))}; first at index {first})")
    raise SensorError(f"{doing}: " + "; ".join(kinds) + ". Pass throw=False to get the result codes instead.")

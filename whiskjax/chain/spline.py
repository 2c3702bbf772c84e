"""Cubic splines through recorded samples: one for each piece of a record between two gaps.

Slopes at the samples are found once; between two samples a spline is then the cubic that meets value and slope at
both, and evaluating it costs a few loads and products.
"""

from collections.abc import Iterator
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.tridiagonal import tridiagonal_solver
from ..algebra.vectors import Component
from ..rules import WhiskjaxError, arrays_of

Interpolation: TypeAlias = Literal["linear", "cubic"]


def check_interpolation(what: str, interpolation: str) -> Interpolation:
    """The choice itself.

    **Raises:** `WhiskjaxError` where it is none; `what` begins the message.
    """
    if interpolation == "linear" or interpolation == "cubic":
        return interpolation
    raise WhiskjaxError(f"{what}: interpolation is 'linear' or 'cubic', not {interpolation!r}")


def hermite(
    w: Float[Array, "..."],
    start: Component,
    end: Component,
    leave: Component,
    arrive: Component,
) -> Component:
    """The cubic in w from `start` at 0 to `end` at 1 with the slopes `leave` and `arrive`, per unit of w."""
    u = 1 - w
    return start + w * w * (3 - 2 * w) * (end - start) + w * u * u * leave - w * w * u * arrive


def pieces(is_gap: Bool[np.ndarray, " n-1"]) -> Iterator[slice]:
    """The samples of each piece, from gap to gap: one sample or more."""
    ends = np.flatnonzero(is_gap) + 1
    for start, stop in zip([0, *ends], [*ends, len(is_gap) + 1], strict=True):
        yield slice(int(start), int(stop))


def spline_slopes(
    time_s: Float[np.ndarray, " n"], value: Float[Any, "n m"], is_gap: Bool[np.ndarray, " n-1"]
) -> Float[Any, "n m"]:
    """Slopes at the samples, per second, with which the second derivative is continuous inside each piece.

    At both ends of a piece the third derivative is continuous across the second sample ("not a knot", de Boor 1978, chapter IV):
    then cubics are met exactly, and the ends err with the fourth power of the spacing, as the middle does. A piece of three
    samples is the parabola through them, of two the line; one sample alone has no slope.
    """
    return arrays_of(value).concatenate([_slopes(time_s[piece], value[piece]) for piece in pieces(is_gap)])


def _slopes(t: Float[np.ndarray, " n"], value: Float[Any, "n m"]) -> Float[Any, "n m"]:
    math = arrays_of(value)
    if len(t) == 1:
        return math.zeros_like(value)
    h = np.diff(t)[:, None]
    steep = math.diff(value, axis=0) / h
    if len(t) == 2:
        return math.repeat(steep, 2, axis=0)
    before, after = h[:-1], h[1:]
    both = before + after
    if len(t) == 3:
        middle = (after * steep[:-1] + before * steep[1:]) / both
        return math.concatenate([2 * steep[:1] - middle, middle, 2 * steep[1:] - middle])
    # At each inner sample: after s[i-1] + 2 both s[i] + before s[i+1] = 3 (after steep[i-1] + before steep[i]). Not a knot, at
    # the first: after s[0] + both s[1] = first; likewise at the last. Taken from their neighbours they leave the inner samples.
    right = 3 * (after * steep[:-1] + before * steep[1:])
    first = ((before + 2 * both) * after * steep[:-1] + before**2 * steep[1:])[0] / both[0]
    last = ((after + 2 * both) * before * steep[1:] + after**2 * steep[:-1])[-1] / both[-1]
    diagonal = 2 * both
    diagonal[0] -= both[0]
    diagonal[-1] -= both[-1]
    right = math.concatenate([right[:1] - first[None], right[1:]])
    right = math.concatenate([right[:-1], right[-1:] - last[None]])
    inner = tridiagonal_solver(after[..., None], diagonal[..., None], before[..., None])(right[:, None])[:, 0]
    start, end = (first - both[0] * inner[0]) / after[0], (last - both[-1] * inner[-1]) / before[-1]
    return math.concatenate([start[None], inner, end[None]])

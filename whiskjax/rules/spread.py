"""Sigmas and covariances as they enter: of a size that float64 can weigh by, and covariances of something.

A weight is one over a variance, and costs are sums of squares: a sigma of 1e200 or 1e-200 is a finite number that turns them into
infinities and zeros, and a covariance with a negative variance in some direction has no weight at all.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from .errors import WhiskjaxError

# Of a measurement, in pixels, metres, radians or seconds: below, it is finer than float64 resolves what is measured; above, it
# says nothing. Of an unknown, whose unit may be anything (a distortion coefficient per pixel^6), what squares can hold.
LEAST_SIGMA, MOST_SIGMA = 1e-12, 1e12
LEAST_SCALE, MOST_SCALE = 1e-100, 1e100
_ROUNDING = 1e-9  # of the largest variance: what products of rotations leave of a zero, and of symmetry


def refuse_sigmas(
    sigma: Float[np.ndarray, "n ..."],
    label: Callable[[int], str],
    *,
    zero: bool = False,
    least: float = LEAST_SIGMA,
    most: float = MOST_SIGMA,
) -> None:
    """Refuse sigmas that are not positive, or of no size by which anything can be weighed.

    **Arguments:** `label`: what the i-th of them is called; `zero`: whether it may be zero, for what is exactly known.

    **Raises:** `WhiskjaxError` naming the first.
    """
    values = np.asarray(sigma, dtype=float)
    fine = (values >= least) & (values <= most) | (zero & (values == 0))
    if not fine.all():
        i = tuple(int(k) for k in np.argwhere(~fine)[0])
        wide = f"{least:.0e} to {most:.0e}" + (", or 0 where it is exact" if zero else "")
        raise WhiskjaxError(
            f"{label(i[0])} is {values[i]:g}, a 1-sigma by which nothing can be weighed: {wide} is expected; leave out what is "
            "not known at all"
        )


def refuse_sizes(values: Float[np.ndarray, "n ..."], label: Callable[[int], str]) -> None:
    """Refuse finite numbers that are no pixel and no place: their differences and squares mean nothing.

    **Arguments:** `label`: what the i-th of them is called. **Raises:** `WhiskjaxError` naming the first.
    """
    values = np.asarray(values, dtype=float)
    wrong = np.abs(values) > MOST_SIGMA  # not where it is not a number
    if wrong.any():
        i = tuple(int(k) for k in np.argwhere(wrong)[0])
        raise WhiskjaxError(f"{label(i[0])} holds {values[i]:g}, where nothing is; look at it and at its unit")


def refuse_covariances(covariance: Float[np.ndarray, "n d d"], label: Callable[[int], str]) -> None:
    """Refuse what is no covariance: not finite, not symmetric, negative in some direction, or too large to weigh by.

    Zero is exact. **Arguments:** `label`: what the i-th of them is called.

    **Raises:** `WhiskjaxError` naming the first.
    """
    covariance, most = np.asarray(covariance, dtype=float), MOST_SIGMA**2

    def first(wrong: Any, what: Callable[[int], str]) -> None:
        if wrong.any():
            i = int(np.argmax(wrong))
            raise WhiskjaxError(f"{label(i)} is no covariance: {what(i)}")

    first(~np.isfinite(covariance).all(axis=(1, 2)), lambda i: "it holds what is not a finite number")
    size = np.abs(covariance).max(axis=(1, 2))
    first(size > most, lambda i: f"by a variance of {size[i]:g} nothing can be weighed, {most:.0e} at most is expected")
    skew = np.abs(covariance - covariance.swapaxes(1, 2)).max(axis=(1, 2))
    first(skew > _ROUNDING * size, lambda i: f"it is not symmetric, by {skew[i]:.3g} beside {size[i]:.3g}")
    least = np.linalg.eigvalsh(covariance)[:, 0]
    first(least < -_ROUNDING * size, lambda i: f"its variance is {least[i]:.3g} in some direction, and none is negative")

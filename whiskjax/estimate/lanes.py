"""Many calibrations of one shape, side by side: lanes of Gauss-Newton steps, pure, to be compiled by the caller."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.vectors import Vec2
from ..rules import RESULTS, first_failure
from .least_squares import descend, judge
from .linearised import pixels
from .problem import Problem


class Lanes(eqx.Module):
    """Solved lanes, whitened.

    `cost` is the sum of squared whitened residuals and priors, `residual_px` (x, y) of each group, (lanes, n) each.
    """

    u: Float[Array, "lanes k"]
    covariance: Float[Array, "lanes k k"]
    cost: Float[Array, " lanes"]
    residual_px: tuple[Vec2, ...]
    result: RESULTS


def solve_lanes(
    problem: Problem, start: Float[Array, "*lanes k"], steps: int = 6, chunk: int = 10, common: Problem | None = None
) -> Lanes:
    """Solve many baked problems of one shape; pure, to be compiled by the caller.

    **Arguments:**

    - `problem`: every array has a leading axis of lanes.
    - `start`: whitened; (lanes, k), or (k,) for all.
    - `steps`: of Gauss-Newton.
    - `chunk`: lanes that are computed side by side; 10 to 50 run alike.
    - `common`: arrays that all lanes share, where `problem` has None.
    """
    arrays, static = eqx.partition(problem if start.ndim == 1 else (problem, start), eqx.is_array)

    def lane(arrays) -> Lanes:
        one = eqx.combine(arrays, static)
        own, first = (one, start) if start.ndim == 1 else one
        return solve_lane(own if common is None else eqx.combine(own, common), first, steps)

    return jax.lax.map(lane, arrays, batch_size=chunk)


def solve_lane(problem: Problem, start: Any, steps: int) -> Lanes:
    m = start.shape[0]
    here = descend(problem, start, steps)
    u, step, normal = here
    inverse = jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(normal[:m, :m]), jnp.eye(m), lower=True)
    after, codes = zip(*(pixels(problem, group, u) for group in problem.groups), strict=True)
    worst = jnp.stack([code.max() for code in codes]).max()
    result = first_failure(judge(here), jax.tree.map(lambda _: worst, RESULTS.successful))
    # The last step went to the minimum of the quadratic whose value at its start is the corner of the normal matrix.
    return Lanes(u, inverse.T @ inverse, normal[m, m] + normal[:m, m] @ step, after, result)

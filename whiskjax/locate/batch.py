"""Gauss-Newton over all looks at once, with the prior as one more observation."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import add, mul, stack
from .filter import Belief
from .model import Model

# The gate closes in rounds, so that looks that bend the first solution do not take good ones with them.
_GATES = (64.0, 16.0, 4.0, 1.0)


class Equations(NamedTuple):
    """All looks, linearised at a state of the last look; residuals, rows and noise in sigmas of the pixel.

    `weight` is the inverse covariance of each look's noise, zero for looks left out; `data` the information of the looks alone,
    `formal` the covariance of what is estimated as if what is considered were known, zero there.
    """

    residual: Float[Array, "looks 2"]
    rows: Float[Array, "looks 2 n"]
    noise: Float[Array, "looks 2 2"]
    weight: Float[Array, "looks 2 2"]
    counts: Bool[Array, " looks"]
    data: Float[Array, "n n"]
    formal: Float[Array, "n n"]


class Solved(NamedTuple):
    """The most probable state at the last look, its covariance, each look's residual covariance and NIS, and whether it passed.

    `cost` is the sum of the squared whitened residuals of looks and prior, `step` the last step in posterior sigmas.
    """

    state: Float[Array, " n"]
    covariance: Float[Array, "n n"]
    equations: Equations
    residual_covariance: Float[Array, "looks 2 2"]
    nis: Float[Array, " looks"]
    passes: Bool[Array, " looks"]
    cost: Float[Array, ""]
    step: Float[Array, ""]


def solve(model: Model, prior: Belief, start: Float[Array, " n"], steps: int, gate_nis: float | None) -> Solved:
    """Least squares of all looks and the prior.

    What is considered keeps its prior mean; its covariance is carried into that of the rest (Schmidt 1966).

    **Arguments:** `prior`: at the first look; `start`: where to linearise first, a state of the last look.
    """
    mean, spread = at_last(model, prior)
    information = jnp.linalg.inv(spread)
    estimated = jnp.asarray(model.share, dtype=float)

    def iterate(state: Array, used: Array) -> tuple[Array, Array]:
        def once(_: Any, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            state, _ = carry
            found = equations(model, information, state, used)
            right = jnp.einsum("kan,kab,kb->n", found.rows, found.weight, found.residual) + information @ (mean - state)
            step = found.formal @ right
            sigma = jnp.sqrt(jnp.diag(found.formal))
            return state + step, jnp.abs(step / jnp.where(sigma > 0, sigma, 1.0)).max()

        return jax.lax.fori_loop(0, steps, once, (state, jnp.zeros(())))

    used = jnp.ones(model.pixel_px[0].shape, dtype=bool)
    state, step = iterate(start, used)
    for wider in _GATES if gate_nis is not None else ():
        found = equations(model, information, state, used)
        used = _nis(found, _residual_covariance(found, spread, estimated, used)) <= wider * gate_nis
        state, step = iterate(state, used)
    found = equations(model, information, state, used)
    effect = considered(found, estimated)
    residual_covariance = _residual_covariance(found, spread, estimated, used)
    away = state - mean
    cost = jnp.einsum("ka,kab,kb->", found.residual, found.weight, found.residual) + away @ information @ away
    return Solved(
        state,
        found.formal + effect @ spread @ effect.T,
        found,
        residual_covariance,
        _nis(found, residual_covariance),
        used,
        cost,
        step,
    )


def at_last(model: Model, prior: Belief) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Mean and covariance of the prior, carried from the first look to the last; the motion is even."""
    mean, covariance = jnp.stack([jnp.asarray(c, dtype=float) for c in prior.state]), _matrix(prior.covariance)
    if model.density is None:
        return mean, covariance
    n = len(mean)
    forward = jnp.eye(n) + jnp.zeros((n, n)).at[jnp.arange(3), jnp.arange(3, 6)].set(-model.since_s[0])
    return forward @ mean, forward @ covariance @ forward.T


def equations(
    model: Model, information: Float[Array, "n n"], state: Float[Array, " n"], used: Bool[Array, " looks"]
) -> Equations:
    """Linearise all looks; `information` is that of the prior."""
    parts = tuple(state[i] for i in range(len(state)))
    if model.density is not None:
        parts = (*(add(x, mul(v, model.since_s)) for x, v in zip(parts[:3], parts[3:6], strict=True)), *parts[3:])
    seen = model.expect(parts)
    rows = [list(row) for row in seen.rows]
    if model.density is not None:
        rows = [[*row[:3], *(mul(model.since_s, h) for h in row[:3]), *row[6:]] for row in rows]
    r00, r01, r11 = seen.noise
    w = jnp.where(seen.counts & used, 1 / (r00 * r11 - r01 * r01), 0.0)
    shape = used.shape
    weight = _pairs((r11 * w, -r01 * w, r00 * w), shape)
    matrix = jnp.stack([jnp.stack([jnp.broadcast_to(jnp.asarray(h, dtype=float), shape) for h in row], -1) for row in rows], -2)
    data = jnp.einsum("kan,kab,kbm->nm", matrix, weight, matrix)
    share = jnp.asarray(model.share, dtype=float)
    both = jnp.outer(share, share)
    formal = jnp.linalg.inv((data + information) * both + jnp.diag(1 - share)) * both
    return Equations(stack(seen.residual), matrix, _pairs(seen.noise, shape), weight, seen.counts, data, formal)


def considered(found: Equations, estimated: Float[Array, " n"]) -> Float[Array, "n n"]:
    """How the errors of what is considered reach the whole state: themselves, and what is estimated from looks that they bent."""
    return (jnp.eye(len(estimated)) - found.formal @ found.data) * (1 - estimated)


def _residual_covariance(
    found: Equations, spread: Float[Array, "n n"], estimated: Float[Array, " n"], used: Bool[Array, " looks"]
) -> Float[Array, "looks 2 2"]:
    """Of the residuals at the solution: looks that took part were fitted, the others were not."""
    fitted = jnp.einsum("kan,nm,kbm->kab", found.rows, found.formal, found.rows)
    bent = jnp.einsum("kan,nm->kam", found.rows, considered(found, estimated))
    sign = jnp.where(used & found.counts, -1.0, 1.0)[:, None, None]
    return found.noise + sign * fitted + jnp.einsum("kan,nm,kbm->kab", bent, spread, bent)


def _nis(found: Equations, covariance: Float[Array, "looks 2 2"]) -> Float[Array, " looks"]:
    s00, s01, s11 = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    x, y = found.residual[:, 0], found.residual[:, 1]
    return (s11 * x * x - 2 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01)


def _pairs(upper: tuple[Any, ...], shape: tuple[int, ...]) -> Float[Array, "looks 2 2"]:
    a, b, c = (jnp.broadcast_to(jnp.asarray(v, dtype=float), shape) for v in upper)
    return jnp.stack([jnp.stack([a, b], -1), jnp.stack([b, c], -1)], -2)


def _matrix(rows: tuple[tuple[Any, ...], ...]) -> Float[Array, "n n"]:
    return jnp.stack([jnp.stack([jnp.asarray(c, dtype=float) for c in row]) for row in rows])

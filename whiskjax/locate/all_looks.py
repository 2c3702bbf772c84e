"""Gauss-Newton over all looks at once, with the prior as one more observation."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.implicit import stationary
from ..algebra.vectors import mul
from .filter import Belief
from .model import Expected, Model

# The gate closes in rounds, so that looks that bend the first solution do not take good ones with them.
_GATES = (64.0, 16.0, 4.0, 1.0)


class Equations(NamedTuple):
    """All looks, linearised at a state of the last look; residuals, rows and noise in sigmas of the pixel.

    `noise` is the covariance of each look's, `joint` that of all looks together where their errors have something in common;
    `weight` is the inverse of the one or the other, zero for looks left out; `data` the information of the looks alone,
    `formal` the covariance of what is estimated as if what is considered were known, zero there.
    """

    residual: Float[Array, "looks 2"]
    rows: Float[Array, "looks 2 n"]
    noise: Float[Array, "looks 2 2"]
    weight: Float[Array, "looks 2 2"] | Float[Array, "looks 2 looks 2"]
    joint: Float[Array, "looks 2 looks 2"] | None
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

    What is considered keeps its prior mean; its covariance is carried into that of the rest (Schmidt 1966). The iteration is not
    differentiated: the state is where J^T W r + P0^-1 (mean - x) vanishes, with the weights W of that state, and that equation
    implies how it follows everything else. Which looks pass the gate is held.

    **Arguments:** `prior`: at the first look; `start`: where to linearise first, a state of the last look.
    """
    mean, spread = at_last(model, prior)
    information = jnp.linalg.inv(spread)
    estimated = jnp.asarray(model.share, dtype=float)
    held, mean_held, information_held = jax.lax.stop_gradient((model, mean, information))

    def iterate(state: Array, used: Array) -> tuple[Array, Array]:
        def once(_: Any, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            state, _ = carry
            found = equations(held, information_held, state, used)
            step = found.formal @ _slope(found, state, mean_held, information_held)
            sigma = jnp.sqrt(jnp.diag(found.formal))
            return state + step, jnp.abs(step / jnp.where(sigma > 0, sigma, 1.0)).max()

        return jax.lax.fori_loop(0, steps, once, (state, jnp.zeros(())))

    used = jnp.ones(model.pixel_px[0].shape, dtype=bool)
    state, step = iterate(jax.lax.stop_gradient(start), used)
    for limit in () if gate_nis is None else (wider * gate_nis for wider in _GATES):
        found = equations(held, information_held, state, used)
        used = _nis(found, _residual_covariance(found, jax.lax.stop_gradient(spread), estimated, used)) <= limit
        state, step = iterate(state, used)

    def vanishes(state: Array, model: Model, mean: Array, information: Array, start: Array, used: Array) -> Array:
        slope = _slope(equations(model, information, state, used), state, mean, information)
        return jnp.where(np.array(model.share) > 0, slope, start - state)

    state = stationary(vanishes, state, model, mean, information, start, used)
    found = equations(model, information, state, used)
    effect = considered(found, estimated)
    residual_covariance = _residual_covariance(found, spread, estimated, used)
    away = state - mean
    cost = _weighed(found.residual, found.weight, found.residual) + away @ information @ away
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


def _slope(found: Equations, state: Array, mean: Array, information: Array) -> Float[Array, " n"]:
    """Minus half the slope of the cost, weights held."""
    return _weighed(found.rows, found.weight, found.residual) + information @ (mean - state)


def at_last(model: Model, prior: Belief) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Mean and covariance of the prior, carried from the first look to the last; the motion is even."""
    mean, covariance = jnp.stack([jnp.asarray(c, dtype=float) for c in prior.state]), _matrix(prior.covariance)
    if model.since_s is None:
        return mean, covariance
    n = len(mean)
    forward = jnp.eye(n) + jnp.zeros((n, n)).at[jnp.arange(3), jnp.arange(3, 6)].set(-model.since_s[0])
    return forward @ mean, forward @ covariance @ forward.T


def equations(
    model: Model, information: Float[Array, "n n"], state: Float[Array, " n"], used: Bool[Array, " looks"]
) -> Equations:
    """Linearise all looks; `information` is that of the prior."""
    seen = _one_by_one(model, state)
    residual, rows, noise = (jnp.stack(seen.residual, -1), _stacked(seen.rows), _pairs(seen.noise))
    part, joint = seen.counts & used, None
    if model.remembered.size:
        joint = _joint(noise, _stacked(seen.effects), model.remembered.kernel())
        noise, weight = jnp.einsum("kakb->kab", joint), _inverse_of_all(joint, part)
    else:
        weight = jnp.where(part[:, None, None], _inverse(noise), 0.0)
    data = _weighed(rows, weight, rows)
    share = jnp.asarray(model.share, dtype=float)
    both = jnp.outer(share, share)
    formal = jnp.linalg.inv((data + information) * both + jnp.diag(1 - share)) * both
    return Equations(residual, rows, noise, weight, joint, seen.counts, data, formal)


def _one_by_one(model: Model, state: Float[Array, " n"]) -> Expected:
    """Every look beside a state of the last look, components (looks,).

    In a loop: stacked into a matrix, XLA on the CPU would evaluate the chain again for each of its entries.
    """
    own, shared = model.split()

    def one(_: None, own: Model) -> tuple[None, Expected]:
        look = eqx.combine(own, shared)
        parts, since = tuple(state[i] for i in range(len(state))), look.since_s
        if since is not None:
            parts = (*(x + since * v for x, v in zip(parts[:3], parts[3:6], strict=True)), *parts[3:])
        seen = look.expect(parts)
        if since is not None:
            seen = seen._replace(rows=tuple((*row[:3], *(mul(since, h) for h in row[:3]), *row[6:]) for row in seen.rows))
        return None, jax.tree.map(lambda c: jnp.asarray(c, dtype=c.dtype if eqx.is_array(c) else float), seen)

    return jax.lax.scan(one, None, own)[1]


def considered(found: Equations, estimated: Float[Array, " n"]) -> Float[Array, "n n"]:
    """How the errors of what is considered reach the whole state: themselves, and what is estimated from looks that they bent."""
    return (jnp.eye(len(estimated)) - found.formal @ found.data) * (1 - estimated)[None, :]


def _residual_covariance(
    found: Equations, spread: Float[Array, "n n"], estimated: Float[Array, " n"], used: Bool[Array, " looks"]
) -> Float[Array, "looks 2 2"]:
    """Of the residuals at the solution: looks that took part were fitted, the others were not."""
    fitted = jnp.einsum("kan,nm,kbm->kab", found.rows, found.formal, found.rows)
    bent = jnp.einsum("kan,nm->kam", found.rows, considered(found, estimated))
    if found.joint is not None:
        # R - M R - R M^T + H F H^T with M = H F H^T W: a look left out was predicted by others that share its errors.
        shared = jnp.einsum("kan,nm,lcm,lcjd,jdkb->kab", found.rows, found.formal, found.rows, found.weight, found.joint)
        own = found.noise + fitted - shared - shared.swapaxes(1, 2)
        return own + jnp.einsum("kan,nm,kbm->kab", bent, spread, bent)
    sign = jnp.where(used & found.counts, -1.0, 1.0)[:, None, None]
    return found.noise + sign * fitted + jnp.einsum("kan,nm,kbm->kab", bent, spread, bent)


def _weighed(a: Array, weight: Array, b: Array) -> Array:
    """a^T W b over all looks; the last axes of a and b, where they have one, stay."""
    left, right = ("n" if a.ndim == 3 else ""), ("m" if b.ndim == 3 else "")
    if weight.ndim == 4:
        return jnp.einsum(f"ka{left},kalb,lb{right}->{left}{right}", a, weight, b)
    return jnp.einsum(f"ka{left},kab,kb{right}->{left}{right}", a, weight, b)


def _joint(
    noise: Float[Array, "looks 2 2"], effects: Float[Array, "looks 2 m"], kernel: Float[Array, "m looks looks"]
) -> Float[Array, "looks 2 looks 2"]:
    """The covariance of all looks: what is new at each, and what they have in common, sums of e_k e_l^T times a correlation."""
    own = jnp.einsum("kab,kl->kalb", noise, jnp.eye(noise.shape[0]))
    return own + jnp.einsum("kam,mkl,lbm->kalb", effects, kernel, effects)


def _inverse_of_all(joint: Float[Array, "looks 2 looks 2"], part: Bool[Array, " looks"]) -> Float[Array, "looks 2 looks 2"]:
    """The inverse of the covariance of the looks that take part; zero for the others."""
    looks = joint.shape[0]
    both = (part[:, None] & part[None, :])[:, None, :, None]
    alone = jnp.where(part, 0.0, 1.0)[:, None, None, None] * jnp.eye(2 * looks).reshape(joint.shape)
    inverse = jnp.linalg.inv((jnp.where(both, joint, 0.0) + alone).reshape(2 * looks, 2 * looks))
    return jnp.where(both, inverse.reshape(joint.shape), 0.0)


def _nis(found: Equations, covariance: Float[Array, "looks 2 2"]) -> Float[Array, " looks"]:
    return jnp.einsum("ka,kab,kb->k", found.residual, _inverse(covariance), found.residual)


def _inverse(pairs: Float[Array, "looks 2 2"]) -> Float[Array, "looks 2 2"]:
    a, b, c = pairs[:, 0, 0], pairs[:, 0, 1], pairs[:, 1, 1]
    return _pairs((c, -b, a)) / (a * c - b * b)[:, None, None]


def _pairs(upper: tuple[Array, ...]) -> Float[Array, "looks 2 2"]:
    a, b, c = upper
    return jnp.stack([jnp.stack([a, b], -1), jnp.stack([b, c], -1)], -2)


def _stacked(rows: Any) -> Float[Array, "... n"]:
    return jnp.stack([jnp.stack(row, -1) for row in rows], -2)


def _matrix(rows: tuple[tuple[Any, ...], ...]) -> Float[Array, "n n"]:
    return _stacked(tuple(tuple(jnp.asarray(c, dtype=float) for c in row) for row in rows))

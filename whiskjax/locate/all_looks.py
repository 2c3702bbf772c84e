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
from .innovations import whitened
from .model import Expected, Model

# Steps in posterior sigmas below which nothing moves any more.
_ENDED_SIGMAS = 1e-9
# The gate closes in rounds, so that looks that bend the first solution do not take good ones with them; then it stays where it is
# until the looks that pass are those of which the solution was made, or for so many rounds.
_GATES = (64.0, 16.0, 4.0, 1.0)
_ROUNDS = 12


class Equations(NamedTuple):
    """All looks, linearised at a state of the last look; residuals, rows and noise in sigmas of the pixel.

    `noise` is the covariance of each look by itself, `effects` what a sigma of each error that looks have in common does to it;
    `white`, `white_rows`: residual and rows over a factor of the covariance of all looks, zero for looks left out; `data`: the
    information of the looks alone; `formal`: the covariance of what is estimated if what is considered were known, zero there.
    """

    residual: Float[Array, "looks 2"]
    rows: Float[Array, "looks 2 n"]
    noise: Float[Array, "looks 2 2"]
    effects: Float[Array, "looks 2 m"]
    white: Float[Array, "looks 2"]
    white_rows: Float[Array, "looks 2 n"]
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
        def once(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            i, state, _ = carry
            found = equations(held, information_held, state, used)
            step = found.formal @ _slope(found, state, mean_held, information_held)
            sigma = jnp.sqrt(jnp.diag(found.formal))
            return i + 1, state + step, jnp.abs(step / jnp.where(sigma > 0, sigma, 1.0)).max()

        def goes_on(carry: tuple[Array, Array, Array]) -> Array:
            return (carry[0] < steps) & (carry[2] > _ENDED_SIGMAS)

        return jax.lax.while_loop(goes_on, once, (jnp.zeros((), int), state, jnp.full((), jnp.inf)))[1:]

    used = jnp.ones(model.pixel_px[0].shape, dtype=bool)
    state, step = iterate(jax.lax.stop_gradient(start), used)
    if gate_nis is not None:
        limits, spread_held = gate_nis * jnp.asarray(_GATES), jax.lax.stop_gradient(spread)

        def close(carry: tuple[Array, ...]) -> tuple[Array, ...]:
            i, used, state, *_ = carry
            found = equations(held, information_held, state, used)
            passes = _nis(found, _residual_covariance(held, found, spread_held, estimated, used)) <= limits[i]
            return i + 1, passes, *iterate(state, passes), (passes != used).any()

        def is_open(carry: tuple[Array, ...]) -> Array:
            return (carry[0] < len(_GATES)) | (carry[4] & (carry[0] < _ROUNDS))

        begun = jnp.zeros((), int), used, state, step, jnp.ones((), dtype=bool)
        _, used, state, step, _ = jax.lax.while_loop(is_open, close, begun)

    def vanishes(state: Array, model: Model, mean: Array, information: Array, start: Array, used: Array) -> Array:
        slope = _slope(equations(model, information, state, used), state, mean, information)
        return jnp.where(np.array(model.share) > 0, slope, start - state)

    state = stationary(vanishes, state, model, mean, information, start, used)
    found = equations(model, information, state, used)
    effect = considered(found, estimated)
    residual_covariance = _residual_covariance(model, found, spread, estimated, used)
    away = state - mean
    cost = (found.white**2).sum() + away @ information @ away
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
    return jnp.einsum("kan,ka->n", found.white_rows, found.white) + information @ (mean - state)


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
    effects = _stacked(seen.effects) if model.remembered.size else jnp.zeros((*residual.shape, 0))
    white = _white(model, noise, effects, seen.counts & used, jnp.concatenate([residual[:, :, None], rows], -1))
    white, white_rows = white[:, :, 0], white[:, :, 1:]
    data = jnp.einsum("kan,kam->nm", white_rows, white_rows)
    share = jnp.asarray(model.share, dtype=float)
    both = jnp.outer(share, share)
    formal = jnp.linalg.inv((data + information) * both + jnp.diag(1 - share)) * both
    return Equations(residual, rows, noise, effects, white, white_rows, seen.counts, data, formal)


def _white(model: Model, noise: Array, effects: Array, part: Array, columns: Array) -> Float[Array, "looks 2 c"]:
    keep = jnp.stack([*model.remembered.keep], -1) if model.remembered.size else jnp.zeros((len(noise), 0))
    return whitened(noise, effects, keep, part, columns)


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
    model: Model, found: Equations, spread: Float[Array, "n n"], estimated: Float[Array, " n"], used: Bool[Array, " looks"]
) -> Float[Array, "looks 2 2"]:
    """Of the residuals at the solution: looks that took part were fitted, the others were not."""
    fitted = jnp.einsum("kan,nm,kbm->kab", found.rows, found.formal, found.rows)
    bent = jnp.einsum("kan,nm->kam", found.rows, considered(found, estimated))
    part = used & found.counts
    # R - M R - R M^T + H F H^T with M = H F H^T W, where W R is one for looks that took part ...
    noise, answered = found.noise, jnp.where(part[:, None, None], fitted, 0.0)
    if model.remembered.size:
        # ... and what the others know of the errors that they share, for one that was left out.
        joint = jnp.einsum("kam,mkl,lbm->kalb", found.effects, model.remembered.kernel(), found.effects)
        noise = noise + jnp.einsum("kakb->kab", joint)
        known = _white(model, found.noise, found.effects, part, joint.reshape(*joint.shape[:2], -1)).reshape(joint.shape)
        shared = jnp.einsum("kan,nm,lcm,lckb->kab", found.rows, found.formal, found.white_rows, known)
        answered = jnp.where(part[:, None, None], fitted, shared)
    own = noise + fitted - answered - answered.swapaxes(1, 2)
    return own + jnp.einsum("kan,nm,kbm->kab", bent, spread, bent)


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

"""The extended Kalman filter over the looks, and its iterated form.

With R = (2 px)^2 and no errors of frames this is the filter of Liu et al. (2019, equations 13 to 18).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, dot, mul, sub
from ..rules import once
from .model import Expected, Model
from .motion import Transition, predict
from .update import Covariance, Innovation, Rows, State, corrected, gain, innovate, joseph, seen_by


class Belief(NamedTuple):
    """A state and its covariance."""

    state: State
    covariance: Covariance


class Step(NamedTuple):
    """One look: the belief after it, the innovation before it, whether it counts, and whether it passed the gate."""

    belief: Belief
    innovation: Innovation
    counts: Component
    passes: Component


def run(
    model: Model, prior: Belief, iterations: int, gate_nis: float | None, passes: Bool[Array, " looks"] | None = None
) -> tuple[Belief, Step]:
    """Correct the prior by one look after the other.

    **Arguments:**

    - `iterations`: how often each look is linearised again at its own result (Bell and Cathey 1993: Gauss-Newton on that look); 0
      is the extended filter.
    - `gate_nis`: looks whose normalised innovation squared is larger change nothing; None takes all.
    - `passes`: which looks may change anything, where that is known already.

    **Returns:** the belief after the last look, and every look's `Step`, components with the looks as first axis.
    """
    own, shared = model.split()

    def one(carry: Any, each: tuple[Model, Any]) -> tuple[Any, Any]:
        own, passes = each
        look = eqx.combine(own, shared)
        belief = Belief(carry[0], _full(carry[1]))
        if look.remembered.size:
            belief = Belief(*look.remembered.predict(*belief))
        if look.density is not None:
            belief = Belief(*predict(*belief, Transition(look.step_s, look.density)))
        step = correct(look, belief, iterations, gate_nis, passes)
        carry = step.belief.state, _upper(step.belief.covariance)
        return carry, step._replace(belief=carry)

    n, prior = len(prior.state), _with_errors(prior, model.remembered.size)
    start = jax.tree.map(lambda c: jnp.asarray(c, dtype=float), (prior.state, _upper(prior.covariance)))
    (state, upper), steps = jax.lax.scan(one, start, (own, passes))
    return _first(n, state, _full(upper)), steps._replace(belief=_first(n, steps.belief[0], _full(steps.belief[1])))


def _with_errors(prior: Belief, more: int) -> Belief:
    """The same with whitened errors behind; the first look draws them, whatever they are here."""
    n = len(prior.state)
    wider = [(*row, *(0.0,) * more) for row in prior.covariance]
    wider += [tuple(float(i == j) for j in range(n + more)) for i in range(n, n + more)]
    return Belief((*prior.state, *(0.0,) * more), tuple(wider))


def _first(n: int, state: State, covariance: Covariance) -> Belief:
    """What is told of it: the target and the numbers of the sensor."""
    return Belief(state[:n], tuple(row[:n] for row in covariance[:n]))


def correct(look: Model, prior: Belief, iterations: int, gate_nis: float | None, allowed: Bool[Array, ""] | None = None) -> Step:
    """One look. One that does not count has no residual and no derivatives, and so changes nothing."""

    def relinearise(i: Any, last: _Pass) -> _Pass:
        linear = _linearise(look, prior, last.state)
        predicted = jax.tree.map(lambda new, old: jnp.where(i == 0, new, old), linear.innovation, last.predicted)
        residual, share = linear.seen.residual, look.share + (1,) * look.remembered.size
        if iterations:
            # z - h(s) - H (x - s): the residual at s, less what the way back to the prediction explains.
            way = tuple(sub(a, b) for a, b in zip(prior.state, last.state, strict=True))
            residual = tuple(sub(r, dot(h, way)) for r, h in zip(residual, linear.seen.rows, strict=True))
        passes = jnp.ones((), dtype=bool) if allowed is None else allowed
        if gate_nis is not None:
            passes = passes & (predicted.nis <= gate_nis)
        if gate_nis is not None or allowed is not None:
            share = tuple(mul(s, jnp.where(passes, 1.0, 0.0)) for s in share)
        k = gain(linear.crossed, linear.innovation.covariance, share)
        done = _Pass(corrected(prior.state, k, residual), k, linear, predicted, passes)
        # A loop carries arrays only; without one the zero gain of what is considered stays structural and costs nothing.
        return jax.tree.map(lambda c: c if eqx.is_array(c) else jnp.asarray(c, dtype=float), done) if iterations else done

    shapes = jax.eval_shape(lambda: _linearise(look, prior, prior.state))
    nothing: _Linear = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    start = _Pass(prior.state, nothing.crossed, nothing, nothing.innovation, jnp.ones((), dtype=bool))
    last = jax.lax.fori_loop(0, iterations + 1, relinearise, start) if iterations else relinearise(0, start)
    covariance = joseph(prior.covariance, last.gain, last.linear.crossed, last.linear.innovation.covariance)
    return Step(Belief(last.state, covariance), last.predicted, last.linear.seen.counts, last.passes)


class _Linear(NamedTuple):
    """A look, linearised at a state: beside the look, the prior covariance seen by it, and the innovation."""

    seen: Expected
    crossed: Rows
    innovation: Innovation


class _Pass(NamedTuple):
    """What one linearisation of a look gives; `predicted` is the innovation of the first."""

    state: State
    gain: Rows
    linear: _Linear
    predicted: Innovation
    passes: Bool[Array, ""]


def _linearise(look: Model, prior: Belief, state: State) -> _Linear:
    seen = once(lambda: look.expect(state))

    def innovation() -> _Linear:
        crossed = seen_by(prior.covariance, seen.rows)
        return _Linear(seen, crossed, innovate(seen.residual, crossed, seen.rows, seen.noise))

    return jax.tree.map(jnp.asarray, once(innovation))


def _upper(covariance: Covariance) -> tuple[Component, ...]:
    n = len(covariance)
    return tuple(covariance[i][j] for i in range(n) for j in range(i, n))


def _full(upper: tuple[Component, ...]) -> Covariance:
    n = int((8 * len(upper) + 1) ** 0.5 - 1) // 2
    at = {(i, j): k for k, (i, j) in enumerate((i, j) for i in range(n) for j in range(i, n))}
    return tuple(tuple(upper[at[min(i, j), max(i, j)]] for j in range(n)) for i in range(n))

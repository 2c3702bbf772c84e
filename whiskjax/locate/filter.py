"""The extended Kalman filter over the looks, and its iterated form.

With R = (2 px)^2 and no noise of frames this is the filter of paper 003 (equations 13 to 18).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..algebra.vectors import Component, dot, mul, sub
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


def run(model: Model, prior: Belief, iterations: int, gate_nis: float | None) -> tuple[Belief, Step]:
    """Correct the prior by one look after the other.

    **Arguments:**

    - `iterations`: how often each look is linearised again at its own result (Bell and Cathey 1993: Gauss-Newton on that look); 0
      is the extended filter.
    - `gate_nis`: looks whose normalised innovation squared is larger change nothing; None takes all.

    **Returns:** the belief after the last look, and every look's `Step`, components with the looks as first axis.
    """
    own, shared = model.split()

    def one(carry: Any, own: Model) -> tuple[Any, Any]:
        look = eqx.combine(own, shared)
        belief = Belief(carry[0], _full(carry[1]))
        if look.density is not None:
            belief = Belief(*predict(*belief, Transition(look.step_s, look.density)))
        step = correct(look, belief, iterations, gate_nis)
        carry = step.belief.state, _upper(step.belief.covariance)
        return carry, step._replace(belief=carry)

    start = jax.tree.map(lambda c: jnp.asarray(c, dtype=float), (prior.state, _upper(prior.covariance)))
    (state, upper), steps = jax.lax.scan(one, start, own)
    return Belief(state, _full(upper)), steps._replace(belief=Belief(steps.belief[0], _full(steps.belief[1])))


def correct(look: Model, prior: Belief, iterations: int, gate_nis: float | None) -> Step:
    """One look. One that does not count has no residual and no derivatives, and so changes nothing."""
    state, covariance = prior
    seen, crossed, innovation = _linearise(look, prior, state)
    predicted, share, passes = innovation, look.share, True
    if gate_nis is not None:
        passes = innovation.nis <= gate_nis
        share = tuple(mul(s, jnp.where(passes, 1.0, 0.0)) for s in share)

    def improve(seen: Expected, crossed: Rows, innovation: Innovation, state: State) -> tuple[State, Rows]:
        k = gain(crossed, innovation.covariance, share)
        # z - h(s) - H (x - s): the residual at s, less what the way back to the prediction explains.
        way = tuple(sub(a, b) for a, b in zip(prior.state, state, strict=True))
        back = tuple(sub(r, dot(h, way)) for r, h in zip(seen.residual, seen.rows, strict=True))
        return corrected(prior.state, k, back if iterations else seen.residual), k

    def again(_: Any, state: State) -> State:
        return improve(*_linearise(look, prior, state), state)[0]

    if iterations:
        state, _ = improve(seen, crossed, innovation, state)
        state = jax.lax.fori_loop(0, iterations - 1, again, state)
        seen, crossed, innovation = _linearise(look, prior, state)
    state, k = improve(seen, crossed, innovation, state)
    return Step(Belief(state, joseph(covariance, k, crossed, innovation.covariance)), predicted, seen.counts, passes)


def _linearise(look: Model, prior: Belief, state: State) -> tuple[Expected, Rows, Innovation]:
    seen = look.expect(state)
    crossed = seen_by(prior.covariance, seen.rows)
    return seen, crossed, innovate(seen.residual, crossed, seen.rows, seen.noise)


def _upper(covariance: Covariance) -> tuple[Component, ...]:
    n = len(covariance)
    return tuple(covariance[i][j] for i in range(n) for j in range(i, n))


def _full(upper: tuple[Component, ...]) -> Covariance:
    n = int((8 * len(upper) + 1) ** 0.5 - 1) // 2
    at = {(i, j): k for k, (i, j) in enumerate((i, j) for i in range(n) for j in range(i, n))}
    return tuple(tuple(upper[at[min(i, j), max(i, j)]] for j in range(n)) for i in range(n))

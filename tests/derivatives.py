"""Derivatives, three ways: forward mode, reverse mode, and central differences of the function itself."""

import jax
import jax.numpy as jnp
import numpy as np

# Forward and reverse mode do the same arithmetic in another order.
MODES_AGREE = 1e-9


def assert_derivatives(f, x, step, tolerance, zero=False):
    """Forward mode == reverse mode == central difference, at each of the points x.

    A derivative is compared as the change it predicts over `step`, so that everything has the unit of the output. The difference
    quotient is extrapolated once (Richardson): over steps h and h/2 its error falls with h^4, and a step can be so long that
    rounding (a few ulp of f) does not matter.

    **Arguments:**

    - `f`: one array (n,) -> array (m,), or a tuple of them.
    - `x`: points (n,) or (points, n).
    - `step`: (n,) or (), how far each input moves, in its own unit.
    - `tolerance`: (m,) or (), how far predicted and computed change may differ, in the unit of the output.
    - `zero`: all derivatives may vanish. A tolerance that swallows a change is refused in any case: an output either moves by
      more than a thousand tolerances or by less than one.
    """
    x = np.atleast_2d(np.asarray(x, dtype=np.float64))
    step = np.broadcast_to(np.asarray(step, dtype=np.float64), x.shape[1:])

    def flat(v):
        return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(f(v))])

    # Tangents and cotangents one by one: a vmap over them gives the same and takes XLA twice as long to compile.
    def forward_columns(v):
        return jax.lax.map(lambda tangent: jax.jvp(flat, (v,), (tangent,))[1], jnp.eye(len(v)))

    def reverse_rows(v):
        value, pull = jax.vjp(flat, v)
        return jax.lax.map(lambda cotangent: pull(cotangent)[0], jnp.eye(len(value)))

    both = jax.jit(lambda xs: jax.lax.map(lambda v: (forward_columns(v), reverse_rows(v)), xs))
    forward, reverse = (np.asarray(d) for d in both(x))
    forward, reverse = np.swapaxes(forward, 1, 2) * step, reverse * step
    moves = np.concatenate([sign * np.diag(share * step) for share in (1.0, 0.5) for sign in (1, -1)])
    moved = (x[:, None] + moves).reshape(-1, x.shape[1])
    values = np.asarray(jax.jit(lambda xs: jax.lax.map(flat, xs))(moved)).reshape(len(x), len(moves), -1)
    up, down, half_up, half_down = np.split(values, 4, axis=1)
    central = np.swapaxes((4 * (half_up - half_down) - (up - down) / 2) / 3, 1, 2)

    size = np.abs(forward).max(axis=(0, 2))
    tolerance = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), size.shape)
    assert np.isfinite(forward).all(), "forward mode is not finite"
    assert np.isfinite(reverse).all(), "reverse mode is not finite"
    seen, constant = tolerance < 1e-3 * size, size <= tolerance
    assert (seen | constant).all(), f"the tolerance {tolerance} swallows the change {size}"
    assert seen.any() or zero, "every derivative vanishes: nothing is tested"
    modes = np.abs(forward - reverse).max(axis=(0, 2))
    assert (modes <= MODES_AGREE * np.maximum(size, tolerance)).all(), f"forward and reverse mode differ by {modes}"
    worst = np.abs(forward - central).max(axis=(0, 2))
    assert (worst <= tolerance).all(), f"derivative and difference differ by {worst}, allowed {tolerance}, changes {size}"


def assert_second_derivatives(f, x, step, share=0.1, tolerance=1e-6, reverse=False):
    """Second derivatives, forward over forward, against central differences of the Jacobian; and both mixed modes against them.

    All inputs are counted in their steps. What may differ is a part of the largest second derivative of the same output.

    **Arguments:**

    - `f`: one array (n,) -> array (m,), or a tuple of them.
    - `x`: points (n,) or (points, n).
    - `step`: (n,), over which each input changes the output as it does in use.
    - `share`: over which part of the step the differences are taken, extrapolated once (Richardson).
    - `tolerance`: relative.
    - `reverse`: take forward over reverse and reverse over forward, too; these compile four times as long.

    **Returns:** the second derivatives (points, m, n, n).
    """
    x = np.atleast_2d(np.asarray(x, dtype=np.float64))
    n = x.shape[1]
    step = jnp.broadcast_to(jnp.asarray(step, dtype=float), (n,))
    unit = jnp.eye(n)

    def flat(v, y):
        return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(f(v + step * y))])

    def slope(v, y, tangent):
        return jax.jvp(lambda y: flat(v, y), (y,), (tangent,))[1]

    @jax.jit
    def forward(v, moves, first, second):
        """At each of the moved points one column of the Jacobian, and its derivative by one more input."""

        def one(row):
            y, i, j = row
            return jax.jvp(lambda y: slope(v, y, unit[i]), (y,), (unit[j],))

        return jax.lax.map(one, (moves, first, second))

    @jax.jit
    def mixed(v, weight):
        """Rows of the second derivatives of one weighted output."""
        y = jnp.zeros(n)
        gradient = jax.grad(lambda y: weight @ flat(v, y))
        of_slope = lambda i: jax.grad(lambda y: weight @ slope(v, y, unit[i]))(y)
        return jax.lax.map(lambda i: (jax.jvp(gradient, (y,), (unit[i],))[1], of_slope(i)), jnp.arange(n))

    # All pairs of inputs where x is; and all columns of the Jacobian where each input has moved by four steps.
    parts = np.array([1.0, 0.5, -1.0, -0.5]) * share
    moves = np.concatenate([np.zeros((n * n, n)), np.repeat(np.kron(parts[:, None], np.eye(n)), n, axis=0)])
    i, j = (np.concatenate([a.ravel(), np.resize(np.arange(n), 4 * n * n)]) for a in np.indices((n, n)))
    answers = []
    for v in x:
        columns, second = (np.asarray(a) for a in forward(v, moves, i, j))
        second = np.moveaxis(second[: n * n].reshape(n, n, -1), -1, 0)
        a, b, c, d = columns[n * n :].reshape(4, n, n, -1)
        central = np.moveaxis((8 * (b - d) - (a - c)) / (6 * share), -1, 0)
        size = np.abs(central).max(axis=(1, 2))
        assert np.isfinite(second).all(), "the second derivative is not finite"
        assert (size > 0).all(), "a second derivative vanishes: nothing is tested"
        off = np.abs(second - central).max(axis=(1, 2)) / size
        assert (off <= tolerance).all(), f"second derivatives are off by {off} of the largest"
        if reverse:
            weight = np.random.default_rng(81).uniform(0.5, 1.5, len(size)) / size
            expected = np.tensordot(weight, second, 1)
            for got in mixed(v, weight):
                np.testing.assert_allclose(got, expected, rtol=0, atol=MODES_AGREE * np.abs(expected).max())
        answers.append(second)
    return np.stack(answers)

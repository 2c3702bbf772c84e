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

"""Derivatives of numbers that solve equations, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from whiskjax.algebra.implicit import implicit


def cubes(x, a):
    """Vanishes at the cube root."""
    return (x[0] * x[0] * x[0] - a,)


def root(a):
    return implicit(cubes, (jnp.cbrt(jax.lax.stop_gradient(a)),), a)[0]


def test_a_cube_root_has_its_derivatives_in_both_modes_and_in_batches():
    a = np.array([1.0, 8.0, 0.5])
    expected = [a ** (1 / 3), a ** (-2 / 3) / 3, -2 / 9 * a ** (-5 / 3), 10 / 27 * a ** (-8 / 3)]
    f, g = root, root
    for derivative in expected:
        np.testing.assert_allclose(jax.jit(jax.vmap(f))(a), derivative, rtol=1e-13)
        np.testing.assert_allclose(jax.vmap(g)(a), derivative, rtol=1e-13)
        f, g = jax.jacfwd(f), jax.grad(g)
    np.testing.assert_allclose(jax.vmap(jax.grad(jax.jacfwd(root)))(a), expected[2], rtol=1e-13)


def turned(x, numbers, which):
    """Polar coordinates of a point; what is asked for lies in a tree beside what is no number."""
    (radius, angle), (u, v) = x, numbers["point"]
    return radius * jnp.cos(angle) - u[which], radius * jnp.sin(angle) + numbers["none"] - v[which]


@pytest.mark.parametrize("which", [1, jnp.array(1)], ids=["static", "an index among the arrays"])
def test_two_equations_in_a_tree(which):
    def polar(u, v, which):
        at = jax.lax.stop_gradient((u, v))
        x = jnp.hypot(*at), jnp.arctan2(at[1], at[0])
        numbers = {"point": (jnp.stack([jnp.zeros(()), u]), jnp.stack([jnp.zeros(()), v])), "none": 0, "nothing": None}
        return jnp.stack(implicit(turned, x, numbers, which))

    def closed(u, v):
        return jnp.stack([jnp.hypot(u, v), jnp.arctan2(v, u)])

    point = 3.0, 4.0
    for derivative in (jax.jacfwd, jax.jacrev, lambda *a: jax.hessian(*a)):
        got = jax.jit(derivative(lambda u, v: polar(u, v, which), (0, 1)))(*point)
        expected = derivative(closed, (0, 1))(*point)
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)


def test_where_the_equations_do_not_tell_the_derivative_is_finite():
    assert float(root(0.0)) == 0.0
    for derivative in (jax.jacfwd(root), jax.jacfwd(jax.grad(root))):
        assert np.isfinite(derivative(0.0))

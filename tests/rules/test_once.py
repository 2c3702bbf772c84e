"""What stands in a fence is made once, whatever the compiler knows of its condition."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from whiskjax.rules import once


def chain(x, y):
    """Something of several numbers, with a structural zero and a name among them."""
    return {"b": x * jnp.sin(y) + 1, "a": (x * y, 0, None)}


def test_it_is_the_same_tree():
    """Arrays come back as they are, structural numbers and None as themselves."""
    x = jnp.arange(3.0)
    found, plain = jax.jit(lambda: jax.tree.map(jnp.asarray, once(lambda: chain(x, 2.0))))(), chain(x, 2.0)
    jax.tree.map(np.testing.assert_array_equal, found, jax.tree.map(jnp.asarray, plain))
    kept = []
    jax.jit(lambda: kept.append(once(lambda: chain(x, 2.0))["a"][1:]))()
    assert kept == [(0, None)]


@pytest.mark.parametrize("side_by_side", [False, True])
def test_the_fence_stands_where_nothing_is_an_argument(side_by_side):
    """The compiler cannot take the condition for true, though all that it could depend on is closed over."""
    y = np.linspace(0.0, 1.0, 5)

    def of(x):
        pair = once(lambda: chain(x, y))
        return pair["b"] * pair["b"] + pair["a"][0]

    def run(x):
        return jax.lax.map(of, x, batch_size=2) if side_by_side else of(x)

    x = jnp.ones((4, 5)) if side_by_side else jnp.ones(5)
    assert " conditional(" in jax.jit(run).lower(x).compile().as_text()


def test_derivatives_go_through():
    """Forward, reverse and second order as without the fence."""

    def of(x, fence):
        found = once(lambda: chain(x, 0.3 * x)) if fence else chain(x, 0.3 * x)
        return found["b"] * found["a"][0]

    for derive in (jax.grad, jax.jacfwd, jax.hessian):
        found, plain = (jax.jit(derive(lambda x, f=fence: of(x, f)))(0.7) for fence in (True, False))
        np.testing.assert_allclose(found, plain, rtol=1e-14)

"""Components against numpy, with structural numbers mixed in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.derivatives import assert_derivatives
from tests.oracles import array, matrix
from whiskjax.algebra import vectors as v

EXACT = {"rtol": 0, "atol": 1e-13}


def components(n):
    """Structural 0, 1 and -1 among arrays of four numbers."""
    number = st.floats(-3, 3, allow_subnormal=False)
    values = st.lists(number, min_size=4, max_size=4).map(np.array)
    return st.lists(st.one_of(st.sampled_from([0, 1, -1]), values), min_size=n, max_size=n).map(tuple)


def dense(components):
    return array([np.zeros(4) + c for c in components])


def rows(nine):
    return nine[:3], nine[3:6], nine[6:]


@given(components(3), components(3))
def test_vectors_agree_with_numpy(a, b):
    x, y = dense(a), dense(b)
    np.testing.assert_allclose(dense(v.vadd(a, b)), x + y, **EXACT)
    np.testing.assert_allclose(dense(v.vsub(a, b)), x - y, **EXACT)
    np.testing.assert_allclose(dense(v.cross(a, b)), np.cross(x, y), **EXACT)
    np.testing.assert_allclose(dense([v.dot(a, b)])[:, 0], np.sum(x * y, -1), **EXACT)
    np.testing.assert_allclose(dense(v.scale(a[0], b)), x[:, :1] * y, **EXACT)
    np.testing.assert_allclose(dense([v.neg(c) for c in a]), -x, **EXACT)
    np.testing.assert_allclose(np.zeros(4) + np.asarray(v.norm(a)), np.linalg.norm(x, axis=-1), **EXACT)


@given(components(9), components(9), components(3))
def test_matrices_agree_with_numpy(a, b, c):
    (m, n), x = (rows(a), rows(b)), dense(c)
    p, q = (np.stack([dense(row) for row in rows(nine)], axis=-2) for nine in (a, b))
    np.testing.assert_allclose(np.zeros((4, 3, 3)) + matrix(v.matmul(m, n)), p @ q, **EXACT)
    np.testing.assert_allclose(dense(v.apply(m, c)), np.einsum("bij,bj->bi", p, x), **EXACT)
    np.testing.assert_allclose(np.zeros((4, 3, 3)) + matrix(v.transpose(m)), np.swapaxes(p, 1, 2), **EXACT)


def test_folding_leaves_the_other_operand_untouched():
    a = jnp.arange(3.0)
    assert v.mul(1, a) is a and v.mul(a, 1) is a
    assert v.add(0, a) is a and v.add(a, 0) is a and v.sub(a, 0) is a
    assert v.mul(0, a) == 0 and type(v.mul(a, 0)) is int
    # A float zero is a number like any other: only Python ints are structural.
    assert not v.is_structural(0.0, 0)
    assert not v.is_structural(False, 0)


def test_lengths_must_match():
    with pytest.raises(ValueError):
        v.dot((1, 2, 3), (1, 2))


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_stack_and_unstack_are_inverse(shape):
    a = np.random.default_rng(1).normal(size=(*shape, 3))
    parts = v.unstack(a)
    assert [p.shape for p in parts] == [shape] * 3
    np.testing.assert_array_equal(v.stack(parts), a)


def test_stack_broadcasts_structural_numbers_and_smaller_batches():
    a = np.arange(4.0)
    np.testing.assert_array_equal(v.stack((0, a, np.array(7.0), -1)), np.stack([0 * a, a, 0 * a + 7, 0 * a - 1], -1))
    np.testing.assert_array_equal(v.stack((1, 0)), [1.0, 0.0])


def test_stack_is_differentiable():
    assert_derivatives(lambda x: v.stack((x[0] * x[1], 0, jnp.exp(x[1]))), [0.3, -0.4], step=1e-2, tolerance=1e-10)


def test_stack_passes_nan_and_infinity_in_their_place_only():
    got = np.asarray(v.stack((jnp.array([1.0, jnp.nan]), jnp.array([jnp.inf, 2.0]))))
    np.testing.assert_array_equal(got, [[1.0, np.inf], [np.nan, 2.0]])


def test_columns_are_the_jacobian():
    def f(x, y, z):
        return x * y, jnp.exp(z) * x, 0

    at = tuple(jnp.asarray(c) for c in np.random.default_rng(2).normal(size=(3, 5)))
    got = v.columns(f, at)
    for b in range(5):
        expected = jax.jacfwd(lambda q: jnp.stack([q[0] * q[1], jnp.exp(q[2]) * q[0]]))(jnp.stack([c[b] for c in at]))
        np.testing.assert_allclose([[got[j][i][b] for j in range(3)] for i in range(2)], expected, rtol=1e-14)
    # The last output is a structural number, whose derivative is one too.
    assert all(v.is_structural(got[j][2], 0) for j in range(3))


def test_columns_at_a_structural_zero_take_the_batch_shape_of_like():
    like = jnp.ones(4)
    (by_x,) = v.columns(lambda x: (v.mul(x, 3.0), v.add(x, like)), (0,), like)
    np.testing.assert_array_equal(np.asarray(by_x[0]), 3 * np.ones(4))
    np.testing.assert_array_equal(np.asarray(by_x[1]), np.ones(4))

"""The closed 3x3 solution against numpy."""

import numpy as np
import pytest

from tests.derivatives import assert_derivatives
from tests.oracles import array, matrix, split
from whiskjax.algebra.symmetric import solve3


def problems(shape, condition):
    """Symmetric positive definite matrices of about this condition number, and right sides."""
    rng = np.random.default_rng(3)
    q, _ = np.linalg.qr(rng.normal(size=(*shape, 3, 3)))
    eigenvalues = np.array([1.0, condition**-0.5, 1 / condition])
    return q * eigenvalues @ np.swapaxes(q, -1, -2), rng.normal(size=(*shape, 3))


def upper(a):
    return tuple(a[..., i, j] for i in range(3) for j in range(i, 3))


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
@pytest.mark.parametrize("condition", [1.0, 1e4, 1e8])
def test_solution_and_inverse_agree_with_numpy(shape, condition):
    a, b = problems(shape, condition)
    solution, inverse = solve3(upper(a), split(b))
    relative = 1e-14 * condition
    expected = np.linalg.solve(a, b[..., None])[..., 0]
    np.testing.assert_allclose(array(solution), expected, rtol=0, atol=relative * np.abs(expected).max())
    expected = np.linalg.inv(a)
    np.testing.assert_allclose(matrix(inverse), expected, rtol=0, atol=relative * np.abs(expected).max())


@pytest.mark.parametrize("diagonal", [(-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0), (1.0, 1.0, 0.0)])
def test_a_matrix_that_is_not_positive_definite_has_no_finite_solution(diagonal):
    solution, inverse = solve3(upper(np.diag(diagonal)), (1.0, 2.0, 3.0))
    assert not np.isfinite(array(solution)).all()
    assert not np.isfinite(matrix(inverse)).all()


def test_derivatives():
    a, b = problems((), 10.0)
    x = np.concatenate([upper(a), b])
    assert_derivatives(lambda p: solve3(tuple(p[:6]), tuple(p[6:])), x, step=1e-3, tolerance=1e-7)

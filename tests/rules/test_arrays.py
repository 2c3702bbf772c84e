"""One check for every array: what is taken is taken as it is, what is refused is refused by name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from whiskjax.rules import WhiskjaxError
from whiskjax.rules.arrays import Arrays


@pytest.mark.parametrize(
    "value, shape",
    [
        (1, ""),
        ([1, 2, 3], "3"),
        (np.zeros((4, 3)), "n 3"),
        (np.zeros((2, 4, 3)), "... 3"),
        (np.zeros(3), "... 3"),
        (jnp.zeros((4, 3)), "n 3"),
        (np.float32([1, 2]), "2"),
    ],
)
def test_takes_what_fits_as_float64(value, shape):
    taken = Arrays("Thing").take("value", value, shape)
    assert taken.dtype == np.float64
    np.testing.assert_array_equal(taken, value)


@pytest.mark.parametrize(
    "value, shape, said",
    [
        ([1, 2, 3, 4], "5", r"Thing: value has shape \(4,\), expected \(5,\)"),
        (np.zeros((3, 2)), "n 3", r"shape \(3, 2\), expected \(n, 3\)"),
        (1.0, "... 3", r"shape \(\), expected \(\.\.\., 3\)"),
        (np.zeros((2, 3)), "3", r"shape \(2, 3\), expected \(3,\)"),
        (["a", "b"], "2", "real numbers are expected"),
        ([True, False], "2", "dtype bool; real numbers are expected"),
        ([[1, 2], [3]], "2 2", "cannot be read as an array"),
        ([1j], "1", "dtype complex128; real numbers"),
        (None, "1", "is None"),
    ],
)
def test_refuses_what_does_not_fit(value, shape, said):
    with pytest.raises(WhiskjaxError, match=said):
        Arrays("Thing").take("value", value, shape)


def test_sizes_of_one_owner_agree():
    arrays = Arrays("Thing")
    arrays.take("time_s", np.zeros(4), "n")
    with pytest.raises(WhiskjaxError, match=r"position_m has shape \(5, 3\), expected \(n, 3\) with n = 4 as time_s has"):
        arrays.take("position_m", np.zeros((5, 3)), "n 3")


def test_batches_of_one_owner_broadcast():
    arrays = Arrays("Thing")
    arrays.take("pixel_px", np.zeros((5, 1, 2)), "... 2")
    arrays.take("time_s", np.zeros(4), "...")
    with pytest.raises(
        WhiskjaxError, match=r"height_m has the batch shape \(3,\), which does not broadcast with \(5, 4\) of time_s"
    ):
        arrays.take("height_m", np.zeros(3), "...")


@pytest.mark.parametrize("make", [np.float32, lambda v: jnp.asarray(v, dtype=jnp.float32)])
def test_float32_is_refused_where_it_would_be_wrong(make):
    with pytest.raises(WhiskjaxError, match="Thing: time_s has dtype float32"):
        Arrays("Thing").take("time_s", make([1.0, 2.0]), "n", absolute=True)


def test_finite_numbers_only():
    with pytest.raises(WhiskjaxError, match=r"position_m holds no finite number at index \(1, 2\)"):
        Arrays("Thing").take("position_m", [[0, 0, 0], [0, 0, np.nan]], "n 3", finite=True)
    with pytest.raises(WhiskjaxError, match="focal_px is not a finite number"):
        Arrays("Thing").take("focal_px", np.inf, "", finite=True)


def test_shapes_and_precision_are_seen_while_tracing():
    @jax.jit
    def double(x, y):
        return 2 * Arrays("double").take("x", [x, y], "2", finite=True)

    np.testing.assert_array_equal(double(1.0, 2.0), [2.0, 4.0])
    with pytest.raises(WhiskjaxError, match="double: x has shape"):
        jax.jit(lambda x: Arrays("double").take("x", x, "3"))(jnp.zeros(2))
    with pytest.raises(WhiskjaxError, match="float32"):
        jax.jit(lambda x: Arrays("double").take("x", x, "2", absolute=True))(jnp.zeros(2, dtype=jnp.float32))

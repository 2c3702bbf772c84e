"""sincos against 60-digit arithmetic, its derivatives, and the elementary rotations against scipy."""

from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

from tests.derivatives import assert_derivatives
from tests.oracles import about, matrix
from tests.strategies import numbers
from whiskjax.algebra.angles import ELEMENTARY, Angle, rx, sincos
from whiskjax.algebra.vectors import IDENTITY, matmul

CLAIMED = 3e-16  # the docstring of sincos, absolute, for |angle| < 1e5 rad
_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")


def exact_sine(x: float) -> Decimal:
    """Sine to more than 40 digits by its Taylor series, after an exact reduction."""
    with localcontext() as context:
        context.prec = 70
        r = Decimal(x) % (2 * _PI)
        if r > _PI:
            r -= 2 * _PI
        term, value, n = r, r, 1
        while abs(term) > Decimal("1e-45"):
            term = -term * r * r / ((n + 1) * (n + 2))
            value, n = value + term, n + 2
        return value


def exact_cosine(x: float) -> Decimal:
    """cos(x) = 1 - 2 sin(x/2)^2; halving a float is exact."""
    return 1 - 2 * exact_sine(x / 2) ** 2


def hard_angles() -> np.ndarray:
    """All scales up to 1e5 rad, and the floats around multiples of pi/4, where a quadrant changes or the result cancels."""
    rng = np.random.default_rng(0)
    scales = np.concatenate([rng.uniform(-s, s, 60) for s in (1e-8, 1e-3, 1.0, 10.0, 1e3, 1e5)])
    octants = rng.integers(-127323, 127323, 150) * (np.pi / 4)
    return np.concatenate([scales, octants, np.nextafter(octants, np.inf), np.nextafter(octants, -np.inf), [0.0]])


def test_sincos_is_as_accurate_as_it_says():
    x = hard_angles()
    s, c = (np.asarray(v) for v in jax.jit(sincos)(x))
    for name, got, exact in (("sine", s, exact_sine), ("cosine", c, exact_cosine)):
        error = [abs(float(Decimal(g) - exact(float(a)))) for g, a in zip(got.tolist(), x, strict=True)]
        assert max(error) < CLAIMED, f"{name}: {max(error):.2e} at {x[int(np.argmax(error))]!r} rad"


@given(numbers(-1e4, 1e4))
def test_sincos_lies_on_the_unit_circle_and_is_odd_and_even(x):
    s, c = (np.asarray(v) for v in sincos(x))
    np.testing.assert_allclose(s * s + c * c, 1.0, rtol=0, atol=1e-15)
    back_s, back_c = (np.asarray(v) for v in sincos(-x))
    np.testing.assert_array_equal(back_s, -s)
    np.testing.assert_array_equal(back_c, c)


def test_sincos_of_what_is_no_angle_is_no_number():
    for value in sincos(np.array([np.nan, np.inf, -np.inf])):
        assert np.isnan(value).all()


def test_derivatives_of_sincos():
    x = np.array([[-3.0], [0.0], [0.7], [np.pi / 2], [1234.5]])
    assert_derivatives(lambda v: sincos(v[0]), x, step=1e-2, tolerance=1e-10)
    assert_derivatives(lambda v: jax.jacfwd(lambda a: jnp.stack(sincos(a)))(v[0]), x, step=1e-2, tolerance=1e-10)


@pytest.mark.parametrize("outer, inner", [(jax.jacfwd, jax.jacfwd), (jax.jacrev, jax.jacfwd), (jax.jacfwd, jax.jacrev)])
def test_second_derivative_of_sine_is_minus_sine(outer, inner):
    x = np.linspace(-7, 7, 9)
    second = jax.vmap(outer(inner(lambda a: sincos(a)[0])))(x)
    np.testing.assert_allclose(second, -np.sin(x), rtol=0, atol=1e-15)


def test_the_structural_zero_turns_nothing():
    assert sincos(0) == (0, 1)
    assert rx(0) == IDENTITY


@pytest.mark.parametrize("axis", "xyz")
@given(angle=numbers(-10, 10))
def test_elementary_rotations_are_active_and_right_handed(axis, angle):
    np.testing.assert_allclose(matrix(ELEMENTARY[axis](angle)), about(axis, angle).as_matrix(), rtol=0, atol=1e-15)


def multiplications(f, *arguments) -> int:
    """Multiplications that XLA is given outside of sincos (which is one call of its own)."""
    return sum(e.primitive.name == "mul" for e in jax.make_jaxpr(f)(*arguments).eqns)


def test_structural_zeros_fold_while_tracing():
    def product(a, b, c):
        return matmul(ELEMENTARY["x"](a), matmul(ELEMENTARY["y"](b), ELEMENTARY["z"](c)))

    # By hand, with sa sb and ca sb computed once: 2 + (2 + 5) + 5; two products of full matrices take 54.
    assert multiplications(product, 0.1, 0.2, 0.3) <= 14


def test_a_rotated_point_costs_four_multiplications_a_turn():
    def into(a, x, y, z):
        rows = ELEMENTARY["y"](a)
        return matmul(rows, ((x,), (y,), (z,)))

    assert multiplications(into, 0.1, 1.0, 2.0, 3.0) == 4


def test_an_angle_known_by_its_sine_and_cosine_stands_for_the_angle():
    x = np.linspace(-7, 7, 23)
    angle = Angle.of(x)
    np.testing.assert_allclose([angle.sine, angle.cosine], [np.sin(x), np.cos(x)], rtol=0, atol=4e-16)
    assert sincos(angle) == (angle.sine, angle.cosine)
    for axis in "xyz":
        np.testing.assert_array_equal(matrix(ELEMENTARY[axis](angle)), matrix(ELEMENTARY[axis](x)))


def test_the_structural_zero_is_its_own_angle():
    assert Angle.of(0) == 0 and isinstance(Angle.of(0), int)
    assert isinstance(Angle.of(np.float64(0.0)), Angle), "a zero that was measured is a number like any other"


def test_an_angle_passes_through_jit_and_derivatives():
    x = np.array([0.3, -2.0])
    angle = jax.jit(Angle.of)(x)
    np.testing.assert_array_equal(angle.sine, Angle.of(x).sine)
    slope = jax.jvp(lambda a: Angle.of(a).sine, (x,), (np.ones(2),))[1]
    np.testing.assert_allclose(slope, np.cos(x), rtol=0, atol=4e-16)

"""Quantiles of an error's length: closed forms, nested quadrature of the normal density by scipy, draws, and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from tests.derivatives import assert_derivatives
from whiskjax.estimate.accuracy import accuracy, error_radius
from whiskjax.rules import WhiskjaxError

RATIOS = (1.0, 3.0, 30.0, 1e3, 1e4)


def turned(sigma, seed=0):
    """A covariance with these axes in a direction that is nothing special, and the rotation."""
    d = len(sigma)
    if d == 1:
        return np.array([[sigma[0] ** 2]]), np.eye(1)
    angle = np.random.default_rng(seed).uniform(0.2, 1.3)
    rotation = Rotation.from_rotvec([0.3, -0.5, angle]).as_matrix() if d == 3 else Rotation.from_rotvec([0, 0, angle]).as_matrix()
    rotation = rotation[:d, :d]
    return rotation @ np.diag(np.square(sigma)) @ rotation.T, rotation


NODES, WEIGHTS = np.polynomial.legendre.leggauss(30)


def within(radius, sigma, mean):
    """P(|x| < radius) for independent axes: the textbook's nested integral, the shortest axis by the normal distribution."""
    if sigma[-1] == 0:
        return within(np.sqrt(np.maximum(radius**2 - mean[-1] ** 2, 0.0)), sigma[:-1], mean[:-1])
    s, m = sigma[0], mean[0]
    if len(sigma) == 1:
        # The tail that is smaller, so that nothing cancels.
        low, high = (-radius - m) / s, (radius - m) / s
        return np.where(low + high < 0, ndtr(high) - ndtr(low), ndtr(-low) - ndtr(-high))
    # The inner probability steps where the ball is as wide as the other axes' bias, within a few of their sigmas.
    steps = {np.linalg.norm(mean[1:]) + k * rest for rest in sigma[1:] for k in (-8, -3, -1, 0, 1, 3, 8)}
    edges = [side * np.sqrt(radius**2 - step**2) for step in steps if abs(step) < radius for side in (-1, 1)]
    edges += [m + k * s for k in (-9, -4, -1.5, 0, 1.5, 4, 9)]
    low, high = max(-radius, m - 9 * s), min(radius, m + 9 * s)
    edges = np.array([low, *sorted(e for e in edges if low < e < high), high])
    # u = centre + half sin(t): the square roots at both ends become smooth.
    half, t = np.diff(edges)[:, None] / 2, NODES * np.pi / 2
    u = (edges[:-1, None] + edges[1:, None]) / 2 + half * np.sin(t)
    weight = half * np.cos(t) * WEIGHTS * np.pi / 2 * np.exp(-(((u - m) / s) ** 2) / 2) / (s * np.sqrt(2 * np.pi))
    left = np.sqrt(np.maximum(radius**2 - u * u, 0.0))
    inner = within(left, sigma[1:], mean[1:]) if len(sigma) == 2 else np.vectorize(lambda r: within(r, sigma[1:], mean[1:]))(left)
    return float((weight * inner).sum())


def assert_radius(radius, probability, sigma, mean, tolerance=1e-7):
    """The true quantile lies within `tolerance` of the radius: the oracle's probability passes the wanted one in between."""
    low, high = (within(radius * (1 + side * tolerance), sigma, mean) for side in (-1, 1))
    assert low <= probability <= high, (radius, low - probability, high - probability)


@pytest.mark.parametrize(
    "d, probability, expected",
    [
        (1, 0.9, 1.6448536269514722),
        (2, 0.9, np.sqrt(-2 * np.log(0.1))),
        (2, 0.5, np.sqrt(2 * np.log(2))),
        (3, 0.9, 2.500277710809411),
    ],
)
def test_equal_axes_have_the_factors_of_the_tables(d, probability, expected):
    assert float(error_radius(np.eye(d), probability)) == pytest.approx(expected, rel=1e-12)
    assert float(error_radius(49e4 * np.eye(d), probability)) == pytest.approx(700 * expected, rel=1e-12)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("probability", [0.001, 0.05, 0.5, 0.9, 0.99, 0.999999])
def test_equal_axes_with_a_bias_are_noncentral_chi(d, probability):
    bias = np.array([0.6, -0.64, 0.48])[:d] / np.linalg.norm([0.6, -0.64, 0.48][:d])
    lengths = np.array([1e-3, 0.3, 1.0, 3.0, 10.0])
    expected = np.sqrt(scipy.stats.ncx2.ppf(probability, d, lengths**2))
    found = error_radius(np.eye(d), probability, lengths[:, None] * bias)
    # scipy's root search stops at 1e-9 or so.
    np.testing.assert_allclose(found, expected, rtol=2e-8)


@pytest.mark.parametrize(("d", "probability"), [(1, 0.05), (2, 0.0920429), (3, 0.0345079)])
def test_a_search_that_has_arrived_stays(d, probability):
    """Of thousands of lanes: rounding may put Newton's last step a hair outside of its bracket."""
    lengths = 10 ** np.random.default_rng(1).uniform(-3, 1, 4000)
    expected = np.sqrt(scipy.stats.ncx2.ppf(probability, d, lengths**2))
    found = error_radius(np.eye(d), probability, lengths[:, None] * np.eye(d)[0])
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("probability", [0.01, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("ratio", RATIOS)
def test_ellipses(probability, ratio):
    """Axis ratios from a circle to a needle, without and with a bias along, across and oblique, up to ten long sigmas."""
    sigma = [1.0, 1 / ratio]
    covariance, rotation = turned(sigma)
    for mean in ([0, 0], [0.5, 0], [0, 0.5], [3, -2], [10, 0], [0, 10], [7, 7]):
        found = float(error_radius(covariance, probability, rotation @ mean))
        assert_radius(found, probability, sigma, np.array(mean, dtype=float))


@pytest.mark.parametrize("sigma", [[1, 0.5, 0.2], [1, 1, 0.01], [1, 0.03, 0.03], [1, 0.1, 1e-4], [1, 1e-3, 1e-4], [1, 0.3, 0]])
def test_ellipsoids(sigma):
    covariance, rotation = turned(sigma)
    for probability, mean in ((0.9, [0, 0, 0]), (0.9, [1, 0.3, 2]), (0.5, [0, 0, 10])):
        found = float(error_radius(covariance, probability, rotation @ mean))
        assert_radius(found, probability, sigma, np.array(mean, dtype=float), tolerance=1e-6)


def test_an_axis_may_be_zero():
    """A line in the plane is 1-D, a plane in space 2-D; a bias across a line adds by Pythagoras."""
    covariance, rotation = turned([2.0, 0.0])
    assert float(error_radius(covariance, 0.9)) == pytest.approx(2 * 1.6448536269514722, rel=1e-10)
    across = float(error_radius(covariance, 0.9, rotation @ [0.0, 5.0]))
    assert across == pytest.approx(np.hypot(2 * 1.6448536269514722, 5.0), rel=1e-10)
    covariance, _ = turned([2.0, 2.0, 0.0])
    assert float(error_radius(covariance, 0.9)) == pytest.approx(2 * np.sqrt(-2 * np.log(0.1)), rel=1e-10)
    assert float(error_radius(np.zeros((2, 2)), 0.9, [3.0, 4.0])) == 5.0
    assert float(error_radius(np.zeros((3, 3)), 0.9)) == 0.0


def test_a_bias_beyond_ten_sigma():
    """The error along a far bias is normal, the error across it lifts the length by sigma^2 / 2 b."""
    for length in (1e2, 1e4, 1e6):
        over = float(error_radius(np.diag([1.0, 0.25]), 0.9, [length, 0.0])) - length
        assert over == pytest.approx(1.2815515655446004 + 0.125 / length, abs=1 / length**2 + 1e-9)


def test_draws_of_an_oblique_look():
    """A million draws; the share within each radius has a sigma of 0.0003 (0.0005 at the median)."""
    rng = np.random.default_rng(4)
    covariance, rotation = turned([14.0, 2.0, 0.7])
    bias = rotation @ [3.0, -4.0, 1.0]
    x = rng.multivariate_normal(bias, covariance, 1_000_000)
    found = accuracy(covariance, bias)
    flat, up, length = np.hypot(x[:, 0], x[:, 1]), np.abs(x[:, 2]), np.linalg.norm(x, axis=1)
    assert np.mean(flat < found.cep50_m) == pytest.approx(0.5, abs=4 * 0.0005)
    for sample, radius in ((flat, found.ce90_m), (up, found.le90_m), (length, found.se90_m)):
        assert np.mean(sample < radius) == pytest.approx(0.9, abs=4 * 0.0003)


@pytest.mark.parametrize("ratio, short_by", [(1, 0.0), (3, 0.15), (5, 0.22), (10, 0.28), (100, 0.34)])
def test_a_factor_on_an_averaged_sigma_is_wrong(ratio, short_by):
    """CE90 = 2.146 (sigma_e + sigma_n) / 2 holds for circles; for the needles of oblique looks it is a third too small."""
    sigma, rule = [1.0, 1 / ratio], 2.145966026289347 * (1 + 1 / ratio) / 2
    exact = scipy.optimize.brentq(lambda r: within(r, sigma, np.zeros(2)) - 0.9, 0.5, 4, xtol=1e-10)
    assert float(error_radius(np.diag(np.square(sigma)), 0.9)) == pytest.approx(exact, rel=1e-9)
    assert 1 - rule / exact == pytest.approx(short_by, abs=0.01)


def test_scale_rotation_and_probability():
    covariance, _ = turned([1.0, 0.2, 0.05])
    bias = np.array([0.3, -0.5, 0.1])
    base = float(error_radius(covariance, 0.9, bias))
    assert float(error_radius(1e-10 * covariance, 0.9, 1e-5 * bias)) == pytest.approx(1e-5 * base, rel=1e-10)
    assert float(error_radius(1e16 * covariance, 0.9, 1e8 * bias)) == pytest.approx(1e8 * base, rel=1e-10)
    turns = Rotation.random(20, rng=1).as_matrix()
    everywhere = error_radius(turns @ covariance @ np.swapaxes(turns, 1, 2), 0.9, turns @ bias)
    np.testing.assert_allclose(everywhere, base, rtol=1e-10)
    assert float(error_radius(covariance, 0.9, -bias)) == pytest.approx(base, rel=1e-12)
    rising = [float(error_radius(covariance, p, bias)) for p in np.linspace(0.001, 0.999, 60)]
    assert (np.diff(rising) > 0).all()


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_batch_shapes(shape):
    rng = np.random.default_rng(2)
    root = rng.normal(size=(*shape, 3, 3))
    covariance, bias = root @ np.swapaxes(root, -1, -2), rng.normal(size=(*shape, 3))
    found = accuracy(covariance, bias)
    for name in ("cep50_m", "ce90_m", "le90_m", "se90_m"):
        values = np.asarray(getattr(found, name))
        assert values.shape == shape
        one_by_one = [float(getattr(accuracy(covariance[i], bias[i]), name)) for i in np.ndindex(*shape)]
        np.testing.assert_allclose(values.ravel(), one_by_one, rtol=1e-12)
    # One covariance, many biases; and a map over lanes.
    flat = bias[..., :2]
    assert error_radius(np.eye(2), 0.9, flat).shape == shape
    mapped = jax.jit(jax.vmap(lambda b: error_radius(jnp.eye(2), 0.9, b)))(flat.reshape(-1, 2))
    np.testing.assert_allclose(np.ravel(mapped), np.ravel(error_radius(np.eye(2), 0.9, flat)), rtol=1e-12)


AXES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def of_packed(v):
    """SE90 of six entries of the covariance and three of the bias."""
    place = np.zeros((3, 3), dtype=int)
    for k, (i, j) in enumerate(AXES):
        place[i, j] = place[j, i] = k
    return error_radius(v[:6][place], 0.9, v[6:])


def packed(covariance, bias):
    return np.concatenate([[covariance[i, j] for i, j in AXES], bias])


def test_derivatives_three_ways():
    """An ellipsoid with a bias, a ball, a spheroid, and a needle: equal axes have no derivatives of their eigenvectors."""
    points = [
        packed(turned([1.0, 0.5, 0.2])[0], [0.3, -0.2, 0.5]),
        packed(np.eye(3), np.zeros(3)),
        packed(np.diag([1.0, 1.0, 0.04]), [0, 0, 0.3]),
        packed(turned([1.0, 0.03, 0.02])[0], [0.1, 0.2, 0.0]),
    ]
    assert_derivatives(of_packed, points, step=np.array([2e-5] * 6 + [1e-3] * 3), tolerance=1e-9)


def test_derivative_of_equal_axes_is_their_share():
    """By symmetry each axis of a ball carries the same share, and scaling makes the sum r / 2 sigma^2."""
    gradient = jax.grad(lambda c: error_radius(c, 0.9))(4 * jnp.eye(3))
    np.testing.assert_allclose(gradient, np.eye(3) * 2 * 2.500277710809411 / 24, rtol=0, atol=1e-12)


def test_second_derivative():
    """A small bias lifts the radius of a circle by r b^2 / 4: the noncentral chi-square as a Poisson mixture, first order."""
    found = jax.jit(jax.hessian(lambda b: error_radius(jnp.eye(2), 0.9, b)))(jnp.zeros(2))
    np.testing.assert_allclose(found, np.eye(2) * 2.145966026289347 / 2, rtol=0, atol=1e-10)


BAD = [
    (np.diag([1.0, -1e-6]), [0.0, 0.0]),
    (-np.eye(2), [0.0, 0.0]),
    (np.array([[1.0, 2.0], [2.0, 1.0]]), [0.0, 0.0]),
    (np.array([[1.0, 0.5], [0.4, 1.0]]), [0.0, 0.0]),
    (np.full((2, 2), np.nan), [0.0, 0.0]),
    (np.eye(2), [np.nan, 0.0]),
    (np.diag([np.inf, 1.0]), [0.0, 0.0]),
]


@pytest.mark.parametrize("covariance, bias", BAD)
def test_what_is_no_covariance_is_refused(covariance, bias):
    with pytest.raises(WhiskjaxError, match="positive semi-definite"):
        error_radius(covariance, 0.9, bias)


def test_inside_jit_what_is_no_covariance_is_not_a_number():
    covariance, bias = (
        np.stack([*part, good]) for part, good in zip(zip(*BAD, strict=True), (np.eye(2), [0.0, 0.0]), strict=True)
    )
    inside = jax.jit(lambda c, b: error_radius(c, 0.9, b))(covariance, bias)
    np.testing.assert_array_equal(np.isnan(inside), [True] * len(BAD) + [False])


def test_the_refusal_names_the_first_lane():
    covariance = np.broadcast_to(np.eye(2), (3, 2, 2, 2)).copy()
    covariance[1, 1] *= -1
    with pytest.raises(WhiskjaxError, match=r"\[1, 1\]"):
        error_radius(covariance, 0.9)


@pytest.mark.parametrize("probability", [0.0, 1.0, 90.0, -0.5, 1e-4, float("nan")])
def test_a_share_is_between_0_and_1(probability):
    with pytest.raises(WhiskjaxError, match="probability"):
        error_radius(np.eye(2), probability)


@pytest.mark.parametrize("shape", [(3,), (4, 4), (2, 3), ()])
def test_shapes_that_are_no_covariance(shape):
    with pytest.raises(WhiskjaxError, match="shape"):
        error_radius(np.ones(shape), 0.9)

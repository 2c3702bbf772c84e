"""How far off a position is: exact quantiles of the length of a normal error with any covariance and a bias.

The square of the length, Q = |x|^2 with x ~ N(b, C), has the Laplace transform

    E exp(-s Q) = det(I + 2 s C)^(-1/2) exp(-s b' (I + 2 s C)^-1 b),

which needs no eigenvectors: it is smooth where axes are equal, and an axis of zero length is nothing special. Probability and
density of Q are its Bromwich integrals, taken along a hyperbola through the saddle point of the integrand on the real axis. On
it the integrand falls off doubly exponentially, whatever the ratio of the axes, so that the trapezoidal rule with a few nodes is
exact (rule and figures: tests/estimate/test_accuracy.py).

**Reference:** Rice (1980), SIAM J. Sci. Stat. Comput. 1, 438-448 (quadratic forms in normal variables through the saddle point);
Weideman and Trefethen (2007), Math. Comp. 76, 1341-1356 (hyperbolic contours).
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.special import ndtri
from jaxtyping import Array, Float

from ..algebra.vectors import Component, dot, total, unstack
from ..rules import Arrays, Numbers, WhiskjaxError, is_traced, require_x64

# The contour s0 + w (i sinh u + slope (1 - cosh u)), 0 <= u <= reach. A slope below 1 leaves a Gaussian integrand (a bias of many
# sigma) falling, a slope above 0 gives one that falls like a power of s (a needle) the decay of exp(s q).
_SLOPE = 0.7
# Nodes and reach: one for the search (1e-5 of the probability), one for the answer (1e-11).
_COARSE, _FINE = (24, 4.0), (48, 5.0)
# Newton on normal scores takes 3 to 5 steps, up to 8 beside the ends of the probabilities.
_STEPS = 8
_LOWEST, _HIGHEST = 1e-3, 1 - 1e-6
# Of log s: where Newton's step has come down to this, it is rounding that decides on which side of the bracket it ends.
_ARRIVED = 1e-6
# An eigenvalue below zero by less than this share of the trace is rounding.
_ROUNDING = 1e-9


class Accuracy(eqx.Module):
    """Exact accuracy measures of a position in metres, each of shape (...).

    **Attributes:**

    - `cep50_m`, `ce90_m`: circular error, the horizontal distance that 50 and 90 of 100 errors stay within.
    - `le90_m`: linear error, the same in height for 90 of 100.
    - `se90_m`: spherical error, the same in space for 90 of 100.
    """

    cep50_m: Float[Array, "..."]
    ce90_m: Float[Array, "..."]
    le90_m: Float[Array, "..."]
    se90_m: Float[Array, "..."]

    def __check_init__(self):
        arrays = Arrays("Accuracy")
        for name in ("cep50_m", "ce90_m", "le90_m", "se90_m"):
            arrays.take(name, getattr(self, name), "...")


def accuracy(covariance_enu_m2: Float[Numbers, "... 3 3"], bias_enu_m: Float[Numbers, "... 3"] | None = None) -> Accuracy:
    """Accuracy of a position from the covariance and the bias of its error.

    **Arguments:**

    - `covariance_enu_m2`: covariance in east, north, up, square metres, shape (..., 3, 3).
    - `bias_enu_m`: mean error in the same frame, metres, shape (..., 3); none where left out.

    **Returns:** the measures, each of shape (...).

    **Raises:** as `error_radius`.
    """
    arrays = Arrays("accuracy")
    covariance = jnp.asarray(arrays.take("covariance_enu_m2", covariance_enu_m2, "... 3 3"))
    bias = jnp.zeros(3) if bias_enu_m is None else jnp.asarray(arrays.take("bias_enu_m", bias_enu_m, "... 3"))

    def radius(axes: slice, probability: float) -> Array:
        return error_radius(covariance[..., axes, axes], probability, bias[..., axes])

    horizontal, vertical, space = slice(0, 2), slice(2, 3), slice(0, 3)
    return Accuracy(radius(horizontal, 0.5), radius(horizontal, 0.9), radius(vertical, 0.9), radius(space, 0.9))


def error_radius(
    covariance: Float[Numbers, "... d d"], probability: float, bias: Float[Numbers, "... d"] | None = None
) -> Float[Array, "..."]:
    """The radius that a normal error of 1, 2 or 3 dimensions stays within with a given probability.

    Exact to 1e-9 of the radius for axes of any ratio (an axis may be zero) and a bias of up to ten times the longest. It can be
    differentiated by covariance and bias any number of times, equal axes included.

    **Arguments:**

    - `covariance`: shape (..., d, d), d = 1, 2 or 3, in the square of any unit.
    - `probability`: between 0.001 and 0.999999.
    - `bias`: mean of the error, shape (..., d); zero where left out.

    **Returns:** the radius, shape (...), in the unit of the error; not a number, inside `jax.jit`, for what is refused outside.
    Where the covariance is zero (sigma below 1e-12 of the bias) it is the length of the bias, whose derivative by the covariance
    does not exist and is returned as zero.

    **Raises:** `WhiskjaxError` where a covariance is not symmetric, not positive semi-definite or not finite, or the probability
    or a shape is out of range; `RuntimeError` where float64 is off.
    """
    require_x64("error_radius")
    arrays = Arrays("error_radius")
    if not _LOWEST <= float(arrays.take("probability", probability, "")) <= _HIGHEST:
        arrays.refuse("probability", f"is {probability}, and a share between {_LOWEST} and {_HIGHEST} is expected")
    covariance = jnp.asarray(arrays.take("covariance", covariance, "... d d", meaning="d = 1, 2 or 3"))
    if covariance.shape[-1] not in (1, 2, 3):
        arrays.refuse("covariance", f"has shape {covariance.shape}, expected (..., d, d) with d = 1, 2 or 3")
    bias = jnp.zeros(covariance.shape[-1:]) if bias is None else jnp.asarray(arrays.take("bias", bias, "... d"))
    batch = jnp.broadcast_shapes(covariance.shape[:-2], bias.shape[:-1])
    covariance = jnp.broadcast_to(covariance, batch + covariance.shape[-2:])
    radius = _radius(covariance, jnp.broadcast_to(bias, batch + covariance.shape[-1:]), probability)
    if not is_traced(radius) and not jnp.isfinite(radius).all():
        where = tuple(int(i) for i in jnp.argwhere(~jnp.isfinite(radius))[0])
        raise WhiskjaxError(f"covariance or bias{list(where) or ''} is not symmetric, not positive semi-definite or not finite")
    return radius


@jax.jit
def _radius(covariance: Float[Array, "... d d"], bias: Float[Array, "... d"], probability: Component) -> Component:
    b = unstack(bias)
    half = [unstack(column) for column in unstack(covariance / 2)]
    c = tuple(tuple(half[i][j] + half[j][i] for j in range(len(b))) for i in range(len(b)))
    trace = total(c[i][i] for i in range(len(b)))
    skew = total(jnp.abs(half[i][j] - half[j][i]) for i in range(len(b)) for j in range(i))
    # The pivots of rounding * trace * I + C are positive, or the root of one is not a number.
    certain = trace <= 1e-24 * dot(b, b)
    s = 1 / (2 * _ROUNDING * jnp.where(certain, 1.0, trace))
    sound = jnp.isfinite(_transform(s, c, b)[0] + dot(b, b)) & (skew <= _ROUNDING * trace) & (trace >= 0)
    usual = ~certain & sound
    c = tuple(tuple(jnp.where(usual, c[i][j], float(i == j)) for j in range(len(b))) for i in range(len(b)))
    squared, _, _ = _quantile(c, tuple(jnp.where(usual, a, 0.0) for a in b), jnp.broadcast_to(probability, trace.shape))
    squared = jnp.where(certain, dot(b, b), squared)
    exists = squared > 0
    return jnp.where(sound, jnp.where(exists, jnp.sqrt(jnp.where(exists, squared, 1.0)), 0.0), jnp.nan)


def _transform(s: Component, covariance: Sequence[Sequence[Component]], bias: Sequence[Component]) -> tuple[Component, Component]:
    """det(I + 2 s C)^(-1/2) and the exponent of E exp(-s |x|^2), by elimination in I + 2 s C.

    For a complex s off the negative axis all eigenvalues of I + 2 s C lie on a ray from 1 that does not meet the negative axis;
    then nor does a pivot, and the product of principal roots is the branch that starts from 1 at s = 0.
    """
    d = len(bias)
    y = [b.astype(s.dtype) for b in bias]
    a = [[2 * s * covariance[i][j].astype(s.dtype) + float(i == j) for j in range(i + 1)] for i in range(d)]
    root, exponent = jnp.ones_like(s), jnp.zeros_like(s)
    for k in range(d):
        inverse = 1 / a[k][k]
        root, exponent = root * jnp.sqrt(inverse), exponent - s * y[k] * y[k] * inverse
        for i in range(k + 1, d):
            factor = a[i][k] * inverse
            y[i] = y[i] - factor * y[k]
            for j in range(k + 1, i + 1):
                a[i][j] = a[i][j] - factor * a[j][k]
    return root, exponent


def _mean_and_variance(s: Component, covariance, bias) -> tuple[Component, Component]:
    """Of |x|^2 under the density tilted by exp(-s |x|^2): the first two derivatives of the logarithm of the transform."""

    def logarithm(s: Component) -> Component:
        root, exponent = _transform(s, covariance, bias)
        return jnp.log(root) + exponent

    one = jnp.ones_like(s)
    slope = lambda s: jax.jvp(logarithm, (s,), (one,))[1]
    minus_mean, variance = jax.jvp(slope, (s,), (one,))
    return -minus_mean, variance


def _distribution(rule: tuple[int, float], q: Component, s0: Component, width: Component, covariance, bias):
    """Probability that |x|^2 < q, and its density at q, both along the contour through s0."""

    def node(u: Component) -> tuple[Component, Component]:
        s = jax.lax.complex(s0 + width * _SLOPE * (1 - jnp.cosh(u)), width * jnp.sinh(u))
        ds = jax.lax.complex(-width * _SLOPE * jnp.sinh(u), width * jnp.cosh(u))
        root, exponent = _transform(s, covariance, bias)
        density = root * jnp.exp(s * q.astype(s.dtype) + exponent) * ds
        return (density / s).imag, density.imag

    # The contour is symmetric about the real axis: half of it, and half the weight where it begins.
    nodes, reach = rule
    weight = jnp.full(nodes, reach / (nodes - 1) / jnp.pi).at[0].multiply(0.5)
    probability, density = jax.vmap(node)(jnp.linspace(0, reach, nodes))
    return jnp.tensordot(weight, probability, 1), jnp.tensordot(weight, density, 1)


@jax.custom_jvp
def _quantile(covariance, bias, probability: Component) -> tuple[Component, Component, Component]:
    """The q with P(|x|^2 < q) = probability, and the contour through its saddle point: s0 and width.

    The saddle point of exp(s q) E exp(-s Q) / s lies where q = 1/s + mean of Q tilted by s: q falls with s. So s is what is
    searched for, and no saddle point ever is: by Newton on normal scores, in which P is nearly linear, within a bracket.
    """
    zero = jnp.zeros_like(probability)
    _, variance = _mean_and_variance(zero, covariance, bias)
    score, sigma = ndtri(probability), jnp.sqrt(variance)

    def at(log_s: Component, rule: tuple[int, float]) -> tuple[Component, ...]:
        s = jnp.exp(log_s)
        mean, variance = _mean_and_variance(s, covariance, bias)
        curvature = 1 / (s * s) + variance
        q, width = 1 / s + mean, 1 / jnp.sqrt(curvature)
        return q, s, width, *_distribution(rule, q, s, width, covariance, bias)

    def step(_, state):
        log_s, low, high = state
        _, s, width, reached, density = at(log_s, _COARSE)
        low, high = jnp.where(reached > probability, log_s, low), jnp.where(reached > probability, high, log_s)
        here = ndtri(jnp.clip(reached, 1e-300, 1 - 1e-16))
        slope = -density * s / (width * width) * jnp.exp(here * here / 2) * jnp.sqrt(2 * jnp.pi)
        newton = log_s - (here - score) / slope
        is_fine = (newton >= low) & (newton <= high) | (jnp.abs(newton - log_s) < _ARRIVED)
        return jnp.where(is_fine, newton, (low + high) / 2), low, high

    # A normal Q of the same mean and variance has q = 1/s + mean - variance s.
    start = jnp.log((jnp.sqrt(score * score + 4) - score) / (2 * sigma))
    bracket = jnp.log(1e-2 / sigma), jnp.log(1e8 / sigma)
    log_s, _, _ = jax.lax.fori_loop(0, _STEPS, step, (start, *bracket))
    q, s, width, reached, density = at(log_s, _FINE)
    return q - (reached - probability) / density, s, width


@_quantile.defjvp
def _quantile_jvp(primals, tangents):
    """Implicit: what the probability within q gains, over the density at q. The value does not depend on the contour."""
    covariance, bias, probability = primals
    q, s, width = _quantile(covariance, bias, probability)
    within = lambda covariance, bias: _distribution(_FINE, q, s, width, covariance, bias)
    (_, density), (gain, _) = jax.jvp(within, (covariance, bias), tangents[:2])
    return (q, s, width), ((tangents[2] - gain) / density, jnp.zeros_like(s), jnp.zeros_like(width))

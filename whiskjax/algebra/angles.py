"""Sines and cosines that vectorise, and the elementary rotations made of them."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .vectors import Component, Mat3, is_structural

# pi/2 in two parts (33 + 53 bits: k * PIO2_HI is exact for |k| < 2**20) and the minimax polynomials on [-pi/4, pi/4] of the
# fdlibm kernels k_sin.c and k_cos.c (Sun Microsystems, 1993).
_PIO2_HI, _PIO2_LO = 1.57079632673412561417, 6.07710050650619224932e-11
_SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COS = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def _horner(z: Float[Array, "..."], coefficients: tuple[float, ...]) -> Float[Array, "..."]:
    *rest, before, last = coefficients
    value = before + z * last
    for c in reversed(rest):
        value = c + z * value
    return value


@jax.jit  # traced once for each shape: a chain asks for dozens of angles
def _polynomials(x: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    k = jnp.round(x * (2 / jnp.pi))
    r = (x - k * _PIO2_HI) - k * _PIO2_LO
    z = r * r
    s = r + r * z * _horner(z, _SIN)
    c = 1.0 - 0.5 * z + z * z * _horner(z, _COS)
    quadrant = k - 4.0 * jnp.floor(0.25 * k)
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    sine, cosine = jnp.where(odd, c, s), jnp.where(odd, s, c)
    return (
        jnp.where(quadrant >= 2.0, -sine, sine),
        jnp.where((quadrant == 1.0) | (quadrant == 2.0), -cosine, cosine),
    )


@jax.custom_jvp
def _sincos(x: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    return _polynomials(x)


@_sincos.defjvp
def _sincos_jvp(primals, tangents):
    s, c = _sincos(*primals)
    return (s, c), (c * tangents[0], -s * tangents[0])


def sincos(angle_rad: Component) -> tuple[Component, Component]:
    """Sine and cosine of an angle together.

    XLA's float64 sin and cos on the CPU are scalar library calls; this one is polynomial arithmetic that vectorises. Its
    error is below 3e-16 for |angle| < 1e5 rad. The structural zero gives the structural (0, 1).
    """
    if is_structural(angle_rad, 0):
        return 0, 1
    return _sincos(jnp.asarray(angle_rad, dtype=jnp.result_type(float)))


SMALL_RAD = 0.05  # the first term left out of either series is below 1e-17


def sincos_of_small(angle_rad: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """The same for angles up to `SMALL_RAD` (half the turn from one POS sample to the next), in a third of the operations."""
    z = angle_rad * angle_rad
    sine = angle_rad * (1 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (1 / 362880)))))
    return sine, 1 + z * (-1 / 2 + z * (1 / 24 + z * (-1 / 720 + z * (1 / 40320))))


def rx(angle_rad: Component) -> Mat3:
    """Active right-handed rotation about x."""
    s, c = sincos(angle_rad)
    return ((1, 0, 0), (0, c, -s), (0, s, c))


def ry(angle_rad: Component) -> Mat3:
    """Active right-handed rotation about y."""
    s, c = sincos(angle_rad)
    return ((c, 0, s), (0, 1, 0), (-s, 0, c))


def rz(angle_rad: Component) -> Mat3:
    """Active right-handed rotation about z."""
    s, c = sincos(angle_rad)
    return ((c, -s, 0), (s, c, 0), (0, 0, 1))


ELEMENTARY = {"x": rx, "y": ry, "z": rz}

"""Sines and cosines that vectorise, and the elementary rotations made of them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .vectors import Component, Mat3, is_structural

# pi/2 in two parts (33 + 53 bits: k * PIO2_HI is exact for |k| < 2**20; fdlibm, e_rem_pio2.c) and the minimax polynomial of
# (sin(r) / r - 1) / r^2 on [-pi/2, pi/2], made with the Remez exchange: sin is off by at most 2e-19 before rounding.
_PIO2_HI, _PIO2_LO = 1.57079632673412561417, 6.07710050650619224932e-11
_SIN = (
    -1.66666666666666645502e-01,
    8.33333333333311400346e-03,
    -1.98412698411859607790e-04,
    2.75573192077869121124e-06,
    -2.50521066066355205289e-08,
    1.60589278363680798845e-10,
    -7.64271292549516603903e-13,
    2.71849634785522087460e-15,
)


def _sine(x: Float[Array, "..."], quarters: int) -> Float[Array, "..."]:
    """sin(x + quarters * pi/2).

    With one polynomial over half a turn, so that sine and cosine share nothing: XLA on the CPU makes a loop for each, and would
    evaluate in both what they share.
    """
    half_turns = jnp.round(x * (1 / jnp.pi) + 0.5 * quarters)
    k = 2.0 * half_turns - quarters
    r = (x - k * _PIO2_HI) - k * _PIO2_LO
    z = r * r
    *rest, value = _SIN
    for c in reversed(rest):
        value = c + z * value
    sine = r + r * z * value
    is_odd = half_turns - 2.0 * jnp.floor(0.5 * half_turns)
    return sine * (1.0 - 2.0 * is_odd)


@jax.jit  # traced once for each shape: a chain asks for dozens of angles
def _polynomials(x: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    return _sine(x, 0), _sine(x, 1)


@jax.custom_jvp
def _sincos(x: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    return _polynomials(x)


@_sincos.defjvp
def _sincos_jvp(primals, tangents):
    s, c = _sincos(*primals)
    return (s, c), (c * tangents[0], -s * tangents[0])


class Angle(eqx.Module):
    """An angle that is known by its sine and cosine, computed once; it can stand wherever an angle is asked for."""

    sine: Component
    cosine: Component

    @classmethod
    def of(cls, angle_rad: Component) -> Any:
        """Of an angle in radians; the structural zero stays one."""
        return angle_rad if is_structural(angle_rad, 0) else cls(*sincos(angle_rad))


def sincos(angle_rad: Component | Angle) -> tuple[Component, Component]:
    """Sine and cosine of an angle together.

    XLA's float64 sin and cos on the CPU are scalar library calls; this one is polynomial arithmetic that vectorises. Its
    error is below 3e-16 for |angle| < 1e5 rad. The structural zero gives the structural (0, 1).
    """
    if is_structural(angle_rad, 0):
        return 0, 1
    if isinstance(angle_rad, Angle):
        return angle_rad.sine, angle_rad.cosine
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

"""Closed forms for small symmetric systems, on components: library routines cost 7 to 14 times as much on the CPU."""

import jax.numpy as jnp

from .vectors import Component, Mat3, Vec3


def inverse_lower(upper: tuple[Component, ...]) -> tuple[Component, ...]:
    """L^-1 of a symmetric positive definite 3x3 matrix A = L L^T (Cholesky).

    **Arguments:** `upper`: (a00, a01, a02, a11, a12, a22).

    **Returns:** (k00, k10, k11, k20, k21, k22); not finite where the matrix is not positive definite.
    """
    a00, a01, a02, a11, a12, a22 = upper
    l00 = jnp.sqrt(a00)
    l10, l20 = a01 / l00, a02 / l00
    l11 = jnp.sqrt(a11 - l10 * l10)
    l21 = (a12 - l20 * l10) / l11
    l22 = jnp.sqrt(a22 - l20 * l20 - l21 * l21)
    k00, k11, k22 = 1 / l00, 1 / l11, 1 / l22
    k10 = -l10 * k00 * k11
    k21 = -l21 * k11 * k22
    k20 = -(l20 * k00 + l21 * k10) * k22
    return k00, k10, k11, k20, k21, k22


def solve3(upper: tuple[Component, ...], right: Vec3) -> tuple[Vec3, Mat3]:
    """Solve a symmetric positive definite 3x3 system, by Cholesky.

    **Arguments:** `upper`: (a00, a01, a02, a11, a12, a22); `right`: the right side.

    **Returns:** the solution and the inverse matrix; not finite where the matrix is not positive definite.
    """
    k00, k10, k11, k20, k21, k22 = inverse_lower(upper)
    y0, y1, y2 = right
    z0, z1, z2 = k00 * y0, k10 * y0 + k11 * y1, k20 * y0 + k21 * y1 + k22 * y2
    solution = k00 * z0 + k10 * z1 + k20 * z2, k11 * z1 + k21 * z2, k22 * z2
    i00, i01, i02 = k00 * k00 + k10 * k10 + k20 * k20, k10 * k11 + k20 * k21, k20 * k22
    i11, i12, i22 = k11 * k11 + k21 * k21, k21 * k22, k22 * k22
    return solution, ((i00, i01, i02), (i01, i11, i12), (i02, i12, i22))

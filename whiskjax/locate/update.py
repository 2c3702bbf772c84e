"""The algebra of one measurement: a pair of numbers corrects a state of any length, on components.

The state is a tuple, its covariance the upper triangle of a symmetric matrix as rows of a full one, whose entries may be structural
zeros (the cross-covariance of a state that nothing links): they cost nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ..algebra.vectors import Component, Vec2, Vec3, add, dot, mul, sub

State = tuple[Component, ...]
Covariance = tuple[tuple[Component, ...], ...]
Rows = tuple[Sequence[Component], Sequence[Component]]


class Innovation(NamedTuple):
    """Measured minus predicted in px, its covariance (s00, s01, s11) and the normalised square, chi-square with 2 freedoms."""

    residual_px: Vec2
    covariance_px2: Vec3
    nis: Component


def seen_by(covariance: Covariance, rows: Rows) -> Rows:
    """Covariance of the state with the pixel: P H^T, a column for each image axis."""
    x, y = (tuple(dot(row, h) for row in covariance) for h in rows)
    return x, y


def innovate(residual: Vec2, crossed: Rows, rows: Rows, noise: Vec3) -> tuple[Innovation, Vec3]:
    """The innovation, and the inverse of its covariance."""
    s00 = add(dot(rows[0], crossed[0]), noise[0])
    s01 = add(dot(rows[0], crossed[1]), noise[1])
    s11 = add(dot(rows[1], crossed[1]), noise[2])
    w = 1 / (s00 * s11 - s01 * s01)
    inverse = s11 * w, -s01 * w, s00 * w
    x, y = residual
    nis = inverse[0] * x * x + 2 * inverse[1] * x * y + inverse[2] * y * y
    return Innovation(residual, (s00, s01, s11), nis), inverse


def gain(crossed: Rows, inverse: Vec3, share: Sequence[Component]) -> Rows:
    """K = P H^T S^-1 (paper 003, equation 16), each row times its share: 0 for what is only considered or for a look left out."""
    i00, i01, i11 = inverse
    pairs = [(mul(w, a * i00 + b * i01), mul(w, a * i01 + b * i11)) for w, a, b in zip(share, *crossed, strict=True)]
    x, y = zip(*pairs, strict=True)
    return x, y


def corrected(state: State, k: Rows, residual: Vec2) -> State:
    """x + K (z - h(x)): paper 003, equation 17 with the residual of the image, not of its linearisation."""
    return tuple(add(x, add(mul(a, residual[0]), mul(b, residual[1]))) for x, a, b in zip(state, *k, strict=True))


def joseph(covariance: Covariance, k: Rows, crossed: Rows, rows: Rows, noise: Vec3) -> Covariance:
    """(I - K H) P (I - K H)^T + K R K^T (paper 003, equation 18), valid for every gain.

    Evaluated from the right as M = P - K (H P), P' = M - (M H^T - K R) K^T: products with two columns, no matrix with a matrix.
    """
    r00, r01, r11 = noise
    left = [
        tuple(sub(p, add(mul(a, cx), mul(b, cy))) for p, cx, cy in zip(row, *crossed, strict=True))
        for row, a, b in zip(covariance, *k, strict=True)
    ]
    back = [
        (
            sub(dot(row, rows[0]), add(mul(a, r00), mul(b, r01))),
            sub(dot(row, rows[1]), add(mul(a, r01), mul(b, r11))),
        )
        for row, a, b in zip(left, *k, strict=True)
    ]
    n = len(covariance)
    upper = {
        (i, j): sub(left[i][j], add(mul(back[i][0], k[0][j]), mul(back[i][1], k[1][j]))) for i in range(n) for j in range(i, n)
    }
    return tuple(tuple(upper[min(i, j), max(i, j)] for j in range(n)) for i in range(n))

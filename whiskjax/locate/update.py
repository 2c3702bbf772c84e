"""The algebra of one measurement: a pair of numbers corrects a state of any length, on components.

The state is a tuple, its covariance the rows of a symmetric matrix. Residual, derivatives and noise may be in any unit, the same
for all three.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ..algebra.vectors import Component, Vec2, Vec3, add, dot, mul, sub

State = tuple[Component, ...]
Covariance = tuple[tuple[Component, ...], ...]
Rows = tuple[Sequence[Component], Sequence[Component]]


class Innovation(NamedTuple):
    """Measured minus predicted, its covariance (s00, s01, s11), and its normalised square: chi-square with 2 freedoms."""

    residual: Vec2
    covariance: Vec3
    nis: Component


def seen_by(covariance: Covariance, rows: Rows) -> Rows:
    """Covariance of the state with the pixel: P H^T, a column for each image axis."""
    x, y = (tuple(dot(row, h) for row in covariance) for h in rows)
    return x, y


def innovate(residual: Vec2, crossed: Rows, rows: Rows, noise: Vec3) -> Innovation:
    """The innovation and its covariance S = H P H^T + R."""
    s00 = add(dot(rows[0], crossed[0]), noise[0])
    s01 = add(dot(rows[0], crossed[1]), noise[1])
    s11 = add(dot(rows[1], crossed[1]), noise[2])
    x, y = residual
    nis = (s11 * x * x - 2 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01)
    return Innovation(residual, (s00, s01, s11), nis)


def gain(crossed: Rows, s: Vec3, share: Sequence[Component]) -> Rows:
    """K = P H^T S^-1 (Liu et al. 2019, equation 16), each row times its share: 0 for what is only considered or a look left out.

    Divided entry by entry: XLA on the CPU keeps a quotient, but computes a product again wherever it is used.
    """
    s00, s01, s11 = s
    determinant = s00 * s11 - s01 * s01
    pairs = [
        (mul(w, (a * s11 - b * s01) / determinant), mul(w, (b * s00 - a * s01) / determinant))
        for w, a, b in zip(share, *crossed, strict=True)
    ]
    x, y = zip(*pairs, strict=True)
    return x, y


def corrected(state: State, k: Rows, residual: Vec2) -> State:
    """x + K (z - h(x)): Liu et al. (2019), equation 17 with the residual of the image, not of its linearisation."""
    return tuple(add(x, add(mul(a, residual[0]), mul(b, residual[1]))) for x, a, b in zip(state, *k, strict=True))


def joseph(covariance: Covariance, k: Rows, crossed: Rows, s: Vec3) -> Covariance:
    """(I - K H) P (I - K H)^T + K R K^T (Liu et al. 2019, equation 18), valid for every gain.

    With C = P H^T and S = H P H^T + R that is P - K C^T - (C - K S) K^T: nothing but products with two columns. The bracket
    vanishes for the optimal gain, and is what makes the form valid for any other.
    """
    s00, s01, s11 = s
    left = [
        (sub(cx, add(mul(a, s00), mul(b, s01))), sub(cy, add(mul(a, s01), mul(b, s11))))
        for a, b, cx, cy in zip(*k, *crossed, strict=True)
    ]
    n = len(covariance)

    def entry(i: int, j: int) -> Component:
        value = sub(covariance[i][j], add(mul(k[0][i], crossed[0][j]), mul(k[1][i], crossed[1][j])))
        return sub(value, add(mul(left[i][0], k[0][j]), mul(left[i][1], k[1][j])))

    upper = {(i, j): entry(i, j) for i in range(n) for j in range(i, n)}
    return tuple(tuple(upper[min(i, j), max(i, j)] for j in range(n)) for i in range(n))

"""The attitude counterpart of a cubic spline: angular rate and angular acceleration are continuous at every sample.

Between two samples the rotation vector from the first of them is a cubic in time (scipy's `RotationSpline`, after N. Mayorov,
"Smooth attitude interpolation", 2019). Continuity is a block tridiagonal system for the rates at the samples, which one term
makes slightly nonlinear. On the host (numpy, never traced).
"""

import numpy as np
from jaxtyping import Bool, Float

from ..algebra.tridiagonal import tridiagonal_solver
from ..rules import WhiskjaxError
from .samples import relative_turns
from .spline import pieces

# The system is solved again with the nonlinear term of the last rates, until no rate changes the turn of an interval by this.
_SAME_RAD, _MOST_ROUNDS = 1e-15, 60
# An end takes samples that are turned by less than this: beyond half a turn a rotation vector leads the other way round.
_FAR_RAD = 0.9 * np.pi


def attitude_rates(
    time_s: Float[np.ndarray, " n"], quaternion: Float[np.ndarray, "n 4"], is_gap: Bool[np.ndarray, " n-1"]
) -> tuple[Float[np.ndarray, "n-1 3"], Float[np.ndarray, "n-1 3"], Float[np.ndarray, "n-1 3"]]:
    """Rotation vectors (rad) from each sample to the next, and their derivatives (rad/s) at the start and end of the interval.

    At both ends of a piece the rate is that of the cubic through the rotation vectors of four samples (fewer where the piece is
    shorter, or turns too far): the ends then err with the fourth power of the spacing, as the middle does, where those
    of `RotationSpline`, whose rate is that of the first interval, err with the second. A piece of two samples turns evenly; in a
    gap the turn is even too, and nobody may ask for it.

    **Arguments:** `quaternion`: sign-continuous.

    **Raises:** `WhiskjaxError` where the samples turn too far for the iteration to end.
    """
    turn = relative_turns(quaternion)
    leave = turn / np.diff(time_s)[:, None]
    arrive = leave.copy()
    for piece in pieces(is_gap):
        if piece.stop - piece.start > 2:
            inner = slice(piece.start, piece.stop - 1)
            rate = _rates(time_s[piece], quaternion[piece], turn[inner])
            leave[inner], arrive[inner] = rate[:-1], _apply(_rate_to_derivative(turn[inner]), rate[1:])
    return turn, leave, arrive


def _rates(t: Float[np.ndarray, " n"], q: Float[np.ndarray, "n 4"], turn: Float[np.ndarray, "n-1 3"]) -> Float[np.ndarray, "n 3"]:
    """Angular rates at the samples of one piece, in the body frame."""
    h = np.diff(t)[:, None]
    to_derivative, to_rate = _rate_to_derivative(turn), _derivative_to_rate(turn)
    rate = np.concatenate([turn / h, turn[-1:] / h[-1:]])
    rate[0], rate[-1] = _end_rate(t[:4], q[:4]), _end_rate(t[:-5:-1], q[:-5:-1])
    before, after = h[:-1, :, None], h[1:, :, None]
    lower, upper = 2 / before * to_rate[:-1], 2 / after * to_derivative[1:]
    solve = tridiagonal_solver(lower, 4 * (1 / before + 1 / after) * np.eye(3), upper)
    right = 6 * (turn[:-1] / h[:-1] ** 2 + turn[1:] / h[1:] ** 2)
    right[0] -= lower[0] @ rate[0]
    right[-1] -= upper[-1] @ rate[-1]
    for _ in range(_MOST_ROUNDS):
        bent = _bend(turn[:-1], _apply(to_derivative[:-1], rate[1:-1]))
        new = solve((right - bent)[:, :, None])[:, :, 0]
        change = np.abs(new - rate[1:-1]).max(axis=1) * np.maximum(h[:-1, 0], h[1:, 0])
        rate[1:-1] = new
        if not np.isfinite(new).all():
            break
        if (change <= _SAME_RAD * (1 + np.abs(turn).max())).all():
            return rate
    i = int(np.argmax(np.linalg.norm(turn, axis=1)))
    raise WhiskjaxError(
        f"the attitude turns too far between samples for a spline, by up to {np.degrees(np.linalg.norm(turn[i])):.0f} deg, at "
        f"{t[i]:.6f} s: record it more often, or take interpolation='linear'"
    )


def _end_rate(t: Float[np.ndarray, " k"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, " 3"]:
    """The rate at the first sample, of the polynomial through the rotation vectors from it to the others (Lagrange)."""
    away = relative_turns(np.stack([np.broadcast_to(q[0], q[1:].shape), q[1:]], axis=1).reshape(-1, 4))[::2]
    steps = np.linalg.norm(relative_turns(q), axis=1)
    near = 1 + max(1, int((np.cumsum(steps) < _FAR_RAD).sum()))
    rate = np.zeros(3)
    for j in range(1, near):
        others = [k for k in range(1, near) if k != j]
        weight = np.prod([(t[0] - t[k]) / (t[j] - t[k]) for k in others])
        rate += weight / (t[j] - t[0]) * away[j - 1]
    return rate


def _skew(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The matrices that take a cross product from the left."""
    x, y, z = v.T
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], axis=-2)


def _series(angle: Float[np.ndarray, " n"], exact: np.ndarray, *terms: float) -> Float[np.ndarray, "n 1 1"]:
    """A coefficient of the angle, by its power series where the closed form is a small difference of large numbers."""
    z = angle**2
    near = sum(c * z**k for k, c in enumerate(terms))
    return np.where(angle < 0.05, near, exact)[:, None, None]


def _coefficients(turn: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(1 - cos a) / a^2, (a - sin a) / a^3 and 1 / a^2 - (1 + cos a) / (2 a sin a), of the angle a of each turn."""
    angle = np.linalg.norm(turn, axis=1)
    a = np.where(angle < 0.05, 1.0, angle)
    first = _series(angle, (1 - np.cos(a)) / a**2, 1 / 2, -1 / 24, 1 / 720, -1 / 40320)
    second = _series(angle, (a - np.sin(a)) / a**3, 1 / 6, -1 / 120, 1 / 5040, -1 / 362880)
    third = _series(angle, (1 - 0.5 * a / np.tan(0.5 * a)) / a**2, 1 / 12, 1 / 720, 1 / 30240, 1 / 1209600)
    return first, second, third


def _derivative_to_rate(turn: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Takes the derivative of a rotation vector to the angular rate in the body frame."""
    first, second, _ = _coefficients(turn)
    s = _skew(turn)
    return np.eye(3) - first * s + second * (s @ s)


def _rate_to_derivative(turn: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The inverse."""
    *_, third = _coefficients(turn)
    s = _skew(turn)
    return np.eye(3) + 0.5 * s + third * (s @ s)


def _bend(turn: Float[np.ndarray, "n 3"], derivative: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The angular acceleration of a rotation vector whose derivative is constant: it vanishes where the two are parallel."""
    angle = np.linalg.norm(turn, axis=1)
    a = np.where(angle < 0.05, 1.0, angle)
    # Derivatives of the two coefficients by the angle, over the angle.
    first = _series(angle, (a * np.sin(a) + 2 * (np.cos(a) - 1)) / a**4, -1 / 12, 1 / 180, -1 / 6720)[..., 0]
    second = _series(angle, (3 * np.sin(a) - a * np.cos(a) - 2 * a) / a**5, -1 / 60, 1 / 1260, -1 / 60480)[..., 0]
    along = np.einsum("ni,ni->n", turn, derivative)[:, None]
    once = np.cross(turn, derivative)
    _, third, _ = _coefficients(turn)
    return along * (-first * once + second * np.cross(turn, once)) + third[..., 0] * np.cross(derivative, once)


def _apply(matrices: Float[np.ndarray, "n 3 3"], vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return np.einsum("nij,nj->ni", matrices, vectors)

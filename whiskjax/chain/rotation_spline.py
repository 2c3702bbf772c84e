"""The attitude counterpart of a cubic spline: angular rate and angular acceleration are continuous at every sample.

Between two samples the rotation vector from the first of them is a cubic in time (scipy's `RotationSpline`, after N. Mayorov,
"Smooth attitude interpolation", 2019). Continuity is a block tridiagonal system for the rates at the samples, which one term
makes slightly nonlinear.
"""

from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from ..algebra.tridiagonal import tridiagonal_solver
from ..rules import WhiskjaxError, arrays_of
from .samples import relative_turns
from .spline import pieces

# The system is solved again with the nonlinear term of the last rates, until no rate changes the turn of an interval by this.
_SAME_RAD, _MOST_ROUNDS = 1e-15, 60
_TRACED_ROUNDS = 12  # where nobody can look; attitudes that turn by half a radian an interval take as many
# An end takes samples that are turned by less than this: beyond half a turn a rotation vector leads the other way round.
_FAR_RAD = 0.9 * np.pi
_NEARLY_RAD = 1e-12  # what the last round may still change where nobody can look
_SMALL_RAD2 = 0.05**2


def attitude_rates(
    time_s: Float[np.ndarray, " n"], quaternion: Float[Any, "n 4"], is_gap: Bool[np.ndarray, " n-1"]
) -> tuple[Float[Any, "n-1 3"], Float[Any, "n-1 3"], Float[Any, "n-1 3"]]:
    """Rotation vectors (rad) from each sample to the next, and their derivatives (rad/s) at the start and end of the interval.

    At both ends of a piece the rate is that of the cubic through the rotation vectors of four samples (fewer where the piece is
    shorter, or turns too far): the ends then err with the fourth power of the spacing, as the middle does, where those
    of `RotationSpline`, whose rate is that of the first interval, err with the second. A piece of two samples turns evenly; in a
    gap the turn is even too, and nobody may ask for it.

    **Arguments:** `quaternion`: sign-continuous.

    **Raises:** `WhiskjaxError` where the samples turn too far for the iteration to end; traced ones are then not numbers.
    """
    turn, math = relative_turns(quaternion), arrays_of(quaternion)
    even = turn / np.diff(time_s)[:, None]
    leave, arrive = [], []
    for piece in pieces(is_gap):
        inner, over = slice(piece.start, piece.stop - 1), slice(piece.stop - 1, piece.stop)
        if piece.stop - piece.start > 2:
            rate = _rates(time_s[piece], quaternion[piece], turn[inner])
            leave += [rate[:-1], even[over]]
            arrive += [_apply(_rate_to_derivative(turn[inner]), rate[1:]), even[over]]
        else:
            leave.append(even[piece])
            arrive.append(even[piece])
    return turn, math.concatenate(leave), math.concatenate(arrive)


def _rates(t: Float[np.ndarray, " n"], q: Float[Any, "n 4"], turn: Float[Any, "n-1 3"]) -> Float[Any, "n 3"]:
    """Angular rates at the samples of one piece, in the body frame."""
    math, h = arrays_of(q), np.diff(t)[:, None]
    to_derivative, to_rate = _rate_to_derivative(turn), _derivative_to_rate(turn)
    start, end = _end_rate(t[:4], q[:4]), _end_rate(t[:-5:-1], q[:-5:-1])
    before, after = h[:-1, :, None], h[1:, :, None]
    lower, upper = 2 / before * to_rate[:-1], 2 / after * to_derivative[1:]
    solve = tridiagonal_solver(lower, 4 * (1 / before + 1 / after) * np.eye(3), upper)
    right = 6 * (turn[:-1] / h[:-1] ** 2 + turn[1:] / h[1:] ** 2)
    right = math.concatenate([right[:1] - (lower[0] @ start)[None], right[1:]])
    right = math.concatenate([right[:-1], right[-1:] - (upper[-1] @ end)[None]])
    longest = np.maximum(h[:-1], h[1:])

    def once(rate: Any) -> tuple[Any, Any]:
        """The rates again, and what changed: the largest turn of an interval."""
        bent = _bend(turn[:-1], _apply(to_derivative[:-1], rate))
        new = solve((right - bent)[:, :, None])[:, :, 0]
        return new, (abs(new - rate) * longest).max()

    rate = (turn / h)[:-1]
    if math is not np:
        rate, change = jax.lax.fori_loop(0, _TRACED_ROUNDS, lambda _, at: once(at[0]), once(rate))
        return math.concatenate([start[None], math.where(change < _NEARLY_RAD, rate, math.nan), end[None]])
    for _ in range(_MOST_ROUNDS):
        rate, change = once(rate)
        if is_same := change <= _SAME_RAD * (1 + abs(turn).max()) or not np.isfinite(change):
            break
    if not (is_same and np.isfinite(change)):
        i = int(np.argmax(np.linalg.norm(turn, axis=1)))
        raise WhiskjaxError(
            f"the attitude turns too far between samples for a spline, by up to {np.degrees(np.linalg.norm(turn[i])):.0f} deg, "
            f"at {t[i]:.6f} s: record it more often, or take interpolation='linear'"
        )
    return np.concatenate([start[None], rate, end[None]])


def _end_rate(t: Float[np.ndarray, " k"], q: Float[Any, "k 4"]) -> Float[Any, " 3"]:
    """The rate at the first sample, of the polynomial through the rotation vectors from it to the others (Lagrange)."""
    math = arrays_of(q)
    away = relative_turns(math.stack([math.broadcast_to(q[:1], q[1:].shape), q[1:]], axis=1).reshape(-1, 4))[::2]
    far = math.sqrt((relative_turns(q) ** 2).sum(axis=1)).cumsum() >= _FAR_RAD
    rate = away[0] / (t[1] - t[0])
    for near in range(3, len(t) + 1):
        through = 0.0
        for j in range(1, near):
            others = [k for k in range(1, near) if k != j]
            weight = np.prod([(t[0] - t[k]) / (t[j] - t[k]) for k in others])
            through = through + weight / (t[j] - t[0]) * away[j - 1]
        rate = math.where(far[near - 2], rate, through)
    return rate


def _skew(v: Float[Any, "n 3"]) -> Float[Any, "n 3 3"]:
    """The matrices that take a cross product from the left."""
    math, (x, y, z) = arrays_of(v), v.T
    o = math.zeros_like(x)
    return math.stack([math.stack([o, -z, y], -1), math.stack([z, o, -x], -1), math.stack([-y, x, o], -1)], axis=-2)


def _angles(turn: Float[Any, "n 3"]) -> tuple[Float[Any, " n"], Float[Any, " n"]]:
    """The square of each angle, and the angle itself, or 1 where it is small: a root has no derivative at zero."""
    squared = (turn**2).sum(axis=1)
    return squared, arrays_of(turn).sqrt(arrays_of(turn).where(squared < _SMALL_RAD2, 1.0, squared))


def _series(squared: Float[Any, " n"], exact: Any, *terms: float) -> Float[Any, "n 1 1"]:
    """A coefficient of the angle, by its power series where the closed form is a small difference of large numbers."""
    near = sum(c * squared**k for k, c in enumerate(terms))
    return arrays_of(squared).where(squared < _SMALL_RAD2, near, exact)[:, None, None]


def _coefficients(turn: Float[Any, "n 3"]) -> tuple[Any, Any, Any]:
    """(1 - cos a) / a^2, (a - sin a) / a^3 and 1 / a^2 - (1 + cos a) / (2 a sin a), of the angle a of each turn."""
    math, (squared, a) = arrays_of(turn), _angles(turn)
    first = _series(squared, (1 - math.cos(a)) / a**2, 1 / 2, -1 / 24, 1 / 720, -1 / 40320)
    second = _series(squared, (a - math.sin(a)) / a**3, 1 / 6, -1 / 120, 1 / 5040, -1 / 362880)
    third = _series(squared, (1 - 0.5 * a / math.tan(0.5 * a)) / a**2, 1 / 12, 1 / 720, 1 / 30240, 1 / 1209600)
    return first, second, third


def _derivative_to_rate(turn: Float[Any, "n 3"]) -> Float[Any, "n 3 3"]:
    """Takes the derivative of a rotation vector to the angular rate in the body frame."""
    first, second, _ = _coefficients(turn)
    s = _skew(turn)
    return np.eye(3)[None] - first * s + second * (s @ s)


def _rate_to_derivative(turn: Float[Any, "n 3"]) -> Float[Any, "n 3 3"]:
    """The inverse."""
    *_, third = _coefficients(turn)
    s = _skew(turn)
    return np.eye(3)[None] + 0.5 * s + third * (s @ s)


def _bend(turn: Float[Any, "n 3"], derivative: Float[Any, "n 3"]) -> Float[Any, "n 3"]:
    """The angular acceleration of a rotation vector whose derivative is constant: it vanishes where the two are parallel."""
    math, (squared, a) = arrays_of(turn), _angles(turn)
    # Derivatives of the two coefficients by the angle, over the angle.
    first = _series(squared, (a * math.sin(a) + 2 * (math.cos(a) - 1)) / a**4, -1 / 12, 1 / 180, -1 / 6720)[..., 0]
    second = _series(squared, (3 * math.sin(a) - a * math.cos(a) - 2 * a) / a**5, -1 / 60, 1 / 1260, -1 / 60480)[..., 0]
    along = math.einsum("ni,ni->n", turn, derivative)[:, None]
    once = math.cross(turn, derivative)
    _, third, _ = _coefficients(turn)
    return along * (-first * once + second * math.cross(turn, once)) + third[..., 0] * math.cross(derivative, once)


def _apply(matrices: Float[Any, "n 3 3"], vectors: Float[Any, "n 3"]) -> Float[Any, "n 3"]:
    return arrays_of((matrices, vectors)).einsum("nij,nj->ni", matrices, vectors)

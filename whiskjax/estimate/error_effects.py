"""What errors of recorded poses do to measured pixels, for whoever weighs many exposures at once.

A pixel is off by the sum over components of e_k z_k, with e_k the pixel's change by one sigma and z_k the whitened error at that
exposure. What exposures have in common is a matrix of columns C, pixel error = C s with independent standard normal s: as many
more considered numbers, or C C^T as covariance.
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Mat3, Vec3, stack
from ..chain.joints import JointDerivatives, joint_derivatives
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..earth.surface import AbstractSurface
from ..rules import arrays_of, is_traced, once
from .errors import FrameErrors, unit_motion
from .level import frame_from_level
from .memory import CONSTANT, WHITE

# It keeps the covariance of exposures at one moment positive definite: a millionth of the sigma.
_HAIR = 1e-12


def white_covariance_px2(
    errors: Sequence[FrameErrors], sensor: Sensor, shot: Shot, point: Vec3, surface: AbstractSurface | None = None
) -> Float[Array, "n 2 2"]:
    """What the errors that are new at every exposure add to the covariance of its pixel.

    **Arguments:** `point`: ground points of the exposures, components (n,), world frame, metres; `surface`: what is level, the
    ellipsoid by default.
    """
    swept, n = _swept(sensor, shot, point), np.shape(point[0])[0]
    total = jnp.zeros((n, 2, 2))
    for one, k, effect in _effects(errors, sensor, shot, swept, n, surface):
        if one.memory[k] == WHITE:
            total = total + effect[:, :, None] * effect[:, None, :]
    return total


def common_columns_px(
    errors: Sequence[FrameErrors], sensor: Sensor, shot: Shot, point: Vec3, surface: AbstractSurface | None = None
) -> tuple[Float[Array, "n 2 latent"], tuple[str, ...]]:
    """What exposures have in common: columns C of the pixels by independent standard normal numbers, and the names of those.

    A constant error has one number for each value of its key; one that wanders has one for each exposure (the Cholesky factor of
    its correlation).

    **Arguments:** as of `white_covariance_px2`.

    **Returns:** (n, 2, latent) in pixels, of the recorded pose's pixel by each number; names as "body turn x" or, of several
    values, "body turn x 3".

    **Raises:** `WhiskjaxError` where the shots lack a time or a key, or nobody knows what is up.
    """
    swept, n = _swept(sensor, shot, point), np.shape(point[0])[0]
    columns: list[Array] = []
    names: list[str] = []
    for one, k, effect in _effects(errors, sensor, shot, swept, n, surface):
        if one.memory[k] == WHITE:
            continue
        root = _root(one, shot, k, n)
        columns.append(effect[:, :, None] * root[:, None, :])
        axis = (("x", "y", "z") if one.axes == "frame" else ("east", "north", "up"))[k % 3]
        name = f"{one.frame} {'turn' if k < 3 else 'shift'} {axis}"
        names += [name] if root.shape[1] == 1 else [f"{name} {i}" for i in range(root.shape[1])]
    return jnp.concatenate(columns, axis=2) if columns else jnp.zeros((n, 2, 0)), tuple(names)


def passing_effects_px(
    errors: Sequence[FrameErrors], sensor: Sensor, shot: Shot, point: Vec3, surface: AbstractSurface | None = None
) -> tuple[Float[Array, "n 2 k"], tuple[str, ...]]:
    """What one sigma of each error that is new at every exposure, or forgotten after a while, does to the pixels of the recorded
    poses, and the frame of each.

    **Arguments:** as of `white_covariance_px2`.
    """
    swept, n = _swept(sensor, shot, point), np.shape(point[0])[0]
    found = [(one.frame, of) for one, k, of in _effects(errors, sensor, shot, swept, n, surface) if one.memory[k] != CONSTANT]
    effects = jnp.stack([of for _, of in found], axis=2) if found else jnp.zeros((n, 2, 0))
    return effects, tuple(frame for frame, _ in found)


def _swept(sensor: Sensor, shot: Shot, point: Vec3) -> JointDerivatives:
    """By joints; while tracing evaluated once, and not again for each entry of what is stacked of it."""
    if arrays_of((sensor, shot, point)) is jnp:
        return once(lambda: joint_derivatives(sensor, shot, point))
    return joint_derivatives(sensor, shot, point)


def _root(one: FrameErrors, shot: Shot, k: int, n: int) -> Float[Array, "n r"]:
    """A square root of the correlation of a component between exposures."""
    group: Any = one.key(shot)
    if one.memory[k] == CONSTANT and not is_traced(group):
        each = np.broadcast_to(np.asarray(group), (n,))
        return jnp.asarray(each[:, None] == np.unique(each)[None, :], dtype=float)
    return jnp.linalg.cholesky(one.correlation(shot, k, n) + _HAIR * jnp.eye(n))


def _effects(
    errors: Sequence[FrameErrors],
    sensor: Sensor,
    shot: Shot,
    swept: JointDerivatives,
    n: int,
    surface: AbstractSurface | None,
) -> list[tuple[FrameErrors, int, Float[Array, "n 2"]]]:
    """By one sigma of each component of each statement."""
    found = []
    for one in errors:
        one.check(sensor)
        one.refuse_free("errors in the image")
        into: Mat3 | None = None
        if one.axes == "level":
            into = frame_from_level(one.frame, sensor.pose(shot, one.frame), surface)
        for k in one.acting:
            moved = stack(swept.follows(one.frame, unit_motion(k, into)))
            sigma = jnp.broadcast_to(one.sigma[k], (n,))
            found.append((one, k, sigma[:, None] * jnp.broadcast_to(moved, (n, 2))))
    return found

"""What a filter, or a batch, tells of every look."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import stack, vadd
from ..chain.detector import is_beside
from ..chain.imaging import into_camera
from ..rules import RESULTS
from .all_looks import Solved
from .filter import Step
from .look_by_look import LookByLook
from .model import Model
from .problem import Standing, as_matrix


def of_filter(model: Model, steps: Step, standing: Standing, state: Float[Array, " n"]) -> LookByLook:
    """The estimate after each look, and the innovation before it; `state`: where it ended."""
    (after, covariance), innovation = steps.belief, steps.innovation
    s00, s01, s11 = innovation.covariance
    residual, spread = _in_pixels(model, stack(innovation.residual), as_matrix(((s00, s01), (s01, s11))), standing)
    return LookByLook(
        point_m=stack(vadd(model.anchor_m, after[:3])),
        covariance_enu_m2=as_matrix(tuple(row[:3] for row in covariance[:3])),
        innovation_px=residual,
        innovation_covariance_px2=spread,
        nis=innovation.nis,
        is_missed=standing.is_missed,
        is_repeat=standing.is_repeat,
        result=standing.result,
        counts=steps.counts,
        passes=jnp.broadcast_to(steps.passes, standing.is_missed.shape),
        at_end=_at_end(model, state),
        is_beside=_beside(model),
    )


def of_batch(model: Model, found: Solved, standing: Standing) -> LookByLook:
    """A batch knows one answer; of a moving target it is where that was at each look."""
    looks = found.nis.shape[0]
    moved = 0.0 if model.since_s is None else model.since_s[:, None] * found.state[None, 3:6]
    residual, spread = _in_pixels(model, found.equations.residual, found.residual_covariance, standing)
    return LookByLook(
        point_m=jnp.broadcast_to(stack(model.anchor_m) + found.state[:3], (looks, 3)) + moved,
        covariance_enu_m2=jnp.broadcast_to(found.covariance[:3, :3], (looks, 3, 3)),
        innovation_px=residual,
        innovation_covariance_px2=spread,
        nis=found.nis,
        is_missed=standing.is_missed,
        is_repeat=standing.is_repeat,
        result=standing.result,
        counts=found.equations.counts,
        passes=found.passes,
        at_end=_at_end(model, found.state),
        is_beside=_beside(model),
    )


def _at_end(model: Model, state: Float[Array, " n"]) -> RESULTS:
    """Of each look, whether it can have seen the target of a state of the last look; a target that moves did so evenly."""
    kinematic = model.kinematic
    moved = [0.0] * 3 if model.since_s is None else [model.since_s * state[3 + i] for i in range(3)]
    point = tuple(a + state[i] + moved[i] + jnp.zeros(model.pixel_px[0].shape) for i, a in enumerate(model.anchor_m))
    sensor = model.nuisance.put(model.sensor, tuple(state[kinematic:]))
    seen = sensor.camera_at(model.shots).check_direction(into_camera(sensor, model.shots, point))
    return jax.tree.map(lambda code: code + jnp.zeros(point[0].shape, jnp.int32), seen)


def _beside(model: Model) -> Bool[Array, " looks"]:
    """Looks that were measured far beside the detector."""
    return is_beside(model.sensor.camera_at(model.shots), model.pixel_px)


def _in_pixels(
    model: Model, residual: Float[Array, "looks 2"], covariance: Float[Array, "looks 2 2"], standing: Standing
) -> tuple[Float[Array, "looks 2"], Float[Array, "looks 2 2"]]:
    """From sigmas of the pixel to pixels; a look that was missed has no residual."""
    sigma = jnp.broadcast_to(stack(model.sigma_px), residual.shape)
    return jnp.where(standing.is_missed[:, None], jnp.nan, residual * sigma), covariance * sigma[:, :, None] * sigma[:, None, :]

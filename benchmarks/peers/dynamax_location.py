"""The filter of location.cpp by dynamax's extended Kalman filter, under vmap over the runs.

There the measurement covariance may depend on time but not on the state, as the part from recorded errors does. With that
part the measurement is therefore whitened where the filter stands: L^{-1} (h(x) - z) with R = L L^T, measured as zero with
covariance one, its derivative taken with R held. That is the same filter.
"""

import warnings
from collections.abc import Callable

import jax
import jax.numpy as jnp

from . import MissingPeer
from .location import FOCAL_PX, Recorded, Sigmas, Start
from .numpy_location import angles, camera_from_ecef, dot, noise, platform

try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of TensorFlow Probability, which asks jax for old names
        from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter
except ModuleNotFoundError as error:
    raise MissingPeer("dynamax is not installed: pip install 'whiskjax[bench]'") from error


def prepared(
    recorded: Recorded, start: Start, sigmas: Sigmas, full: bool
) -> tuple[Callable[[jax.Array], tuple[jax.Array, jax.Array]], jax.Array]:
    """The filter as a function to be compiled, and its argument."""
    guess, covariance = jnp.asarray(start.guess_ecef_m), jnp.asarray(start.covariance_m2)

    def camera(x, look):
        """The target in the camera's frame; look: platform - guess (3), sines and cosines (12 or 14), pixel (2)."""
        offset = [x[i] - look[i] for i in range(3)]
        return [dot(row, offset) for row in camera_from_ecef(*(look[i : i + 2] for i in range(3, 15, 2)))]

    def pixel(x, look):
        u = camera(x, look)
        return FOCAL_PX * jnp.stack([u[0] / u[2], u[1] / u[2]])

    def white(x, look):
        alpha, beta = look[11:13], look[15:17]
        u = camera(x, look)
        a, b = u[0] / u[2], u[1] / u[2]
        held = jax.lax.stop_gradient((a, b, FOCAL_PX / u[2]))
        mm, mn, nn = noise(sigmas, alpha, beta, *held)
        m = (FOCAL_PX * a - look[17]) / jnp.sqrt(mm)
        n = (FOCAL_PX * b - look[18] - mn / jnp.sqrt(mm) * m) / jnp.sqrt(nn - mn * mn / mm)
        return jnp.stack([m, n])

    def one(looks, pixels):
        emission, variance = (white, 1.0) if full else (pixel, sigmas.pixel_px**2)
        params = ParamsNLGSSM(
            initial_mean=jnp.zeros(3),
            initial_covariance=covariance,
            dynamics_function=lambda x, _: x,
            dynamics_covariance=jnp.zeros((3, 3)),
            emission_function=emission,
            emission_covariance=variance * jnp.eye(2),
        )
        measured = jnp.zeros_like(pixels) if full else pixels
        fields = ["filtered_means", "filtered_covariances"]
        found = extended_kalman_filter(params, measured, inputs=looks, output_fields=fields)
        assert found.filtered_means is not None and found.filtered_covariances is not None
        return found.filtered_means[-1], found.filtered_covariances[-1]

    def every(numbers):
        """numbers: (10, looks, runs). The runs stay the last axis: so laid out it is a little faster."""
        turns = [(jnp.sin(angle), jnp.cos(angle)) for angle in angles(numbers)[: None if full else -1]]
        turns = jax.lax.optimization_barrier(turns)  # XLA would compute a sine again for every number that it enters
        position = platform(turns[0], turns[1], numbers[2])
        pixels = jnp.stack([numbers[8], numbers[9]], 1)
        looks = [p - guess[i] for i, p in enumerate(position)] + [c for turn in turns for c in turn] + [numbers[8], numbers[9]]
        with jax.numpy_rank_promotion("allow"):  # dynamax relies on it
            return jax.vmap(one, in_axes=2)(jnp.stack(looks, 1), pixels)

    return every, jnp.swapaxes(jnp.asarray(recorded.numbers()), 1, 2)

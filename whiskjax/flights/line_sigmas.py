"""Sigmas that were given in lines, as the pixels in which a chain answers."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..chain.image_scale import line_in_image, scale_of_each
from ..chain.imaging import image_to_ground
from ..chain.shot import Shot
from ..estimate.intersection import intersect
from ..rules import FlightError
from ..rules.results import codes_of, message_of

if TYPE_CHECKING:
    from .flight import Flight

_SLENDER = 20.0


def s_per_line(flight: "Flight", index: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """How long the line of each measurement (index) took, seconds; NaN where its image has no lines."""
    m, seconds = flight.measurements, np.full(len(index), np.nan)
    for i in np.unique(m.image[index]):
        here, lines = m.image[index] == i, flight.images[i].lines
        if lines is not None:
            seconds[here] = lines.s_per_line(np.asarray(m.line_px[index][here], dtype=float))
    return seconds


def sigma_px(
    flight: "Flight", index: Int[np.ndarray, " n"], shot: Shot, point_m: Float[np.ndarray, "n 3"], *, at_crossing: bool
) -> Float[np.ndarray, "n 2"]:
    """1-sigma of measurements (index) in focal-plane pixels, (sample, across the line); of a frame as given.

    The chain's start values say how many pixels a line is. An error of the line is one of time: it moves the image across the
    line, and where the image does not move square to the detector along it too; its part along the line adds to the variance of
    the sample.

    **Arguments:**

    - `shot`: of the measurements; `point_m`: where each was seen, world frame; read where the sigma is in lines.
    - `at_crossing`: rays will be evaluated where their points cross the line (`adjust`): errors of the line stay across it.

    **Raises:** `FlightError` naming the first measurement whose image does not move across the line, or whose point is not seen.
    """
    m = flight.measurements
    sigma = np.stack([m.sigma_sample_px[index], m.sigma_line_px[index]], axis=-1)
    in_lines = m.is_in_lines[index]
    if not in_lines.any():
        return sigma
    if not flight.is_line:
        raise FlightError(f"{label(flight, int(index[np.argmax(in_lines)]))}: a frame camera has no lines: give sigma_line_px")
    point = np.where(in_lines[:, None], point_m, np.nan)
    (along, across), result = line_in_image(scale_of_each(flight.sensor, shot, point), s_per_line(flight, index))
    codes = np.where(in_lines, codes_of(result), 0)
    if codes.any():
        i = int(np.argmax(codes != 0))
        raise FlightError(f"{label(flight, int(index[i]))}: sigma_lines: {message_of(int(codes[i]))}")
    lines = np.where(in_lines, np.asarray(m.sigma_lines)[index], 0.0)
    spread = 0.0 if at_crossing else lines * np.nan_to_num(np.asarray(along))
    sigma[:, 0] = np.hypot(sigma[:, 0], spread)
    sigma[:, 1] = np.where(in_lines, np.abs(lines * np.asarray(across)), sigma[:, 1])
    return sigma


def ground_height_m(flight: "Flight", index: Int[np.ndarray, " n"], other_than: Sequence[int] = ()) -> float:
    """Mean ellipsoidal height (z of a local world) of the points that have coordinates, ties and `other_than` left aside.

    **Raises:** `FlightError` naming the first of the measurements (index) that need it, where there is no such point.
    """
    known = np.isfinite(flight.points.position_m).all(axis=1) & (np.asarray(flight.points.roles) != "tie")
    known[list(other_than)] = False
    if not known.any():
        raise FlightError(
            f"{label(flight, int(index[0]))}: sigma_lines: how many pixels a line is depends on the height of the ground, and no "
            "other point has coordinates that tell it; give sigma_line_px"
        )
    return float(np.mean(flight.world.height_m(np.asarray(flight.points.position_m)[known])))


def where_seen(
    flight: "Flight", index: Int[np.ndarray, " n"], whose: Int[np.ndarray, " n"], height_m: Callable[[], float]
) -> Float[np.ndarray, "n 3"]:
    """About where measurements (index) saw the ground, world frame, for points whose coordinates are not to be used.

    Where the rays of a point meet; where it has one ray, or all come from nearly one direction, where each passes a height (NaN
    for a ray whose sigma is in pixels).

    **Arguments:** `whose`: which point each sees, 0 to points - 1 without holes; `height_m`: asked where it is needed.

    **Raises:** `FlightError` naming the first ray that does not meet the height.
    """
    where = np.full((len(index), 3), np.nan)
    several = np.flatnonzero((np.bincount(whose) > 1)[whose])
    if several.size:
        shot, pixel = _rays(flight, index[several])
        point = np.unique(whose[several], return_inverse=True)[1]
        met = intersect(flight.sensor, shot, jnp.asarray(pixel), point, jnp.ones((len(several), 2)), throw=False)
        # The ratio of the largest to the smallest sigma of a point says how slender its rays meet: 20 is some 4 deg.
        variance = np.linalg.eigvalsh(np.nan_to_num(np.asarray(met.covariance_m2)))
        fine = (codes_of(met.result) == 0) & (variance[:, 2] < _SLENDER**2 * variance[:, 0])
        where[several] = np.where(fine[:, None], met.point_m, np.nan)[point]
    alone = np.flatnonzero(np.isnan(where[:, 0]) & flight.measurements.is_in_lines[index])
    if alone.size:
        shot, pixel = _rays(flight, index[alone])
        level = image_to_ground(flight.sensor, shot, pixel, flight.world.surface(height_m()), throw=False)
        codes = np.broadcast_to(codes_of(level.result), alone.shape)
        if codes.any():
            i = int(np.argmax(codes != 0))
            raise FlightError(f"{label(flight, int(index[alone[i]]))}: sigma_lines: {message_of(int(codes[i]))}")
        where[alone] = level.point_m
    return where


def _rays(flight: "Flight", index: Int[np.ndarray, " n"]) -> tuple[Shot, Float[np.ndarray, "n 2"]]:
    """Shots and pixels of measurements of a line camera."""
    m = flight.measurements
    return flight.shot(m.image[index], m.line_px[index]), np.stack([m.sample_px[index], np.zeros(len(index))], axis=-1)


def label(flight: "Flight", i: int) -> str:
    """A measurement, named for people."""
    m = flight.measurements
    return f"observation {i}, image {flight.images[int(m.image[i])].name}, point {flight.points.names[int(m.point[i])]}"

"""Look tables: measured directions of the samples of a line camera."""

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import Component, Vec2, Vec3, cross, dot, norm, scale
from ..rules import RESULTS, Arrays, WhiskjaxError
from ..rules.results import failure_if
from .camera import AbstractCamera
from .shot import Shot


class LookTable(AbstractCamera):
    """Measured look directions of the samples of a line camera, linear between samples.

    Pixels are (sample, line offset) as in `LineCamera`; beyond the first and last look the end segments go on for `pixel`, and
    `sees` says that the sample is not on the detector.

    **Arguments:**

    - `sample_px`: (n,), strictly increasing.
    - `direction`: (n, 3) in the camera frame (looking along -z), any length.
    """

    given: ClassVar = ("sample_px",)
    sample_px: Float[Array, " n"]
    slope: Float[Array, "n 2"]  # image point at focal length 1: (-x/z, -y/z)

    def __init__(self, sample_px: Any, direction: Any):
        """**Raises:** `WhiskjaxError` for shapes that do not fit, samples that do not advance, looks that are not along -z."""
        arrays = Arrays("LookTable")
        sample = np.asarray(arrays.take("sample_px", sample_px, "n", finite=True))
        d = np.asarray(arrays.take("direction", direction, "n 3", meaning="one direction for each sample"))
        if len(sample) < 2:
            arrays.refuse("sample_px", f"has shape {sample.shape}; a look table has at least two samples")
        if not (np.diff(sample) > 0).all():
            raise WhiskjaxError("the samples of a look table must increase")
        if not (d[:, 2] < 0).all():
            raise WhiskjaxError("a look table looks along -z: the z of every direction is negative (use an Axes link before it)")
        slope = d[:, :2] / -d[:, 2:]
        chord = slope[-1] - slope[0]
        if not (np.diff(slope @ chord) > 0).all():
            raise WhiskjaxError("the looks of a look table must advance along the detector from sample to sample")
        self.sample_px, self.slope = jnp.asarray(sample), jnp.asarray(slope)

    @property
    def is_line(self) -> bool:
        """Yes."""
        return True

    def at(self, shot: Shot) -> "LookTable":
        """The same for every shot."""
        return self

    def check(self, shot: Shot) -> RESULTS:
        """The same for every shot."""
        return RESULTS.successful

    def _segment(self, i: Any) -> tuple[Vec2, Vec2, Component]:
        """Start, step per sample and first sample of segment i."""
        x, y = self.slope[:, 0], self.slope[:, 1]
        length = self.sample_px[i + 1] - self.sample_px[i]
        return (x[i], y[i]), ((x[i + 1] - x[i]) / length, (y[i + 1] - y[i]) / length), self.sample_px[i]

    def _find(self, q: Vec3) -> tuple[Any, Vec2]:
        """Segment that a direction belongs to, by its place along the chord, and the image point at focal length 1."""
        point = -q[0] / q[2], -q[1] / q[2]
        chord = self.slope[-1] - self.slope[0]
        knots = self.slope @ chord
        place = point[0] * chord[0] + point[1] * chord[1]
        i = jnp.searchsorted(knots, place, side="right").astype(jnp.int32) - 1
        return jnp.clip(i, 0, self.sample_px.shape[0] - 2), point

    def pixel(self, q: Vec3) -> Vec2:
        """(sample, line offset) of a direction; the offset is in units of the segment's sample spacing."""
        i, point = self._find(q)
        start, step, first = self._segment(i)
        dx, dy = point[0] - start[0], point[1] - start[1]
        w = 1 / (step[0] * step[0] + step[1] * step[1])
        return first + (dx * step[0] + dy * step[1]) * w, (step[0] * dy - step[1] * dx) * w

    def direction(self, pixel: Vec2) -> Vec3:
        """Direction of a (sample, line offset)."""
        i = jnp.searchsorted(self.sample_px, pixel[0], side="right").astype(jnp.int32) - 1
        start, step, first = self._segment(jnp.clip(i, 0, self.sample_px.shape[0] - 2))
        s, c = pixel[0] - first, pixel[1]
        return start[0] + s * step[0] - c * step[1], start[1] + s * step[1] + c * step[0], -1

    def check_direction(self, q: Vec3) -> RESULTS:
        """In front of the camera."""
        return failure_if(~(q[2] < 0), RESULTS.point_behind_camera)

    def check_pixel(self, pixel: Vec2) -> RESULTS:
        """Every pixel has a direction."""
        return RESULTS.successful

    def sees(self, pixel: Vec2) -> Bool[Array, "..."] | bool:
        """Between the first and the last look."""
        return (pixel[0] >= self.sample_px[0] - 0.5) & (pixel[0] <= self.sample_px[-1] + 0.5)

    def ends(self) -> tuple[Component, ...]:
        """The first and the last look."""
        return self.sample_px[0], self.sample_px[-1]

    def miss(self, q: Vec3) -> Component:
        """Tangent of half the angle between the direction and the plane of its segment."""
        i, _ = self._find(q)
        start, step, _ = self._segment(i)
        # Unit vectors: along the segment, normal to the plane that it spans with the projection centre, and the third.
        w = 1 / norm(step)
        along: Vec3 = (step[0] * w, step[1] * w, 0)
        normal: Vec3 = (-along[1], along[0], along[0] * start[1] - along[1] * start[0])
        normal = scale(1 / norm(normal), normal)
        sine, cosine = dot(normal, q), dot(cross(normal, along), q)
        return sine / (norm((sine, cosine)) + cosine)

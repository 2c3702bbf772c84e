"""Line cameras: a detector line in the focal plane, or a table of looks."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import Component, Vec2, Vec3, cross, dot, norm, scale, unstack
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, is_traced
from ..rules.results import choose, failure_if
from .camera import AbstractCamera, common_batch, parameter
from .shot import Shot

# Newton steps from the place on the focal plane to the sample that lies there.
_NEWTON_STEPS = 3


def _sign(arrays: Arrays, name: str, value: Any) -> Any:
    sign = arrays.take(name, value, "...")
    if not is_traced(sign) and not (np.abs(np.asarray(sign)) == 1).all():
        arrays.refuse(name, f"is +1 or -1, not {np.asarray(sign).tolist()}")
    return sign


class LineCamera(AbstractCamera):
    """A detector line in the focal plane, along x or along y.

    Pixels are (sample, line offset): the sample along the detector, and how far across it in pixels the point is imaged, zero
    when the shot's time is exactly right. Sample s lies at along = along_sign (s - principal_sample_px) and across = offset_px,
    plus, with self-calibration, two cubics in (s - principal) / half_width_px: the detector line as it really lies.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments:**

    - `focal_px`: focal length in pixels.
    - `principal_sample_px`: the sample that lies at the principal point.
    - `offset_px`: where the line lies across the focal plane (a view of a three-line camera: f tan(view)).
    - `along`: "x" or "y", the image axis along the detector.
    - `along_sign`, `across_sign`: +1 or -1; across_sign tells on which side the line offset counts positive (a whiskbroom's
      image y = s * camera y, with s by swing, is `across_sign` = s).
    - `deformation_px`: (2, 4), along and across, coefficients of 1, s, s^2, s^3; or None.
    - `samples_px`: first and last sample of the detector, or None where it does not matter.
    """

    given: ClassVar = ("along_sign", "across_sign", "half_width_px", "samples_px")
    focal_px: Float[Array, "..."] = eqx.field(converter=parameter)
    principal_sample_px: Float[Array, "..."] = eqx.field(converter=parameter)
    offset_px: Float[Array, "..."] = eqx.field(converter=parameter)
    along_sign: Float[Array, "..."] = eqx.field(converter=parameter)
    across_sign: Float[Array, "..."] = eqx.field(converter=parameter)
    deformation_px: Float[Array, "*batch 2 4"] | None = eqx.field(converter=parameter)
    half_width_px: Float[Array, "..."] = eqx.field(converter=parameter)
    samples_px: Float[Array, "*batch 2"] | None = eqx.field(converter=parameter)
    along: str = eqx.field(static=True)

    def __init__(
        self,
        focal_px: Float[Numbers, "..."],
        principal_sample_px: Float[Numbers, "..."] = 0.0,
        offset_px: Float[Numbers, "..."] = 0.0,
        along_sign: Float[Numbers, "..."] = 1.0,
        across_sign: Float[Numbers, "..."] = 1.0,
        deformation_px: Float[Numbers, "*batch 2 4"] | None = None,
        half_width_px: Float[Numbers, "..."] = 1.0,
        samples_px: Float[Numbers, "*batch 2"] | None = None,
        along: str = "x",
    ):
        """**Raises:** `WhiskjaxError` for other shapes than these, lengths that are not positive, signs that are none."""
        arrays = Arrays("LineCamera")
        self.focal_px = arrays.take("focal_px", focal_px, "...", finite=True, above=0.0, meaning="a number of pixels")
        self.principal_sample_px = arrays.take("principal_sample_px", principal_sample_px, "...", finite=True)
        self.offset_px = arrays.take("offset_px", offset_px, "...", finite=True)
        self.along_sign, self.across_sign = _sign(arrays, "along_sign", along_sign), _sign(arrays, "across_sign", across_sign)
        cubics = "along and across, coefficients of 1, s, s^2, s^3"
        self.deformation_px = arrays.take("deformation_px", deformation_px, "... 2 4", optional=True, finite=True, meaning=cubics)
        self.half_width_px = arrays.take("half_width_px", half_width_px, "...", finite=True, above=0.0)
        ends = arrays.take("samples_px", samples_px, "... 2", optional=True, finite=True, meaning="first and last sample")
        if ends is not None and not is_traced(ends) and not (np.asarray(ends)[..., 0] <= np.asarray(ends)[..., 1]).all():
            arrays.refuse("samples_px", f"is the first and the last sample, not {np.asarray(ends).tolist()}")
        self.samples_px = ends
        if along not in ("x", "y"):
            raise WhiskjaxError(f"LineCamera: a detector line lies along x or y, not {along!r}")
        self.along = along

    def absent(self, field: str) -> Float[Array, "..."] | None:
        """A straight line."""
        return np.zeros((2, 4)) if field == "deformation_px" else None

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of its numbers."""
        numbers = self.focal_px, self.principal_sample_px, self.offset_px, self.along_sign, self.across_sign, self.half_width_px
        return common_batch(*((n, 0) for n in numbers), (self.deformation_px, 2), (self.samples_px, 1))

    @property
    def is_line(self) -> bool:
        """Yes."""
        return True

    def at(self, shot: Shot) -> "LineCamera":
        """The same for every shot."""
        return self

    def check(self, shot: Shot) -> RESULTS:
        """The same for every shot."""
        return RESULTS.successful

    def _axes(self, q: Vec3) -> Vec2:
        return (q[0], q[1]) if self.along == "x" else (q[1], q[0])

    def _deformation(self, s: Component) -> Vec2:
        if self.deformation_px is None:
            return 0, 0
        u = s / self.half_width_px
        return _cubic(self.deformation_px[..., 0, :], u), _cubic(self.deformation_px[..., 1, :], u)

    def _sample(self, along: Component) -> Component:
        """The centred sample whose deformed position is `along`; where there is none, whatever is finite."""
        if self.deformation_px is None:
            return along
        given = self.deformation_px[..., 0, :], self.half_width_px, along
        coefficients, half_width, aim = jax.lax.stop_gradient(given)
        s = aim
        for _ in range(_NEWTON_STEPS):
            u = s / half_width
            slope = 1 + (coefficients[..., 1] + u * (2 * coefficients[..., 2] + u * (3 * coefficients[..., 3]))) / half_width
            s = s - (s + _cubic(coefficients, u) - aim) / jnp.where(slope == 0, 1.0, slope)
        return implicit(_lies_beside, (jnp.where(jnp.isfinite(s), s, aim),), *given)[0]

    def pixel(self, q: Vec3) -> Vec2:
        """(sample, line offset) of a direction."""
        a, c = self._axes(q)
        w = -self.focal_px / q[2]
        s = self._sample(self.along_sign * (a * w))
        return self.principal_sample_px + s, self.across_sign * (c * w - self.offset_px - self._deformation(s)[1])

    def direction(self, pixel: Vec2) -> Vec3:
        """Direction of a (sample, line offset)."""
        s = pixel[0] - self.principal_sample_px
        d_along, d_across = self._deformation(s)
        a = self.along_sign * (s + d_along)
        c = self.across_sign * pixel[1] + self.offset_px + d_across
        return (a, c, -self.focal_px) if self.along == "x" else (c, a, -self.focal_px)

    def check_direction(self, q: Vec3) -> RESULTS:
        """In front of the camera, whose focal length may have been estimated."""
        result = failure_if(~(q[2] < 0), RESULTS.point_behind_camera)
        return choose(self.focal_px <= 0, RESULTS.no_focal_length, result)

    def check_pixel(self, pixel: Vec2) -> RESULTS:
        """Every pixel has a direction."""
        return RESULTS.successful

    def sees(self, pixel: Vec2) -> Bool[Array, "..."] | bool:
        """Between the first and the last sample."""
        if self.samples_px is None:
            return True
        return (pixel[0] >= self.samples_px[..., 0] - 0.5) & (pixel[0] <= self.samples_px[..., 1] + 0.5)

    def ends(self) -> tuple[Component, ...]:
        """As given."""
        return () if self.samples_px is None else (self.samples_px[..., 0], self.samples_px[..., 1])

    def miss(self, q: Vec3) -> Component:
        """Tangent of half the angle between the direction and the plane of the detector line and the projection centre."""
        a, c = self._axes(q)
        f, place = self.focal_px, self.offset_px
        if self.deformation_px is not None:
            # The sample that will image the point does not change while the camera turns about the line: it follows from the
            # distance to the line, which stays finite where q_z does not.
            distance = norm((c, q[2]))
            for _ in range(4):
                s = self._sample(self.along_sign * a * norm((f, place)) / distance)
                place = self.offset_px + self._deformation(s)[1]
        # The line's plane contains (c, z) = (place, -f): sine and cosine of the angle around the line, up to one factor.
        sine, cosine = c * f + q[2] * place, c * place - q[2] * f
        return self.across_sign * sine / (norm((sine, cosine)) + cosine)


def _cubic(coefficients: Float[Array, "*batch 4"], u: Component) -> Component:
    c0, c1, c2, c3 = unstack(coefficients)
    return c0 + u * (c1 + u * (c2 + u * c3))


def _lies_beside(
    sample: tuple[Component], coefficients: Float[Array, "*batch 4"], half_width_px: Component, along: Component
) -> tuple[Component]:
    """What vanishes at the centred sample whose deformed position is `along`."""
    (s,) = sample
    return (s + _cubic(coefficients, s / half_width_px) - along,)


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

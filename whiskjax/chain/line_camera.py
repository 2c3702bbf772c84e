"""Line cameras: a detector line in the focal plane."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import Component, Vec2, Vec3, norm, unstack
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
    plus, with self-calibration, two cubics in (s - principal) / half_width_px and two waves of one wavelength: the detector line
    as it really lies.

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
    - `wave_px`: (2, 2), along and across, coefficients of sine and cosine of 2 pi (s - principal) / `wavelength_px`; or None.
      What repeats along a detector no cubic follows: an error of the camera that all rays of a sample share.
    - `samples_px`: first and last sample of the detector, or None where it does not matter.
    """

    given: ClassVar = ("along_sign", "across_sign", "half_width_px", "samples_px", "wavelength_px")
    focal_px: Float[Array, "..."] = eqx.field(converter=parameter)
    principal_sample_px: Float[Array, "..."] = eqx.field(converter=parameter)
    offset_px: Float[Array, "..."] = eqx.field(converter=parameter)
    along_sign: Float[Array, "..."] = eqx.field(converter=parameter)
    across_sign: Float[Array, "..."] = eqx.field(converter=parameter)
    deformation_px: Float[Array, "*batch 2 4"] | None = eqx.field(converter=parameter)
    half_width_px: Float[Array, "..."] = eqx.field(converter=parameter)
    samples_px: Float[Array, "*batch 2"] | None = eqx.field(converter=parameter)
    along: str = eqx.field(static=True)
    wave_px: Float[Array, "*batch 2 2"] | None = eqx.field(converter=parameter)
    wavelength_px: Float[Array, "..."] | None = eqx.field(converter=parameter)

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
        wave_px: Float[Numbers, "*batch 2 2"] | None = None,
        wavelength_px: Float[Numbers, "..."] | None = None,
    ):
        """**Raises:** `WhiskjaxError` for other shapes than these, lengths that are not positive, signs that are none, a wave
        without a wavelength."""
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
        waves = "along and across, coefficients of sine and cosine"
        self.wave_px = arrays.take("wave_px", wave_px, "... 2 2", optional=True, finite=True, meaning=waves)
        self.wavelength_px = arrays.take("wavelength_px", wavelength_px, "...", optional=True, finite=True, above=0.0)
        if self.wave_px is not None and self.wavelength_px is None:
            arrays.refuse("wavelength_px", "is None, but there is a wave_px: say how long it is")

    def absent(self, field: str) -> Float[np.ndarray, "..."] | None:
        """A straight line."""
        if field == "wave_px" and self.wavelength_px is not None:
            return np.zeros((2, 2))
        return np.zeros((2, 4)) if field == "deformation_px" else None

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of its numbers."""
        numbers = self.focal_px, self.principal_sample_px, self.offset_px, self.along_sign, self.across_sign, self.half_width_px
        lines = (self.deformation_px, 2), (self.wave_px, 2), (self.samples_px, 1), (self.wavelength_px, 0)
        return common_batch(*((n, 0) for n in numbers), *lines)

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

    def _bend(self, row: int) -> "_Bend | None":
        """By how much samples lie beside the straight line, along it (0) or across it (1); None where nothing says so."""
        if self.deformation_px is None and self.wave_px is None:
            return None
        cubic, wave = (None if a is None else a[..., row, :] for a in (self.deformation_px, self.wave_px))
        return _Bend(cubic, self.half_width_px, wave, None if wave is None else self.wavelength_px)

    def _deformation(self, s: Component) -> Vec2:
        along, across = self._bend(0), self._bend(1)
        return (0, 0) if along is None or across is None else (along.at(s), across.at(s))

    def _sample(self, along: Component) -> Component:
        """The centred sample whose deformed position is `along`; where there is none, whatever is finite."""
        if (bend := self._bend(0)) is None:
            return along
        held, aim = jax.lax.stop_gradient((bend, along))
        s = aim
        for _ in range(_NEWTON_STEPS):
            slope = 1 + held.slope(s)
            s = s - (s + held.at(s) - aim) / jnp.where(slope == 0, 1.0, slope)
        return implicit(_lies_beside, (jnp.where(jnp.isfinite(s), s, aim),), bend, along)[0]

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
        if self._bend(1) is not None:
            # The sample that will image the point does not change while the camera turns about the line: it follows from the
            # distance to the line, which stays finite where q_z does not.
            distance = norm((c, q[2]))
            for _ in range(4):
                s = self._sample(self.along_sign * a * norm((f, place)) / distance)
                place = self.offset_px + self._deformation(s)[1]
        # The line's plane contains (c, z) = (place, -f): sine and cosine of the angle around the line, up to one factor.
        sine, cosine = c * f + q[2] * place, c * place - q[2] * f
        return self.across_sign * sine / (norm((sine, cosine)) + cosine)


class _Bend(NamedTuple):
    """One coordinate of a detector line: a cubic in s / half_width, and a wave."""

    cubic: Float[Array, "*batch 4"] | None
    half_width_px: Component
    wave: Float[Array, "*batch 2"] | None
    wavelength_px: Any

    def at(self, s: Component) -> Component:
        """By how much a centred sample lies beside the straight line."""
        beside: Component = 0
        if self.cubic is not None:
            c0, c1, c2, c3 = unstack(self.cubic)
            u = s / self.half_width_px
            beside = c0 + u * (c1 + u * (c2 + u * c3))
        if self.wave is not None:
            phase = 2 * np.pi * s / self.wavelength_px
            beside = beside + self.wave[..., 0] * jnp.sin(phase) + self.wave[..., 1] * jnp.cos(phase)
        return beside

    def slope(self, s: Component) -> Component:
        """How that changes from sample to sample."""
        slope: Component = 0
        if self.cubic is not None:
            u = s / self.half_width_px
            slope = (self.cubic[..., 1] + u * (2 * self.cubic[..., 2] + u * (3 * self.cubic[..., 3]))) / self.half_width_px
        if self.wave is not None:
            rate = 2 * np.pi / self.wavelength_px
            slope = slope + rate * (self.wave[..., 0] * jnp.cos(rate * s) - self.wave[..., 1] * jnp.sin(rate * s))
        return slope


def _lies_beside(sample: tuple[Component], bend: _Bend, along: Component) -> tuple[Component]:
    """What vanishes at the centred sample whose deformed position is `along`."""
    (s,) = sample
    return (s + bend.at(s) - along,)

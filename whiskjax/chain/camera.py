"""What every camera is, and the frame camera.

The camera frame is photogrammetric: a direction q is imaged at (x, y, -f) with x = -f q_x/q_z, y = -f q_y/q_z; the camera looks
along -z. Pixels are (sample or column, line or row).
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import Component, Vec2, Vec3, unstack, vsub
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, need_flags
from ..rules.results import choose, failure_if
from .part import AbstractPart
from .shot import Shot

# Newton steps from the distorted to the undistorted coordinates.
_NEWTON_STEPS = 6


def parameter(value: Any) -> Any:
    """A camera constant as a float array, None left alone."""
    return None if value is None else jnp.asarray(value, dtype=float)


def common_batch(*fields: tuple[Any, int]) -> tuple[int, ...]:
    """The batch shape that fields have in common: each with the number of its own dimensions; None has none."""
    shapes = {np.shape(a)[: np.ndim(a) - own] for a, own in fields if a is not None} - {()}
    return np.broadcast_shapes(*shapes)


class AbstractCamera(AbstractPart):
    """Pixel <-> direction in the camera frame."""

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """() for one camera of all shots; else it broadcasts with the shots."""
        return ()

    @property
    @abc.abstractmethod
    def is_line(self) -> bool:
        """Whether the image is made of lines exposed one after the other."""

    @abc.abstractmethod
    def at(self, shot: Shot) -> "AbstractCamera":
        """The camera as it was at each shot (a zoom lens has a focal length for each image)."""

    @abc.abstractmethod
    def check(self, shot: Shot) -> RESULTS:
        """Whether there is a camera for each shot."""

    @abc.abstractmethod
    def pixel(self, q: Vec3) -> Vec2:
        """Where a direction of the camera frame is imaged."""

    @abc.abstractmethod
    def direction(self, pixel: Vec2) -> Vec3:
        """The direction, of any length, that is imaged at a pixel."""

    @abc.abstractmethod
    def check_direction(self, q: Vec3) -> RESULTS:
        """Whether the direction can be imaged at all."""

    @abc.abstractmethod
    def check_pixel(self, pixel: Vec2) -> RESULTS:
        """Whether the pixel has a direction."""

    @abc.abstractmethod
    def sees(self, pixel: Vec2) -> Bool[Array, "..."] | bool:
        """Whether the pixel lies on the detector, where its size is known."""

    def ends(self) -> tuple[Component, ...]:
        """First and last sample of a detector line; nothing where there is none, or they are not known."""
        return ()

    def limits(self) -> tuple[Component, ...]:
        """Lowest and highest number of the first pixel coordinate on the detector, then of the second, as far as known."""
        return self.ends()

    @abc.abstractmethod
    def miss(self, q: Vec3) -> Component:
        """For line cameras: a signed measure of how far a direction lies beside the line, monotone over half a turn.

        It vanishes where the direction is imaged on the line, and is the tangent of half the angle, so that the search for the
        time of exposure meets neither the pole of the image coordinate nor a flat top.
        """


_DISTORTION = (
    "k1, k2, k3, p1, p2. OpenCV's order is k1, k2, p1, p2, k3: its four numbers are [k1, k2, 0, p1, p2] here, and more than its "
    "five are another model"
)


def _distorted(coefficients: Float[Array, "*batch 5"], u: Component, v: Component) -> Vec2:
    k1, k2, k3, p1, p2 = unstack(coefficients)
    r2 = u * u + v * v
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u),
        v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v,
    )


def _misses(place: Vec2, coefficients: Float[Array, "*batch 5"], target: Vec2) -> Vec2:
    """What vanishes at the coordinates whose distortion is the target."""
    return vsub(_distorted(coefficients, *place), target)


def _towards(coefficients: Float[Array, "*batch 5"], u: Component, v: Component, target: Vec2) -> Vec2:
    """One Newton step towards the coordinates whose distortion is the target."""
    k1, k2, k3, p1, p2 = unstack(coefficients)
    r2 = u * u + v * v
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    du, dv = _distorted(coefficients, u, v)
    a = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u
    b = slope * u * v + 2 * p1 * u + 2 * p2 * v
    d = radial + slope * v * v + 6 * p1 * v + 2 * p2 * u
    w = 1 / (a * d - b * b)
    eu, ev = target[0] - du, target[1] - dv
    return u + (d * eu - b * ev) * w, v + (a * ev - b * eu) * w


class FrameCamera(AbstractCamera):
    """A frame camera: column = c_x + x, row = c_y - y, with Brown-Conrady distortion.

    With u = x/f to the right, v = -y/f downwards and r^2 = u^2 + v^2, the distorted coordinates are
    u (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 u v + p2 (r^2 + 2 u^2) and likewise v with p1 and p2 exchanged (Brown 1971).

    **Arguments:**

    - `focal_px`: focal length in pixels, () or (n_images,) for a zoom lens.
    - `principal_point_px`: column and row of the principal point in the flight's pixel coordinates.
    - `distortion`: (k1, k2, k3, p1, p2) or None. OpenCV's numbers mean the same, but stand as k1, k2, p1, p2, k3.
    - `size_px`: columns and rows of the detector, or None where it does not matter.
    - `per_image`: `focal_px` holds one number for each image; the shot's image picks it.
    """

    given: ClassVar = ("size_px",)
    focal_px: Float[Array, "..."] = eqx.field(converter=parameter)
    principal_point_px: Float[Array, "*batch 2"] = eqx.field(converter=parameter)
    distortion: Float[Array, "*batch 5"] | None = eqx.field(converter=parameter)
    size_px: Float[Array, "*batch 2"] | None = eqx.field(converter=parameter)
    per_image: bool = eqx.field(static=True)

    def __init__(
        self,
        focal_px: Float[Numbers, "..."],
        principal_point_px: Float[Numbers, "*batch 2"],
        distortion: Float[Numbers, "*batch 5"] | None = None,
        size_px: Float[Numbers, "*batch 2"] | None = None,
        per_image: bool = False,
    ):
        """**Raises:** `WhiskjaxError` for other shapes than these, a focal length or size that is not positive."""
        arrays = Arrays("FrameCamera")
        need_flags("FrameCamera", per_image=per_image)
        # A focal length for each image is no batch of the others: the shot picks one.
        focal, many = (Arrays("FrameCamera"), "images") if per_image else (arrays, "...")
        self.focal_px = focal.take("focal_px", focal_px, many, finite=True, above=0.0, meaning="a number of pixels")
        self.principal_point_px = arrays.take(
            "principal_point_px", principal_point_px, "... 2", finite=True, meaning="column and row"
        )
        self.distortion = arrays.take("distortion", distortion, "... 5", optional=True, finite=True, meaning=_DISTORTION)
        self.size_px = arrays.take(
            "size_px", size_px, "... 2", optional=True, finite=True, above=0.0, meaning="columns and rows of the detector"
        )
        self.per_image = per_image

    def absent(self, field: str) -> Float[np.ndarray, "..."] | None:
        """No distortion."""
        return np.zeros(5) if field == "distortion" else None

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of its numbers, but for a focal length for each image."""
        focal = None if self.per_image else self.focal_px
        return common_batch((focal, 0), (self.principal_point_px, 1), (self.distortion, 1), (self.size_px, 1))

    @property
    def is_line(self) -> bool:
        """No: all at once."""
        return False

    def at(self, shot: Shot) -> "FrameCamera":
        """With the focal length of each shot's image, where there is one for each image."""
        if not self.per_image:
            return self
        return FrameCamera(
            self.focal_px[shot.need("image", "but the focal length differs per image")],
            self.principal_point_px,
            self.distortion,
            self.size_px,
        )

    def check(self, shot: Shot) -> RESULTS:
        """Whether the image has a focal length, where there is one for each image."""
        if not self.per_image or shot.image is None:
            return RESULTS.successful
        known = (shot.image >= 0) & (shot.image < self.focal_px.shape[-1])
        return failure_if(jnp.logical_not(known), RESULTS.unknown_key)

    def _distort(self, u: Component, v: Component) -> Vec2:
        return (u, v) if self.distortion is None else _distorted(self.distortion, u, v)

    def _undistort(self, target: Vec2) -> Vec2:
        """The coordinates whose distortion is the target; of one that is not met, whatever is finite."""
        if self.distortion is None:
            return target
        coefficients, aim = jax.lax.stop_gradient((self.distortion, target))
        u, v = aim
        for _ in range(_NEWTON_STEPS):
            u, v = _towards(coefficients, u, v, aim)
        lost = ~jnp.isfinite(u + v)
        return implicit(_misses, tuple(jnp.where(lost, 0.0, c) for c in (u, v)), self.distortion, target)

    def _principal(self) -> Vec2:
        return self.principal_point_px[..., 0], self.principal_point_px[..., 1]

    def pixel(self, q: Vec3) -> Vec2:
        """(column, row) of a direction."""
        # Quotients, not products with a reciprocal: XLA on the CPU keeps a quotient, but computes what is cheap at every use.
        u, v = self._distort(-q[0] / q[2], q[1] / q[2])
        cx, cy = self._principal()
        return cx + self.focal_px * u, cy + self.focal_px * v

    def direction(self, pixel: Vec2) -> Vec3:
        """Direction of a (column, row)."""
        cx, cy = self._principal()
        u, v = self._undistort(((pixel[0] - cx) / self.focal_px, (pixel[1] - cy) / self.focal_px))
        return u, -v, -1

    def _unfolded(self, u: Component, v: Component) -> Bool[Array, "..."] | bool:
        """Inside the radius up to which the distorted radius grows; beyond it the model images points a second time.

        The slope 1 + 3 k1 x + 5 k2 x^2 + 7 k3 x^3, x = r^2, must be positive from the centre outwards: at x, and at its extrema
        on the way, the roots of 3 k1 + 10 k2 x + 21 k3 x^2.
        """
        if self.distortion is None:
            return True
        k1, k2, k3 = (self.distortion[..., i] for i in range(3))
        r2 = u * u + v * v

        def grows(x):
            return 1 + x * (3 * k1 + x * (5 * k2 + x * 7 * k3)) > 0

        def on_the_way(above, below):
            x = above / jnp.where(below == 0, 1.0, below)
            return jnp.clip(jnp.where(below == 0, 0.0, x), 0.0, r2)

        discriminant = 25 * k2 * k2 - 63 * k1 * k3
        q = -(5 * k2 + jnp.where(k2 < 0, -1.0, 1.0) * jnp.sqrt(jnp.maximum(discriminant, 0.0)))
        return grows(r2) & ((discriminant < 0) | (grows(on_the_way(q, 21 * k3)) & grows(on_the_way(3 * k1, q))))

    def check_direction(self, q: Vec3) -> RESULTS:
        """In front of the camera, whose focal length may have been estimated, and inside the invertible radius."""
        behind = ~(q[2] < 0)
        w = -1 / jnp.where(behind, -1.0, q[2])
        folded = jnp.logical_not(self._unfolded(q[0] * w, q[1] * w))
        result = failure_if(folded, RESULTS.distortion_not_invertible)
        result = choose(behind, RESULTS.point_behind_camera, result)
        return choose(self.focal_px <= 0, RESULTS.no_focal_length, result)

    def check_pixel(self, pixel: Vec2) -> RESULTS:
        """Whether undistorting converged inside the invertible radius."""
        if self.distortion is None:
            return RESULTS.successful
        cx, cy = self._principal()
        target = ((pixel[0] - cx) / self.focal_px, (pixel[1] - cy) / self.focal_px)
        u, v = self._undistort(target)
        du, dv = self._distort(u, v)
        close = jnp.maximum(jnp.abs(du - target[0]), jnp.abs(dv - target[1])) * self.focal_px < 1e-6
        return failure_if(~(close & self._unfolded(u, v)), RESULTS.distortion_not_invertible)

    def sees(self, pixel: Vec2) -> Bool[Array, "..."] | bool:
        """Inside the frame."""
        if self.size_px is None:
            return True
        left, right, top, bottom = self.limits()
        column, row = pixel
        return (column >= left) & (column <= right) & (row >= top) & (row <= bottom)

    def limits(self) -> tuple[Component, ...]:
        """The edges of the outermost pixels."""
        if self.size_px is None:
            return ()
        zero = 0 * self.size_px[..., 0]
        return zero - 0.5, self.size_px[..., 0] - 0.5, zero - 0.5, self.size_px[..., 1] - 0.5

    def miss(self, q: Vec3) -> Component:
        """A frame camera has no line."""
        raise WhiskjaxError("a frame camera exposes the whole image at once: there is no line to search")

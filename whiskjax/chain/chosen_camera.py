"""Several cameras told apart element by element: what `By` is for a batch of shots whose key is an array."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..algebra.vectors import Component, Vec2, Vec3
from ..rules import RESULTS
from ..rules.results import choose
from .camera import AbstractCamera, FrameCamera
from .line_camera import LineCamera
from .shot import Shot


def chosen_camera(key: Int[Array, "..."], cameras: tuple[AbstractCamera, ...]) -> AbstractCamera:
    """The camera of each element; cameras of one kind become one whose numbers are chosen, so that the image is taken once."""

    def plain(camera: AbstractCamera) -> bool:
        return isinstance(camera, FrameCamera | LineCamera) and camera.focal_px.ndim == 0

    if not all(map(plain, cameras)) or len({jax.tree.structure(camera) for camera in cameras}) > 1:
        return ChosenCamera(key, cameras)

    def pick(*numbers: Array) -> Array:
        value = numbers[0]
        for i, number in enumerate(numbers[1:], start=1):
            value = jnp.where(jnp.expand_dims(key == i, tuple(range(-number.ndim, 0))), number, value)
        return value

    return jax.tree.map(pick, *cameras)


class ChosenCamera(AbstractCamera):
    """Every camera is asked and the answer of the right one taken: results are chosen, so the cameras may differ in kind."""

    key: Int[Array, "..."]
    cameras: tuple[AbstractCamera, ...]

    @property
    def is_line(self) -> bool:
        """As the cameras are."""
        return self.cameras[0].is_line

    def _choose(self, ask: Callable[[AbstractCamera], Any], pick: Callable[[Any, Any, Any], Any]) -> Any:
        first, *rest = (ask(camera) for camera in self.cameras)
        for i, answer in enumerate(rest, start=1):
            first = pick(self.key == i, answer, first)
        return first

    def _components(self, ask: Callable[[AbstractCamera], tuple[Component, ...]]) -> tuple[Component, ...]:
        return self._choose(ask, lambda here, a, b: tuple(jnp.where(here, x, y) for x, y in zip(a, b, strict=True)))

    def at(self, shot: Shot) -> "ChosenCamera":
        """Already chosen."""
        return self

    def check(self, shot: Shot) -> RESULTS:
        """The chosen camera's own check."""
        return self._choose(lambda camera: camera.check(shot), choose)

    def pixel(self, q: Vec3) -> Vec2:
        """Where the chosen camera images a direction."""
        return self._components(lambda camera: camera.pixel(q))

    def direction(self, pixel: Vec2) -> Vec3:
        """The chosen camera's direction of a pixel."""
        return self._components(lambda camera: camera.direction(pixel))

    def check_direction(self, q: Vec3) -> RESULTS:
        """Whether the chosen camera can image a direction."""
        return self._choose(lambda camera: camera.check_direction(q), choose)

    def check_pixel(self, pixel: Vec2) -> RESULTS:
        """Whether the chosen camera's pixel has a direction."""
        return self._choose(lambda camera: camera.check_pixel(pixel), choose)

    def sees(self, pixel: Vec2) -> Bool[Array, "..."] | bool:
        """Whether the pixel lies on the chosen detector."""
        return self._choose(lambda camera: camera.sees(pixel), jnp.where)

    def ends(self) -> tuple[Component, ...]:
        """Those of the chosen detector, where all have some."""
        if not all(camera.ends() for camera in self.cameras):
            return ()
        return self._components(lambda camera: camera.ends() or ())

    def limits(self) -> tuple[Component, ...]:
        """Those of the chosen detector, where all have some."""
        if not all(camera.limits() for camera in self.cameras):
            return ()
        return self._components(lambda camera: camera.limits())

    def miss(self, q: Vec3) -> Component:
        """The chosen camera's miss."""
        return self._choose(lambda camera: camera.miss(q), jnp.where)

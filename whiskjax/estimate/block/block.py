"""What a block adjustment adjusts: the rays of control, check and tie points."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ...chain.shot import KEYS, Shot, fit_shot
from ...rules import Arrays, WhiskjaxError, need
from ...rules.spread import refuse_covariances, refuse_sigmas, refuse_sizes

ROLES = ("control", "check", "tie")


@dataclasses.dataclass(frozen=True)
class Block:
    """Image measurements of points, and what is known of the points; residual = measured - projected, in pixels.

    Rays of all three roles take part. Control points have coordinates with a covariance; those of check points are only compared
    with what comes out; tie points have none.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments** (rays, points):

    - `shot`: time and keys, each (rays,).
    - `pixel_px`: measured (sample, line offset) or (column, row), (rays, 2).
    - `sigma_px`: 1-sigma of both, (rays, 2).
    - `point`: which point each ray sees, 0 to points - 1, (rays,).
    - `position_m`: world frame, (points, 3); NaN for tie points.
    - `covariance_m2`: of the coordinates of control and check points in the world frame, (points, 3, 3); not read for tie points.
    - `role`: "control", "check" or "tie", (points,).
    - `points`, `images`, `strips`: names for people, of points, of rays, and of strips by their number.
    """

    shot: Shot
    pixel_px: Float[np.ndarray, "rays 2"]
    sigma_px: Float[np.ndarray, "rays 2"]
    point: Int[np.ndarray, " rays"]
    position_m: Float[np.ndarray, "points 3"]
    covariance_m2: Float[np.ndarray, "points 3 3"]
    role: np.ndarray
    points: Sequence[str] = ()
    images: Sequence[str] = ()
    strips: Sequence[str] = ()

    def __post_init__(self):
        need("Block", "shot", self.shot, Shot, "Shot(time_s=..., image=...)")
        arrays = Arrays("Block")
        taken = {
            "point": arrays.take_whole("point", self.point, "rays", meaning="the index of the point that each ray sees"),
            "pixel_px": arrays.take("pixel_px", self.pixel_px, "rays 2"),
            "sigma_px": arrays.take("sigma_px", self.sigma_px, "rays 2"),
            "role": np.asarray(self.role),
        }
        arrays.fit("role", taken["role"].shape, "points")
        taken["position_m"] = arrays.take("position_m", self.position_m, "points 3", absolute=True)
        taken["covariance_m2"] = arrays.take("covariance_m2", self.covariance_m2, "points 3 3")
        fit_shot(arrays, self.shot, "rays")
        for name, value in taken.items():
            object.__setattr__(self, name, np.asarray(value))
        rays, points = len(self.point), len(self.role)
        if rays == 0:
            raise WhiskjaxError("the block has no rays: nothing can be adjusted")
        strip = self.shot.strip
        strips = 0 if strip is None else 1 + int(np.max(np.asarray(strip)))
        if len(self.strips) and len(self.strips) < strips:
            raise WhiskjaxError(f"block: {len(self.strips)} names of strips, but a ray is of strip {strips - 1}")
        for name, count in (("points", points), ("images", rays)):
            if len(getattr(self, name)) not in (0, count):
                raise WhiskjaxError(f"block: {len(getattr(self, name))} names of {name} for {count}")
        unknown = set(self.role.tolist()) - set(ROLES)
        if unknown:
            raise WhiskjaxError(f"Block: role: a point is a {', '.join(ROLES)} point, not {sorted(map(str, unknown))}")
        wrong = np.flatnonzero((self.point < 0) | (self.point >= points))
        if wrong.size:
            raise WhiskjaxError(f"ray {wrong[0]} sees point {self.point[wrong[0]]}, but the points are 0 to {points - 1}")
        self._require(np.isfinite(self.pixel_px).all(axis=1), "pixel_px is not a finite number")
        self._require((np.isfinite(self.sigma_px) & (self.sigma_px > 0)).all(axis=1), "sigma_px must be a positive number")
        known = self.role != "tie"
        placed = np.isfinite(self.position_m).all(axis=1) & np.isfinite(self.covariance_m2).all(axis=(1, 2))
        if (known & ~placed).any():
            i = int(np.argmax(known & ~placed))
            raise WhiskjaxError(f"{self.point_label(i)} is a {self.role[i]} point, but its coordinates are not finite numbers")
        refuse_sizes(self.pixel_px, lambda i: f"{self.ray_label(i)}: pixel_px")
        refuse_sizes(np.where(known[:, None], self.position_m, 0.0), lambda i: f"{self.point_label(i)}: position_m")
        refuse_sigmas(self.sigma_px, lambda i: f"{self.ray_label(i)}: sigma_px")
        given = np.flatnonzero(known)
        refuse_covariances(self.covariance_m2[given], lambda i: f"{self.point_label(int(given[i]))}: covariance_m2")

    def _require(self, fine: Any, message: str) -> None:
        if not fine.all():
            raise WhiskjaxError(f"{self.ray_label(int(np.argmin(fine)))}: {message}")

    def __len__(self) -> int:
        return len(self.point)

    def key(self, name: str) -> np.ndarray | None:
        """A key, or the time, of every ray; None where it is not recorded."""
        value = getattr(self.shot, name)
        return None if value is None else np.broadcast_to(np.asarray(value), (len(self),))

    @property
    def seen(self) -> Bool[np.ndarray, " points"]:
        """Points that some ray sees."""
        return np.bincount(self.point, minlength=len(self.role)) > 0

    def information(self) -> Float[np.ndarray, "points 3 3"]:
        """Inverse covariance of the control points, zero for others; a sigma below a micrometre counts as one."""
        known = self.role == "control"
        inverse = np.zeros((len(known), 3, 3))
        values, vectors = np.linalg.eigh(self.covariance_m2[known])
        inverse[known] = (vectors / np.maximum(values, 1e-12)[:, None, :]) @ vectors.swapaxes(1, 2)
        return inverse

    def shots(self, index: Any = slice(None)) -> Shot:
        """The shots of rays, by index of any shape."""
        picked: dict[str, Any] = {}
        for name in ("time_s", *KEYS):
            if (value := self.key(name)) is not None:
                picked[name] = value[index]
        return Shot(**picked)

    def point_name(self, i: int) -> str:
        """The name of a point, or its number where there are no names."""
        return str(self.points[i]) if len(self.points) else str(i)

    def point_label(self, i: int) -> str:
        """A point, named for people."""
        return f"point {self.point_name(i)}"

    def ray_label(self, i: int) -> str:
        """A ray, named for people."""
        image = f", image {self.images[i]}" if len(self.images) else ""
        return f"ray {i}{image}, {self.point_label(int(self.point[i]))}"

    def keep(self, rays: np.ndarray) -> "Block":
        """The block with those rays only, by mask or index; all points stay, seen or not."""
        index = Arrays("Block.keep").take_choice("rays", rays, len(self))
        images = [self.images[int(i)] for i in index] if len(self.images) else ()
        return dataclasses.replace(
            self,
            shot=self.shots(index),
            pixel_px=self.pixel_px[index],
            sigma_px=self.sigma_px[index],
            point=self.point[index],
            images=images,
        )

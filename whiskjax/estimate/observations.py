"""What was measured: where known points were seen."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..chain.shot import Shot, fit_shot
from ..rules import Arrays, WhiskjaxError, need
from ..rules.spread import refuse_covariances, refuse_sigmas, refuse_sizes


@dataclasses.dataclass(frozen=True)
class Observations:
    """Image measurements of points with known coordinates; residual = measured - projected, in pixels.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments** (n observations):

    - `shot`: time and keys, each (n,).
    - `point_m`: world frame, (n, 3).
    - `pixel_px`: measured (sample, line offset) or (column, row), (n, 2).
    - `sigma_px`: 1-sigma of both, (n, 2).
    - `is_control`: True where it takes part in the estimation, False for check points, (n,).
    - `point_covariance_m2`: of the point's coordinates in the world frame, (n, 3, 3), or None where they are taken as exact. It
      is propagated into the weights; a point seen several times is then treated as independent each time.
    - `images`, `points`: names for people, n each.
    """

    shot: Shot
    point_m: Float[np.ndarray, "n 3"]
    pixel_px: Float[np.ndarray, "n 2"]
    sigma_px: Float[np.ndarray, "n 2"]
    is_control: Bool[np.ndarray, " n"]
    point_covariance_m2: Float[np.ndarray, "n 3 3"] | None = None
    images: Sequence[str] = ()
    points: Sequence[str] = ()

    def __post_init__(self):
        need("Observations", "shot", self.shot, Shot, "Shot(time_s=..., image=...)")
        arrays = Arrays("Observations")
        taken = {
            "point_m": arrays.take("point_m", self.point_m, "n 3", absolute=True),
            "pixel_px": arrays.take("pixel_px", self.pixel_px, "n 2"),
            "sigma_px": arrays.take("sigma_px", self.sigma_px, "n 2"),
            "is_control": arrays.take_flags("is_control", self.is_control, "n"),
        }
        if self.point_covariance_m2 is not None:
            taken["point_covariance_m2"] = arrays.take("point_covariance_m2", self.point_covariance_m2, "n 3 3")
        fit_shot(arrays, self.shot, "n")
        n = len(taken["point_m"])
        if n == 0:
            raise WhiskjaxError("there are no observations: nothing can be estimated from them")
        for name, value in taken.items():
            value = np.asarray(value)
            object.__setattr__(self, name, value)
            if value.dtype.kind == "f" and not np.isfinite(value).all():
                i = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise WhiskjaxError(f"{self.label(i)}: {name} is not a finite number")
        if not (self.sigma_px > 0).all():
            i = int(np.argwhere(self.sigma_px <= 0)[0, 0])
            raise WhiskjaxError(f"{self.label(i)}: sigma_px must be positive, not {self.sigma_px[i]}")
        for name in ("images", "points"):
            if len(getattr(self, name)) not in (0, n):
                raise WhiskjaxError(f"observations: {len(getattr(self, name))} names of {name} for {n} observations")
        for name in ("point_m", "pixel_px"):
            refuse_sizes(getattr(self, name), lambda i, name=name: f"{self.label(i)}: {name}")
        refuse_sigmas(self.sigma_px, lambda i: f"{self.label(i)}: sigma_px")
        if self.point_covariance_m2 is not None:
            refuse_covariances(self.point_covariance_m2, lambda i: f"{self.label(i)}: point_covariance_m2")

    def __len__(self) -> int:
        return len(self.point_m)

    def label(self, i: int) -> str:
        """An observation, named for people."""
        image = f", image {self.images[i]}" if len(self.images) else ""
        point = f", point {self.points[i]}" if len(self.points) else ""
        return f"observation {i}{image}{point}"

    def take(self, keep: np.ndarray) -> "Observations":
        """Those observations, by mask or index."""
        index = Arrays("Observations.take").take_choice("keep", keep, len(self))
        pick: dict[str, Any] = {
            f: np.asarray(v)[index]
            for f in ("image", "swing", "view", "strip")
            if (v := _array(self.shot, f, len(self))) is not None
        }
        time = _array(self.shot, "time_s", len(self))
        return Observations(
            Shot(time_s=None if time is None else time[index], **pick),
            self.point_m[index],
            self.pixel_px[index],
            self.sigma_px[index],
            self.is_control[index],
            None if self.point_covariance_m2 is None else self.point_covariance_m2[index],
            [self.images[int(i)] for i in index] if len(self.images) else (),
            [self.points[int(i)] for i in index] if len(self.points) else (),
        )

    def key(self, name: str) -> np.ndarray | None:
        """A key, or the time, of every observation; None where it is not recorded."""
        return _array(self.shot, name, len(self))


def _array(shot: Shot, name: str, n: int) -> np.ndarray | None:
    value = getattr(shot, name)
    return None if value is None else np.broadcast_to(np.asarray(value), (n,))

"""What was measured: where known points were seen."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..chain.shot import KEYS, Shot, fit_shot
from ..rules import Arrays, Labels, WhiskjaxError, is_traced, need, plain
from ..rules.spread import refuse_covariances, refuse_sigmas, refuse_sizes

_UNNAMED = Labels(images=(), points=())


class Observations(eqx.Module):
    """Image measurements of points with known coordinates; residual = measured - projected, in pixels.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them. Numbers may be traced.

    **Arguments** (n observations):

    - `shot`: time and keys, each (n,).
    - `point_m`: world frame, (n, 3).
    - `pixel_px`: measured (sample, line offset) or (column, row), (n, 2).
    - `sigma_px`: 1-sigma of both, (n, 2).
    - `is_control`: True where it takes part in the estimation, False for check points, (n,).
    - `point_covariance_m2`: of the point's coordinates in the world frame, (n, 3, 3), or None where they are taken as exact. It
      is propagated into the weights. A point was surveyed once: its error is the same in all rays that see it.
    - `images`, `points`: names for people, n each. Rays whose points have one name see one point; without names every ray sees
      its own.
    - `point`: which point each ray sees, (n,), where there are no names; kept in step with them, and None where every ray sees
      its own.
    """

    shot: Shot
    point_m: Float[Any, "n 3"]
    pixel_px: Float[Any, "n 2"]
    sigma_px: Float[Any, "n 2"]
    is_control: Bool[np.ndarray, " n"]
    point_covariance_m2: Float[Any, "n 3 3"] | None
    point: Int[Any, " n"] | None
    labels: Labels = eqx.field(static=True)

    def __init__(
        self,
        shot: Shot,
        point_m: Float[Any, "n 3"],
        pixel_px: Float[Any, "n 2"],
        sigma_px: Float[Any, "n 2"],
        is_control: Bool[Any, " n"],
        point_covariance_m2: Float[Any, "n 3 3"] | None = None,
        images: Sequence[str] = (),
        points: Sequence[str] = (),
        point: Int[Any, " n"] | None = None,
        labels: Labels = _UNNAMED,
    ):
        """**Raises:** `WhiskjaxError` naming the observation whose numbers make no sense; shapes that do not fit."""
        need("Observations", "shot", shot, Shot, "Shot(time_s=..., image=...)")
        arrays = Arrays("Observations")
        self.shot = shot
        self.point_m = plain(arrays.take("point_m", point_m, "n 3", absolute=True))
        self.pixel_px = plain(arrays.take("pixel_px", pixel_px, "n 2"))
        self.sigma_px = plain(arrays.take("sigma_px", sigma_px, "n 2"))
        self.is_control = plain(arrays.take_flags("is_control", is_control, "n"))
        self.point_covariance_m2 = None
        if point_covariance_m2 is not None:
            self.point_covariance_m2 = plain(arrays.take("point_covariance_m2", point_covariance_m2, "n 3 3"))
        fit_shot(arrays, shot, "n")
        n = len(self.point_m)
        if n == 0:
            raise WhiskjaxError("there are no observations: nothing can be estimated from them")
        for name, names in (("images", images), ("points", points)):
            if len(names) not in (0, n):
                raise WhiskjaxError(f"observations: {len(names)} names of {name} for {n} observations")
        # Names are no part of what is compiled: what they say of the points is kept as an array, that they say nothing as None.
        if point is not None:
            point = plain(arrays.take_whole("point", point, "n", meaning="which point a ray sees"))
        names = points or (labels["points"] if point is None else ())
        self.point = point if is_traced(point) and not len(names) else numbered(names if len(names) or point is None else point)
        self.labels = Labels(images=images or labels["images"], points=points or labels["points"])
        self._check()

    def _check(self) -> None:
        """What numbers may be, of those that are known."""
        known = {
            name: value
            for name in ("point_m", "pixel_px", "sigma_px", "point_covariance_m2")
            if (value := getattr(self, name)) is not None and not is_traced(value)
        }
        for name, value in known.items():
            if not np.isfinite(value).all():
                i = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise WhiskjaxError(f"{self.label(i)}: {name} is not a finite number")
        if "sigma_px" in known and not (self.sigma_px > 0).all():
            i = int(np.argwhere(self.sigma_px <= 0)[0, 0])
            raise WhiskjaxError(f"{self.label(i)}: sigma_px must be positive, not {self.sigma_px[i]}")
        for name in known.keys() & {"point_m", "pixel_px"}:
            refuse_sizes(known[name], lambda i, name=name: f"{self.label(i)}: {name}")
        if "sigma_px" in known:
            refuse_sigmas(self.sigma_px, lambda i: f"{self.label(i)}: sigma_px")
        if "point_covariance_m2" in known:
            refuse_covariances(known["point_covariance_m2"], lambda i: f"{self.label(i)}: point_covariance_m2")
            self._refuse_two_surveys(known)

    def _refuse_two_surveys(self, known: dict[str, Any]) -> None:
        """**Raises:** `WhiskjaxError` where rays of one point say different things of it, of which one error can be no error."""
        if self.point is None or is_traced(self.point):
            return
        first = np.unique(self.point, return_index=True)[1][self.point]
        for name in known.keys() & {"point_m", "point_covariance_m2"}:
            differs = (known[name] != known[name][first]).reshape(len(self), -1).any(axis=1)
            if differs.any():
                i = int(np.argmax(differs))
                raise WhiskjaxError(
                    f"{self.label(i)}: another {name} than {self.label(int(first[i]))} of the same point; a point is surveyed "
                    "once: give two points two names"
                )

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the images, one for each observation; or none."""
        return self.labels["images"]

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points, one for each observation; or none."""
        return self.labels["points"]

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
        covariance = self.point_covariance_m2
        return Observations(
            self.shots(index),
            self.point_m[index],
            self.pixel_px[index],
            self.sigma_px[index],
            self.is_control[index],
            None if covariance is None else covariance[index],
            [self.images[int(i)] for i in index] if len(self.images) else (),
            [self.points[int(i)] for i in index] if len(self.points) else (),
            None if self.point is None else self.point[index],
        )

    def shots(self, index: np.ndarray) -> Shot:
        """Time and keys of some observations."""
        picked: dict[str, Any] = {}
        for name in ("time_s", *KEYS):
            if (value := self.key(name)) is not None:
                picked[name] = value[index]
        return Shot(**picked)

    def key(self, name: str) -> Any:
        """A key, or the time, of every observation; None where it is not recorded."""
        value = getattr(self.shot, name)
        if value is None or is_traced(value):
            return value if value is None or value.ndim else jnp.broadcast_to(value, (len(self),))
        return np.broadcast_to(np.asarray(value), (len(self),))


def numbered(names: Sequence[Any] | np.ndarray) -> Int[np.ndarray, " n"] | None:
    """Equal numbers for equal names, in the order in which these first come; None where no two are equal."""
    first: dict[Any, int] = {}
    number = [first.setdefault(name, len(first)) for name in (names.tolist() if isinstance(names, np.ndarray) else names)]
    return np.array(number) if len(first) < len(number) else None

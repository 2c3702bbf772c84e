"""What a block adjustment adjusts: the rays of control, check and tie points."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...chain.shot import KEYS, Shot, fit_shot
from ...rules import Arrays, Fixed, Labels, WhiskjaxError, arrays_of, is_traced, need, plain
from ...rules.spread import refuse_covariances, refuse_sigmas, refuse_sizes

ROLES = ("control", "check", "tie")
_UNNAMED = Labels(points=(), images=(), strips=())
_EXACT = 1e-12  # m^2: what is known to a micrometre is known


class Block(eqx.Module):
    """Image measurements of points, and what is known of the points; residual = measured - projected, in pixels.

    Rays of all three roles take part. Control points have coordinates with a covariance; those of check points are only compared
    with what comes out; tie points have none.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    Times, pixels, sigmas, coordinates and covariances may be traced, and are not looked at then; which point a ray sees, roles
    and keys are not: they say what is computed (`dataclasses.replace` changes any of them, and names).

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

    time_s: Float[Any, "..."] | None
    pixel_px: Float[Any, "rays 2"]
    sigma_px: Float[Any, "rays 2"]
    position_m: Float[Any, "points 3"]
    covariance_m2: Float[Any, "points 3 3"]
    fixed: Fixed = eqx.field(static=True)
    labels: Labels = eqx.field(static=True)

    def __init__(
        self,
        shot: Shot | None = None,
        pixel_px: Any = None,
        sigma_px: Any = None,
        point: Any = None,
        position_m: Any = None,
        covariance_m2: Any = None,
        role: Any = None,
        points: Sequence[str] | None = None,
        images: Sequence[str] | None = None,
        strips: Sequence[str] | None = None,
        *,
        time_s: Any = None,
        fixed: Fixed | None = None,
        labels: Labels = _UNNAMED,
    ):
        """`time_s`, `fixed` and `labels` are what a block holds of the others: `dataclasses.replace` hands them on.

        **Raises:** `WhiskjaxError` naming the ray or the point whose numbers make no sense; shapes that do not fit.
        """
        arrays = Arrays("Block")
        if shot is not None or fixed is None:
            need("Block", "shot", shot, Shot, "Shot(time_s=..., image=...)")
            assert shot is not None  # checked just now
            time_s = shot.time_s
            for name in KEYS:
                if is_traced(getattr(shot, name)):
                    arrays.refuse(
                        f"shot.{name}", "is traced, but keys say what is computed: make the shot outside of jit and vmap"
                    )
        kept: Any = {} if fixed is None else fixed
        keys = {name: kept[name] if shot is None else getattr(shot, name) for name in KEYS}
        point = kept["point"] if point is None and fixed is not None else point
        role = kept["role"] if role is None and fixed is not None else role
        if is_traced(point):
            arrays.refuse("point", "is traced, but it says what is computed: give plain indices")
        point = np.asarray(arrays.take_whole("point", point, "rays", meaning="the index of the point that each ray sees"))
        self.pixel_px = plain(arrays.take("pixel_px", pixel_px, "rays 2"))
        self.sigma_px = plain(arrays.take("sigma_px", sigma_px, "rays 2"))
        arrays.fit("role", np.shape(role), "points")
        self.position_m = plain(arrays.take("position_m", position_m, "points 3", absolute=True))
        self.covariance_m2 = plain(arrays.take("covariance_m2", covariance_m2, "points 3 3"))
        self.time_s = None if time_s is None else plain(time_s)
        if shot is not None:
            fit_shot(arrays, shot, "rays")
        self.fixed = Fixed(point=point, role=role, **keys)
        named = {"points": points, "images": images, "strips": strips}
        self.labels = Labels(**{kind: labels[kind] if of is None else of for kind, of in named.items()})
        self._check()

    def _check(self) -> None:
        """What roles, indices and names may be, and those numbers that are known."""
        rays, points = len(self.point), len(self.role)
        if rays == 0:
            raise WhiskjaxError("the block has no rays: nothing can be adjusted")
        strip = self.fixed["strip"]
        strips = 0 if strip is None else 1 + int(np.max(strip))
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
        if not is_traced(self.pixel_px):
            self._require(np.isfinite(self.pixel_px).all(axis=1), "pixel_px is not a finite number")
            refuse_sizes(self.pixel_px, lambda i: f"{self.ray_label(i)}: pixel_px")
        if not is_traced(self.sigma_px):
            self._require((np.isfinite(self.sigma_px) & (self.sigma_px > 0)).all(axis=1), "sigma_px must be a positive number")
        self._check_points()
        if not is_traced(self.sigma_px):
            refuse_sigmas(self.sigma_px, lambda i: f"{self.ray_label(i)}: sigma_px")

    def _check_points(self) -> None:
        known = self.role != "tie"
        given = np.flatnonzero(known)
        placed = np.ones(len(known), dtype=bool)
        if not is_traced(self.position_m):
            placed &= np.isfinite(self.position_m).all(axis=1)
        if not is_traced(self.covariance_m2):
            placed &= np.isfinite(self.covariance_m2).all(axis=(1, 2))
        if (known & ~placed).any():
            i = int(np.argmax(known & ~placed))
            raise WhiskjaxError(f"{self.point_label(i)} is a {self.role[i]} point, but its coordinates are not finite numbers")
        if not is_traced(self.position_m):
            refuse_sizes(np.where(known[:, None], self.position_m, 0.0), lambda i: f"{self.point_label(i)}: position_m")
        if not is_traced(self.covariance_m2):
            refuse_covariances(self.covariance_m2[given], lambda i: f"{self.point_label(int(given[i]))}: covariance_m2")

    @property
    def shot(self) -> Shot:
        """Time and keys, as they were given."""
        keys: dict[str, Any] = {name: self.fixed[name] for name in KEYS}
        of_all = {name: value.item() for name, value in keys.items() if value is not None and np.ndim(value) == 0}
        return Shot(self.time_s, **(keys | of_all))

    @property
    def point(self) -> Int[np.ndarray, " rays"]:
        """Which point each ray sees."""
        return self.fixed["point"]

    @property
    def role(self) -> np.ndarray:
        """What each point is."""
        return self.fixed["role"]

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points; or none."""
        return self.labels["points"]

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the images, one for each ray; or none."""
        return self.labels["images"]

    @property
    def strips(self) -> tuple[str, ...]:
        """Names of the strips, by number; or none."""
        return self.labels["strips"]

    def _require(self, fine: Any, message: str) -> None:
        if not fine.all():
            raise WhiskjaxError(f"{self.ray_label(int(np.argmin(fine)))}: {message}")

    def __len__(self) -> int:
        return len(self.point)

    def key(self, name: str) -> Any:
        """A key, or the time, of every ray; None where it is not recorded."""
        value = self.time_s if name == "time_s" else self.fixed[name]
        return value if value is None else arrays_of(value).broadcast_to(value, (len(self),))

    @property
    def seen(self) -> Bool[np.ndarray, " points"]:
        """Points that some ray sees."""
        return np.bincount(self.point, minlength=len(self.role)) > 0

    def information(self) -> Float[Any, "points 3 3"]:
        """Inverse covariance of the control points, zero for others; a sigma below a micrometre counts as one."""
        known = np.flatnonzero(self.role == "control")
        if is_traced(self.covariance_m2):
            inverse = _inverse(self.covariance_m2[known], _EXACT)
            return jnp.zeros((len(self.role), 3, 3)).at[known].set(inverse)
        inverse = np.zeros((len(self.role), 3, 3))
        values, vectors = np.linalg.eigh(self.covariance_m2[known])
        inverse[known] = (vectors / np.maximum(values, _EXACT)[:, None, :]) @ vectors.swapaxes(1, 2)
        return inverse

    def shots(self, index: Any = slice(None), held: Callable[[Any], Any] = lambda a: a) -> Shot:
        """The shots of rays, by index of any shape. **Arguments:** `held`: applied to each array."""
        picked: dict[str, Any] = {}
        for name in ("time_s", *KEYS):
            if (value := self.key(name)) is not None:
                picked[name] = held(value[index])
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
        time_s, keys = self.key("time_s"), {name: self.key(name) for name in KEYS}
        return dataclasses.replace(
            self,
            pixel_px=self.pixel_px[index],
            sigma_px=self.sigma_px[index],
            time_s=None if time_s is None else time_s[index],
            fixed=self.fixed.changed(point=self.point[index], **{k: v if v is None else v[index] for k, v in keys.items()}),
            images=images,
        )


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def _inverse(covariance: Float[Array, "n 3 3"], least: float) -> Float[Array, "n 3 3"]:
    """The inverse, with variances below the floor taken as `least`; where that is zero, without their directions.

    The rule needs no derivative of eigenvectors, which equal variances do not have, and holds to every order: d(C^-1) =
    -C^-1 dC C^-1. What is exactly known stays so.
    """
    values, vectors = jnp.linalg.eigh(covariance)
    exact = values < _EXACT
    weight = jnp.where(exact, 1 / least if least else 0.0, 1 / jnp.where(exact, 1.0, values))
    return (vectors * weight[:, None, :]) @ jnp.swapaxes(vectors, 1, 2)


@_inverse.defjvp
def _inverse_jvp(least, primals, tangents):
    (covariance,), (change,) = primals, tangents
    known = _inverse(covariance, 0.0)
    return _inverse(covariance, least), -known @ change @ known

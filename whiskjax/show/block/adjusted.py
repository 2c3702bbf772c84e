"""One adjusted block: what every table and figure is made from."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...chain.imaging import ray
from ...estimate.block.adjustment import Adjustment
from ...estimate.block.block import ROLES, Block
from ...estimate.block.direct import Direct
from ...estimate.map_limits import Standard
from ...flights.flight import Flight
from ..scales import Scales, axes_of, scales_of


class Course(NamedTuple):
    """Motions at stations: turns (rad) and shifts (m), their 1-sigmas, all (stations, 6); times where stations have them.

    `segments`: what people call consecutive stations (a strip), and how many there are.
    """

    value: Float[np.ndarray, "stations 6"]
    sigma: Float[np.ndarray, "stations 6"]
    time_s: Float[np.ndarray, " stations"] | None
    segments: Sequence[tuple[str, int]]


@dataclasses.dataclass(frozen=True)
class Adjusted:
    """An adjusted flight.

    **Arguments:**

    - `adjustment`: made from `flight.block()`.
    - `direct`: direct positioning before and after, where it was asked for.
    - `standard`: what the check points are held against.
    """

    flight: Flight
    adjustment: Adjustment
    direct: tuple[Direct, Direct] | None = None
    standard: Standard | None = None

    @property
    def block(self) -> Block:
        """The block with the sigmas that were used."""
        return self.adjustment.block

    @property
    def roles(self) -> list[str]:
        """The roles that there are."""
        return [role for role in ROLES if (self.block.role == role).any()]

    @cached_property
    def role(self) -> np.ndarray:
        """The role of the point of each ray."""
        return self.block.role[self.block.point]

    @cached_property
    def wrong(self) -> Bool[np.ndarray, " rays"]:
        """Rays that were left out as wrong; not those that alone see their point."""
        names = np.asarray([self.block.point_name(i) for i in range(len(self.block.role))])
        return ~self.adjustment.used & ~np.isin(names, self.adjustment.left_out)[self.block.point]

    @property
    def axes(self) -> tuple[str, str]:
        """What the two axes of a residual are called."""
        return axes_of(self.flight.is_line)

    @property
    def place(self) -> Float[np.ndarray, "rays 2"]:
        """Where each ray was measured: sample (px) and line (a count), or column and row (px)."""
        m = self.flight.measurements
        return np.stack([m.sample_px, m.line_px], axis=-1)

    @cached_property
    def normalised(self) -> Float[np.ndarray, "rays 2"]:
        """Residuals in sigmas."""
        return self.adjustment.residual_px / self.block.sigma_px

    @cached_property
    def scales(self) -> Scales:
        """How large pixels are where the rays see the adjusted points; NaN where there is none."""
        block, every = self.block, np.arange(len(self.block))
        return scales_of(self.flight, self.adjustment.sensor, block.shots(), self.adjustment.point_m[block.point], every)

    @cached_property
    def views(self) -> list[tuple[str, Bool[np.ndarray, " rays"]]]:
        """The rays of each view; all together where images have none."""
        names = [image.view for image in self.flight.images]
        if None in names:
            return [("all images", np.ones(len(self.block), dtype=bool))]
        of_ray = np.array(names)[self.flight.measurements.image]
        return [(str(name), of_ray == name) for name in dict.fromkeys(names)]

    @cached_property
    def world_from_enu(self) -> Float[np.ndarray, "points 3 3"]:
        """East, north and up at every adjusted point."""
        return self.flight.world.from_enu(self.adjustment.point_m)

    @cached_property
    def covariance_enu_m2(self) -> Float[np.ndarray, "points 3 3"]:
        """Covariance of every adjusted point."""
        return np.einsum("nji,njk,nkl->nil", self.world_from_enu, self.adjustment.covariance_m2, self.world_from_enu)

    @cached_property
    def sigma_enu_m(self) -> Float[np.ndarray, "points 3"]:
        """1-sigma of every adjusted point, NaN where there is none."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance_enu_m2, axis1=1, axis2=2), 0.0))

    @cached_property
    def error_enu_m(self) -> Float[np.ndarray, "points 3"]:
        """Adjusted less given coordinates, NaN for tie points."""
        given = np.where((self.block.role != "tie")[:, None], self.block.position_m, np.nan)
        return np.einsum("nji,nj->ni", self.world_from_enu, self.adjustment.point_m - given)

    def direct_error_enu_m(self, direct: Direct) -> Float[np.ndarray, "n 3"]:
        """Direct less given coordinates of control and check points, strip by strip."""
        known = np.isfinite(direct.error_m).all(axis=1)
        return np.einsum("nji,nj->ni", self.world_from_enu[direct.point[known]], direct.error_m[known])

    @cached_property
    def plan_m(self) -> Float[np.ndarray, "points 2"]:
        """East and north of every adjusted point: of the local world, or from the middle of the block."""
        return self.flight.world.plan_m(self.adjustment.point_m)

    @cached_property
    def ground_m(self) -> Float[np.ndarray, "rays 2"]:
        """Residuals on the ground, east and north: where each measured ray passes the height of its point, less the point."""
        block = self.block
        sight = ray(self.adjustment.sensor, block.shot, jnp.asarray(block.pixel_px), throw=False)
        point, axes = self.adjustment.point_m[block.point], self.world_from_enu[block.point]
        away = np.einsum("nji,nj->ni", axes, np.asarray(sight.origin_m) - point)
        direction = np.einsum("nji,nj->ni", axes, np.asarray(sight.direction))
        return away[:, :2] - direction[:, :2] * (away[:, 2] / direction[:, 2])[:, None]

    @cached_property
    def course(self) -> Course | None:
        """The estimated motions of the trajectory; None where it was kept."""
        errors = self.adjustment.motions
        if errors is None:
            return None
        link = errors.stations(self.adjustment.sensor)
        turn, shift = (np.zeros((link.stations, 3)) if of is None else np.asarray(of) for of in link.motions)
        value, sigma = np.concatenate([turn, shift], axis=1), self.adjustment.trust.stations
        if link.node_s is None:
            return Course(value, sigma, None, [("all stations", link.stations)])
        parts = np.split(link.node_s, np.cumsum(link.segments)[:-1])
        return Course(value, sigma, link.node_s, [(self._called(i, part), len(part)) for i, part in enumerate(parts)])

    def _called(self, number: int, time_s: np.ndarray) -> str:
        """The strip whose rays lie within some stations; where there is not one strip, the number of the segment."""
        time, strip = self.block.key("time_s"), self.block.key("strip")
        if time is not None and strip is not None:
            here = np.unique(strip[(time >= time_s[0]) & (time <= time_s[-1])])
            if len(here) == 1:
                return str(self.flight.strips[int(here[0])])
        return f"segment {number}"

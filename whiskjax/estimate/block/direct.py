"""Direct positioning: points from the rays of single strips, with the sensor as it is and no adjustment."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...chain.sensor import Sensor
from ...rules import WhiskjaxError, need, need_flags
from ...rules.results import codes_of
from ..intersection import intersect
from .adjustment import Statistics
from .block import Block


@dataclasses.dataclass(frozen=True)
class Direct:
    """Intersections, one for each point and strip that sees it from two views or more.

    - `point`, `strip`: indices, (n,); `position_m`: where the rays meet, (n, 3); `error_m`: less the given coordinates, (n, 3),
      NaN for tie points.
    - `alone`: pairs of point and strip with one ray, `lost`: with rays that do not meet; neither is in the lists.
    """

    point: Int[np.ndarray, " n"]
    strip: Int[np.ndarray, " n"]
    position_m: Float[np.ndarray, "n 3"]
    error_m: Float[np.ndarray, "n 3"]
    alone: int
    lost: int

    def statistics(self) -> tuple[Statistics, Statistics, Statistics]:
        """Of the errors of control and check points along x, y and z (Wang et al. 2018, Tables 1, 2 and 4)."""
        known = np.isfinite(self.error_m).all(axis=1)
        x, y, z = (Statistics.of(e) for e in self.error_m[known].T)
        return x, y, z


def direct_positioning(sensor: Sensor, block: Block, *, ties: bool = False) -> Direct:
    """Intersect the rays of every point strip by strip (Wang et al. 2018, section 5: direct positioning).

    **Arguments:** `ties`: intersect tie points too.

    **Raises:** `WhiskjaxError` where the rays carry no strip.
    """
    need("direct_positioning", "sensor", sensor, Sensor)
    need("direct_positioning", "block", block, Block)
    need_flags("direct_positioning", ties=ties)
    strip = block.key("strip")
    if strip is None:
        raise WhiskjaxError("direct positioning goes strip by strip, but the rays of the block carry no strip")
    rays = np.flatnonzero((block.role[block.point] != "tie") | ties)
    pair = np.stack([block.point[rays], strip[rays]], axis=-1)
    pairs, index, count = np.unique(pair, axis=0, return_inverse=True, return_counts=True)
    index = index.ravel()
    enough = count >= 2
    kept = enough[index]
    if not kept.any():
        raise WhiskjaxError(
            f"no {'point' if ties else 'control or check point'} is seen twice from one strip: there is nothing to intersect"
        )
    some = block.keep(rays[kept])
    number = np.cumsum(enough) - 1
    sigma = jnp.asarray(some.sigma_px)
    met = intersect(sensor, some.shot, jnp.asarray(some.pixel_px), number[index[kept]], sigma, throw=False)
    fine = codes_of(met.result) == 0
    point, which = pairs[enough][fine].T
    position = np.asarray(met.point_m)[fine]
    given = np.where((block.role != "tie")[:, None], block.position_m, np.nan)
    return Direct(point, which, position, position - given[point], int((~enough).sum()), int((~fine).sum()))

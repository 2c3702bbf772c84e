"""What a block adjustment found."""

import dataclasses
from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ...chain.detector import lies_beside
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...earth.surface import AbstractSurface
from ...rules import RESULTS, arrays_of, plain
from ...rules.results import codes_of
from ..check_points import CheckTest
from ..checks import CHECKS
from ..errors import FrameErrors
from ..estimate import Estimate
from ..evidence import Evidence, Held, Seen, Words, courses, groupings, kinks, numbered, records
from ..far_turns import far_turns
from ..model_test import consistency
from ..reason import Reason, by_weight, is_sound, judged, warnings
from ..suspects import Suspects, suspects
from ..unknown import Unknown
from ..variance_components import Components
from .block import Block
from .check import checked
from .checks import BLOCK_CHECKS, Rays
from .connect import seen_once
from .fitted import BlockFitted
from .orientation import ExteriorOrientation, exterior_orientation
from .prepare import Prepared
from .solve import Solved
from .station_errors import StationErrors, at_stations
from .weakness import data_rows
from .weights import NAMES, groups_of

_TAKEN_APART = 4000  # motions and unknowns
_MOST = 0.5  # of the rays, that may be left out as wrong
_WORDS = Words(
    how="the iteration converged",
    noun="rays",
    observed="ray",
    residuals="residuals",
    outliers="rays are wrong and were left out",
    remedy="look for wrong tie points, or let the weights be estimated",
    hint="is the block mirrored? start nearer",
)


class Trust(NamedTuple):
    """Second moments of the unknowns in the units of their fields, and 1-sigma of the stations' motions (turn rad, shift m).

    `data_share` is 1 - sigma_post^2 / sigma_prior^2 (NaN without a prior).
    """

    covariance: Float[Any, "q q"]
    sigma: Float[Any, " q"]
    stations: Float[Any, "stations 6"]
    data_share: Float[Any, " q"]


class Statistics(NamedTuple):
    """Of one axis: max, min, mean and root mean square, as Wang et al. (2018) tabulate them."""

    largest: float
    smallest: float
    mean: float
    rmse: float
    count: int

    @classmethod
    def of(cls, errors: Float[np.ndarray, " n"]) -> "Statistics":
        """Of errors (n,); NaN where there is none."""
        if len(errors) == 0:
            return cls(np.nan, np.nan, np.nan, np.nan, 0)
        e = np.asarray(errors)
        return cls(float(e.max()), float(e.min()), float(e.mean()), float(np.sqrt((e**2).mean())), len(e))


class Adjustment(eqx.Module):
    """A solved block; residual = measured - projected, in pixels.

    - `sensor`: with the solution put in; `value`, `start`: of the unknowns, in the units of their fields; `estimate`: they
      with their joint covariance, points and motions integrated out: knowledge for the next verb.
    - `errors`: the statements by which the trajectory was weighed; `motions`: what they say of the link whose motions were
      estimated, None where it was kept.
    - `point_m`, `covariance_m2`: every point, world frame; NaN for points that nobody sees.
    - `used`: rays that took part; `components`: factors on the given sigmas, where weights were estimated (`block` has the new).
    - `residual_px`: (sample or column, line offset or row) of every ray.
    - `cost`: the sum of squared whitened residuals, POS and priors included; `variance_factor` divides it by `freedom`.
    - `check`: the check points' coordinates beside those that came out; `left_out`: check and tie points, by name, that one ray
      alone sees: it takes no part and has no residual (NaN).

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    Under jit, vmap and derivatives `sensor`, `estimate`, points, residuals and covariances are traced; what is told to people
    (`variance_factor`, `check`, `warnings`, `is_sound`) is worked out when somebody looks at it, outside.
    """

    sensor: Sensor
    estimate: Estimate
    unknowns: tuple[Unknown, ...]
    start: Float[Any, " q"]
    block: Block
    errors: tuple[FrameErrors, ...]
    point_m: Float[Any, "points 3"]
    covariance_m2: Float[Any, "points 3 3"]
    residual_px: Float[Any, "rays 2"]
    used: Bool[Any, " rays"]
    components: Components | None
    steps: Any
    _prepared: Prepared
    _solved: Solved
    _inverse: Float[Any, "m m"]
    _spread: Float[Any, "m m"]  # the same, knowing how well the weights are known
    _code: Int[Any, " rays"]

    @property
    def value(self) -> Float[Any, " q"]:
        """Of the unknowns."""
        return self.estimate.value

    @property
    def result(self) -> RESULTS:
        """How the solution ended."""
        return self.estimate.result

    @property
    def cost(self) -> Any:
        """The sum of squared whitened residuals."""
        return self.estimate.cost

    @property
    def freedom(self) -> Any:
        """Observations and priors less what was estimated."""
        return self.estimate.freedom

    @property
    def is_determined(self) -> bool:
        """Whether the equations determine everything."""
        return bool(np.isfinite(np.asarray(self._inverse)).all())

    @cached_property
    def trust(self) -> Trust:
        """Second moments in the units of the fields."""
        x, sigma = self._solved.state.x, plain(self._prepared.ready.unknowns.sigma)
        math = arrays_of((self._spread, sigma))
        stations = math.sqrt(self._spread.diagonal()[: x.size]).reshape(x.shape) * sigma[:, None]
        return Trust(self.estimate.covariance, self.estimate.sigma, stations.T, 1 - self.estimate.prior_share)

    @cached_property
    def motions(self) -> StationErrors | None:
        """What the statements of errors say of the link whose motions were estimated; None where it was kept."""
        ready = self._prepared.ready
        found = at_stations("adjust", self.errors, ready.sensor, self.block)
        return None if found is None else dataclasses.replace(found, sigma=np.asarray(ready.unknowns.sigma))

    @cached_property
    def _consistency(self) -> tuple[float, float, bool]:
        factor, tail, sound = consistency(self.cost, self.freedom)
        return float(factor), float(tail), bool(sound)

    @property
    def variance_factor(self) -> float:
        """`cost` over `freedom`."""
        return self._consistency[0]

    @property
    def tail_probability(self) -> float:
        """Of a larger variance factor by chance."""
        return self._consistency[1]

    @property
    def is_consistent(self) -> bool:
        """Whether residuals are no larger than chance explains."""
        return self._consistency[2]

    @cached_property
    def check(self) -> CheckTest:
        """The check points' coordinates beside those that came out."""
        points = np.asarray(self.point_m), np.asarray(self.covariance_m2)
        return checked(self._prepared, np.asarray(self.used), *points, self._information, lambda: self._fitted)

    @property
    def _information(self) -> Float[np.ndarray, "m m"]:
        """On motions and unknowns, points integrated out; as far as weights are known."""
        return np.asarray(self._solved.reduced.matrix) if self.components is None else np.linalg.inv(np.asarray(self._spread))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Check and tie points, by name, that one ray alone sees."""
        return tuple(self.block.point_name(int(i)) for i in np.flatnonzero(seen_once(self.block)))

    @property
    def evidence(self) -> Evidence:
        """What the checks of the verdict see; under tracing without check points."""
        traced = arrays_of(self.estimate.covariance) is jnp
        at = self if traced else jax.tree.map(lambda a: np.asarray(a) if isinstance(a, jax.Array) else a, self)
        block, others = at.block, at._prepared.ready.unknowns.others
        math = arrays_of((at.estimate, at.used))
        candidate = ~seen_once(block)[block.point]
        names = block.images or tuple(map(str, block.key("image") if block.key("image") is not None else ("",) * len(block)))
        factor, tail, _ = consistency(at.cost, at.freedom)
        matrix = at._solved.reduced.matrix
        is_finite = traced or bool(np.isfinite(matrix).all())
        measured = Seen(
            candidate=candidate,
            used=at.used,
            outlying=candidate & ~at.used,
            code=at._code,
            beside=lies_beside(self.sensor, block.shots(), block.pixel_px) & at.used,
            record=records(block.shots(), block.pixel_px, block.sigma_px),
            image=numbered(names),
            most=_MOST,
            label=block.ray_label,
            images=tuple(sorted(set(names))),
            groups=() if traced else groupings(self.sensor, block.key, block.images, block.strips),
            along={} if traced else courses(self.sensor, block.shots(), block.pixel_px),
        )
        return Evidence(
            estimate=at.estimate,
            estimated=np.ones(len(at.unknowns), dtype=bool),
            shift=math.where(math.asarray(others.has_prior), at._solved.state.u, math.nan),
            scale=plain(others.scale),
            rows=data_rows(matrix, at._solved.state.x.size, others.information) if is_finite else None,
            variance_factor=factor,
            freedom=at.freedom,
            tail=tail,
            kinks=kinks(self.sensor, at.estimate),
            turned=() if traced else far_turns(self.sensor, at.estimate, np.asarray(at.start)),
            words=_WORDS,
            check=None if traced or int(codes_of(self.result)) else self.check,
            components=at.components,
            seen=measured,
            held=() if traced or int(codes_of(self.result)) else self._held,
            suspects=None if traced or int(codes_of(self.result)) else self._suspects,
            fit=None if traced or int(codes_of(self.result)) else self._fitted,
        )

    @cached_property
    def _suspects(self) -> Suspects:
        """What was taken as known."""
        point = np.asarray(self.point_m)
        point = np.where(np.isfinite(point), point, point[np.isfinite(point).all(axis=1)][0])
        block, known = self.block, self.estimate.places
        given = (block.role == "control")[block.point]
        return suspects(self.sensor, block.shots(), point[block.point], block.pixel_px, known, given, self.motions is not None)

    @cached_property
    def _held(self) -> tuple[Held, ...]:
        """Rays, surveyed points and POS: how large their errors are, and how much of them the others control.

        The reduced matrix is taken apart for it: of thousands of stations it is too large.
        """
        if self._solved.reduced.right.size > _TAKEN_APART:
            return ()
        found = groups_of(self._prepared, self._solved, np.asarray(self.used))
        return tuple(Held(*one) for one in zip(NAMES, found.squares.tolist(), found.redundancy.tolist(), strict=True))

    @cached_property
    def _fitted(self) -> BlockFitted:
        """The residuals of rays that took part, beside points, motions and unknowns."""
        return BlockFitted(self._prepared, self._solved.state, np.asarray(self.used), np.asarray(self._inverse))

    @cached_property
    def reasons(self) -> tuple[Reason, ...]:
        """What speaks for and against the block, failures first."""
        rests = "the priors" if self.motions is None else "POS" if self.motions.observed else "nothing"
        rays = Rays(self.block, np.asarray(self.used), rests, self.left_out)
        return by_weight([*judged(CHECKS, self.evidence), *judged(BLOCK_CHECKS, rays)])

    @property
    def is_sound(self) -> bool:
        """Whether nothing fails it: it converged, everything is determined, residuals and check points are no farther off than
        chance explains, few rays were left out, and no sigma is stretched beyond reason."""
        return is_sound(self.reasons)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a careful person would say, the most serious first."""
        return warnings(self.reasons)

    def exterior_orientation(self, shot: Shot | None = None, *, surface: AbstractSurface | None = None) -> ExteriorOrientation:
        """Projection centre and POS reference point: position and attitude, with their 6x6 covariance in level axes there.

        **Arguments:**

        - `shot`: exposures, fields of the shape (n,); by default every station: each image of poses per image, each node in time,
          with the keys of the ray that is nearest to it in time.
        - `surface`: what is level: the ellipsoid by default; `Plane((0, 0, 0), (0, 0, 1))` in a local world.

        **Raises:** `WhiskjaxError` where there are no stations and no shot is given, or nobody knows what is up.
        """
        return exterior_orientation(self._prepared, self._solved.state, self._spread, shot, surface)

    def errors_m(self, role: str) -> Float[np.ndarray, "n 3"]:
        """Adjusted less given coordinates of the seen points of a role with known coordinates ("check", "control")."""
        error = (self.point_m - self.block.position_m)[self.block.role == role]
        return error[np.isfinite(error).all(axis=1)]

    def statistics(self, role: str = "check") -> tuple[Statistics, Statistics, Statistics]:
        """Of `errors_m` along x, y and z."""
        x, y, z = (Statistics.of(e) for e in self.errors_m(role).T)
        return x, y, z

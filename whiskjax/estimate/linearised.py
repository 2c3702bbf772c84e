"""One least-squares adjustment: prepare, solve, linearise, refine.

What the data say near a solution is small: whitened residuals and their derivatives, a few hundred rows. They are evaluated by
compiled functions of fixed shape and judged in numpy, so that leaving observations out, weighing them anew or asking another
question compiles nothing. While tracing, the same steps are traced.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..algebra.vectors import Vec2, Vec3, unstack
from ..chain.extremes import refuse_extremes
from ..chain.imaging import into_camera
from ..chain.joints import joint_derivatives
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface
from ..rules import RESULTS, SensorError, arrays_of, compiled, first_failure, once, plain
from ..rules.results import message_of
from .columns import columns
from .error_effects import white_covariance_px2
from .errors import FrameErrors
from .given import Knowledge
from .losses import AbstractLoss
from .observations import Observations
from .problem import Group, Layout, Problem, by_observation, pose_problem, weigh
from .solution import levenberg_marquardt, solution
from .surveys import Joint, Shared, Surveys, common_surveys, point_part, triangles

_ROUNDING = 1e-11  # of a prior sigma or scale: below it a step is rounding


class LeastSquares(eqx.Module):
    """A problem ready to be solved again and again with other weights.

    `sensor` has room for the unknowns; `problem` is baked and carries the weights of all observations, check points too. `weight`
    (n, 3) is the lower triangle that whitens each residual by itself, `follows` (n, 2, 3) the derivative of the pixel by the
    ground point, `fixed_px2` the part of each measurement's covariance that comes from the point's coordinates and errors of
    recorded poses, `prior` (k, k) the root of the priors' information: their whitened residuals are prior @ u, zero rows without
    a prior. `surveys` are the points that several rays see, whose errors those rays share.
    """

    sensor: Sensor
    problem: Problem
    indices: list[np.ndarray]
    observations: Observations
    start: Float[np.ndarray, " k"]
    follows: Float[np.ndarray, "n 2 3"]
    fixed_px2: Float[np.ndarray, "n 2 2"]
    weight: Float[np.ndarray, "n 3"]
    prior: Float[np.ndarray, "k k"]
    before_px: Float[np.ndarray, "n 2"]
    unseen: Int[np.ndarray, " n"]
    surveys: Surveys | None = None

    @property
    def scale(self) -> Float[np.ndarray, " k"]:
        """What one whitened unit is, in the units of the fields."""
        return plain(self.problem.unknowns.scale)

    @property
    def has_prior(self) -> Bool[np.ndarray, " k"]:
        """Which unknowns have a prior."""
        return (self.prior != 0).any(axis=1)

    def values(self, u: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Unknowns in the units of their fields."""
        return plain(self.problem.unknowns.mean) + self.scale * u

    def weighted(self, weight: Float[np.ndarray, "n 3"], prior: Float[np.ndarray, "k k"] | None = None) -> "LeastSquares":
        """The same with other weights of the measurements, and another root of the priors."""
        prior = self.prior if prior is None else prior
        problem = weigh(self.problem, weight, self.indices)
        problem = dataclasses.replace(problem, unknowns=dataclasses.replace(problem.unknowns, root=jnp.asarray(prior)))
        return dataclasses.replace(self, problem=problem, weight=weight, prior=prior)

    def joint(self, share: Float[Any, " n"]) -> Joint:
        """What rays of one point have in common, where each takes part by its `share`."""
        assert self.surveys is not None
        return self.surveys.joint(whitening(self.observations.sigma_px, self.surveys.alone_px2), share)

    def deciding(self, used: Bool[Any, " n"]) -> Problem:
        """The problem of the used observations alone, rays of one point weighed together."""
        if self.surveys is None or not self.surveys.are_shared_by(used):
            weight = arrays_of((self.weight, used)).where(used[:, None], self.weight, 0.0)
            return weigh(self.problem, weight, self.indices)
        joint = self.joint(used.astype(float))
        math = arrays_of((joint, used))
        joint = joint._replace(by=math.where(used[:, None, None], joint.by, 0.0))
        problem = weigh(self.problem, math.where(used[:, None], joint.weight, 0.0), self.indices)
        shared = Shared.of_groups(joint, self.indices, [len(group.pixel[0]) for group in problem.groups])
        return dataclasses.replace(problem, shared=shared)

    def drawn_anew(self, pixel_px: Float[Any, "n 2"]) -> "LeastSquares":
        """The same with other measurements, traced."""
        padded = [
            index[np.minimum(np.arange(len(g.pixel[0])), len(index) - 1)]
            for g, index in zip(self.problem.groups, self.indices, strict=True)
        ]
        pixels = [(pixel_px[i, 0], pixel_px[i, 1]) for i in padded]
        problem = eqx.tree_at(lambda p: [group.pixel for group in p.groups], self.problem, pixels)
        return dataclasses.replace(self, problem=problem, before_px=self.before_px + pixel_px - self.observations.pixel_px)

    def reweighed(self, observed: Float[np.ndarray, "n 2"], prior: Float[np.ndarray, " k"]) -> "LeastSquares":
        """The same with factors on the sigmas of the measurements and of the priors."""
        observations = dataclasses.replace(self.observations, sigma_px=self.observations.sigma_px * observed)
        weight = whitening(observations.sigma_px, self.fixed_px2)
        return dataclasses.replace(self.weighted(weight, self.prior / prior), observations=observations)


class Linearised(NamedTuple):
    """The observations, linearised at whitened unknowns u: whitened + rows du, and in pixels residual_px + rows_px du."""

    u: Float[np.ndarray, " k"]
    residual_px: Float[np.ndarray, "n 2"]
    whitened: Float[np.ndarray, "n 2"]
    rows: Float[np.ndarray, "n 2 k"]
    rows_px: Float[np.ndarray, "n 2 k"]
    unseen: Int[np.ndarray, " n"]

    @property
    def squared(self) -> Float[np.ndarray, " n"]:
        """Squared length of each whitened residual."""
        return (self.whitened**2).sum(axis=1)

    def moved(self, step: Float[np.ndarray, " k"]) -> "Linearised":
        """The linear model at u + step, with the same derivatives."""
        return self._replace(
            u=self.u + step,
            residual_px=self.residual_px + self.rows_px @ step,
            whitened=self.whitened + self.rows @ step,
        )


def prepare(
    sensor: Sensor,
    observations: Observations,
    unknowns: Knowledge,
    loss: AbstractLoss | None,
    layout: Layout | None = None,
    errors: Sequence[FrameErrors] = (),
    surface: AbstractSurface | None = None,
) -> LeastSquares:
    """Pose, bake and weigh a problem; the sigmas of the points are carried into the image at the start values.

    **Raises:** `WhiskjaxError` for unknowns or keys that make no sense.
    """
    refuse_extremes(sensor, "calibrate")
    layout = layout or Layout.of(sensor, observations, split=False)
    problem, start, indices = pose_problem(sensor, observations, unknowns, loss, layout=layout)
    baked, linked = _fenced(_baked, problem, jnp.asarray(start))
    before, follows, seen = _fenced(_begun, baked, jnp.asarray(start))
    n = len(observations)
    before, linked, unseen = (by_observation(part, indices, n) for part in (_stacked(before), linked, seen))
    follows = by_observation(_stacked(follows), indices, n).reshape(n, 2, 3)
    unseen = arrays_of(linked).where(linked != 0, linked, unseen)
    fixed, surveys = np.zeros((n, 2, 2)), None
    if errors:
        fixed = fixed + plain(white_covariance_px2(errors, sensor, observations.shot, unstack(observations.point_m), surface))
    if (covariance := observations.point_covariance_m2) is not None:
        point = observations.point if layout.point is None else np.frombuffer(layout.point, dtype=np.int32)
        surveys = common_surveys(point, covariance, follows, fixed)
        fixed = fixed + point_part(follows, covariance)
    weight = whitening(observations.sigma_px, fixed)
    prior = plain(problem.unknowns.root)
    weighed = weigh(baked, weight, indices)
    return LeastSquares(
        problem.sensor, weighed, indices, observations, start, follows, fixed, weight, prior, before, unseen, surveys
    )


def solve(ready: LeastSquares, used: Bool[np.ndarray, " n"], max_steps: int) -> tuple[Any, Any, RESULTS]:
    """Whitened solution of the used observations by Levenberg-Marquardt, its steps and result.

    Under a robust loss it goes on from the least-squares solution, where few points are far off. Traced, it is differentiable.
    """
    problem, start = ready.deciding(used), jnp.asarray(ready.start)
    if arrays_of((problem, start)) is jnp:
        solved = solution(problem, start, max_steps)
        return solved.u, solved.steps, solved.result
    solved = levenberg_marquardt(problem, start, max_steps)
    return np.asarray(solved.u), int(solved.steps), solved.result


def linearise(ready: LeastSquares, u: Float[np.ndarray, " k"]) -> Linearised:
    """Residuals and derivatives of all observations at whitened unknowns."""
    n = len(ready.observations)
    whitened, rows, unseen = _fenced(_evaluated, ready.problem, jnp.asarray(u))
    whitened, rows, unseen = (by_observation(part, ready.indices, n) for part in (_stacked(whitened), _stacked(rows), unseen))
    math = arrays_of((whitened, ready.weight))
    w00, w10, w11 = ready.weight.T

    def in_pixels(x: Any, y: Any) -> Any:
        x = x / w00[:, None]
        return math.stack([x, (y - w10[:, None] * x) / w11[:, None]], axis=1)

    residual_px = in_pixels(whitened[:, 0, None], whitened[:, 1, None])[..., 0]
    return Linearised(plain(u), residual_px, whitened, rows, in_pixels(rows[:, 0], rows[:, 1]), unseen)


def _fenced(of: Any, problem: Problem, u: Array) -> Any:
    """A compiled function's answer; while tracing, a part of the whole that is evaluated once."""
    if arrays_of((problem, u)) is np:
        return of(problem, u)
    return once(lambda: of(problem, u))


def refine(
    ready: LeastSquares, here: Linearised, share: Float[np.ndarray, " n"], steps: int, near: float = np.inf, frozen: bool = False
) -> Linearised:
    """Gauss-Newton steps to the minimum of the observations weighted by `share` and the priors.

    Each step is an orthogonal decomposition of the weighted rows.

    **Arguments:** `steps`: at most so many, and none that is longer than `near` (of a prior sigma or scale); `frozen`: keep the
    derivatives of `here`, which costs no evaluation of the chain.
    """
    for _ in range(steps):
        step = -np.linalg.lstsq(*weighted_rows(ready, here, share), rcond=None)[0]
        if not np.abs(step).max() < near:
            break
        settled = np.abs(step).max() < _ROUNDING
        here = here.moved(step) if frozen or settled else linearise(ready, here.u + step)
        if settled:
            break
    return here


def independent(ready: LeastSquares, here: Linearised, share: Float[Any, " n"]) -> Linearised:
    """The same with residuals and derivatives of rays of one point weighed together, of those rays that have a share.

    Others are whitened each by itself, as all are where no point is seen twice.
    """
    if ready.surveys is None:
        return here
    joint, kept = ready.joint(share), share > 0
    math = arrays_of((joint, here))
    alone, whole = triangles(joint.weight), triangles(ready.weight)

    def of(px: Any) -> Any:
        flat = px.reshape(len(px), 2, -1)
        return math.where(kept[:, None, None], joint.independent(alone @ flat), whole @ flat).reshape(px.shape)

    return here._replace(whitened=of(here.residual_px), rows=of(here.rows_px))


def weighted_rows(ready: LeastSquares, here: Linearised, share: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (rows, k) and residuals (rows,) of the observations that have a share, and of the priors.

    A robust loss shares out residuals that no survey error correlates any more. Else a share is one of the measurement: what rays
    of one point together say of its survey is less with it.
    """
    kept, root = share > 0, ready.prior[ready.has_prior]
    here = independent(ready, here, share if ready.problem.loss is None else kept.astype(float))
    pull = np.sqrt(share[kept])[:, None]
    rows = (pull[:, :, None] * here.rows[kept]).reshape(-1, len(here.u))
    right = (pull * here.whitened[kept]).ravel()
    return np.concatenate([rows, root]), np.concatenate([right, root @ here.u])


def refuse(codes: Int[np.ndarray, " n"], observations: Observations) -> None:
    """**Raises:** `SensorError` naming the first observation that the sensor cannot have made, and how many there are."""
    if codes.any():
        raise SensorError(impossible(codes, observations))


def impossible(codes: Int[np.ndarray, " n"], observations: Observations) -> str:
    """Names the first observation that the sensor cannot have made, and how many there are; at least one."""
    i, count = int(np.argmax(codes != 0)), int((codes != 0).sum())
    more = f" ({count} of {len(codes)} observations fail)" if count > 1 else ""
    return f"{observations.label(i)}: {message_of(int(codes[i]))}{more}"


def whitening(sigma_px: Float[np.ndarray, "n 2"], fixed_px2: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 3"]:
    """Lower triangle (w00, w10, w11) of the inverse Cholesky factor of each observation's covariance.

    **Arguments:** `fixed_px2`: what comes to the measurement's own: the point's coordinates, carried into the image, say.
    """
    math = arrays_of((sigma_px, fixed_px2))
    c00, c11 = sigma_px[:, 0] ** 2 + fixed_px2[:, 0, 0], sigma_px[:, 1] ** 2 + fixed_px2[:, 1, 1]
    l00 = math.sqrt(c00)
    l10 = fixed_px2[:, 0, 1] / l00
    l11 = math.sqrt(c11 - l10**2)
    return math.stack([1 / l00, -l10 / (l00 * l11), 1 / l11], axis=-1)


def pixels(problem: Problem, group: Group, u: Array) -> tuple[Vec2, Array]:
    """Residuals (x, y) of a group in pixels, (n,) each, and the codes of observations that cannot have been made (n,)."""
    sensor = problem.put(u)
    q = into_camera(sensor, group.shot, group.point)
    x, y = sensor.camera_at(group.shot).pixel(q)
    return (group.pixel[0] - x, group.pixel[1] - y), _codes(sensor, group, q)


def _codes(sensor: Sensor, group: Group, inside: Vec3) -> Array:
    """Of observations that the sensor cannot have made of points in the camera frame, (n,)."""
    result = first_failure(sensor.check(group.shot), sensor.camera_at(group.shot).check_direction(inside))
    return jax.tree.leaves(result)[0] + jnp.zeros(group.pixel[0].shape, dtype=jnp.int32)


def _stacked(groups: list[tuple[Array, ...]]) -> list[Any]:
    """Arrays that belong together, stacked on the host: in a compiled function XLA would repeat what they are made of."""
    return [arrays_of(arrays).stack(arrays) for arrays in groups]


def _bake(problem: Problem, start: Array):
    """The baked problem, and for each group the failures of its links: a baked pose does not know its time any more."""
    codes = []
    for group in problem.groups:
        linked = jax.tree.leaves(problem.put(start).check(group.shot))[0]
        codes.append(linked + jnp.zeros(group.point[0].shape, dtype=jnp.int32))
    return problem.baked(), codes


def _begin(problem: Problem, start: Array):
    """For each group residuals in pixels, the six derivatives by the ground point, and failure codes of the camera.

    Compiled apart from `_bake`, and without stacking the derivatives: XLA would evaluate the links again for each of them.
    """
    before, follows, unseen = [], [], []
    for group in problem.groups:
        residual, code = pixels(problem, group, start)
        derivative = joint_derivatives(problem.put(start), group.shot, group.point).derivatives["earth"]
        before.append(residual)
        follows.append(tuple(jnp.broadcast_to(c, code.shape) for row in derivative for c in row))
        unseen.append(code)
    return before, follows, unseen


def _evaluate(problem: Problem, u: Array):
    """For each group: whitened residuals (x, y), their derivatives (x, y), (unknowns, n) each, and failure codes."""
    after, rows, unseen = [], [], []
    sensor = problem.put(u)
    for group in problem.groups:
        found = columns(problem, group, u)
        order = found.order
        place = np.argsort([*order, *(k for k in range(len(u)) if k not in order)])
        after.append(found.residual)
        rows.append(tuple(jnp.pad(c, ((0, len(u) - len(order)), (0, 0)))[place] for c in found.by))
        unseen.append(_codes(sensor, group, found.inside))
    return after, rows, unseen


_baked, _begun = (compiled(of, lambda problem, _: problem.size) for of in (_bake, _begin))
_evaluated = compiled(_evaluate, lambda problem, _: problem.size, often=True)

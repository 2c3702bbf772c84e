"""Weights from the data: how large the errors of each group of observations, and of each group of priors, really are.

Restricted maximum likelihood (Patterson and Thompson 1971): the unknowns are integrated out, so that the residuals are judged
against what the fit leaves of the errors, and an unknown without a prior costs its degree of freedom. One sigma factor a group;
derivatives by autodiff; the curvature at the maximum is the uncertainty of the factors. What points are known to has no factor:
it is integrated out like the unknowns, once for all rays of a point; what is considered likewise.

A factor that few values decide is not known, and none is found: `decided`. What the uncertainty of the others does to the answer
is in weight_uncertainty.py.
"""

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..rules import Arrays, WhiskjaxError, need_flags
from .linearised import LeastSquares, Linearised
from .observations import Observations
from .surveys import Surveys
from .unknown import Unknown

_AXES = ("x", "y")
# Images with fewer control points share a factor: of so few residuals a sigma is known to a third.
_FEW_POINTS, _FEW = 5, "images of few points"
# A factor whose logarithm is less well known is no factor: as of fewer than five values, log sigma = 1 / sqrt(2 * 5).
LEAST_KNOWN = 10**-0.5
_ALIKE = 0.01  # sigmas that differ by less are one statement
_SUFFIX = re.compile("_(m|rad|s|px)$")
_MEAN, _STATED = -1, -2  # places behind the groups: of images without control points, and of sigmas that stay
# Sigmas that are only guessed are wrong by 2 or 3; beyond this factor the errors are of another kind than was said.
STRETCHED, DOUBTFUL, _SURE = 5.0, 2.0, 2.0


@dataclasses.dataclass(frozen=True)
class Reweigh:
    """Which errors share one factor on their sigmas.

    **Arguments:**

    - `images`, `axes`: a factor for each image, and for each of the two pixel coordinates; off, all of them share one. By default
      on in `calibrate`, where images with fewer than five control points share one; a block knows two groups of rays alone, those
      of tie points and those of surveyed ones.
    - `priors`: False leaves what is known beforehand as it is. True makes groups of it: in `calibrate` of fields of one name
      whose priors have one sigma (a sigma that was stated for several numbers was one guess), in `adjust` of the recorded
      attitudes and of the positions. Or name groups of unknowns: {"lever arm": ["u_gps", "v_gps", "w_gps"]}.
    - `spread`: the given sigmas are right to within this factor, 1-sigma. It keeps groups that the data say nothing of where they
      are, and hardly pulls on the others.

    Whatever the groups: one that fewer than five values decide, those that the fit does not take (its redundancy), keeps the
    sigma that was stated. Of three priors nobody can tell how large their errors are.
    """

    images: bool | None = None
    axes: bool | None = None
    priors: Mapping[str, Sequence[str]] | bool = False
    spread: float = 30.0

    def __post_init__(self):
        Arrays("Reweigh").take("spread", self.spread, "")
        need_flags("Reweigh", **{name: on for name in ("images", "axes") if (on := getattr(self, name)) is not None})
        if not isinstance(self.priors, bool | Mapping):
            raise WhiskjaxError(f"Reweigh: priors is True, False, or groups of unknowns by name, not {self.priors!r}")
        if not (math.isfinite(self.spread) and self.spread > 1):
            raise WhiskjaxError(f"Reweigh: spread is a factor above 1, not {self.spread}")


class Components(NamedTuple):
    """Factors on the given sigmas, by group, and the covariance of their logarithms.

    `is_prior` tells groups of priors from groups of observations; `count` is the number of values in the group.
    """

    names: tuple[str, ...]
    is_prior: Bool[np.ndarray, " groups"]
    count: Int[np.ndarray, " groups"]
    factor: Float[np.ndarray, " groups"]
    covariance: Float[np.ndarray, "groups groups"]

    @property
    def log_sigma(self) -> Float[np.ndarray, " groups"]:
        """The uncertainty of each factor's logarithm (0.1 is 10 %)."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def is_stretched(self) -> Bool[np.ndarray, " groups"]:
        """Groups whose sigma would have to be another by more than five times, either way, and surely so: 2 of its own log
        sigmas."""
        return self._beyond(STRETCHED)

    @property
    def is_doubtful(self) -> Bool[np.ndarray, " groups"]:
        """The same by more than two times: sigmas that were not known."""
        return self._beyond(DOUBTFUL)

    def _beyond(self, times: float) -> Bool[np.ndarray, " groups"]:
        return np.abs(np.log(self.factor)) - _SURE * self.log_sigma > math.log(times)


class Grouping(NamedTuple):
    """Names of the groups, and the group of each pixel coordinate (n, 2) and each unknown (k,); negative is none.

    -1 of a pixel coordinate: an image without control points (`weighing`); -2: its sigma stays as it was stated.
    """

    names: tuple[str, ...]
    observed: Int[np.ndarray, "n 2"]
    prior: Int[np.ndarray, " k"]

    def keep(self, some: Bool[np.ndarray, " groups"]) -> "Grouping":
        """Without the other groups, whose sigmas stay as they were stated."""
        number = np.append(np.where(some, np.cumsum(some) - 1, _STATED), [_STATED, _MEAN])
        prior = np.where(self.prior < 0, -1, np.maximum(number[self.prior], -1))
        return Grouping(tuple(n for n, one in zip(self.names, some, strict=True) if one), number[self.observed], prior)


def group(rule: Reweigh, observations: Observations, unknowns: Sequence[Unknown]) -> Grouping:
    """Who shares a factor with whom.

    **Raises:** `WhiskjaxError` where a group of priors is empty, or names an unknown twice, or one that is not or has no prior.
    """
    pooled = rule.images is False or not len(observations.images)
    images = np.array(["all images"] * len(observations) if pooled else observations.images, dtype=object)
    if not pooled:
        control = images[observations.is_control]
        few = [name for name in dict.fromkeys(control) if (control == name).sum() < _FEW_POINTS]
        images[np.isin(images, few)] = _FEW
    axes = ("", "") if rule.axes is False else _AXES
    labels = [[f"{image} {axis}".strip() for axis in axes] for image in images]
    decide = [pair for pair, control in zip(labels, observations.is_control, strict=True) if control]
    names = list(dict.fromkeys(label for pair in decide for label in pair))
    observed = np.array([[names.index(label) if label in names else -1 for label in pair] for pair in labels])
    known = [x.name for x in unknowns]
    prior = np.full(len(unknowns), -1)
    for k, (name, members) in enumerate(_prior_groups(rule, unknowns).items(), start=len(names)):
        if not members or name in names:
            raise WhiskjaxError(f"Reweigh: the group of priors {name!r} is empty, or called as a group of observations is")
        for member in members:
            if member not in known or unknowns[known.index(member)].sigma is None:
                raise WhiskjaxError(f"Reweigh: group {name!r} lists {member!r}, which is no unknown with a prior")
            if prior[known.index(member)] >= 0:
                raise WhiskjaxError(f"Reweigh: {member!r} is in two groups of priors")
            prior[known.index(member)] = k
    return Grouping((*names, *_prior_groups(rule, unknowns)), observed, prior)


def _prior_groups(rule: Reweigh, unknowns: Sequence[Unknown]) -> Mapping[str, Sequence[str]]:
    if not isinstance(rule.priors, bool):
        return rule.priors
    if not rule.priors:
        return {}
    groups: list[tuple[str, float, list[str]]] = []
    for x in unknowns:
        if x.sigma is None:
            continue
        field, sigma = _SUFFIX.sub("", x.places[0].path[-1]).replace("_", " "), float(x.sigma)
        alike = (members for kind, size, members in groups if kind == field and abs(sigma / size - 1) < _ALIKE)
        if (members := next(alike, None)) is None:
            groups.append((field, sigma, members := []))
        members.append(x.name)
    of = {x.name: x for x in unknowns}
    shown = [(kind, size * of[members[0]].unit.factor, of[members[0]].unit.name, members) for kind, size, members in groups]
    return {f"priors of {kind} ({size:.3g} {unit})": members for kind, size, unit, members in shown}


def weighing(grouping: Grouping, found: Components) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " k"]]:
    """The factor of every pixel coordinate and of every prior.

    An image without control points has no factor of its own: its sigmas were stated with those of the others, and take the mean
    of their factors (of the logarithms, by their precision; axis by axis).
    """
    factor = np.append(found.factor, [1.0, 1.0])
    observed = factor[grouping.observed]
    for axis, groups in enumerate(grouping.observed.T):
        own = np.unique(groups[groups >= 0])
        if own.size:
            mean = np.average(np.log(found.factor[own]), weights=found.log_sigma[own] ** -2)
            observed[groups == _MEAN, axis] = np.exp(mean)
    return observed, factor[grouping.prior]


class Data(NamedTuple):
    """The linearised problem in pixels: residual at u = 0, derivatives by whitened unknowns, the parts of each covariance.

    What is considered stands behind the unknowns, each of sigma 1.
    """

    residual: Float[Array, "n 2"]
    rows: Float[Array, "n 2 k"]
    sigma: Float[Array, "n 2"]
    fixed: Float[Array, "n 2 2"]
    observed: Int[Array, "n 2"]
    used: Float[Array, " n"]
    prior: Int[Array, " k"]
    root: Float[Array, "k k"]
    spread: Float[Array, ""]
    surveys: Surveys | None


class Equations(NamedTuple):
    """Normal equations at log factors: N u + right = 0, the squared residual at u = 0 and log |V|, V the errors' covariance."""

    normal: Float[Array, "k k"]
    right: Float[Array, " k"]
    square: Float[Array, ""]
    volume: Float[Array, ""]


def equations(theta: Float[Array, " groups"], data: Data) -> Equations:
    """Of the unknowns, and of what is considered."""
    factor = jnp.append(jnp.exp(theta), jnp.ones(2))
    sigma = data.sigma * factor[data.observed]
    c00, c01, c11 = sigma[:, 0] ** 2 + data.fixed[:, 0, 0], data.fixed[:, 0, 1], sigma[:, 1] ** 2 + data.fixed[:, 1, 1]
    determinant = c00 * c11 - c01**2
    w = data.used / determinant
    inverse = jnp.stack([jnp.stack([w * c11, -w * c01], -1), jnp.stack([-w * c01, w * c00], -1)], -2)
    weighted = jnp.einsum("nij,njk->nik", inverse, data.rows)
    root = data.root / factor[data.prior][None, :]
    normal = jnp.einsum("nik,nil->kl", data.rows, weighted) + root.T @ root
    right = jnp.einsum("nik,ni->k", weighted, data.residual)
    square = jnp.einsum("ni,nij,nj->", data.residual, inverse, data.residual)
    volume = jnp.sum(data.used * jnp.log(determinant))
    if data.surveys is not None:  # V = D + F S F^T: less what the points explain, and log |V| = log |D| + log |M| (Sylvester)
        whole = jnp.concatenate([data.rows, data.residual[:, :, None]], axis=2)
        m, explained = data.surveys.explained(inverse, whole)
        normal, right, square = normal - explained[:-1, :-1], right - explained[:-1, -1], square - explained[-1, -1]
        volume = volume + jnp.sum(jnp.linalg.slogdet(m)[1])
    volume = volume + 2 * jnp.sum(jnp.where((data.root != 0).any(axis=1), jnp.log(factor[data.prior]), 0.0))
    return Equations(normal, right, square, volume)


def _minus_log_likelihood(theta: Float[Array, " groups"], data: Data) -> Float[Array, ""]:
    """-log p(residuals | log factors) with the unknowns integrated out, plus the hyperprior; constants left out."""
    normal, right, square, volume = equations(theta, data)
    lower = jnp.linalg.cholesky(normal)
    half = jax.scipy.linalg.solve_triangular(lower, right, lower=True)
    volume = volume + 2 * jnp.sum(jnp.log(jnp.diag(lower)))
    return 0.5 * (square - half @ half + volume) + 0.5 * jnp.sum((theta / jnp.log(data.spread)) ** 2)


@eqx.filter_jit
def _judge(theta: Array, data: Data) -> tuple[Array, Array, Array]:
    return (
        _minus_log_likelihood(theta, data),
        jax.grad(_minus_log_likelihood)(theta, data),
        jax.hessian(_minus_log_likelihood)(theta, data),
    )


def data_of(
    grouping: Grouping,
    spread: float,
    ready: LeastSquares,
    here: Linearised,
    used: Bool[np.ndarray, " n"],
    considered_px: Float[np.ndarray, "n 2 c"] | None = None,
) -> Data:
    """The problem about `here`, weighed as it was stated. **Arguments:** `considered_px`: one sigma of each, in pixels."""
    more = np.zeros((len(used), 2, 0)) if considered_px is None else considered_px
    k, c = len(here.u), more.shape[2]
    return Data(
        residual=jnp.asarray(here.residual_px - here.rows_px @ here.u),
        rows=jnp.asarray(np.concatenate([here.rows_px, more], axis=2)),
        sigma=jnp.asarray(ready.observations.sigma_px),
        fixed=jnp.asarray(ready.fixed_px2 if ready.surveys is None else ready.surveys.alone_px2),
        observed=jnp.asarray(grouping.observed),
        used=jnp.asarray(used.astype(float)),
        prior=jnp.asarray(np.append(grouping.prior, np.full(c, -1))),
        root=jnp.asarray(np.block([[ready.prior, np.zeros((k, c))], [np.zeros((c, k)), np.eye(c)]])),
        spread=jnp.asarray(float(spread)),
        surveys=jax.tree.map(jnp.asarray, ready.surveys),
    )


def components(
    grouping: Grouping,
    spread: float,
    ready: LeastSquares,
    here: Linearised,
    used: Bool[np.ndarray, " n"],
    considered_px: Float[np.ndarray, "n 2 c"] | None = None,
    steps: int = 60,
) -> Components:
    """Factors on the sigmas given in `ready.observations` and the unknowns' priors that make the residuals most likely.

    The problem is taken as linear about `here`; repeat at the solution with the new weights where they moved it far.
    """
    if not grouping.names:
        return Components((), np.zeros(0, dtype=bool), np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 0)))
    theta, curvature = _newton(data_of(grouping, spread, ready, here, used, considered_px), len(grouping.names), steps)
    members = np.concatenate([grouping.observed[used].ravel(), grouping.prior])
    count = np.bincount(members[members >= 0], minlength=len(theta))
    is_prior = np.isin(np.arange(len(theta)), grouping.prior)
    return Components(grouping.names, is_prior, count, np.exp(theta), np.linalg.inv(curvature))


def decided(
    grouping: Grouping,
    spread: float,
    ready: LeastSquares,
    here: Linearised,
    used: Bool[np.ndarray, " n"],
    considered_px: Float[np.ndarray, "n 2 c"] | None = None,
) -> tuple[Grouping, Components]:
    """The same, of groups that the data know; others are given up, and their sigmas stay as they were stated."""
    while True:
        found = components(grouping, spread, ready, here, used, considered_px)
        known = found.log_sigma <= LEAST_KNOWN
        if known.all():
            return grouping, found
        grouping = grouping.keep(known)


def _newton(data: Data, size: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Newton's minimum, eigenvalues of the curvature kept positive, steps of at most one in a logarithm, halved where uphill."""
    theta = np.zeros(size)
    value, slope, curvature = (np.asarray(x) for x in _judge(jnp.asarray(theta), data))
    for _ in range(steps):
        values, vectors = np.linalg.eigh(curvature)
        step = -vectors @ ((vectors.T @ slope) / np.maximum(np.abs(values), 1e-3))
        step /= max(1.0, np.abs(step).max())
        for _ in range(20):
            tried = tuple(np.asarray(x) for x in _judge(jnp.asarray(theta + step), data))
            if tried[0] <= value + 1e-12 * abs(value):
                break
            step = step / 2
        theta, (value, slope, curvature) = theta + step, tried
        if np.abs(step).max() < 1e-8:
            break
    return theta, curvature

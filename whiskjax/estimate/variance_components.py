"""Weights from the data: how large the errors of each group of observations, and of each group of priors, really are.

Restricted maximum likelihood (Patterson and Thompson 1971): the unknowns are integrated out, so that the residuals are judged
against what the fit leaves of the errors, and an unknown without a prior costs its degree of freedom. One sigma factor a group;
derivatives by autodiff; the curvature at the maximum is the uncertainty of the factors. What points are known to has no factor:
it is integrated out like the unknowns, once for all rays of a point.
"""

import dataclasses
import math
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
# Sigmas that are only guessed are wrong by 2 or 3; beyond this factor the errors are of another kind than was said.
STRETCHED, DOUBTFUL, _SURE = 5.0, 2.0, 2.0


@dataclasses.dataclass(frozen=True)
class Reweigh:
    """Which errors share one factor on their sigmas.

    **Arguments:**

    - `images`, `axes`: a factor for each image, and for each of the two pixel coordinates; off, all of them share one. By default
      on in `calibrate`; a block knows two groups of rays alone, those of tie points and those of surveyed ones.
    - `priors`: False leaves what is known beforehand as it is. True makes groups of it: in `calibrate` of each link's vector
      (options of a `By` together), in `adjust` of the recorded attitudes and of the positions. Or name groups of unknowns:
      {"lever arm": ["u_gps", "v_gps", "w_gps"]}. A factor shared by three numbers is known to a factor of three or so only, and
      the covariance takes it as exact: ask for it where priors are guesses, not where they are knowledge.
    - `spread`: the given sigmas are right to within this factor, 1-sigma. It keeps groups that the data say nothing of where they
      are, and hardly pulls on the others.
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
    """Factors on the given sigmas, by group; `log_sigma` is the uncertainty of each factor's logarithm (0.1 is 10 %).

    `is_prior` tells groups of priors from groups of observations; `count` is the number of values in the group.
    """

    names: tuple[str, ...]
    is_prior: Bool[np.ndarray, " groups"]
    count: Int[np.ndarray, " groups"]
    factor: Float[np.ndarray, " groups"]
    log_sigma: Float[np.ndarray, " groups"]

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
    """Names of the groups, and the group of each pixel coordinate (n, 2) and each unknown (k,); -1 is none.

    Images without control points have none (`weighing`).
    """

    names: tuple[str, ...]
    observed: Int[np.ndarray, "n 2"]
    prior: Int[np.ndarray, " k"]


def group(rule: Reweigh, observations: Observations, unknowns: Sequence[Unknown]) -> Grouping:
    """Who shares a factor with whom.

    **Raises:** `WhiskjaxError` where a group of priors is empty, or names an unknown twice, or one that is not or has no prior.
    """
    pooled = rule.images is False or not len(observations.images)
    images = ["all images"] * len(observations) if pooled else list(observations.images)
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
    groups: dict[str, list[str]] = {}
    for x in unknowns:
        if x.sigma is not None:
            place = x.places[0]
            field = place.text.partition("[")[0].rpartition(".")[2]
            groups.setdefault(f"prior of {place.link} {field}", []).append(x.name)
    return groups


def weighing(grouping: Grouping, found: Components) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " k"]]:
    """The factor of every pixel coordinate and of every prior.

    An image without control points has no factor of its own: its sigmas were stated with those of the others, and take the mean
    of their factors (of the logarithms, by their precision; axis by axis).
    """
    factor = np.append(found.factor, 1.0)  # index -1: no group
    observed = factor[grouping.observed]
    for axis, groups in enumerate(grouping.observed.T):
        own = np.unique(groups[groups >= 0])
        mean = np.average(np.log(found.factor[own]), weights=found.log_sigma[own] ** -2)
        observed[groups < 0, axis] = np.exp(mean)
    return observed, factor[grouping.prior]


class _Data(NamedTuple):
    """The linearised problem in pixels: residual at u = 0, derivatives by whitened unknowns, the parts of each covariance."""

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


def _minus_log_likelihood(theta: Float[Array, " groups"], data: _Data) -> Float[Array, ""]:
    """-log p(residuals | log factors) with the unknowns integrated out, plus the hyperprior; constants left out."""
    factor = jnp.append(jnp.exp(theta), 1.0)  # index -1: no group
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
    lower = jnp.linalg.cholesky(normal)
    half = jax.scipy.linalg.solve_triangular(lower, right, lower=True)
    volume = volume + 2 * jnp.sum(jnp.log(jnp.diag(lower)))
    volume = volume + 2 * jnp.sum(jnp.where((data.root != 0).any(axis=1), jnp.log(factor[data.prior]), 0.0))
    return 0.5 * (square - half @ half + volume) + 0.5 * jnp.sum((theta / jnp.log(data.spread)) ** 2)


@eqx.filter_jit
def _judge(theta: Array, data: _Data) -> tuple[Array, Array, Array]:
    return (
        _minus_log_likelihood(theta, data),
        jax.grad(_minus_log_likelihood)(theta, data),
        jax.hessian(_minus_log_likelihood)(theta, data),
    )


def components(
    grouping: Grouping, spread: float, ready: LeastSquares, here: Linearised, used: Bool[np.ndarray, " n"], steps: int = 60
) -> Components:
    """Factors on the sigmas given in `ready.observations` and the unknowns' priors that make the residuals most likely.

    The problem is taken as linear about `here`; repeat at the solution with the new weights where they moved it far.
    """
    observations = ready.observations
    data = _Data(
        residual=jnp.asarray(here.residual_px - here.rows_px @ here.u),
        rows=jnp.asarray(here.rows_px),
        sigma=jnp.asarray(observations.sigma_px),
        fixed=jnp.asarray(ready.fixed_px2 if ready.surveys is None else ready.surveys.alone_px2),
        observed=jnp.asarray(grouping.observed),
        used=jnp.asarray(used.astype(float)),
        prior=jnp.asarray(grouping.prior),
        root=jnp.asarray(ready.prior),
        spread=jnp.asarray(float(spread)),
        surveys=jax.tree.map(jnp.asarray, ready.surveys),
    )
    theta, curvature = _newton(data, len(grouping.names), steps)
    members = np.concatenate([grouping.observed[used].ravel(), grouping.prior[grouping.prior >= 0]])
    count = np.bincount(members, minlength=len(theta))
    is_prior = np.isin(np.arange(len(theta)), grouping.prior)
    return Components(grouping.names, is_prior, count, np.exp(theta), np.sqrt(np.diag(np.linalg.inv(curvature))))


def _newton(data: _Data, size: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
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

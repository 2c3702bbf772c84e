"""Weights from the data: variance components of tie rays, of control points, and of POS attitude and position.

Each group's sum of squared whitened residuals is set against its redundancy, the number of its observations less what the
estimation takes of them (Foerstner 1979); repeated until the factors stand still. Redundancies come from the reduced equations
alone: of N = N_g + rest, tr(N^-1 N_g) needs only the share of the group in the reduced matrix, and three unknowns a point.

No point has rays of two groups, so that the reduced matrix S is the sum of the groups' own, S_g, each of which a factor f divides
by f^2. With r_g the redundancies, the information on the logarithms of the factors is 2 tr(S^-1 S_g S^-1 S_h) for two groups, and
rows of it, with what is in no group, add up to 2 r_g (Foerstner 1979; of restricted likelihood: Patterson and Thompson 1971). The
answer moves by 2 S^-1 (gradient of the group's half of the squares), its covariance by 2 S^-1 S_g S^-1 (weight_uncertainty.py).
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...rules import WhiskjaxError
from ...rules.progress import tell
from ..variance_components import LEAST_KNOWN, Components, Reweigh
from ..weight_uncertainty import Uncertain, uncertain
from .block import Block
from .covariance import evaluate
from .prepare import Prepared, State
from .solve import Solved, gauss_newton, reduce

_ROUNDS = 25
_SAME_FACTOR = 3e-3  # of a logarithm
_LONGEST = np.log(3.0)  # a factor changes by at most this much in one round: redundancies move with it

_TIES, _CONTROL, _TURN, _SHIFT = range(4)
NAMES = ("tie rays", "control and check points", "POS attitude", "POS position")


class Groups(NamedTuple):
    """Of the four groups: sums of squares, redundancies and numbers of observations; their parts of the reduced matrix, and the
    gradients of half their squares by what the reduced matrix is of."""

    squares: Float[np.ndarray, " 4"]
    redundancy: Float[np.ndarray, " 4"]
    count: np.ndarray
    parts: Float[np.ndarray, "4 m m"]
    slopes: Float[np.ndarray, "4 m"]


def reweigh(
    prepared: Prepared, solved: Solved, used: np.ndarray, rule: Reweigh, before: Components | None, max_steps: int
) -> tuple[Prepared, Solved, Components, Uncertain]:
    """Solve again and again with sigmas as large as the residuals say.

    Groups: rays of tie points; rays of control and check points together with the control points' coordinates; POS attitude;
    POS position, if priors are asked for. A group that has little to say (a redundancy below five) keeps its sigma.
    That the given sigmas are right to within the rule's spread adds log(factor) / log(spread)^2 to the squares that are expected.

    **Arguments:** `used`: rays that take part; `rule`: see `refuse_groups`; `before`: factors that the sigmas of
    the block have in them already, from an earlier call.

    **Returns:** the factors of both calls, and what their uncertainty does to motions and unknowns.
    """
    asked, given_right = np.array([True, True, bool(rule.priors), bool(rule.priors)]), np.log(rule.spread) ** -2
    known = {} if before is None else dict(zip(before.names, np.log(before.factor), strict=True))
    begun = np.array([known.get(name, 0.0) for name in NAMES])
    block, log_factor = prepared.block, begun.copy()
    given, marked = prepared, _marked(block)
    for i in range(_ROUNDS):
        tell(f"weights: round {i + 1}")
        found = groups_of(prepared, solved, used)
        step = _step(found.squares, found.redundancy, log_factor, given_right)
        step = np.where(asked & (found.redundancy > 0.5), step, 0.0)
        if (last := i == _ROUNDS - 1) or np.abs(step).max() < _SAME_FACTOR:
            there = np.flatnonzero(asked & (found.count > 0))
            covariance, by_factors, log_variance = _uncertainty(found, np.asarray(solved.reduced.matrix), there, given_right)
            is_known = np.sqrt(covariance.diagonal()) <= LEAST_KNOWN
            if last or is_known.all():
                break
            asked[there[~is_known]] = False
            step = np.where(asked, step, begun - log_factor)
        log_factor += step
        prepared = _rescaled(given, np.exp(log_factor - begun), solved.state, used, marked)
        solved = gauss_newton(prepared.ready, prepared.start, max_steps)
    names, is_prior = tuple(NAMES[g] for g in there), np.asarray(there >= _TURN)
    parts = Components(names, is_prior, found.count[there], np.exp(log_factor[there]), covariance)
    return prepared, solved, parts, uncertain(by_factors, log_variance, covariance)


def _step(
    squares: Float[np.ndarray, " 4"], redundancy: Float[np.ndarray, " 4"], log_factor: Float[np.ndarray, " 4"], given_right: float
) -> Float[np.ndarray, " 4"]:
    """The change d of each log factor by which squares exp(-2 d) are what is expected, bisected; within the longest step."""
    low, high = np.full(4, -_LONGEST), np.full(4, _LONGEST)
    for _ in range(50):
        middle = (low + high) / 2
        larger = squares * np.exp(-2 * middle) > redundancy + given_right * (log_factor + middle)
        low, high = np.where(larger, middle, low), np.where(larger, high, middle)
    return middle


def refuse_groups(rule: Reweigh) -> None:
    """**Raises:** `WhiskjaxError` for groups that a block does not tell apart."""
    if rule.images or rule.axes:
        raise WhiskjaxError(
            "adjust: rays share one factor, those of tie points and those of surveyed points apart; leave images and axes out of "
            "Reweigh()"
        )
    if not isinstance(rule.priors, bool):
        raise WhiskjaxError(
            "adjust: Reweigh(priors=True) finds factors of the recorded attitudes and positions; groups of unknowns by name are "
            "for calibrate"
        )


def _rescaled(given: Prepared, factor: np.ndarray, state: State, used: np.ndarray, marked: np.ndarray) -> Prepared:
    """The block with other sigmas: rays by their weights, control coordinates by their covariance, POS by its rows."""
    of_ray = np.where(marked, factor[_CONTROL], factor[_TIES])
    block = dataclasses.replace(
        given.block,
        sigma_px=given.block.sigma_px * of_ray[:, None],
        covariance_m2=given.block.covariance_m2 * factor[_CONTROL] ** 2,
    )
    weight = np.where(used[:, None], 1 / block.sigma_px, 0.0)
    roots = given.ready.roots / jnp.asarray(np.repeat(factor[[_TURN, _SHIFT]], len(given.ready.roots) // 2))[:, None, None]
    prepared = dataclasses.replace(given, block=block).weighted(weight, state)
    return dataclasses.replace(prepared, ready=eqx.tree_at(lambda r: r.roots, prepared.ready, roots))


def groups_of(prepared: Prepared, solved: Solved, used: np.ndarray) -> Groups:
    """What each of the four groups says at the solution.

    **Arguments:** `used`: rays that take part.
    """
    ready, state, block = prepared.ready, solved.state, prepared.block
    marked = _marked(block)
    whole = np.asarray(solved.reduced.matrix)
    inverse, size = np.linalg.inv(whole), state.x.size
    # Of turns and of shifts, and what of them moves: rows of an axis that stays take it, and are no observations.
    roots, recorded = np.asarray(ready.roots), np.asarray(ready.recorded(state.x))
    groups, _, stretch = roots.shape
    parts, slopes = np.zeros((4, *whole.shape)), np.zeros((4, len(whole)))
    known, pulled = np.zeros_like(whole), np.zeros(len(whole))  # what is in no ray: POS and priors
    moves = np.repeat(np.asarray(ready.unknowns.sigma) > 0, state.x.shape[1])
    is_turn = np.arange(size) < size // 2
    for a in range(groups):
        place = slice(a * stretch, (a + 1) * stretch)
        known[place, place] = roots[a].T @ roots[a]
        pulled[place] = roots[a].T @ recorded[a]
    for group, which in ((_TURN, moves & is_turn), (_SHIFT, moves & ~is_turn)):
        which = np.append(which, np.zeros(len(whole) - size, dtype=bool))
        parts[group], slopes[group] = known * np.outer(which, which), pulled * which
    known[size:, size:] = information = np.asarray(ready.unknowns.others.information)
    pulled[size:] = information @ np.asarray(state.u)
    pos_count = (moves & (np.abs(roots).sum(axis=2) > 0).ravel()).reshape(2, -1).sum(axis=1)
    pos_squares = np.where(moves, recorded.ravel() ** 2, 0.0).reshape(2, -1).sum(axis=1)
    # What control and check points give to the reduced matrix; the rest comes from the ties.
    control = (block.role == "control") & block.seen
    some = used & ~prepared.lone(used)[block.point]
    alone = prepared.weighted(np.where((some & marked)[:, None], 1 / block.sigma_px, 0.0), state)
    reduced, _ = reduce(alone.ready, state)
    parts[_CONTROL], slopes[_CONTROL] = np.asarray(reduced.matrix) - known, -np.asarray(reduced.right) - pulled
    parts[_TIES], slopes[_TIES] = whole - np.asarray(reduced.matrix), np.asarray(reduced.right)
    residual = prepared.by_ray(evaluate(ready, state).residual_px) / block.sigma_px
    squared = np.where(some, (residual**2).sum(axis=1), 0.0)
    point = prepared.point_m(state)
    off = np.where(control[:, None], np.nan_to_num(point - block.position_m), 0.0)[control]
    surveyed = np.einsum("ni,nij,nj->", off, block.information()[control], off)
    seen = np.unique(block.point[some])
    ties, others = int((block.role[seen] == "tie").sum()), int((block.role[seen] == "check").sum())
    squares = [squared[~marked].sum(), squared[marked].sum() + surveyed, *pos_squares]
    count = [2 * int((some & ~marked).sum()), 2 * int((some & marked).sum()) + 3 * int(control.sum())]
    count += [int(n) for n in pos_count]
    used_up = np.einsum("ij,gij->g", inverse, parts) + [3 * ties, 3 * (others + int(control.sum())), 0, 0]
    return Groups(np.array(squares, dtype=float), np.array(count) - used_up, np.array(count), parts, slopes)


def _marked(block: Block) -> np.ndarray:
    """Rays of surveyed points."""
    return block.role[block.point] != "tie"


def _uncertainty(
    found: Groups, matrix: Float[np.ndarray, "m m"], there: np.ndarray, given_right: float
) -> tuple[Float[np.ndarray, "g g"], Float[np.ndarray, "g m"], Float[np.ndarray, "g m"]]:
    """Covariance of the logarithms of some groups' factors, and what they do to the answer and its variances' logarithms."""
    inverse = np.linalg.inv(matrix)
    taken = [inverse @ part for part in found.parts]
    rest = np.eye(len(matrix)) - sum(taken)
    both = np.array([[np.sum(a * b.T) for b in (*taken, rest)] for a in taken])
    both[:, :4] += np.diag(found.redundancy - both.sum(axis=1))
    information = 2 * both[np.ix_(there, there)] + given_right * np.eye(len(there))
    answer = 2 * found.slopes[there] @ inverse
    log_variance = [2 * np.sum(taken[g] * inverse.T, axis=1) / inverse.diagonal() for g in there]
    return np.linalg.inv(information), answer, np.array(log_variance).reshape(len(there), len(matrix))

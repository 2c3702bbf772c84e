"""Weights from the data: variance components of tie rays, of control points, and of POS attitude and position.

Each group's sum of squared whitened residuals is set against its redundancy, the number of its observations less what the
estimation takes of them (Foerstner 1979); repeated until the factors stand still. Redundancies come from the reduced equations
alone: of N = N_g + rest, tr(N^-1 N_g) needs only the share of the group in the reduced matrix, and three unknowns a point.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...rules import WhiskjaxError
from ...rules.progress import tell
from ..variance_components import Components, Reweigh
from .block import Block
from .covariance import evaluate
from .prepare import Prepared, State
from .solve import Solved, gauss_newton, reduce

_ROUNDS = 25
_SAME_FACTOR = 3e-3  # of a logarithm
_LONGEST = np.log(3.0)  # a factor changes by at most this much in one round: redundancies move with it

_TIES, _CONTROL, _TURN, _SHIFT = range(4)
NAMES = ("tie rays", "control and check points", "POS attitude", "POS position")


def reweigh(
    prepared: Prepared, solved: Solved, used: np.ndarray, rule: Reweigh, before: Components | None, max_steps: int
) -> tuple[Prepared, Solved, Components]:
    """Solve again and again with sigmas as large as the residuals say.

    Groups: rays of tie points; rays of control and check points together with the control points' coordinates; POS attitude;
    POS position, if priors are asked for. A group that has nothing to say (no such observations, no redundancy) keeps its sigma.
    That the given sigmas are right to within the rule's spread adds log(factor) / log(spread)^2 to the squares that are expected.

    **Arguments:** `used`: rays that take part; `rule`: see `refuse_groups`; `before`: factors that the sigmas of
    the block have in them already, from an earlier call.

    **Returns:** the factors of both calls.
    """
    asked, given_right = np.array([True, True, bool(rule.priors), bool(rule.priors)]), np.log(rule.spread) ** -2
    known = {} if before is None else dict(zip(before.names, np.log(before.factor), strict=True))
    begun = np.array([known.get(name, 0.0) for name in NAMES])
    block, log_factor = prepared.block, begun.copy()
    given, marked = prepared, _marked(block)
    for i in range(_ROUNDS):
        tell(f"weights: round {i + 1}")
        squares, redundancy, _ = groups_of(prepared, solved.state, used, _inverse(solved))
        step = np.where(asked & (redundancy > 0.5), _step(squares, redundancy, log_factor, given_right), 0.0)
        if np.abs(step).max() < _SAME_FACTOR:
            break
        log_factor += step
        prepared = _rescaled(given, np.exp(log_factor - begun), solved.state, used, marked)
        solved = gauss_newton(prepared.ready, prepared.start, max_steps)
    _, redundancy, count = groups_of(prepared, solved.state, used, _inverse(solved))
    there = asked & (count > 0)
    names = tuple(name for name, some in zip(NAMES, there, strict=True) if some)
    is_prior = np.array([False, False, True, True])[there]
    expected = np.maximum((redundancy + given_right * log_factor)[there], 0.0)
    uncertain = 1 / np.sqrt(2 * expected + given_right)
    return prepared, solved, Components(names, is_prior, count[there], np.exp(log_factor[there]), uncertain)


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


class Groups(NamedTuple):
    """Sums of squares, redundancies and numbers of observations of the four groups."""

    squares: Float[np.ndarray, " 4"]
    redundancy: Float[np.ndarray, " 4"]
    count: Float[np.ndarray, " 4"]


def groups_of(prepared: Prepared, state: State, used: np.ndarray, inverse: Float[np.ndarray, "m m"]) -> Groups:
    """What the four groups have at a solution.

    **Arguments:** `used`: rays that take part; `inverse`: of the reduced normal matrix.
    """
    ready, block = prepared.ready, prepared.block
    marked = _marked(block)
    # Of turns and of shifts, and what of them moves: rows of an axis that stays take it, and are no observations.
    roots, size = np.asarray(ready.roots), state.x.size
    groups, _, stretch = roots.shape
    information = np.einsum("aei,aej->aij", roots, roots)
    blocks = inverse[:size, :size].reshape(groups, stretch, groups, stretch)
    taken = np.stack([np.sum(blocks[a, :, a] * information[a], axis=1) for a in range(groups)]).reshape(2, -1)
    moves = np.repeat(np.asarray(ready.unknowns.sigma) > 0, state.x.shape[1]).reshape(2, -1)
    pos_taken = np.where(moves, taken, 0.0).sum(axis=1)
    pos_count = (moves & (np.abs(roots).sum(axis=2) > 0).reshape(2, -1)).sum(axis=1)
    pos_squares = np.where(moves, np.asarray(ready.recorded(state.x)).reshape(2, -1) ** 2, 0.0).sum(axis=1)
    priors = taken.sum() + np.sum(inverse[size:, size:] * np.asarray(ready.unknowns.others.information))
    # What control and check points give to the reduced matrix; the rest comes from the ties, and all together take its trace.
    control = (block.role == "control") & block.seen
    some = used & ~prepared.lone(used)[block.point]
    alone = prepared.weighted(np.where((some & marked)[:, None], 1 / block.sigma_px, 0.0), state)
    taken_marked = float(np.sum(inverse * np.asarray(reduce(alone.ready, state)[0].matrix)) - priors)
    taken_ties = len(inverse) - priors - taken_marked
    residual = prepared.by_ray(evaluate(ready, state).residual_px) / block.sigma_px
    squared = np.where(some, (residual**2).sum(axis=1), 0.0)
    point = prepared.point_m(state)
    off = np.where(control[:, None], np.nan_to_num(point - block.position_m), 0.0)[control]
    pulled = np.einsum("ni,nij,nj->", off, block.information()[control], off)
    seen = np.unique(block.point[some])
    ties, others = int((block.role[seen] == "tie").sum()), int((block.role[seen] == "check").sum())
    squares = [squared[~marked].sum(), squared[marked].sum() + pulled, *pos_squares]
    count = [2 * int((some & ~marked).sum()), 2 * int((some & marked).sum()) + 3 * int(control.sum())]
    count += [int(n) for n in pos_count]
    used_up = [taken_ties + 3 * ties, taken_marked + 3 * (others + int(control.sum())), *pos_taken]
    return Groups(np.array(squares, dtype=float), np.array(count) - np.array(used_up), np.array(count))


def _marked(block: Block) -> np.ndarray:
    """Rays of surveyed points."""
    return block.role[block.point] != "tie"


def _inverse(solved: Solved) -> Float[np.ndarray, "m m"]:
    return np.linalg.inv(np.asarray(solved.reduced.matrix))

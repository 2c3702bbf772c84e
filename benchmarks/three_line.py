"""The block adjustment of `flights.songshan`, data set A, with as many tie points as the paper and with 4 and 16 times as many.

Everybody has the same rays, unknowns, priors and start: zero corrections, points where their rays meet. An iteration leads from
normal equations to normal equations: the step, then residuals, derivatives and eliminated points where it ends. Times are CPU
time, the fastest of several iterations.
"""

import math
import pickle
import tempfile
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from whiskjax.algebra.vectors import Vec3
from whiskjax.chain.samples import quaternions_from_matrices
from whiskjax.estimate.block.begin import begin
from whiskjax.estimate.block.prepare import Prepared, State, prepare
from whiskjax.estimate.block.solve import Reduced, damped, reduce
from whiskjax.estimate.block.station_errors import at_stations
from whiskjax.flights import songshan
from whiskjax.flights.songshan_draw import (
    ATTITUDE_CORRELATION_S,
    ATTITUDE_SIGMA_RAD,
    CENTRE_PX,
    FOCAL_PX,
    POS_CORRELATION_S,
    POS_SIGMA_M,
    VIEW_RAD,
    start_s,
)

from .own_process import in_own_process
from .peers import ceres_block
from .peers.ceres_block import DEFORMATION, MOUNT, BlockArrays, CeresAnswer, Derivatives, Solution
from .suite import benchmark
from .timing import Measured

TIES, MILLION = 14_157, 1_000_000
ITERATIONS = 2  # of scipy, which takes its time
SAME_COST = 1e-9  # relative


class Posed(NamedTuple):
    """A block as the adjustment is given it."""

    scene: songshan.Scene
    sensor: wj.Sensor
    block: wj.Block
    start_m: np.ndarray

    @property
    def errors(self) -> tuple[wj.FrameErrors, ...]:
        """What is known of POS."""
        return songshan.frame_errors(self.scene)

    def prepared(self) -> Prepared:
        """In tiles, on the device."""
        return prepare(
            self.sensor, self.block, songshan.unknowns(self.scene), at_stations("block", self.errors, self.sensor), self.start_m
        )

    def adjusted(self, retime: bool = True) -> wj.Adjustment:
        """By `wj.adjust`, which intersects the rays once more; without `retime` it is the block that the peers are given."""
        unknowns = songshan.unknowns(self.scene)
        return wj.adjust(self.sensor, self.block, unknowns, errors=self.errors, retime=retime)


@cache
def posed(ties: int) -> Posed:
    """Data set A, nominal, seed 0."""
    return pose(songshan.Scene("A", "nominal", ties))


def pose(scene: songshan.Scene) -> Posed:
    """Seed 0 of a scene."""
    drawn = songshan.simulate_block(scene, 0)
    sensor, start_m = begin(drawn.sensor, drawn.block, at_stations("block", songshan.frame_errors(scene), drawn.sensor))
    return Posed(scene, sensor, drawn.block, start_m)


def for_peer(at: Posed) -> BlockArrays:
    """The same adjustment for a peer, from what the paper and the scene say."""
    block, views, strips = at.block, len(songshan.VIEWS), len(at.scene.data.strips)
    time_s, strip, view = (np.asarray(block.key(name)) for name in ("time_s", "strip", "view"))
    pose = at.sensor["body"].pose(block.shot)
    rotation = np.stack([np.stack([np.asarray(c) for c in row], -1) for row in pose.rotation], -2)
    nodes = math.ceil(songshan.STRIP_S / at.scene.spacing_s) + 1
    first, weight = lagrange((time_s - start_s(strips)[strip]) / at.scene.spacing_s, nodes)

    row, prior_node, coefficient = _forgetting(
        np.array([*ATTITUDE_SIGMA_RAD, *POS_SIGMA_M]),
        np.exp(-at.scene.spacing_s / np.array([*ATTITUDE_CORRELATION_S, *POS_CORRELATION_S])),
        strips,
        nodes,
    )
    free = np.zeros(MOUNT + views * DEFORMATION, bool)
    mean, sigma = np.zeros(free.size), np.zeros(free.size)
    for unknown in songshan.unknowns(at.scene):
        k = _seat(unknown.name)
        free[k], mean[k], sigma[k] = True, unknown.mean, unknown.sigma
    control = np.flatnonzero(block.role == "control")
    start_m = at.start_m.copy()
    start_m[control] = block.position_m[control]
    return BlockArrays(
        focal_px=FOCAL_PX,
        principal_sample_px=CENTRE_PX,
        half_width_px=CENTRE_PX,
        offset_px=FOCAL_PX * np.tan(list(VIEW_RAD.values())),
        body_from_imu=np.diag([1.0, -1.0, -1.0]),
        quaternion_xyzw=quaternions_from_matrices(rotation),
        position_m=np.stack([np.asarray(c) for c in pose.translation], -1),
        first_node=first + nodes * strip,
        weight=weight,
        view=view,
        point=block.point,
        pixel_px=block.pixel_px,
        sigma_px=block.sigma_px,
        start=Solution(np.zeros((strips * nodes, 6)), mean, start_m),
        shared_held=~free,
        shared_mean=mean,
        shared_sigma=sigma,
        prior_start=np.concatenate([[0], np.cumsum(np.bincount(row))]),
        prior_axis=np.repeat(np.arange(6), strips * nodes),
        prior_node=prior_node,
        prior_coefficient=coefficient,
        control=control,
        control_m=block.position_m[control],
        control_whitening=np.linalg.inv(np.linalg.cholesky(block.covariance_m2[control])),
    )


def _seat(name: str) -> int:
    """Where an unknown of songshan is among `Solution.shared`, whose lever arm leads the other way: its prior is symmetric."""
    if name in "uvw":
        return 3 + "uvw".index(name)
    if name in ("ex", "ey", "ez"):
        return "xyz".index(name[1])
    term, view = name.split("_")
    return MOUNT + DEFORMATION * songshan.VIEWS.index(view) + 4 * "ba".index(term[0]) + int(term[1])


def lagrange(x: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """First of the four nodes nearest to each time in spacings, and the weights of the cubic through them."""
    first = np.clip(np.floor(x).astype(int) - 1, 0, nodes - 4)
    at = x - first
    others = [[m for m in range(4) if m != k] for k in range(4)]
    return first, np.stack([np.prod([(at - o) / (k - o) for o in others[k]], axis=0) for k in range(4)], axis=-1)


def _forgetting(sigma: np.ndarray, rho: np.ndarray, strips: int, nodes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, nodes and coefficients of the processes: (v_k - rho v_(k-1)) / (sigma sqrt(1 - rho^2)), anew in each strip."""
    axis, node, before = (i.ravel() for i in np.meshgrid(range(6), range(strips * nodes), [True, False], indexing="ij"))
    chained = node % nodes > 0
    scale = 1 / (sigma[axis] * np.where(chained, np.sqrt(1 - rho[axis] ** 2), 1.0))
    used = chained | ~before
    row = axis * strips * nodes + node
    return row[used], (node - before)[used], (np.where(before, -rho[axis], 1.0) * scale)[used]


@cache
def iteration(ties: int) -> Callable[[], tuple[Reduced, Vec3]]:
    """A compiled call of one step of `gauss_newton`."""
    prepared = posed(ties).prepared()
    ready, state = prepared.ready, prepared.start
    reduced, points = reduce(ready, state)
    undamped, one_step = jnp.asarray(0.0), jax.jit(damped)

    def run():
        step, _ = one_step(reduced, undamped)
        size = state.x.size
        return reduce(ready, State(state.x + step[:size].reshape(state.x.shape), state.u + step[size:], points))

    jax.block_until_ready(run())
    return run


def seconds(ties: int) -> float:
    """CPU time of one iteration of ours."""
    run, times = iteration(ties), []
    while len(times) < 4 or (sum(times) < 5 and len(times) < 15):
        start = time.process_time()
        jax.block_until_ready(run())
        times.append(time.process_time() - start)
    return min(times)


@cache
def ceres(ties: int, derivatives: Derivatives = "motion") -> CeresAnswer:
    """What Ceres takes to the minimum."""
    return ceres_block.run(for_peer(posed(ties)), derivatives=derivatives)


@cache
def alone(ties: int, task: str, *numbers: str) -> dict[str, float]:
    """What a task of many_ties.py says of the same block, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "posed"
        path.write_bytes(pickle.dumps(posed(ties)))
        return in_own_process("many_ties", task, str(path), *numbers)


def against_ceres(times: int) -> Measured:
    """An iteration of both, which must end at the same cost."""
    ties = times * TIES
    theirs, ours_s = ceres(ties), seconds(ties)
    off = abs(alone(ties, "solve")["cost"] / (2 * theirs.final_cost) - 1)
    assert off < SAME_COST, f"whiskjax and Ceres end at costs that differ by {off:.1e}"
    note = f"{len(posed(ties).block)} rays; costs differ by {off:.0e}; {theirs.library}, Jets by the ray's own motion"
    if times == 1:
        by_nodes = ceres(ties, "nodes")
        note += f"; by its four nodes {by_nodes.step_s:.2f} s, ours then {ours_s / by_nodes.step_s:.2f}x"
    return Measured(ours_s / theirs.step_s, ours_s=ours_s, peer_s=theirs.step_s, note=note)


for _name, _times, _asked in (("14k", 1, 0.75), ("16x", 16, 0.6)):
    _what = f"block of {_times * TIES:,} tie points, an iteration"
    benchmark(f"three_line.{_name}", what=_what, peer="Ceres", asked=_asked)(partial(against_ceres, _times))


@benchmark("three_line.16x.memory", what="block of 226,512 tie points: resident memory", peer="Ceres", asked=1.5)
def memory() -> Measured:
    theirs, ours, whole = ceres(16 * TIES), alone(16 * TIES, "solve"), alone(16 * TIES, "adjust", "1")
    note = (
        "peaks of processes that read the block and solve it: {peak_gb:.2f} GB ({loaded_gb:.2f} GB once read; tiles of "
        "{bytes_a_ray:.0f} bytes a ray) and {theirs:.2f} GB; all of wj.adjust, with every covariance, {whole:.2f} GB"
    )
    return Measured(ours["peak_gb"] / theirs.peak_gb, note=note.format(theirs=theirs.peak_gb, whole=whole["peak_gb"], **ours))


@benchmark(
    "three_line.scipy",
    what="block of 14,157 tie points, an iteration, against scipy with a sparse Jacobian",
    peer="scipy trf, LSMR",
    asked=0.2,
)
def against_scipy() -> Measured:
    from .peers.scipy_block import ScipyBlock

    answer = ScipyBlock(for_peer(posed(TIES))).solve(ITERATIONS)
    ours_s, peer_s = seconds(TIES), answer.cpu_per_iteration_s
    return Measured(ours_s / peer_s, ours_s=ours_s, peer_s=peer_s, note=f"{answer.iterations} iterations of scipy, their mean")


@benchmark(
    "three_line.growth", what="block: time of one ray at 16 times as many tie points over that at 14,157", peer="-", asked=1.0
)
def growth() -> Measured:
    each = [(len(posed(k * TIES).block), seconds(k * TIES)) for k in (1, 4, 16)]
    (few, few_s), *_, (many, many_s) = each
    told = ", ".join(f"{rays} rays {s:.2f} s" for rays, s in each)
    exponent = math.log(many_s / few_s) / math.log(many / few)
    return Measured((many_s / many) / (few_s / few), note=f"one ray's share at 16x over that at 14k; {told}: rays^{exponent:.2f}")


@benchmark("three_line.compile", what="block: compiling the normal equations, nothing cached", peer="-", asked=10.0, unit="s")
def compile_time() -> Measured:
    whole = alone(TIES, "adjust", "2")
    told = f"all of wj.adjust {whole['first_s'] - whole['adjust_s']:.1f} s, and {whole['adjust_s']:.1f} s a call"
    return Measured(alone(TIES, "solve")["compile_s"], note=f"CPU time, nothing cached, of the normal equations; {told}")


@benchmark(
    "million_ties",
    what="block of 1,000,000 tie points: all of `adjust` with every covariance, CPU time",
    peer="-",
    asked=None,
    unit="s",
    on_request=True,
)
def million() -> Measured:
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "posed")
        drawn = in_own_process("many_ties", "draw", path, str(MILLION // 4), "4")
        solved, whole = in_own_process("many_ties", "solve", path), in_own_process("many_ties", "adjust", path, "1")
    note = (
        "CPU time of all of wj.adjust, compiling included, {whole[peak_gb]:.1f} GB, variance factor {whole[factor]:.4f}; "
        "{solved[rays]} rays, drawn in {drawn[draw_s]:.0f} s; the solution alone is made ready in {solved[prepare_s]:.0f} s, "
        "{solved[steps]} steps take {solved[solve_s]:.0f} s, normal equations {solved[reduce_s]:.1f} s, {solved[peak_gb]:.1f} GB"
    )
    return Measured(whole["adjust_s"], note=note.format(drawn=drawn, solved=solved, whole=whole))

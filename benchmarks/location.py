"""The extended filter through the general chain: thousands of locations of the target of `flights.tianshan` from 40 looks each.

A run is the records of its looks, angles as the instruments gave them, and ends as position and covariance; everybody starts from
those numbers, in the order in memory that suits him best. With pixel noise R is that of registration alone, (2 px)^2; with full
noise it carries the errors of all records too. Times are for one look.
"""

import dataclasses
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from whiskjax.flights import tianshan
from whiskjax.locate.all_looks import at_last, solve
from whiskjax.locate.filter import Belief, run
from whiskjax.locate.model import Model
from whiskjax.locate.nuisance import gather
from whiskjax.locate.problem import Problem

from . import one_thread
from .own_process import in_own_process
from .peers import location as cxx
from .suite import benchmark
from .timing import Measured, compiled, race

RUNS, LOOKS = 4096, 40
LANES = 512  # runs side by side: they stay in the cache, and calls of XLA's loops do not count
FEW_RUNS = 20  # of the peers that loop in Python
SAME_M = 1e-6
SIGMA_ENU_M = (1216.0, 1666.0, 1500.0)  # equation 19 of the paper in metres
NOISES = {"pixel_noise": False, "full_noise": True}
TOLD = {"pixel_noise": "R of pixels alone", "full_noise": "R with the errors of all records"}
# C++, one run at a time, is as fast with -mprefer-vector-width=512 as without.
WIDE: dict[str, str | bool] = {"xla_cpu_prefer_vector_width": "512"}
RELINEARISED, STEPS = 5, 15  # those of wj.locate

Drawn = tuple[tianshan.Recorded, Any]
Solve = Callable[[Model, Belief], Any]


def drawn(runs: int, looks: int, seed: int) -> Drawn:
    """Records and pixels, (runs, looks) and (runs, looks, 2)."""
    return tianshan.draw_runs(tianshan.Scene(looks=looks), runs, seed)


def in_chunks(data: Drawn, lanes: int) -> Drawn:
    """The same as (chunks, looks, lanes) and (chunks, looks, 2, lanes): each number of a look lies in one piece for all lanes."""

    def cut(a: Any) -> np.ndarray:
        chunks = np.reshape(a, (-1, lanes, *np.shape(a)[1:]))
        return np.ascontiguousarray(np.moveaxis(chunks, 1, -1))

    return jax.tree.map(lambda a: jnp.asarray(cut(a)), data)


def guess() -> wj.Guess:
    """That of the paper."""
    lat_deg, lon_deg, height_m = tianshan.FIRST_GUESS
    return wj.Guess.around(wj.geodetic_to_ecef(np.radians(lat_deg), np.radians(lon_deg), height_m), SIGMA_ENU_M)


def extended(model: Model, prior: Belief) -> Belief:
    """The filter that is raced."""
    return run(model, prior, 0, None)[0]


def iterated(model: Model, prior: Belief) -> Belief:
    """Every look linearised again at its own result."""
    return run(model, prior, RELINEARISED, None)[0]


def batch(model: Model, prior: Belief) -> tuple[jax.Array, jax.Array]:
    """Gauss-Newton over all looks."""
    found = solve(model, prior, at_last(model, prior)[0], STEPS, None)
    return found.state, found.covariance


def locate(full: bool, of: Solve = extended) -> Callable[[Drawn], Any]:
    """A pure function of runs in chunks; what `of` returns of each gets (runs,) as first axis."""
    start, errors, surface = guess(), tianshan.frame_errors() if full else (), wj.HeightSurface(0.0)

    def one(data: Drawn) -> Any:
        recorded, pixel_px = data
        looks = wj.Looks(wj.Shot(), pixel_px, (tianshan.PIXEL_SIGMA_PX,) * 2)
        sensor, nuisance = gather(tianshan.sensor(recorded), (), ())
        return of(*Problem(sensor, looks, start, surface, errors, nuisance, None).pose())

    def every(data: Drawn) -> Any:
        found = jax.lax.map(jax.vmap(one, in_axes=-1), data)
        return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), found)

    return every


def arrays(found: Belief) -> cxx.Located:
    """Offset from the guess (runs, 3) and covariance (runs, 3, 3), as the peers return them."""
    return np.stack(found.state, -1), np.stack([np.stack(row, -1) for row in found.covariance], -2)


@cache
def recorded_for_peer(runs: int = RUNS) -> cxx.Recorded:
    """The same runs, or the first of them."""
    recorded, pixel_px = drawn(RUNS, LOOKS, 1)
    return cxx.Recorded(*(np.asarray(a)[:runs] for a in (*dataclasses.astuple(recorded), pixel_px)))


def start_for_peer() -> cxx.Start:
    """The same first guess, its covariance in ECEF axes."""
    lat_deg, lon_deg, _ = tianshan.FIRST_GUESS
    ecef_from_enu = np.asarray(wj.enu_rotation(np.radians(lat_deg), np.radians(lon_deg)))
    return cxx.Start(np.asarray(guess().point_m), ecef_from_enu @ np.diag(np.square(SIGMA_ENU_M)) @ ecef_from_enu.T)


def _ours(full: bool, of: Solve = extended) -> tuple[Callable[[], Any], float]:
    """A prepared call, and the seconds that compiling took."""
    data = in_chunks(drawn(RUNS, LOOKS, 1), LANES)
    executable, compile_s = compiled(locate(full, of), data)
    return lambda: executable(data), compile_s


def _same(ours: Callable[[], Any], peer: Callable[[], Any], runs: int) -> None:
    """Both must be the same filter."""
    for mine, its in zip(arrays(ours()), peer(), strict=True):
        np.testing.assert_allclose(mine[:runs], its, rtol=0, atol=SAME_M)


def _against(peer: Callable[[], Any], full: bool, runs: int = RUNS, note: str = "") -> Measured:
    """The extended filter beside a peer that makes the first `runs` of ours."""
    ours, compile_s = _ours(full)
    _same(ours, peer, runs)
    found = race(ours, peer, items=RUNS * LOOKS, compile_s=compile_s)
    share = runs / RUNS
    return dataclasses.replace(
        found,
        reached=found.reached * share,
        median=found.median * share,
        wall=found.wall * share,
        peer_s=found.peer_s / share,
        note=note or f"peer timed on {runs} runs",
    )


def _given(full: bool, runs: int = RUNS) -> tuple[cxx.Recorded, cxx.Start, cxx.Sigmas, bool]:
    return recorded_for_peer(runs), start_for_peer(), cxx.Sigmas(), full


def against_cxx(full: bool) -> Measured:
    return _against(cxx.prepared(*_given(full)), full, note="the same estimates and covariances")


def with_wide_vectors(full: bool) -> Measured:
    data = in_chunks(drawn(RUNS, LOOKS, 1), LANES)
    executable = jax.jit(locate(full)).lower(data).compile(compiler_options=WIDE)
    ours, peer = lambda: executable(data), cxx.prepared(*_given(full))
    _same(ours, peer, RUNS)
    return race(ours, peer, items=RUNS * LOOKS, note="ours compiled for vectors of 512 bits, which XLA avoids unless told")


def against_matrices(full: bool) -> Measured:
    from .peers.numpy_matrices_location import prepared

    return _against(prepared(*_given(full)), full, note="arrays (runs, 3, 3), as numpy is mostly written")


def against_components(full: bool) -> Measured:
    from .peers.numpy_location import prepared

    return _against(prepared(*_given(full)), full, note="every component an array (runs,), by hand: the fastest numpy")


def against_dynamax(full: bool) -> Measured:
    from .peers.dynamax_location import prepared

    function, numbers = prepared(*_given(full))
    chunks = [jnp.asarray(chunk) for chunk in np.split(np.asarray(numbers), RUNS // LANES, axis=-1)]
    executable, _ = compiled(function, chunks[0])

    def peer() -> list[np.ndarray]:
        return [np.concatenate(parts) for parts in zip(*[executable(c) for c in chunks], strict=True)]

    return _against(peer, full, note=f"under vmap, {LANES} runs at a time: faster than all at once")


def against_filterpy(full: bool) -> Measured:
    from .peers.filterpy_location import prepared

    return _against(prepared(*_given(full, FEW_RUNS)), full, FEW_RUNS)


def against_stone_soup(full: bool) -> Measured:
    from .peers.stonesoup_location import prepared

    return _against(prepared(*_given(full, FEW_RUNS)), full, FEW_RUNS)


for _name, _full in NOISES.items():
    for _suffix, _peer, _asked, _measure in (
        ("", "C++ -O3", 1.1, against_cxx),
        (".wide_vectors", "C++ -O3", 1.1, with_wide_vectors),
        (".numpy", "numpy, matrices", 0.125, against_matrices),
        (".numpy_components", "numpy, components", None, against_components),
        (".dynamax", "dynamax", 0.25, against_dynamax),
        (".filterpy", "filterpy", None, against_filterpy),
        (".stone_soup", "Stone Soup", None, against_stone_soup),
    ):
        _what = f"location from 40 looks, {TOLD[_name]}"
        benchmark(f"location.{_name}{_suffix}", what=_what, peer=_peer, asked=_asked)(partial(_measure, _full))


def _beside_extended(of: Solve, note: str) -> Measured:
    ours, compile_s = _ours(True, of)
    return race(ours, cxx.prepared(*_given(True)), items=RUNS * LOOKS, compile_s=compile_s, note=note)


@benchmark(
    "location.iterated",
    what="location from 40 looks, iterated filter, against the extended one in C++",
    peer="C++, extended",
    asked=None,
)
def iterated_filter() -> Measured:
    return _beside_extended(iterated, f"full noise; each look linearised {1 + RELINEARISED} times")


@benchmark(
    "location.batch", what="location from 40 looks, batch, against the extended filter in C++", peer="C++, extended", asked=None
)
def batch_of_looks() -> Measured:
    return _beside_extended(batch, f"full noise; all looks linearised {1 + STEPS} times")


def _in_own_process(task: str, cores: list[int]) -> dict[str, float]:
    """What a task of many_locations.py prints, in a new process on these cores."""
    return in_own_process("many_locations", task, ",".join(map(str, cores)))


@benchmark("location.both_cores", what="location from 40 looks, full R, on both cores", peer="C++ -O3, two threads", asked=1.2)
def both_cores() -> Measured:
    cores = sorted(one_thread.CORES)[-2:]
    if len(cores) < 2:
        return Measured(reached=0.0, note="there is one core only: not measured")
    found = _in_own_process("race", cores)
    note = "full noise; wall clock of the fastest calls"
    return Measured(
        found["ours_s"] / found["peer_s"], found["median"], None, found["ours_s"], found["peer_s"], RUNS * LOOKS, None, note
    )


@benchmark(
    "location_10000x180.memory",
    what="10,000 locations from 180 looks: peak memory of the process",
    peer="-",
    asked=1.0,
    unit="GB",
)
def memory() -> Measured:
    found = _in_own_process("memory", sorted(one_thread.CORES)[-1:])
    note = "full noise; peak of a process from import to end; {draw_s:.1f} s to draw and {locate_s:.2f} s to locate, one core"
    return Measured(found["peak_gb"], note=note.format(**found))

"""Ten thousand flights that calibrate a scanner and ten thousand that locate with it, in one compiled program.

A run draws a truth from the unknowns' priors and the errors of the recorded poses from their statement, calibrates from 130
control points, flies again with other errors, and locates a target from 40 looks by the scanner that it calibrated: what the
calibration left open is considered. Where everything weighs what it should, the normalised errors of the target are chi-square.

Run in a process of its own, whose CPU seconds and memory are all of it, and with one BLAS thread: on a busy machine several of
them wait for each other a hundred times as long as an inverse of 40 looks takes.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.chained [RUNS]
"""

import json
import resource
import sys
import time
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import whiskjax as wj
from whiskjax.chain.pose import Motion
from whiskjax.flights import haian

from .whiskbroom import calibrated, control_points, recorded

BIAS = wj.FrameErrors(
    "body",
    turn_sigma_rad=tuple(haian.POS_BIAS_RAD.tolist()),
    shift_sigma_m=(haian.POS_BIAS_M,) * 3,
    correlation_s=np.inf,
)
LOOKS, WINDOW_S, SIGMA_PX = 40, 0.15, 2.0
GUESS_M = (20.0, 20.0, 50.0)
SIDE_BY_SIDE = 20


def true_sensor(sensor: wj.Sensor, motion: Motion) -> wj.Sensor:
    """The chain as it was: the recorded pose of the body is the true one, followed by the motion."""
    turn, shift = (jnp.stack([jnp.ravel(c)[0] for c in part]) for part in (motion.turn, motion.shift))
    links = dict(zip(sensor.names, sensor.links, strict=True))
    body = links.pop("body")
    return wj.Sensor({"body": body, "error": wj.Mount(lever_arm_m=-shift, angles_rad=-turn), **links}, sensor.camera)


def looks_at_target() -> tuple[wj.Shot, Array]:
    """Times of the looks, half of them in each swing around the moment when it sees the target; and the target."""
    sensor = calibrated()
    middle = wj.Shot(time_s=np.array(haian.SCENES["L1"][0] + haian.SWING_S / 2), swing=0)
    target = wj.image_to_ground(sensor, middle, np.zeros(2), wj.HeightSurface(haian.GROUND_M)).point_m
    times = []
    for swing, name in enumerate(("L1", "R1")):
        start = haian.SCENES[name][0]
        found = wj.ground_to_image(sensor, wj.Shot(swing=swing), target, (start, start + haian.SWING_S))
        times.append(float(found.time_s) + np.linspace(-WINDOW_S, WINDOW_S, LOOKS // 2))
    swing = np.repeat([0, 1], LOOKS // 2)
    return wj.Shot(time_s=np.concatenate(times), swing=swing), target


def program() -> Callable[[Array], Array]:
    """From a key for each run to the normalised errors squared of the target, (runs,); NaN where a run has no answer."""
    sensor, seen, unknowns = recorded().sensor, control_points(), recorded().unknowns
    shot, target = looks_at_target()
    mean, sigma = (np.array([getattr(x, name) for x in unknowns]) for name in ("mean", "sigma"))
    level = np.asarray(wj.HeightSurface(0.0).level(tuple(target)))
    numbers, keys_of_seen = eqx.partition(seen, eqx.is_inexact_array_like)  # which swing sees a point is static

    def images(key: Array, sensor: wj.Sensor, shot: wj.Shot, point: Array, sigma_px: Array) -> Array:
        """What a flight measures: its own errors of recorded poses, and noise of the image."""
        of_pose, of_image = jax.random.split(key)
        drawn = BIAS.draw(of_pose, wj.Shot(time_s=jnp.zeros(())), sensor)
        exact = wj.project(true_sensor(sensor, drawn), shot, point, throw=False).pixel_px
        return exact + sigma_px * jax.random.normal(of_image, exact.shape, float)

    def chained(keys: Array, sensor: wj.Sensor, numbers: wj.Observations) -> Array:
        seen = eqx.combine(numbers, keys_of_seen)

        def run(key: Array) -> Array:
            of_truth, of_flight, of_looks, of_guess = jax.random.split(key, 4)
            truth = wj.assign(sensor, unknowns, mean + sigma * jax.random.normal(of_truth, mean.shape, float))
            first = eqx.tree_at(lambda o: o.pixel_px, seen, images(of_flight, truth, seen.shot, seen.point_m, seen.sigma_px))
            calibration = wj.calibrate(sensor, first, unknowns, errors=[BIAS]).estimate
            pixel = images(of_looks, truth, shot, jnp.broadcast_to(target, (LOOKS, 3)), jnp.full((LOOKS, 2), SIGMA_PX))
            off = level @ (np.array(GUESS_M) * jax.random.normal(of_guess, (3,), float))
            found = wj.locate(
                sensor,
                wj.Looks(shot, pixel, (SIGMA_PX, SIGMA_PX)),
                guess=wj.Guess.around(target + off, GUESS_M),
                consider=calibration,
                errors=[BIAS],
            )
            error = found.world_from_enu.T @ (found.point_m - target)
            return error @ jnp.linalg.solve(found.covariance_enu_m2, error)

        return jax.lax.map(run, keys, batch_size=SIDE_BY_SIDE)

    # The emitters compile it for half as long again and take twice the memory, and the code is no faster.
    solve = eqx.filter_jit(chained, compiler_options={"xla_cpu_use_fusion_emitters": False})
    return lambda keys: solve(keys, sensor, numbers)


def main(runs: int) -> None:
    jax.config.update("jax_enable_x64", True)
    solve = program()
    keys = jax.random.split(jax.random.key(2024), 2 * runs)
    start = time.process_time()
    jax.block_until_ready(solve(keys[runs:]))
    compiled = time.process_time()
    nees = np.asarray(solve(keys[:runs]))
    took = time.process_time() - compiled
    fine = np.isfinite(nees)
    low, high = wj.nees_band(3, max(int(fine.sum()), 1))
    print(
        json.dumps(
            {
                "runs": runs,
                "without_answer": int((~fine).sum()),
                "nees": float(nees[fine].mean()),
                "nees_band": [low, high],
                "cpu_s": took,
                "compile_cpu_s": compiled - start - took,
                "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
            }
        )
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)

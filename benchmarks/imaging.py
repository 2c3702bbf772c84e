"""Image -> ground and ground -> image through the general chain, against C++ written for the whiskbroom scanner alone.

Ours is the public door as a user calls it: checks, result codes and all. Every pixel has its own time.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from whiskjax.flights import haian

from . import peers
from .suite import benchmark
from .timing import Measured, race
from .whiskbroom import LEFT, calibrated, for_peer

PIXELS = 100_000
HEIGHT_M = 10.0
START_S = haian.SCENES["L1"][0]
MARGIN_S = 0.5 * haian.MARGIN_S
WINDOW_S = START_S - MARGIN_S, START_S + haian.SWING_S + MARGIN_S
SAME_M = 2e-8  # a few roundings of an ECEF coordinate
# The search ends after a fixed number of steps, here and there; where it has to cross a kink of the POS it leaves this much.
SAME_PX, SAME_PX_99 = 5e-4, 1e-6


def _pixels() -> tuple[np.ndarray, np.ndarray]:
    """Times in the order of the scan, and samples, of the first left swing."""
    rng = np.random.default_rng(20241)
    time_s = np.sort(rng.uniform(START_S, START_S + haian.SWING_S, PIXELS))
    return time_s, rng.uniform(-haian.HALF_LINE_PX, haian.HALF_LINE_PX, PIXELS)


def _first(run) -> float:
    """Seconds of the first call, in which everything is traced and compiled."""
    start = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - start


@benchmark("image_to_ground", what="image to ground, POS interpolated for every pixel", peer="C++ -O3", asked=1.0)
def image_to_ground() -> Measured:
    time_s, sample_px = _pixels()
    sensor, flight = calibrated(), for_peer(LEFT)
    shot, surface = wj.Shot(time_s=time_s, swing=LEFT), wj.HeightSurface(HEIGHT_M)
    pixel_px = jnp.stack([jnp.asarray(sample_px), jnp.zeros(PIXELS)], -1)

    def ours():
        return wj.image_to_ground(sensor, shot, pixel_px, surface).point_m

    def peer():
        return peers.image_to_ground(flight, time_s, sample_px, HEIGHT_M)

    compile_s = _first(ours)
    np.testing.assert_allclose(ours(), peer(), rtol=0, atol=SAME_M)
    return race(ours, peer, items=PIXELS, compile_s=compile_s)


@benchmark("ground_to_image", what="ground to image, search for the line", peer="C++ -O3", asked=1.5)
def ground_to_image() -> Measured:
    sensor, flight = calibrated(), for_peer(LEFT)
    point_m = peers.image_to_ground(flight, *_pixels(), HEIGHT_M)
    shot, point = wj.Shot(swing=LEFT), jnp.asarray(point_m)

    def ours():
        found = wj.ground_to_image(sensor, shot, point, WINDOW_S)
        return found.time_s, found.pixel_px

    def peer():
        return peers.ground_to_image(flight, point_m, WINDOW_S)

    compile_s = _first(ours)
    (our_s, our_px), (peer_s, peer_px) = ours(), peer()
    for difference_px in ((our_s - peer_s) * haian.LINES_HZ, our_px[:, 0] - peer_px):
        difference_px = np.abs(difference_px)
        assert difference_px.max() < SAME_PX and np.quantile(difference_px, 0.99) < SAME_PX_99
    return race(ours, peer, items=PIXELS, compile_s=compile_s)

"""One run of tianshan, shared by the tests of this room: what is compiled for it is compiled once."""

import dataclasses
import functools

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from tests.locate.textbooks import Chain, enu
from whiskjax.flights import tianshan

SIGMA_ENU_M = np.array([1216.0, 1666.0, 1500.0])
PIXEL_SIGMA_PX = (2.0, 2.0)


@dataclasses.dataclass(frozen=True)
class Run:
    """Recorded poses and pixels of one run, as whiskjax takes them and as the textbook does."""

    scene: tianshan.Scene
    recorded: tianshan.Recorded
    pixel_px: np.ndarray

    @functools.cached_property
    def sensor(self):
        return tianshan.sensor(self.recorded)

    @functools.cached_property
    def chain(self):
        return Chain(self.recorded)

    @functools.cached_property
    def time_s(self):
        return tianshan.time_s(self.scene)

    @functools.cached_property
    def looks(self):
        return self.looks_at(self.pixel_px)

    def looks_at(self, pixel_px):
        return wj.Looks(wj.Shot(time_s=self.time_s), pixel_px, PIXEL_SIGMA_PX)

    @functools.cached_property
    def target_m(self):
        lat, lon, height = self.scene.target
        return oracles.ecef(np.radians(lat), np.radians(lon), height)

    @functools.cached_property
    def anchor_m(self):
        """The first guess that the paper prints."""
        lat, lon, height = tianshan.FIRST_GUESS
        return oracles.ecef(np.radians(lat), np.radians(lon), height)

    @functools.cached_property
    def guess(self):
        return wj.Guess.around(self.anchor_m, SIGMA_ENU_M)

    @functools.cached_property
    def prior(self):
        """Covariance of the guess in the axes of the world."""
        axes = enu(self.anchor_m)
        return axes @ np.diag(SIGMA_ENU_M**2) @ axes.T

    def image(self, k, state, w):
        """The textbook's measurement: the state is the way from the first guess."""
        return self.chain.image(k, self.anchor_m + state[:3], w)

    def locate(self, looks=None, **options):
        options.setdefault("guess", self.guess)
        return wj.locate(options.pop("sensor", self.sensor), self.looks if looks is None else looks, **options)


def draw(seed, run=0, **scene):
    scene = tianshan.Scene(**scene)
    recorded, pixel = tianshan.draw_runs(scene, run + 1, seed)
    return Run(scene, jax.tree.map(lambda a: a[run], recorded), np.asarray(pixel[run]))


@pytest.fixture(scope="session")
def run():
    """40 looks from the orbit."""
    return draw(5)

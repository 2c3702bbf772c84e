"""A link, a camera and a surface of somebody else, from the page that explains them, take part in everything by public names."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj

PAGE = (Path(__file__).parents[2] / "docs" / "conventions.md").read_text()
TIME_S, RNG = np.arange(12.0), np.random.default_rng(2)


@pytest.fixture(scope="module")
def own():
    """The names that the page's block defines."""
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names = {}
    exec(compile(block, "docs/conventions.md", "exec"), names)
    return names


def textbook(point, sway_m=2.0, focal_px=1000.0):
    """Angle off the axis by arccos, the stereographic radius by tan; a mast of 5 km that swings along y."""
    away = point - np.stack([0 * TIME_S, sway_m * np.sin(2 * np.pi * TIME_S / 8.0), 0 * TIME_S + 5000.0], axis=-1)
    angle = np.arccos(-away[:, 2] / np.linalg.norm(away, axis=1))
    radius = 2 * focal_px * np.tan(angle / 2) / np.hypot(away[:, 0], away[:, 1])
    return radius[:, None] * away[:, :2] * [1, -1]


def test_it_images_and_comes_down(own):
    pixel = RNG.uniform(-400, 400, (len(TIME_S), 2))
    ground = wj.image_to_ground(own["sensor"], wj.Shot(time_s=TIME_S), pixel, own["Ball"](jnp.array(4000.0))).point_m
    np.testing.assert_allclose(np.linalg.norm(ground, axis=1), 4000.0, rtol=1e-14)
    np.testing.assert_allclose(textbook(np.asarray(ground)), pixel, rtol=0, atol=1e-8)
    with pytest.raises(wj.SensorError, match="the ray misses the ground"):
        wj.image_to_ground(own["sensor"], wj.Shot(time_s=0.0), [2000.0, 0.0], own["Ball"](jnp.array(4000.0)))


def test_it_is_calibrated_and_differentiated(own):
    point = RNG.normal(0, 800, (len(TIME_S), 3)) + [0, 0, 3000]
    every = np.ones(len(point), dtype=bool)
    pixel = textbook(point, 1.7, 1010.0)
    seen = wj.Observations(wj.Shot(time_s=TIME_S), point, pixel, np.ones_like(pixel), every)
    unknowns = [wj.Unknown("sway", "sway.sway_m", scale=1.0), wj.Unknown("f", "camera.focal_px", scale=10.0)]
    found = wj.calibrate(own["sensor"], seen, unknowns)
    np.testing.assert_allclose(found.value, [1.7, 1010.0], rtol=1e-9)

    def image(values):
        return wj.project(wj.assign(own["sensor"], unknowns, values), wj.Shot(time_s=TIME_S), point, throw=False).pixel_px

    step = np.array([1e-2, 1.0])
    slope = [(textbook(point, *([2.0, 1e3] + h)) - textbook(point, *([2.0, 1e3] - h))) / (2 * h.sum()) for h in np.diag(step)]
    np.testing.assert_allclose(jax.jacfwd(image)(jnp.array([2.0, 1e3])), np.stack(slope, axis=-1), rtol=1e-7, atol=1e-7)

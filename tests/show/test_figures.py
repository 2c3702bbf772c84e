"""Figures: drawn for every kind of flight without a warning, with something on them, and without global traces."""

import copy
import dataclasses
import io
import zlib

import matplotlib
import numpy as np
import pytest
from PIL import Image as Picture

from tests.show.conftest import made_up
from whiskjax.show.calibration.correlation_map import draw_correlations
from whiskjax.show.calibration.shrinkage import draw_shrinkage
from whiskjax.show.calibration.summary import summarise
from whiskjax.show.calibration.trends import draw_trends
from whiskjax.show.calibration.vectors import draw_vectors
from whiskjax.show.style import robust_limit, round_number


def ink_of(drawing):
    """Share of the pixels that are not white; the picture must be whole."""
    png = drawing.png
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    with Picture.open(io.BytesIO(png)) as picture:
        pixels = np.asarray(picture.convert("L"))
    assert 400 < pixels.shape[1] <= 1500 and pixels.shape[0] < 3000
    return (pixels < 250).mean()


def test_all_of_a_calibration(drawings):
    assert [d.name for d in drawings] == ["residual_vectors", "residual_trends", "prior_posterior", "correlations"]
    for drawing in drawings:
        assert ink_of(drawing) > 0.02
        assert drawing.caption.endswith(".") and len(drawing.caption) > 80


CASES = {
    "one image": made_up(1, 150),
    "one point": made_up(1, 1),
    "three images": made_up(3, 40),
    "many images": made_up(68, 30),
    "one crowded image": made_up(1, 600),
    "a look an image": made_up(80, 1, time=True),
    "tracking": made_up(80, 1, spread=False, time=True),
    "a blunder": dataclasses.replace(made_up(2, 50), after_px=np.concatenate([made_up(2, 50).after_px[:-1], [[1e4, -1e4]]])),
    "not finite": dataclasses.replace(made_up(2, 20), after_px=np.full((40, 2), np.nan)),
    "perfect": dataclasses.replace(made_up(2, 20), after_px=np.zeros((40, 2))),
}


@pytest.mark.parametrize("case", CASES)
def test_residuals_of_any_flight(case):
    for drawing in (draw_vectors(CASES[case]), draw_trends(CASES[case])):
        assert ink_of(drawing) > 0.005


def test_what_is_left_out_is_said():
    caption = draw_vectors(CASES["many images"]).caption
    assert "3 of 68 images" in caption and "pools all images" in caption and "means over cells" in caption
    assert "means over cells" in draw_vectors(CASES["one crowded image"]).caption
    assert "Shown:" not in draw_vectors(CASES["three images"]).caption
    assert "beyond the axes are drawn at their edge (2)" in draw_trends(CASES["a blunder"]).caption


@pytest.mark.parametrize("k", [1, 2, 5, 30])
def test_any_number_of_unknowns(summary, k):
    s = copy.deepcopy(summary)
    s["parameters"] = [s["parameters"][i % 15] | {"name": f"an_unknown_{i}"} for i in range(k)]
    rho = np.corrcoef(np.random.default_rng(0).normal(size=(k, 40))).reshape(k, k)
    s["correlation"] |= {"names": [p["name"] for p in s["parameters"]], "matrix": rho.tolist()}
    assert ink_of(draw_shrinkage(s)) > 0.01
    assert ink_of(draw_correlations(s)) > 0.01


def test_unknowns_that_nothing_determines(undetermined):
    s = summarise(*undetermined)
    assert ink_of(draw_shrinkage(s)) > 0.01
    assert "nothing determines" in draw_correlations(s).caption


def test_no_global_state_and_the_same_bytes(residuals):
    before = dict(matplotlib.rcParams)
    first, second = (zlib.crc32(draw_trends(residuals).png) for _ in range(2))
    assert first == second
    assert dict(matplotlib.rcParams) == before
    assert not matplotlib._pylab_helpers.Gcf.figs  # pyplot's list of figures, which would grow


def test_scales():
    assert [round_number(x) for x in (0.7, 1, 9.99, 430, 0.0, np.nan)] == [0.5, 1, 5, 200, 1, 1]
    ordinary = np.linspace(-1, 1, 101)
    assert robust_limit(ordinary) == pytest.approx(1.08)
    assert robust_limit(np.append(ordinary, 1e6)) < 10

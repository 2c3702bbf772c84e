"""Figures of an adjusted block: any block is drawn, axes have units, and what is left out is said."""

import io

import matplotlib
import numpy as np
import pytest
from PIL import Image as Picture

from tests.show.block_made_up import CASES, made
from whiskjax.show.block.charts import (
    _in_cells,
    draw_charts,
    draw_corrections,
    draw_detector,
    draw_point_errors,
    draw_point_sigmas,
    draw_residual_vectors,
)

ALL = ["residual_vectors", "point_errors", "detector_residuals", "trajectory_corrections", "point_sigmas"]
LACKING = {"failed": {"point_sigmas"}, "ties only": {"point_errors"}, "trajectory kept": {"trajectory_corrections"}}


@pytest.mark.parametrize("case", CASES)
def test_any_block_is_drawn(case):
    drawings = draw_charts(made(case))
    assert [drawing.name for drawing in drawings] == [name for name in ALL if name not in LACKING.get(case, ())]
    for drawing in drawings:
        with Picture.open(io.BytesIO(drawing.png)) as picture:
            assert (np.asarray(picture.convert("L")) < 250).mean() > 0.005
        assert drawing.caption.endswith(".") and len(drawing.caption) > 80


def labels(drawing):
    found = [(axes.get_xlabel(), axes.get_ylabel()) for axes in drawing.figure.axes]
    return [x for x, _ in found if x], [y for _, y in found if y]


def test_axes_have_units():
    assert labels(draw_residual_vectors(made("sound"))) == (["east (km)"] * 3, ["north (km)"])
    assert labels(draw_point_errors(made("sound"))) == (["east (km)"] * 2, ["north (km)"])
    x, y = labels(draw_detector(made("sound")))
    assert x == ["sample (px)"] * 3 and y == ["x residual, along the line (px)", "y residual, across the line (px)"]
    assert labels(draw_detector(made("frames")))[0] == ["column (px)", "row (px)"]
    x, y = labels(draw_corrections(made("sound"), made("sound").course))
    assert x == ["s after 0 s", "s after 490 s"] and y[0] == "turn x\n(mdeg)" and y[-1] == "shift z\n(cm)"
    assert labels(draw_point_sigmas(made("sound")))[0] == ["1-sigma (cm)"] * 3


def test_maps_are_to_scale_and_views_have_panels():
    figure = draw_residual_vectors(made("sound")).figure
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        f"{v}: means of cells" for v in ("forward", "nadir", "backward")
    ]
    assert all(axes.get_aspect() == 1 for axes in figure.axes)
    few = draw_residual_vectors(made("frames")).figure
    assert [axes.get_title(loc="left") for axes in few.axes] == ["all images"]


def test_an_axis_that_is_kept_is_not_drawn():
    """The made-up scanner holds turns about y."""
    y = labels(draw_corrections(made("lines over the Earth"), made("lines over the Earth").course))[1]
    assert [text.split("\n")[0] for text in y] == ["turn x", "turn z", "shift x", "shift y", "shift z"]


def test_a_wrong_ray_that_is_left_out_does_not_set_the_scale():
    top = draw_detector(made("left out")).figure.axes[0].get_ylim()[1]
    assert top < 5  # of residuals of half a pixel; the wrong one has 50


def test_means_of_cells_are_means():
    place = np.array([[0.0, 0], [0.1, 0.1], [0.2, 0], [10, 10], [10, 10], [10, 10], [0, 10]])
    vector = np.arange(14.0).reshape(7, 2)
    where, mean = _in_cells(place, vector)
    np.testing.assert_allclose(where, [[0.1, 0.1 / 3], [10, 10]])
    np.testing.assert_allclose(mean, [[2, 3], [8, 9]])


def test_no_global_state():
    before = dict(matplotlib.rcParams)
    assert draw_point_errors(made("sound")).png == draw_point_errors(made("sound")).png
    assert dict(matplotlib.rcParams) == before and not matplotlib._pylab_helpers.Gcf.figs

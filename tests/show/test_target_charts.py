"""Figures of a located target: axes with units, equal scales, everything said that is left out, and no global traces."""

import io

import matplotlib
import numpy as np
import pytest
from PIL import Image as Picture

from tests.show.target_made_up import CASES, made
from whiskjax.show.target.charts import draw_charts, draw_convergence, draw_ellipse, draw_innovations

ALL = ["error_ellipse", "convergence", "innovations"]
DRAWN = {case: ALL for case in CASES} | {"one look": [], "batch": ["error_ellipse", "innovations"]}


def labels(drawing):
    return [axes.get_ylabel() for axes in drawing.figure.axes], [axes.get_xlabel() for axes in drawing.figure.axes]


@pytest.mark.parametrize("case", CASES)
def test_any_case_is_drawn(case):
    drawings = draw_charts(made(case))
    # A filter that ignores the noise of the poses may end with or without an answer.
    expected = DRAWN[case] if made(case).is_answered else DRAWN[case][2:]
    assert [drawing.name for drawing in drawings] == expected
    for drawing in drawings:
        with Picture.open(io.BytesIO(drawing.png)) as picture:
            assert (np.asarray(picture.convert("L")) < 250).mean() > 0.005
        assert drawing.caption.endswith(".") and len(drawing.caption) > 80


def test_ellipse_is_to_scale_and_in_metres():
    sighting = made("sound")
    figure = draw_ellipse(sighting).figure
    plan, side = figure.axes[0], figure.axes[0].child_axes[0]
    assert plan.get_xlabel() == "east of the estimate (m)" and plan.get_ylabel() == "north of the estimate (m)"
    assert side.get_title() == "up (m)" and plan.get_aspect() == 1 and side.get_ylim() == plan.get_ylim()
    covariance = np.asarray(sighting.location.covariance_enu_m2)
    ninety, fifty = plan.patches
    # Area of an ellipse of probability p: pi chi2(p) sqrt(det C), with chi2(0.9) = 4.605, chi2(0.5) = 1.386.
    for patch, quantile in ((ninety, 4.605170), (fifty, 1.386294)):
        area = np.pi / 4 * patch.width * patch.height
        assert area == pytest.approx(np.pi * quantile * np.sqrt(np.linalg.det(covariance[:2, :2])), rel=1e-5)
    # Along the ellipse's long axis, in the direction in which it is drawn, the variance is that of the half-axis.
    along = np.array([np.cos(np.radians(ninety.angle)), np.sin(np.radians(ninety.angle))])
    assert along @ covariance[:2, :2] @ along == pytest.approx((ninety.width / 2) ** 2 / 4.605170, rel=1e-5)


def test_arrows_point_to_the_platform():
    sighting = made("sound")
    plan = draw_ellipse(sighting).figure.axes[0]
    arrows = [text for text in plan.texts if text.get_text() == ""]
    assert [text.get_text() for text in plan.texts if text.get_text()] == [
        "to the platform,\nfirst look",
        "to the platform,\nlast look",
    ]
    for arrow, i in zip(arrows, (0, -1), strict=True):
        away = sighting.enu(sighting.platform_m[i])[:2]
        tip = np.array(arrow.xy)
        np.testing.assert_allclose(tip / np.hypot(*tip), away / np.hypot(*away), rtol=0, atol=1e-12)


def test_convergence_and_innovations_have_units():
    y, x = labels(draw_convergence(made("sound")))
    assert y == ["east (m)", "north (m)", "up (m)", "sigma, error (m)"] and x == ["", "", "look", "look"]
    assert labels(draw_convergence(made("position unknown")))[0][-1] == "sigma (m)"
    y, x = labels(draw_innovations(made("sound")))
    assert y == ["x, column (px)", "y, row (px)", "NIS (no unit)"] and x[-1] == "look"


def test_a_gated_look_is_marked_and_said_to_be_beyond():
    drawing = draw_innovations(made("gated"))
    words = [text.get_text() for text in drawing.figure.legends[0].get_texts()]
    assert words == ["used", "gated", "± 2 sigma", "NIS bound (the gate, 0.001)"]
    assert "beyond the axes are drawn at their edge" in drawing.caption
    crosses = [line for line in drawing.figure.axes[2].lines if line.get_marker() == "X"]
    assert [line.get_xdata().tolist() for line in crosses] == [[7]]


def test_a_target_without_a_position_shows_none():
    drawing = draw_ellipse(made("position unknown"))
    assert "given position" not in drawing.caption
    assert not [line for line in drawing.figure.axes[0].lines if line.get_marker() == "^"]


def test_no_global_state():
    before = dict(matplotlib.rcParams)
    assert draw_ellipse(made("sound")).png == draw_ellipse(made("sound")).png
    assert dict(matplotlib.rcParams) == before and not matplotlib._pylab_helpers.Gcf.figs

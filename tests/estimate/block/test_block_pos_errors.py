"""Errors of POS: their rows against textbook covariances."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline

import whiskjax as wj

START_S, SPACING_S, NODES = (10.0, 300.0), 4.0, (6, 9)
SIGMA: dict[str, Any] = {"turn_sigma_rad": (1e-4, 2e-4, 0.0), "shift_sigma_m": (0.05, 0.1, 0.2)}
CORRELATION: dict[str, Any] = {"turn_correlation_s": (60.0, 7.0, 120.0), "shift_correlation_s": (300.0, 3.0, 1.0)}
BASES = {
    "orientation images": wj.OrientationImages(START_S, SPACING_S, NODES),
    "spline": wj.Spline(START_S, SPACING_S, NODES),
}


def sensor(link):
    return wj.Sensor({"pos": link}, wj.FrameCamera(100.0, (0.0, 0.0)))


def epochs(kind):
    """Times of one segment at which POS observes, and the coefficients' weights there by scipy."""
    for start, n in zip(START_S, NODES, strict=True):
        t = start + SPACING_S * np.arange(n)
        if kind == "orientation images":
            yield t, np.eye(n)
            continue
        at = np.sort([*t[1:-1], 0.5 * (t[1] + t[2]), 0.5 * (t[-3] + t[-2])])
        rows = [BSpline.basis_element(k + SPACING_S * np.arange(-2, 3), False)(at) for k in t]
        yield at, np.nan_to_num(np.stack(rows, axis=-1))  # NaN beyond four intervals


@pytest.mark.parametrize("kind", BASES)
@pytest.mark.parametrize("correlated", [True, False])
def test_rows_are_those_of_the_covariance(kind, correlated):
    """R^T R = B^T C^-1 B with C = exp(-|dt| / tau) in a segment and nothing between segments."""
    errors = wj.PosErrors("pos", **SIGMA, **(CORRELATION if correlated else {}))
    roots = errors.roots(sensor(wj.Correction(BASES[kind])))
    assert roots.shape == (6, sum(NODES), sum(NODES))
    for axis in range(6):
        expected, last = np.zeros((sum(NODES),) * 2), 0
        for t, rows in epochs(kind):
            tau = errors.correlation_s[axis]
            covariance = np.eye(len(t)) if tau is None else np.exp(-np.abs(t[:, None] - t) / tau)
            n = len(t)
            expected[last : last + n, last : last + n] = rows.T @ np.linalg.solve(covariance, rows)
            last += n
        np.testing.assert_allclose(roots[axis].T @ roots[axis], expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_rows_without_time():
    """Images are independent; nothing recorded is no row, but an axis with sigma zero stays."""
    frames = sensor(wj.PosePerImage(np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1))))
    np.testing.assert_array_equal(wj.PosErrors("pos", **SIGMA).roots(frames), np.broadcast_to(np.eye(3), (6, 3, 3)))
    free = wj.PosErrors("pos", **SIGMA, observed=False).roots(frames)
    np.testing.assert_array_equal(free[[0, 1, 3, 4, 5]], 0.0)
    np.testing.assert_array_equal(free[2], np.eye(3))
    with pytest.raises(wj.WhiskjaxError, match="pos has no nodes in time"):
        wj.PosErrors("pos", **SIGMA, **CORRELATION).roots(frames)
    with pytest.raises(wj.WhiskjaxError, match="pos is a Mount; a Correction or a PosePerImage is needed"):
        wj.PosErrors("pos", **SIGMA).roots(sensor(wj.Mount()))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"turn_sigma_rad": (1e-4, -1e-4, 0.0)}, r"turn_sigma_rad is -0.0001 at index \(1,\); it must be 0 or more"),
        ({"shift_sigma_m": (0.1, np.nan, 0.0)}, "shift_sigma_m holds no finite number"),
        ({"shift_sigma_m": (0.1, 0.1)}, r"shift_sigma_m has shape \(2,\), expected \(3,\)"),
        ({"turn_correlation_s": (1.0, 0.0, 1.0)}, r"turn_correlation_s is 0 at index \(1,\); it must be above 0"),
        ({"shift_correlation_s": (1.0, np.inf, 1.0)}, "shift_correlation_s holds no finite number"),
        ({"turn_sigma_rad": (0.0,) * 3, "shift_sigma_m": (0.0,) * 3}, "all sigmas are zero"),
    ],
)
def test_senseless_errors_are_refused(change, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.PosErrors("pos", **(SIGMA | change))

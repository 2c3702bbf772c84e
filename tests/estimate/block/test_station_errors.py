"""Errors at stations: their rows against textbook covariances."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

import whiskjax as wj
from tests.estimate.block.conftest import SCENE
from tests.estimate.block.frames import FREE, POS, frames
from whiskjax.estimate.block.station_errors import at_stations
from whiskjax.flights import songshan

START_S, SPACING_S, NODES = (10.0, 300.0), 4.0, (6, 9)
SIGMA: dict[str, Any] = {"turn_sigma_rad": (1e-4, 2e-4, 0.0), "shift_sigma_m": (0.05, 0.1, 0.2)}
CORRELATION_S = (60.0, 7.0, 120.0, 300.0, 3.0, 1.0)
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


def of(sensor, *errors):
    found = at_stations("adjust", errors, sensor)
    assert found is not None
    return found


def covariance_at(t, sigma, tau):
    return sigma**2 * (np.eye(len(t)) if tau == 0 else np.exp(-np.abs(t[:, None] - t) / tau))


def information(kind, statements, axis, whole=False):
    """B^T C^-1 B of one axis with C the sum over (sigma, tau), nothing between segments; `whole`: on through the gaps."""
    parts, n = list(epochs(kind)), sum(NODES)
    t = np.concatenate([part[0] for part in parts])
    rows, segment = np.zeros((n, n)), np.repeat([0, 1], NODES)
    rows[: NODES[0], : NODES[0]], rows[NODES[0] :, NODES[0] :] = parts[0][1], parts[1][1]
    c = sum(covariance_at(t, sigma[axis], tau[axis]) for sigma, tau in statements)
    if not whole:
        c = np.where(segment[:, None] == segment, c, 0.0)
    return rows.T @ np.linalg.solve(c, rows)


def check_rows(found, sensor, kind, statements, **how):
    roots = found.roots(sensor)
    assert roots.shape == (6, sum(NODES), sum(NODES))
    for axis in range(6):
        if found.sigma[axis] == 0:
            continue  # whose motions stay as they are
        expected = information(kind, statements, axis, **how) * found.sigma[axis] ** 2
        np.testing.assert_allclose(roots[axis].T @ roots[axis], expected, rtol=0, atol=1e-10 * np.abs(expected).max())


SIX = (*SIGMA["turn_sigma_rad"], *SIGMA["shift_sigma_m"])


@pytest.mark.parametrize("kind", BASES)
@pytest.mark.parametrize("tau", [CORRELATION_S, (0.0,) * 6], ids=["wandering", "white"])
@pytest.mark.parametrize("anew", ["strip", "flight"])
def test_rows_are_those_of_the_covariance(kind, tau, anew):
    """R^T R = B^T C^-1 B with C = exp(-|dt| / tau); drawn anew in a strip, with nothing between segments."""
    corrected = sensor(wj.Correction(BASES[kind]))
    found = of(corrected, wj.FrameErrors("pos", **SIGMA, correlation_s=tau, anew=anew))
    np.testing.assert_array_equal(found.sigma, SIX)
    check_rows(found, corrected, kind, [(SIX, tau)], whole=anew == "flight")


@pytest.mark.parametrize("kind", BASES)
def test_statements_add(kind):
    """A drift of minutes and a vibration: the sum of both covariances."""
    corrected = sensor(wj.Correction(BASES[kind]))
    shaking = (3e-5, 1e-4, 0.0, 0.1, 0.01, 0.02), (0.7, 0.0, 0.7, 2.0, 0.0, 1.5)
    more = wj.FrameErrors("pos", shaking[0][:3], shaking[0][3:], shaking[1], anew="strip")
    found = of(corrected, wj.FrameErrors("pos", **SIGMA, correlation_s=CORRELATION_S, anew="strip"), more)
    np.testing.assert_allclose(found.sigma, np.hypot(SIX, shaking[0]), rtol=1e-15)
    check_rows(found, corrected, kind, [(SIX, CORRELATION_S), shaking])


@pytest.mark.parametrize("anew", ["strip", "flight"])
def test_a_constant_adds(anew):
    """Beside what wanders, a bias of each strip, or of all, is sigma^2 in all covariances."""
    corrected = sensor(wj.Correction(BASES["orientation images"]))
    bias = wj.FrameErrors("pos", (2e-4, 2e-4, 0.0), (0.1, 0.2, 0.1), np.inf, anew=anew)
    found = of(corrected, wj.FrameErrors("pos", **SIGMA, correlation_s=CORRELATION_S, anew="strip"), bias)
    t, segment = np.concatenate([part[0] for part in epochs("orientation images")]), np.repeat([0, 1], NODES)
    same = segment[:, None] == segment
    for axis in (0, 1, 3, 4, 5):
        drift = np.where(same, covariance_at(t, SIX[axis], CORRELATION_S[axis]), 0.0)
        constant = (same if anew == "strip" else 1.0) * np.asarray(bias.sigma[axis]) ** 2
        root = found.roots(corrected)[axis] / found.sigma[axis]
        np.testing.assert_allclose(root @ (drift + constant) @ root.T, np.eye(len(t)), rtol=0, atol=1e-9)


def test_a_sigma_for_each_image():
    """Rows are as many times shorter as a sigma is larger than that in which motions are counted."""
    three = sensor(wj.PosePerImage(np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1))))
    each = np.array([0.1, 0.2, 0.4])
    found = of(three, wj.FrameErrors("pos", SIGMA["turn_sigma_rad"], (each, 0.3, 0.3)))
    root = found.roots(three)[3]
    np.testing.assert_allclose(np.diag(root) / found.sigma[3], 1 / each, rtol=1e-14)
    assert np.count_nonzero(root) == 3
    with pytest.raises(wj.WhiskjaxError, match="the sigma of shift x has 2 values; one positive number, or one for each"):
        of(three, wj.FrameErrors("pos", shift_sigma_m=(each[:2], 0.3, 0.3)))


def test_rows_without_time():
    """Images are independent; nothing recorded is no row, but an axis with sigma zero stays."""
    three = sensor(wj.PosePerImage(np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1))))
    for more in ({}, {"correlation_s": np.inf, "anew": "image"}):
        np.testing.assert_array_equal(
            of(three, wj.FrameErrors("pos", **SIGMA, **more)).roots(three), np.broadcast_to(np.eye(3), (6, 3, 3))
        )
    free = of(three, wj.FrameErrors("pos", **SIGMA), wj.FrameErrors("pos", (np.inf, np.inf, 0), (np.inf,) * 3))
    np.testing.assert_array_equal(free.roots(three)[[0, 1, 3, 4, 5]], 0.0)
    np.testing.assert_array_equal(free.roots(three)[2], np.eye(3))
    np.testing.assert_array_equal(free.sigma, SIX)
    with pytest.raises(wj.WhiskjaxError, match="pos has no nodes in time"):
        of(three, wj.FrameErrors("pos", **SIGMA, correlation_s=CORRELATION_S)).roots(three)


def test_a_start_of_which_nothing_is_said():
    """A tenth of a radian, and of the median distance to the control points; the solution is the same."""
    sensor, block, *_ = frames()
    free = FREE[1]
    found = at_stations("adjust", [free], sensor, block)
    assert found is not None and found.free == (True,) * 6 and not found.observed
    control = block.keep((block.role == "control")[block.point])
    pose = sensor.pose(control.shots()).translation
    away = np.linalg.norm(block.position_m[control.point] - np.stack(pose, axis=-1), axis=1)
    np.testing.assert_allclose(found.sigma, [0.1] * 3 + [0.1 * np.median(away)] * 3, rtol=1e-12)
    one, other = (wj.adjust(sensor, block, errors=errors) for errors in (FREE, [free]))
    np.testing.assert_allclose(one.point_m, other.point_m, rtol=0, atol=1e-5)
    assert one.freedom == other.freedom and one.cost == pytest.approx(other.cost, rel=1e-8)


PHOTO = {"frame": "photo", "shift_sigma_m": (1.0,) * 3}
REFUSED = {
    "a mount": ({"frame": "mount"}, "mount is a Mount; a Correction or a PosePerImage is needed"),
    "no frame": ({"frame": "head"}, "no frame named 'head'; there are photo, mount, wave"),
    "constant": ({"correlation_s": np.inf}, r"shift x errs by a constant, which is an unknown: motion_unknowns\(\)"),
    "free and level": ({"axes": "level", "shift_sigma_m": (np.inf,) * 3}, "are infinite along level axes"),
    "nothing": ({"shift_sigma_m": (0.0,) * 3}, "all sigmas are zero, so the trajectory would not change: leave errors out"),
    "half free": ({"shift_sigma_m": (1.0, np.inf, 1.0)}, "some sigmas are infinite and others are not; make two statements"),
    "by swing": ({"frame": "wave", "correlation_s": 5.0, "anew": "swing"}, "nodes in time know anew=.strip., their segments"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_stations_cannot_have_is_refused(case):
    change, message = REFUSED[case]
    sensor, block, *_ = frames()
    links = {"photo": sensor["photo"], "mount": wj.Mount(), "wave": wj.Correction(BASES["spline"])}
    with pytest.raises(wj.WhiskjaxError, match=f"adjust: .*{message}|{message}"):
        wj.adjust(wj.Sensor(links, sensor.camera), block, errors=[wj.FrameErrors(**(PHOTO | change))])


def test_errors_of_two_links_are_refused():
    sensor, block, *_ = frames()
    both = wj.Sensor({"photo": sensor["photo"], "wave": wj.Correction(BASES["spline"])}, sensor.camera)
    with pytest.raises(wj.WhiskjaxError, match="adjust: errors of photo and wave; the motions of one link are estimated"):
        wj.adjust(both, block, errors=[*POS, wj.FrameErrors("wave", **SIGMA)])


def test_segments_that_touch_cannot_go_on():
    touching = sensor(wj.Correction(wj.OrientationImages((0.0, 20.0), 4.0, (6, 6))))
    with pytest.raises(wj.WhiskjaxError, match=r"two nodes lie 0 s apart.*anew=.strip. only"):
        of(touching, wj.FrameErrors("pos", **SIGMA, correlation_s=60.0)).roots(touching)


@pytest.mark.parametrize("axes", ["frame", "level"])
def test_sigmas_and_memories_may_be_traced(axes):
    """What the record says, by sigmas and a correlation time: traced as on the host, and its derivative by differences."""
    of = songshan.simulate_block(SCENE, 2).sensor
    surface = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))

    def information(t):
        turn = tuple(1e-4 * (1 + 0.2 * t[0]) * c for c in (1.0, 0.8, 2.0))
        told = [
            wj.FrameErrors("pos_error", turn, (0, 0, 0), 60.0 + 5.0 * t[1], anew="strip"),
            wj.FrameErrors("pos_error", (2e-5,) * 3, tuple(0.05 + 0.01 * t[2] * c for c in (1.0, 0.0, 2.0)), axes=axes),
        ]
        motions = at_stations("adjust", told, of, surface=surface)
        roots = motions.roots(of)
        unit = jnp.repeat(motions.sigma, roots.shape[-1] * len(roots) // 6).reshape(len(roots), 1, -1)
        whitened = roots / unit  # of motions in radians and metres
        return jnp.sqrt(jnp.einsum("gri,gri->gi", whitened, whitened)).ravel() * 1e-4

    at = jnp.array([0.3, -0.4, 0.2])
    traced, host = jax.jit(information)(at), information(np.asarray(at))
    np.testing.assert_allclose(traced, host, rtol=1e-8)
    forward, reverse = jax.jit(jax.jacfwd(information))(at), jax.jit(jax.jacrev(information))(at)

    def differences(step):
        return np.stack([(information(at + step * e) - information(at - step * e)) / (2 * step) for e in np.eye(3)], -1)

    expected = (4 * differences(0.05) - differences(0.1)) / 3
    largest = np.abs(expected).max(axis=0)
    assert (np.abs(forward - expected).max(axis=0) < 1e-5 * largest).all() and (largest > 0).all()
    np.testing.assert_allclose(forward, reverse, rtol=1e-8, atol=1e-8 * largest.min())

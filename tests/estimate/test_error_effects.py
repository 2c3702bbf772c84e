"""What errors do to pixels, against the textbook's chain: derivatives by complex steps, kernels written out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.locate.conftest import draw
from tests.locate.textbooks import EXACT, MOTIONS, differentiated, enu
from whiskjax.estimate.error_effects import common_columns_px, white_covariance_px2

INF = float("inf")
LOOKS = 6
STRIP = np.array([0, 1, 1, 0, 2, 2])
SIGMA = np.array([1e-4, 0.0, 3e-4, 5.0, 0.0, 4.0])
TAU_S = (0.0, 0.0, 8.0, INF, 0.0, 0.0)


@pytest.fixture(scope="module")
def run():
    return draw(5, looks=LOOKS)


@pytest.fixture(scope="module", params=["frame", "level"])
def case(request, run):
    """Statements of the body, and the textbook's derivative of each pixel by one sigma of each component, (looks, 2, 6)."""
    errors = [wj.FrameErrors("body", SIGMA[:3].tolist(), SIGMA[3:].tolist(), TAU_S, anew="strip", axes=request.param)]
    by_sigma = []
    for k in range(LOOKS):
        motion = differentiated(lambda w, k=k: run.chain.image(k, run.target_m, w), EXACT)
        into = np.eye(3) if request.param == "frame" else run.chain.ecef_from_body[k].T @ enu(run.chain.platform[k])
        both = np.zeros((MOTIONS, 6))
        both[:3, :3], both[3:6, 3:] = into, into
        by_sigma.append(motion @ both * SIGMA)
    point = tuple(jnp.full(LOOKS, c) for c in run.target_m)
    return errors, (run.sensor, wj.Shot(time_s=run.time_s, strip=STRIP), point), np.array(by_sigma)


def test_white_covariance(case):
    errors, where, by_sigma = case
    white = by_sigma[:, :, [0, 5]]
    expected = white @ white.swapaxes(1, 2)
    found = white_covariance_px2(errors, *where)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_columns_give_the_covariance_of_all(run, case):
    errors, where, by_sigma = case
    columns, names = common_columns_px(errors, *where)
    dt = np.abs(run.time_s[:, None] - run.time_s[None, :])
    same = (STRIP[:, None] == STRIP[None, :]).astype(float)
    expected = np.zeros((LOOKS, 2, LOOKS, 2))
    for k, correlation in ((2, same * np.exp(-dt / 8.0)), (3, same)):
        g = by_sigma[:, :, k]
        expected += np.einsum("ka,kl,lb->kalb", g, correlation, g)
    found = np.einsum("kan,lbn->kalb", columns, columns)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    # A number for each exposure of what wanders, one for each strip of what is constant.
    assert columns.shape == (LOOKS, 2, LOOKS + 3) and len(names) == LOOKS + 3
    x, up = ("x", "z") if errors[0].axes == "frame" else ("east", "up")
    assert names[0] == f"body turn {up} 0" and names[-1] == f"body shift {x} 2"


def test_columns_are_traceable(case):
    errors, where, _ = case

    def of(scale):
        scaled = wj.FrameErrors("body", (0, 0, scale * 3e-4), (scale * 5.0, 0, 0), TAU_S, anew="strip", axes=errors[0].axes)
        return common_columns_px([scaled], *where)[0]

    once, twice = jax.jit(of)(jnp.asarray(1.0)), jax.jit(of)(jnp.asarray(2.0))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-12)
    np.testing.assert_allclose(jax.jacfwd(of)(jnp.asarray(1.0)), once, rtol=1e-9, atol=1e-9 * np.abs(once).max())


def test_nothing_in_common_is_no_column(case):
    _, where, _ = case
    columns, names = common_columns_px([wj.FrameErrors("body", (1e-4, 0, 0))], *where)
    assert columns.shape == (LOOKS, 2, 0) and names == ()

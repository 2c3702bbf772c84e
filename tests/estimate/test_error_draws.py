"""Draws of errors: their sample covariance against the textbook's, their keys, and the axes in which they are stated."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles

INF = float("inf")
TIME_S = np.array([3.0, 0.0, 0.5, 9.0, 3.0, 4.0])
STRIP = np.array([0, 0, 1, 1, 0, 1])
SHOTS = wj.Shot(time_s=TIME_S, strip=STRIP)
TAU_S = (0.0, 2.0, 7.0, INF, 2.0, 0.0)
RUNS = 20_000


def textbook(sigma, tau, anew):
    """Gelb (1974): sigma_i sigma_j exp(-|dt| / tau), and nothing between exposures that share no draw."""
    n = len(TIME_S)
    found = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            rho = float(i == j) if tau == 0 else np.exp(-abs(TIME_S[i] - TIME_S[j]) / tau)
            found[i, j] = sigma[i] * sigma[j] * rho * (anew == "flight" or STRIP[i] == STRIP[j])
    return found


def many(errors, runs=RUNS, seed=0):
    """Draws (runs, 6, exposures)."""

    def once(key):
        motion = wj.draw_errors(errors, key, SHOTS)["body"]
        return jnp.stack([jnp.broadcast_to(c, TIME_S.shape) for c in (*motion.turn, *motion.shift)])

    return np.asarray(jax.jit(jax.vmap(once))(jax.random.split(jax.random.key(seed), runs)))


def check_covariance(drawn, expected):
    """Each entry within five of its standard errors, sqrt((C_ii C_jj + C_ij^2) / runs) (Isserlis)."""
    found = np.einsum("rki,rkj->kij", drawn, drawn) / len(drawn)
    variance = np.einsum("kii->ki", expected)
    error = np.sqrt((variance[:, :, None] * variance[:, None, :] + expected**2) / len(drawn))
    assert (np.abs(found - expected) <= 5 * error + 1e-30).all()


@pytest.mark.parametrize("anew", ["flight", "strip"])
def test_sample_covariance(anew):
    each = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    errors = wj.FrameErrors("body", (1e-3, 2e-3, 0), (each, 0.2, 0.3), TAU_S, anew=anew)
    drawn = many([errors])
    sigmas = [np.full(6, s) for s in (1e-3, 2e-3, 0.0)] + [each, np.full(6, 0.2), np.full(6, 0.3)]
    check_covariance(drawn, np.stack([textbook(s, t, anew) for s, t in zip(sigmas, TAU_S, strict=True)]))
    # Components are independent of each other.
    crossed = np.einsum("ri,ri->i", drawn[:, 0], drawn[:, 1]) / RUNS
    assert np.abs(crossed).max() < 5 * 1e-3 * 2e-3 / np.sqrt(RUNS)


def test_statements_add():
    """A bias of the flight beside one of the strip and one that wanders; two of the same words are two draws."""
    parts = [(0.1, INF, "flight"), (0.2, INF, "strip"), (0.3, 2.0, "strip"), (0.15, 2.0, "strip")]
    errors = [wj.FrameErrors("body", shift_sigma_m=(s, 0, 0), correlation_s=t, anew=a) for s, t, a in parts]
    expected = np.zeros((6, 6, 6))
    expected[3] = sum(textbook(np.full(6, s), t, a) for s, t, a in parts)
    check_covariance(many(errors), expected)


def test_a_statement_draws_the_same_whatever_stands_beside_it():
    key, one = jax.random.key(3), wj.FrameErrors("body", (1e-3, 0, 0), correlation_s=5.0)
    other = wj.FrameErrors("gimbal", (1e-3, 0, 0), correlation_s=5.0)
    alone, both = wj.draw_errors([one], key, SHOTS), wj.draw_errors([other, one], key, SHOTS)
    np.testing.assert_array_equal(alone["body"].turn[0], both["body"].turn[0])
    np.testing.assert_array_equal(one.draw(key, SHOTS).turn[0], alone["body"].turn[0])
    assert np.abs(both["gimbal"].turn[0] - both["body"].turn[0]).min() > 0
    # What nobody speaks of costs nothing.
    assert alone["body"].turn[1:] == (0, 0) and alone["body"].shift == (0, 0, 0)


def test_exposures_at_one_moment_err_alike_and_have_derivatives():
    """Where they remember anything; white errors are new at each."""
    key = jax.random.key(1)
    wandering = wj.FrameErrors("body", (1e-3, 0, 0), correlation_s=2.0).draw(key, SHOTS).turn[0]
    white = wj.FrameErrors("body", (1e-3, 0, 0)).draw(key, SHOTS).turn[0]
    assert wandering[0] == wandering[4] and white[0] != white[4]

    def of(tau):
        return wj.FrameErrors("body", (1e-3, 0, 0), correlation_s=tau).draw(key, SHOTS).turn[0]

    step = 1e-5
    expected = (of(2.0 + step) - of(2.0 - step)) / (2 * step)
    np.testing.assert_allclose(jax.jacfwd(of)(jnp.asarray(2.0)), expected, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(jax.jacrev(of)(jnp.asarray(2.0)), expected, rtol=1e-7, atol=1e-12)


def over_the_earth():
    lat, lon = np.radians([46.0, 46.1]), np.radians([7.0, 7.2])
    place = oracles.ecef(lat, lon, np.array([3000.0, 3100.0]))
    turned = oracles.ecef_from_ned(lat, lon) * Rotation.from_euler("ZYX", [[30.0, 5, -3], [200.0, -4, 2]], degrees=True)
    return wj.Sensor({"body": wj.PosePerImage(place, turned.as_quat())}, wj.FrameCamera(1000.0, (0.0, 0.0))), lat, lon, turned


def test_level_axes_are_east_north_and_up_at_the_frame():
    sensor, lat, lon, turned = over_the_earth()
    shots, key = wj.Shot(image=np.arange(2)), jax.random.key(2)
    errors = wj.FrameErrors("body", (1e-3, 2e-3, 3e-3), (1.0, 2.0, 3.0), INF, axes="level")
    drawn = errors.draw(key, shots, sensor)
    # North, east, down of the textbook's rotation; east, north, up of the statement.
    enu = (oracles.ecef_from_ned(lat, lon) * Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])).inv() * turned
    level = [enu.apply(np.stack(part, axis=-1)) for part in (drawn.turn, drawn.shift)]
    # Constant in level axes, and the same numbers as they are drawn where the frame is level.
    np.testing.assert_allclose(level[1][0], level[1][1], rtol=1e-9)
    flat = wj.Sensor({"body": wj.PosePerImage(np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1)))}, sensor.camera)
    plain = errors.draw(key, shots, flat, wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    for found, expected in zip(level, (plain.turn, plain.shift), strict=True):
        np.testing.assert_allclose(found, np.stack(expected, axis=-1), rtol=0, atol=1e-12 * np.abs(found).max())


def test_what_cannot_be_drawn_is_refused():
    sensor, *_ = over_the_earth()
    key, shots = jax.random.key(0), wj.Shot(image=np.arange(2))
    local = wj.Sensor({"body": wj.PosePerImage(np.ones((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1)))}, sensor.camera)
    level = wj.FrameErrors("body", shift_sigma_m=(1.0, 1.0, 1.0), correlation_s=INF, axes="level")
    with pytest.raises(wj.WhiskjaxError, match="errors of body are in level axes; a sensor is needed"):
        level.draw(key, shots)
    with pytest.raises(wj.WhiskjaxError, match=r"level axes, but the world is a local one.*surface=Plane"):
        level.draw(key, shots, local)
    with pytest.raises(wj.WhiskjaxError, match="the poses of body are free"):
        wj.FrameErrors("body", shift_sigma_m=(INF, INF, INF)).draw(key, shots)
    with pytest.raises(wj.WhiskjaxError, match=r"exposures of the shape \(2, 3\).*use vmap"):
        wj.FrameErrors("body", (1e-3, 0, 0)).draw(key, wj.Shot(image=np.zeros((2, 3), dtype=int)))
    with pytest.raises(wj.WhiskjaxError, match=r"draw_errors: errors\[1\] of 'body' says exactly"):
        wj.draw_errors([level, level], key, shots, sensor)

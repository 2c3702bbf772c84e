"""Errors of recorded frames in a calibration: new ones weigh, common ones are considered."""

import dataclasses

import jax
import numpy as np
import pytest
import scipy.linalg

import whiskjax as wj
from tests.estimate.test_pure import COVARIANCE_M2, PIXEL_PX, POINT_M, SIZE, TIME_S, UNKNOWNS, N, sensor

WHITE = wj.FrameErrors("body", turn_sigma_rad=(2e-3, 1e-3, 3e-3), shift_sigma_m=(0.1, 0.2, 0.0))
BIAS = wj.FrameErrors("body", turn_sigma_rad=(2e-3, 1e-3, 3e-3), shift_sigma_m=(0.1, 0.2, 0.0), correlation_s=np.inf)
SEEN = wj.Observations(wj.Shot(time_s=TIME_S), POINT_M, PIXEL_PX, np.full((N, 2), 0.7), np.arange(N) < N - 2, COVARIANCE_M2)


def moved(motion):
    """The pixels of a recorded pose that is followed by a small motion (turn about, shift along the body's axes), from a chain
    with that motion in it."""
    turn, shift = motion
    found = wj.Sensor(
        {"body": sensor().links[0], "error": wj.Mount(lever_arm_m=shift, angles_rad=turn), "mount": sensor().links[1]},
        wj.LineCamera(1000.0),
    )
    found = wj.assign(found, UNKNOWNS, wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=[WHITE]).value)
    return np.asarray(wj.project(found, SEEN.shot, POINT_M, throw=False).pixel_px)


@pytest.fixture(scope="module")
def effects():
    """The pixel by one sigma of each of the five components, by central differences, (n, 2, 5)."""
    sigma = np.array([2e-3, 1e-3, 3e-3, 0.1, 0.2])
    columns = []
    for k in range(5):
        step = np.zeros(6)
        step[k] = 0.1 * sigma[k]
        up, down = (moved((s * step[:3], s * step[3:])) for s in (1, -1))
        columns.append((up - down) / 0.2)
    return np.stack(columns, -1)


def test_what_is_new_at_every_exposure_weighs(effects):
    """The same as a measurement whose covariance is larger by what the errors do to the pixel: reckoned densely at the end."""
    found = wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=[WHITE])
    control = SEEN.is_control
    plain = wj.calibrate(sensor(), SEEN, UNKNOWNS)
    rows, follows = np.asarray(plain._here.rows_px), plain._ready.follows
    own = 0.49 * np.eye(2) + follows @ COVARIANCE_M2 @ follows.swapaxes(1, 2)
    weight = np.linalg.inv(own + effects @ effects.swapaxes(1, 2))
    normal = np.einsum("nik,nij,njl->kl", rows[control], weight[control], rows[control]) + np.diag([1.0, 1, 1, 0])
    expected = np.sqrt(np.diag(np.linalg.inv(normal))) * SIZE
    np.testing.assert_allclose(found.estimate.sigma, expected, rtol=0.02)  # the weights are those of the start
    assert (np.asarray(found.estimate.sigma) > 1.2 * np.asarray(plain.estimate.sigma)).any()


def test_what_exposures_have_in_common_is_considered(effects):
    """Schmidt (1966) in dense matrices: C + (C J^T W H)(C J^T W H)^T, and the value does not know of it."""
    found, plain = (wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=e) for e in ([BIAS], []))
    np.testing.assert_array_equal(found.value, plain.value)
    control = SEEN.is_control
    rows, follows = np.asarray(plain._here.rows_px), plain._ready.follows
    weight = np.linalg.inv(0.49 * np.eye(2) + follows @ COVARIANCE_M2 @ follows.swapaxes(1, 2))[control]
    normal = np.einsum("nik,nij,njl->kl", rows[control], weight, rows[control]) + np.diag([1.0, 1, 1, 0])
    formal = np.linalg.inv(normal)
    bent = formal @ np.einsum("nik,nij,njc->kc", rows[control], weight, effects[control])
    expected = (formal + bent @ bent.T) * np.outer(SIZE, SIZE)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found.estimate.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-3)
    assert (np.asarray(found.estimate.sigma) > 1.2 * np.asarray(plain.estimate.sigma)).any()


def test_errors_that_wander_enter_the_model_test(effects):
    """The cost is the least of generalised least squares with their covariance between exposures, exp(-dt / tau), in that of the
    pixels; effects and weights are those of the start, a hundredth off."""
    wanders = wj.FrameErrors("body", turn_sigma_rad=(2e-3, 1e-3, 3e-3), shift_sigma_m=(0.1, 0.2, 0.0), correlation_s=0.5)
    found, plain = (wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=e) for e in ([wanders], []))
    use = np.flatnonzero(SEEN.is_control)
    rows, follows = np.asarray(plain._here.rows_px)[use], plain._ready.follows[use]
    own = 0.49 * np.eye(2) + follows @ COVARIANCE_M2[use] @ follows.swapaxes(1, 2)
    memory = np.exp(-np.abs(TIME_S[use, None] - TIME_S[use]) / 0.5)
    common = np.einsum("iac,jbc,ij->iajb", effects[use], effects[use], memory).reshape(2 * len(use), 2 * len(use))
    weight = np.linalg.inv(scipy.linalg.block_diag(scipy.linalg.block_diag(*own) + common, np.eye(3)))
    design = np.concatenate([rows.reshape(-1, 4), np.eye(4)[:3]])
    left = np.concatenate([plain.residual_after_px[use].ravel(), plain._here.u[:3]])
    left = left - design @ np.linalg.solve(design.T @ weight @ design, design.T @ weight @ left)
    assert found.estimate.cost == pytest.approx(left @ weight @ left, rel=0.05)
    assert found.estimate.cost < 0.8 * plain.estimate.cost and found.estimate.freedom == plain.estimate.freedom


def test_the_covariance_holds_for_drawn_errors():
    """Truth from the priors, biases and noise from their statements: errors beside their covariance, over many runs."""
    shot = SEEN.shot

    def run(key):
        of_truth, of_bias, of_noise, of_points = jax.random.split(key, 4)
        truth = np.array([0.0, 0, 0, 1000.0]) + SIZE * np.array([1, 1, 1, 0.3]) * jax.random.normal(of_truth, (4,), float)
        chain = wj.assign(sensor(), UNKNOWNS, truth)
        motion = BIAS.draw(of_bias, shot, chain)
        # The true pose is the recorded one without its error; to first order the pixel follows at the joint.
        swept = wj.joint_derivatives(chain, shot, tuple(POINT_M.T))
        off = swept.follows("body", motion)
        exact = jax.numpy.stack(swept.pixel, -1)
        pixel = exact - jax.numpy.stack(off, -1) + 0.7 * jax.random.normal(of_noise, (N, 2), float)
        point = POINT_M + jax.numpy.asarray(np.sqrt([[0.01, 0.01, 0.04]])) * jax.random.normal(of_points, (N, 3), float)
        seen = dataclasses.replace(SEEN, pixel_px=pixel, point_m=point)
        found = wj.calibrate(sensor(), seen, UNKNOWNS, errors=[BIAS]).estimate
        return found.value - truth, found.covariance

    runs = 400
    error, covariance = jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(3), runs))
    low, high = wj.nees_band(4, runs)
    assert low < wj.nees(error, covariance).mean() < high


def test_bad_errors_are_named():
    with pytest.raises(wj.WhiskjaxError, match="no frame"):
        wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=[wj.FrameErrors("wing", turn_sigma_rad=(1e-3, 0, 0))])
    with pytest.raises(wj.WhiskjaxError, match="exactly what one before it says"):
        wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=[WHITE, WHITE])
    level = wj.FrameErrors("body", shift_sigma_m=(0, 0, 0.1), correlation_s=np.inf, axes="level")
    with pytest.raises(wj.WhiskjaxError, match="up"):
        wj.calibrate(sensor(), SEEN, UNKNOWNS, errors=[level])

"""`calibrate` against scipy on a textbook loop, and what it must do with bad input."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.estimate.least_squares import gauss_newton, levenberg_marquardt
from whiskjax.estimate.linearised import linearise, prepare, refine
from whiskjax.estimate.problem import pose_problem, weigh
from whiskjax.flights import haian

TRUTH = np.concatenate(haian.TABLE_4)
SIGMA = np.concatenate(haian.PRIOR_SIGMA)


@pytest.fixture(scope="module")
def reference(textbook, calibration):
    """Whitened residuals and central-difference Jacobian of the textbook loop, priors included, at our solution."""
    factor = np.linalg.inv(np.linalg.cholesky(textbook.covariances_px2(np.zeros(15))))

    def residuals(u):
        r = np.einsum("nij,nj->ni", factor, textbook.residuals_px(SIGMA * u))
        return np.concatenate([r.ravel(), u])

    u = calibration.value / SIGMA
    step = 1e-4
    columns = [(residuals(u + step * e) - residuals(u - step * e)) / (2 * step) for e in np.eye(15)]
    return residuals(u), np.stack(columns, -1)


def test_solution_is_the_textbook_minimum(reference):
    """One Gauss-Newton step of the textbook problem from our solution goes nowhere: below 1e-6 of a prior sigma."""
    r, jac = reference
    step, *_ = np.linalg.lstsq(jac, -r)
    np.testing.assert_allclose(step, 0.0, atol=1e-6)


def test_residuals_are_the_textbook_loops(calibration, textbook, flight):
    used = flight.observations().is_control
    np.testing.assert_allclose(calibration.residual_before_px[used], textbook.residuals_px(np.zeros(15)), atol=1e-6)
    np.testing.assert_allclose(calibration.residual_after_px[used], textbook.residuals_px(calibration.value), atol=1e-6)


def test_covariance_is_the_inverse_normal_matrix(calibration, reference):
    _, jac = reference
    expected = np.linalg.inv(jac.T @ jac) * np.outer(SIGMA, SIGMA)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        calibration.posterior.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-4
    )
    np.testing.assert_allclose(calibration.posterior.sigma, sigma, rtol=1e-4)
    np.testing.assert_allclose(calibration.posterior.data_share, 1 - (sigma / SIGMA) ** 2, atol=2e-4)


def test_fit_counts_every_residual_once(calibration, reference):
    assert calibration.fit.degrees_of_freedom == 2 * 130 + 15 - 15
    np.testing.assert_allclose(calibration.fit.variance_factor, (reference[0] ** 2).sum() / 260, rtol=1e-6)
    assert calibration.is_sound


@pytest.mark.parametrize("scan_first", [True, False])
def test_noise_free_recovery(scan_first):
    """scenarios.md: the truth to 1e-10 m and deg, prior centred on it, start 3 sigma away."""
    flight = haian.simulate(3, noise=False, drift=False, scan_first=scan_first)
    rng = np.random.default_rng(5)
    far = haian.Truth(*(t + 3 * s * rng.choice([-1, 1], 3) for t, s in zip(haian.TABLE_4, haian.PRIOR_SIGMA, strict=True)))
    parts = (flight.sensor[k] for k in ("body", "scan", "pitch"))
    body, scan, pitch = next(parts), next(parts).encoder, next(parts).encoder
    start = haian.sensor(body, scan, pitch, far, scan_first=scan_first)
    unknowns = haian.unknowns(haian.TABLE_4)
    found = wj.calibrate(start, flight.observations(), unknowns)
    shown = np.array([x.unit.factor for x in unknowns])
    np.testing.assert_allclose(found.value * shown, TRUTH * shown, rtol=0, atol=1e-10)


def test_data_shares_of_the_scenario(calibration):
    """scenarios.md: which unknowns the data determine, and which only the prior."""
    share = dict(zip([x.name for x in calibration.unknowns], calibration.posterior.data_share, strict=True))
    for name in ("omega_pos_left", "kappa_pos_left", "kappa_pos_right", "phi_sen", "w_gps", "kappa_sen"):
        assert share[name] >= 0.94
    assert share["phi_pos_left"] == pytest.approx(0.83, abs=0.04)
    assert share["w_sen"] == pytest.approx(0.76, abs=0.06)
    assert share["v_gps"] == pytest.approx(0.29, abs=0.06)
    assert share["v_sen"] == pytest.approx(0.10, abs=0.04)
    assert share["u_gps"] == pytest.approx(0.05, abs=0.02)
    assert share["omega_sen"] < 0.01
    assert any("fixed by" in w and "omega_sen" in w for w in calibration.warnings)


def test_condition_number_without_priors(calibration, flight):
    """scenarios.md: 2e7 for 15 unknowns, 1e9 for 12 from one swing, of the column-scaled normal matrix (the square of ours)."""
    assert 0.5e7 < calibration.posterior.condition**2 < 8e7
    observations = flight.observations()
    one = observations.take(np.asarray(observations.images) == "L1")
    twelve = [x for x in flight.unknowns if "right" not in x.name]
    assert 2e8 < wj.calibrate(flight.sensor, one, twelve).posterior.condition ** 2 < 5e9


def test_gauss_newton_is_levenberg_marquardt(flight):
    """The fast solver ends where the safe one does: 1e-8 of a prior sigma."""
    observations = flight.observations()
    weight = np.zeros((len(observations), 3))
    weight[:, [0, 2]] = observations.is_control[:, None] / observations.sigma_px
    problem, start, indices = pose_problem(flight.sensor, observations, flight.unknowns)
    problem = weigh(eqx.filter_jit(lambda p: p.baked())(problem), weight, indices)
    safe = levenberg_marquardt(problem, jnp.asarray(start)).u
    fast = eqx.filter_jit(gauss_newton)(problem, jnp.asarray(start), 6)
    np.testing.assert_allclose(fast, safe, rtol=0, atol=1e-8)


@pytest.mark.parametrize("seed", [20, 21, 28, 39])
def test_steps_are_those_that_moved_something(seed):
    """Where the cost cannot judge a step any more the iteration ends: seeds whose last steps were rejected for rounding, some
    twenty times, and the minimum all the same (no Gauss-Newton step leaves it)."""
    flight = haian.simulate(seed)
    found = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    assert 3 <= found.steps <= 10
    ready = prepare(flight.sensor, flight.observations(), flight.unknowns, None)
    share = flight.observations().is_control.astype(float)
    here = linearise(ready, found.value / SIGMA)
    assert np.abs(refine(ready, here, share, steps=1).u - here.u).max() < 1e-8


def test_steps_are_counted_up_to_the_most_that_may_be_tried(flight):
    for most in (1, 2):
        found = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, max_steps=most, throw=False)
        assert found.steps == most and found.result == wj.RESULTS.not_converged


def test_check_points_take_no_part(flight, calibration):
    observations = flight.observations()
    moved = observations.pixel_px + np.where(observations.is_control[:, None], 0.0, 50.0)
    again = wj.calibrate(flight.sensor, dataclasses.replace(observations, pixel_px=moved), flight.unknowns)
    np.testing.assert_allclose(again.value, calibration.value, rtol=0, atol=1e-12)
    change = again.residual_after_px - calibration.residual_after_px
    expected = np.where(observations.is_control, 0.0, 50.0)
    np.testing.assert_allclose(change, np.stack([expected, expected], -1), atol=1e-6)


@pytest.mark.parametrize("loss", [wj.Huber(2.0), wj.Cauchy(2.0)])
def test_robust_loss_withstands_blunders(flight, calibration, loss):
    """Twelve blunders of 30 to 60 px in 130 points: the projection stays, where plain least squares moves by pixels."""
    observations = flight.observations()
    rng = np.random.default_rng(2)
    wrong = rng.choice(np.flatnonzero(observations.is_control), 12, replace=False)
    pixel = observations.pixel_px.copy()
    pixel[wrong] += rng.uniform(30, 60, (12, 2))
    spoilt = dataclasses.replace(observations, pixel_px=pixel)
    robust = wj.calibrate(flight.sensor, spoilt, flight.unknowns, loss=loss)
    plain = wj.calibrate(flight.sensor, spoilt, flight.unknowns)
    good = np.setdiff1d(np.arange(len(observations)), wrong)

    def moved(answer):
        return np.sqrt(np.mean((answer.residual_after_px - calibration.residual_after_px)[good] ** 2))

    assert moved(robust) < 0.25 * moved(plain)
    assert moved(plain) > 1.0
    assert robust.robust_weight[wrong].max() < 0.2 < np.median(robust.robust_weight[good])
    assert not plain.fit.is_consistent


def test_point_sigmas_reach_the_weights(flight):
    """With exact image measurements and coarse points the sigmas of the unknowns follow the points."""
    observations = flight.observations()
    coarse = dataclasses.replace(
        observations,
        sigma_px=np.full_like(observations.sigma_px, 1e-3),
        point_covariance_m2=100 * observations.point_covariance_m2,
    )
    # 0.3 m and 0.5 m at 3000 to 4700 m slant range are about 0.6 to 1.2 px.
    sigma = wj.calibrate(flight.sensor, coarse, flight.unknowns).fit.variance_factor
    assert 1 < sigma < 10
    exact = dataclasses.replace(coarse, point_covariance_m2=None)
    assert wj.calibrate(flight.sensor, exact, flight.unknowns).fit.variance_factor > 1e5


def test_one_unknown_in_two_places():
    """One encoder delay for two axes, and the attitude delay: found where the data hold them."""
    rng = np.random.default_rng(1)
    time = np.arange(0, 20, 0.05)
    wave = [0.1 * np.sin(time * w + p) for w, p in ((0.7, 0), (1.1, 1), (0.9, 2))]
    position = np.stack([time * 60, 0 * time, 1000 + 0 * time], -1)
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_euler("ZYX", np.stack(wave, -1)).as_quat()
    azimuth = wj.Encoder(time, 0.3 * np.sin(time), 0.1)
    elevation = wj.Encoder(time, 0.2 * np.cos(1.3 * time), 0.1)

    def sensor(attitude_s, encoder_s):
        return wj.Sensor(
            {
                "body": wj.Trajectory(time, position, quaternion, max_gap_s=0.1, attitude_delay_s=attitude_s),
                "azimuth": wj.Turn("z", azimuth, delay_s=encoder_s),
                "elevation": wj.Turn("y", elevation, delay_s=encoder_s),
            },
            wj.FrameCamera(2000.0, (0.0, 0.0)),
        )

    shot = wj.Shot(time_s=rng.uniform(1, 18, 60))
    pixel = rng.uniform(-300, 300, (60, 2))
    ground = wj.Plane(jnp.array([0.0, 0.0, 0.0]), jnp.array([0.0, 0.0, 1.0]))
    point = np.asarray(wj.image_to_ground(sensor(0.04, -0.03), shot, pixel, ground).point_m)
    seen = wj.Observations(shot, point, pixel, np.ones((60, 2)), np.ones(60, bool))
    unknowns = [
        wj.Unknown("attitude delay", "body.attitude_delay_s", scale=0.05),
        wj.Unknown("encoder delay", ("azimuth.delay_s", "elevation.delay_s"), mean=0.0, sigma=0.1),
    ]
    # The prior pulls by (0.03 / 0.1) of its sigma against a data sigma of about 1e-4 s.
    found = wj.calibrate(sensor(0, 0), seen, unknowns)
    np.testing.assert_allclose(found.value, [0.04, -0.03], atol=2e-6)
    assert found.unknowns[1].unit.name == "ms"


def test_null_space_has_names(flight):
    """Two mounts in a row turn about the same axis: without priors neither is determined, and both are named."""
    links = dict(zip(flight.sensor.names, flight.sensor.links, strict=True))
    doubled = wj.Sensor(links | {"second": wj.Mount(angles_rad=[0.0, 0.0, 0.0])}, flight.sensor.camera)
    pair = [wj.Unknown(n, f"{link}.angles_rad[2]", scale=0.01) for n, link in (("kappa one", "sensor"), ("kappa two", "second"))]
    with pytest.raises(wj.SensorError, match=r"kappa one, kappa two.*priors"):
        wj.calibrate(doubled, flight.observations(), pair)
    loose = wj.calibrate(doubled, flight.observations(), pair, throw=False)
    assert loose.posterior.rank == 1 and not loose.is_sound
    assert set(loose.posterior.null_space[0]) == {"kappa one", "kappa two"}
    held = [dataclasses.replace(x, mean=0.0, sigma=0.01, scale=None) for x in pair]
    with_prior = wj.calibrate(doubled, flight.observations(), held)
    assert with_prior.posterior.is_determined and with_prior.posterior.rank == 1
    assert any("do not determine kappa one, kappa two" in reason.text for reason in with_prior.reasons)


def test_more_unknowns_than_observations(flight):
    observations = flight.observations()
    few = observations.take(np.arange(3))
    free = [dataclasses.replace(x, mean=None, sigma=None, scale=x.sigma) for x in flight.unknowns if "right" not in x.name]
    with pytest.raises(wj.SensorError, match="do not determine these unknowns"):
        wj.calibrate(flight.sensor, few, free)


def test_bad_input_is_named(flight):
    observations, sensor, unknowns = flight.observations(), flight.sensor, flight.unknowns
    with pytest.raises(wj.WhiskjaxError, match="check points"):
        wj.calibrate(sensor, dataclasses.replace(observations, is_control=np.zeros(len(observations), bool)), unknowns)
    with pytest.raises(wj.WhiskjaxError, match="no observations"):
        observations.take(np.zeros(len(observations), bool))
    pixel = observations.pixel_px.copy()
    pixel[7, 1] = np.nan
    with pytest.raises(wj.WhiskjaxError, match=r"observation 7, image L1, point L1-08: pixel_px is not a finite"):
        dataclasses.replace(observations, pixel_px=pixel)
    time = np.array(observations.shot.time_s)
    time[9] = 30.0
    late = dataclasses.replace(observations, shot=dataclasses.replace(observations.shot, time_s=jnp.asarray(time)))
    with pytest.raises(wj.SensorError, match=r"observation 9, image L1, point L1-10: .*gap"):
        wj.calibrate(sensor, late, unknowns)
    time[9] = 5000.0
    late = dataclasses.replace(observations, shot=dataclasses.replace(observations.shot, time_s=jnp.asarray(time)))
    with pytest.raises(wj.SensorError, match=r"observation 9.*outside the recorded"):
        wj.calibrate(sensor, late, unknowns)
    point = observations.point_m.copy()
    point[4] *= 1.01
    with pytest.raises(wj.SensorError, match=r"observation 4.*behind the camera"):
        wj.calibrate(sensor, dataclasses.replace(observations, point_m=point), unknowns)
    with pytest.raises(wj.WhiskjaxError, match="nothing to estimate"):
        wj.calibrate(sensor, observations, [])
    with pytest.raises(wj.WhiskjaxError, match="already estimated"):
        wj.calibrate(sensor, observations, [*unknowns, wj.Unknown("again", "sensor.angles_rad[1]", scale=1.0)])
    for where, match in (
        ("mirror.angles_rad[0]", "no link named 'mirror'; there are body, flu"),
        ("platform.up.angles_rad[0]", "no swing named 'up'; there are left, right"),
        ("sensor.angle_rad[0]", "Mount has no 'angle_rad'; it has lever_arm_m, angles_rad"),
        ("sensor.angles_rad[3]", r"shape \(3,\)"),
        ("sensor.angles_rad", r"name one of its entries"),
        ("sensor.order", "not a number"),
        ("nonsense", "no place in a sensor"),
    ):
        with pytest.raises(wj.WhiskjaxError, match=match):
            wj.calibrate(sensor, observations, [wj.Unknown("x", where, scale=1.0)])


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"mean": 0.0}, "both a mean and a sigma"),
        ({"mean": 0.0, "sigma": 0.0}, "positive"),
        ({"mean": 0.0, "sigma": -1.0}, "positive"),
        ({"mean": float("nan"), "sigma": 1.0}, "prior mean is nan"),
        ({}, "either a prior"),
        ({"mean": 0.0, "sigma": 1.0, "scale": 1.0}, "either a prior"),
    ],
)
def test_priors_that_make_no_sense(given, match):
    with pytest.raises(wj.WhiskjaxError, match=match):
        wj.Unknown("x", "sensor.angles_rad[0]", **given)

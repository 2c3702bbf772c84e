"""Numbers of the sensor that all looks share, estimated and considered, against augmented textbook filters."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize
from scipy.interpolate import interp1d
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation, Slerp

import whiskjax as wj
from tests import oracles
from tests.locate.conftest import draw
from tests.locate.textbooks import TABLE_1, Chain, assert_in_sigmas, enu, kalman, least_squares
from whiskjax.flights import tianshan
from whiskjax.flights.tianshan import in_time
from whiskjax.locate.nuisance import gather
from whiskjax.locate.problem import Problem

SIGMA = np.array([2e-3, 4e-3, 20.0])  # turn about x and z, shift along y
TRUE_BIAS = np.array([2e-3, -5e-3, 12.0])
PLACE = [0, 2, 4]


def bias_of(state):
    return np.zeros(6, dtype=np.asarray(state).dtype) + np.eye(6)[PLACE].T @ state[3:]


@dataclasses.dataclass(frozen=True)
class Biased:
    """A run whose body is turned and shifted against its records, the same at all looks."""

    run: object
    sensor: wj.Sensor
    unknowns: tuple
    pixel_px: np.ndarray

    def image(self, k, state, w):
        return self.run.chain.image(k, self.run.anchor_m + state[:3], w, bias_of(state))

    def locate(self, **options):
        looks = self.run.looks_at(self.pixel_px)
        return self.run.locate(looks, sensor=self.sensor, errors=tianshan.frame_errors(), throw=False, **options)

    def prior(self, bias=None):
        return block_diag(self.run.prior, np.diag(SIGMA**2) if bias is None else bias)


@pytest.fixture(scope="module")
def biased(run):
    sensor = run.sensor.after("body", "bias", wj.Correction(wj.Bias(), np.zeros((1, 3)), np.zeros((1, 3))))
    unknowns = wj.motion_unknowns(sensor, "bias", turn_sigma_rad=[SIGMA[0], 0, SIGMA[1]], shift_sigma_m=[0, SIGMA[2], 0])
    target = np.concatenate([run.target_m - run.anchor_m, TRUE_BIAS])
    plain = [run.chain.image(k, run.target_m) for k in range(40)]
    moved = [run.chain.image(k, run.target_m, bias=bias_of(target)) for k in range(40)]
    return Biased(run, sensor, unknowns, run.pixel_px + np.array(moved) - np.array(plain))


def assert_states(found, states, covariances, anchor, tolerance=1e-6):
    sigma = np.sqrt(np.diagonal(covariances, axis1=-2, axis2=-1))
    error = np.asarray(found.looks.point_m) - anchor - states[..., :3]
    assert np.abs(error / sigma[..., :3]).max() < tolerance
    axes = enu(np.asarray(found.line_m))
    expected = axes.T @ covariances[..., :3, :3] @ axes
    assert_in_sigmas(found.looks.covariance_enu_m2, np.broadcast_to(expected, (40, 3, 3)), expected, tolerance)


@pytest.fixture(scope="module")
def estimated(biased):
    return biased.locate(estimate=biased.unknowns, method="extended")


def test_an_estimated_bias_is_that_of_the_augmented_filter(biased, estimated):
    plain = kalman(biased.image, biased.pixel_px, np.zeros(6), biased.prior(), sigma_w=TABLE_1)
    assert_states(estimated, plain.state, plain.covariance, biased.run.anchor_m)
    sigma = np.sqrt(np.diag(plain.covariance[-1]))[3:]
    np.testing.assert_allclose(np.asarray(estimated.value) / sigma, plain.state[-1, 3:] / sigma, rtol=0, atol=1e-6)
    assert_in_sigmas(estimated.estimate.covariance, plain.covariance[-1, 3:, 3:], plain.covariance[-1, 3:, 3:], 1e-6)
    assert estimated.estimate.names == tuple(x.name for x in biased.unknowns)


def test_an_estimated_bias_is_found(biased, estimated):
    sigma = np.sqrt(np.diag(estimated.estimate.covariance))
    assert (np.abs(np.asarray(estimated.value) - TRUE_BIAS) < 4 * sigma).all()
    assert (sigma / SIGMA).min() < 0.5
    error = np.asarray(estimated.world_from_enu).T @ (np.asarray(estimated.point_m) - biased.run.target_m)
    assert error @ np.linalg.solve(estimated.covariance_enu_m2, error) < 21.1  # chi-square of 3 at 1e-4
    assert estimated.is_sound


@pytest.fixture(scope="module")
def considered(biased):
    return biased.locate(consider=biased.unknowns)


SHARE = np.arange(6) < 3


def test_a_considered_bias_is_that_of_the_filter_with_rows_of_zero_gain(biased, considered):
    plain = kalman(biased.image, biased.pixel_px, np.zeros(6), biased.prior(), sigma_w=TABLE_1, relinearised=5, estimated=SHARE)
    assert_states(considered, plain.state, plain.covariance, biased.run.anchor_m)
    np.testing.assert_allclose(considered.looks.nis, plain.nis, rtol=1e-5)
    # What is considered keeps its prior.
    np.testing.assert_allclose(considered.value, 0, atol=1e-15)
    assert_in_sigmas(considered.estimate.covariance, np.diag(SIGMA**2), np.diag(SIGMA**2), 1e-9)


def test_considering_lies_between_ignoring_and_estimating(biased, estimated, considered):
    ignored = biased.run.locate(biased.run.looks_at(biased.pixel_px), errors=tianshan.frame_errors(), throw=False)
    sizes = [np.trace(f.looks.covariance_enu_m2[-1]) for f in (ignored, estimated, considered)]
    assert sizes[0] < sizes[1] < sizes[2]
    assert not ignored.is_sound and any("common to all looks" in said for said in ignored.warnings)
    assert considered.is_sound


MIXED = np.arange(6) < 4


def dense_consider(dense, prior):
    """C + (C A^T W B) D (C A^T W B)^T of what is estimated, and the covariance of the residuals."""
    weight = np.linalg.inv(dense.noise)
    a, b = dense.rows[:, :, MIXED], dense.rows[:, :, ~MIXED]
    c, d = dense.formal[np.ix_(MIXED, MIXED)], prior[np.ix_(~MIXED, ~MIXED)]
    effect = c @ np.einsum("kan,kab,kbm->nm", a, weight, b)
    bent = b - a @ effect
    residual = dense.noise - a @ c @ np.swapaxes(a, 1, 2) + bent @ d @ np.swapaxes(bent, 1, 2)
    return c + effect @ d @ effect.T, effect @ d, residual


def test_a_batch_estimates_and_considers_as_dense_matrices_do(biased):
    """The first turn estimated, the others considered."""
    found = biased.locate(estimate=biased.unknowns[:1], consider=biased.unknowns[1:], method="batch")
    prior = biased.prior()
    dense = least_squares(biased.image, biased.pixel_px, np.zeros(6), prior, sigma_w=TABLE_1, estimated=MIXED)
    covariance, cross, residual = dense_consider(dense, prior)
    assert_states(found, dense.state, covariance, biased.run.anchor_m)
    sigma = np.sqrt([covariance[3, 3], *np.diag(prior)[4:]])
    np.testing.assert_allclose(np.asarray(found.value) / sigma, dense.state[3:] / sigma, rtol=0, atol=1e-6)
    own = np.block([[covariance[3:, 3:], -cross[3:]], [-cross[3:].T, prior[4:, 4:]]])
    assert_in_sigmas(found.estimate.covariance, own, own, 1e-6)
    assert_in_sigmas(found.looks.innovation_covariance_px2, residual, residual, 1e-6)
    nis = np.einsum("ka,kab,kb->k", dense.residual, np.linalg.inv(residual), dense.residual)
    np.testing.assert_allclose(found.looks.nis, nis, rtol=1e-5, atol=1e-6)


@pytest.fixture(scope="module")
def calibration(biased):
    """The same body calibrated on eight known points, each seen twice: correlated, and not centred."""
    scene = tianshan.Scene(looks=2, spacing_m=3000.0)
    true = jax.tree.map(lambda a: jnp.repeat(a, 8), tianshan.true_records(scene))
    east, north = np.array([[-800, 500, 0, 900, -300, 100, 700, -600], [200, -700, 0, 600, 900, -500, 300, -200]], dtype=float)
    axes = enu(biased.run.target_m)
    points = np.tile(biased.run.target_m + np.stack([east, north, 0 * east], -1) @ axes.T, (2, 1))
    rng = np.random.default_rng(3)
    bias = np.eye(6)[PLACE].T @ TRUE_BIAS
    pixel = [Chain(true).image(k, point, bias=bias) for k, point in enumerate(points)] + rng.normal(0, 20.0, (16, 2))
    stamps = tianshan.time_s(scene)
    sensor = in_time(tianshan.true_records(scene), stamps).after("body", "bias", biased.sensor["bias"])
    shot, sigma = wj.Shot(time_s=np.repeat(stamps, 8)), np.full((16, 2), 20.0)
    observations = wj.Observations(shot, points, pixel, sigma, np.ones(16, dtype=bool))
    return wj.calibrate(sensor, observations, biased.unknowns)


def test_the_posterior_of_a_calibration_is_a_joint_prior(biased, calibration):
    covariance = calibration.posterior.covariance
    assert np.abs(calibration.posterior.correlation - np.eye(3)).max() > 0.5
    found = biased.locate(consider=calibration)
    mean = np.concatenate([np.zeros(3), calibration.value])
    plain = kalman(
        biased.image, biased.pixel_px, mean, biased.prior(covariance), sigma_w=TABLE_1, relinearised=5, estimated=SHARE
    )
    assert_states(found, plain.state, plain.covariance, biased.run.anchor_m)
    np.testing.assert_allclose(found.value, calibration.value, rtol=1e-12)
    assert_in_sigmas(found.estimate.covariance, covariance, covariance, 1e-9)
    # Uncorrelated it would be another answer.
    other = kalman(
        biased.image,
        biased.pixel_px,
        mean,
        biased.prior(np.diag(np.diag(covariance))),
        sigma_w=TABLE_1,
        relinearised=5,
        estimated=SHARE,
    )
    assert np.abs(np.diag(other.covariance[-1]) / np.diag(plain.covariance[-1]) - 1)[:3].max() > 1e-3


# A sensor with trajectory and encoders, where numbers of every kind can be unknown.

# Two legs in opposite directions with a gap between them: on an orbit, or on one leg, a delay is another target.
SAMPLE_S = 0.5 * np.arange(480) + np.repeat([0.0, 30.0], 240)
LOOK_S = (np.array([[3.0], [153.0]]) + 5.83 * np.arange(20)).ravel()


@dataclasses.dataclass(frozen=True)
class Series:
    """The race as samples every half second."""

    run: object
    position_m: np.ndarray
    attitude: Rotation
    gimbal: tuple
    sensor: wj.Sensor


@pytest.fixture(scope="module")
def series():
    scene = tianshan.Scene("race", looks=480, spacing_m=500.0 / 6)
    true = tianshan.true_records(scene)
    position = oracles.ecef(np.asarray(true.lat_rad), np.asarray(true.lon_rad), np.asarray(true.height_m))
    attitude = oracles.ecef_from_ned(np.asarray(true.lat_rad), np.asarray(true.lon_rad)) * oracles.body_in_ned(
        0.0, 0.0, np.asarray(true.heading_rad)
    )
    gimbal = np.asarray(true.gimbal_roll_rad), np.asarray(true.gimbal_pitch_rad)
    links = {
        "body": wj.Trajectory(SAMPLE_S, position, attitude.as_quat(), max_gap_s=1.0),
        "gimbal_roll": wj.Turn("x", wj.Encoder(SAMPLE_S, gimbal[0], 1.0)),
        "gimbal_pitch": wj.Turn("y", wj.Encoder(SAMPLE_S, gimbal[1], 1.0)),
        "bias": wj.Correction(wj.Bias(), np.zeros((1, 3)), np.zeros((1, 3))),
        "view": wj.Axes("x -y -z"),
    }
    return Series(draw(6), position, attitude, gimbal, wj.Sensor(links, wj.FrameCamera(1e5, (0.0, 0.0))))


UNKNOWNS = [
    wj.Unknown("delay", "body.delay_s", 0.003, 0.02),
    wj.Unknown("encoder", "gimbal_roll.delay_s", 0.001, 0.01),
    wj.Unknown("zero", "gimbal_pitch.zero_rad", 1e-4, 1e-3),
    wj.Unknown("turn", "bias.turn_rad[0,1]", 2e-4, 1e-3),
    wj.Unknown("shift", "bias.shift_m[0,2]", 1.0, 5.0),
    wj.Unknown("focal", "camera.focal_px", 1e5, 50.0),
]


def rows_of(sensor, unknowns, run, u):
    """Derivatives of the residuals, as the filter has them, and by differences of `project`; both in px per prior sigma."""
    roomy, nuisance = gather(sensor, unknowns, ())
    looks, guess = wj.Looks(wj.Shot(time_s=LOOK_S), np.zeros((40, 2)), (2.0, 2.0)), run.guess

    @jax.jit
    def ours(u):
        model, _ = Problem(roomy, looks, guess, wj.HeightSurface(0.0), (), nuisance, None).pose()
        return [[jnp.broadcast_to(c, (40,)) for c in row] for row in model.expect((300.0, -200.0, 100.0, *u)).rows]

    point = np.tile(run.anchor_m + [300.0, -200.0, 100.0], (40, 1))
    sigma, mean = np.array([x.sigma for x in unknowns]), np.array([x.mean for x in unknowns])
    pixel = jax.jit(lambda u: wj.project(wj.assign(sensor, unknowns, mean + sigma * u), looks.shot, point).pixel_px)
    steps = 1e-3 * np.eye(len(unknowns))
    differences = [(pixel(u + e) - pixel(u - e)) / 2e-3 for e in steps]
    return 2 * np.moveaxis(np.array(ours(u)), 0, -1)[3:], np.array(differences)


def test_derivatives_by_every_kind_of_unknown(series):
    got, expected = rows_of(series.sensor, UNKNOWNS, series.run, np.full(6, 0.3))
    assert np.abs(expected).max(axis=(1, 2)).min() > 0.01
    # Differences of pixels: rounding 1e-8 px over 2e-3 sigma.
    np.testing.assert_allclose(got, expected, rtol=1e-6, atol=2e-4)


def test_derivative_by_the_air(series):
    sensor = wj.Sensor(dict(zip(series.sensor.names, series.sensor.links, strict=True)), series.sensor.camera, wj.Refraction())
    unknowns = [wj.Unknown("air", "refraction.scale", 1.0, 0.5), wj.Unknown("delay", "body.delay_s", 0.003, 0.02)]
    got, expected = rows_of(sensor, unknowns, series.run, np.array([0.3, -0.2]))
    assert np.abs(expected[0]).max() > 1
    np.testing.assert_allclose(got[0], expected[0], rtol=1e-6, atol=2e-4)
    # sweep.py: a shift with refraction is good to 0.02 % at 45 deg off nadir, to 0.3 % at 78; here it is up to 57.
    np.testing.assert_allclose(got[1], expected[1], rtol=0, atol=4e-4 * np.abs(expected[1]).max())


def test_a_delay_is_found_by_a_batch_as_by_scipy(series):
    late, run, time = 0.02, series.run, LOOK_S
    slerp, place = Slerp(SAMPLE_S, series.attitude), interp1d(SAMPLE_S, series.position_m, axis=0)
    beta, alpha = (np.interp(time, SAMPLE_S, g) for g in series.gimbal)

    def pixels(point, delay):
        u = slerp(time + delay).inv().apply(point - place(time + delay))
        u = oracles.about("y", alpha).inv().apply(oracles.about("x", beta).inv().apply(u))
        return 1e5 * u[:, :2] / u[:, 2:]

    measured = pixels(run.target_m, late) + np.random.default_rng(1).normal(0, 2, (40, 2))
    root = np.linalg.inv(np.linalg.cholesky(run.prior))
    sigma = 0.05

    def residuals(x):
        away = ((measured - pixels(run.anchor_m + x[:3], sigma * x[3])) / 2).ravel()
        return np.concatenate([away, root @ x[:3], x[3:]])

    best = optimize.least_squares(residuals, np.zeros(4), "3-point", x_scale=[1, 1, 1, 1e-3], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    unknown = wj.Unknown("delay", "body.delay_s", 0.0, sigma)
    looks = wj.Looks(wj.Shot(time_s=time), measured, (2.0, 2.0))
    found = run.locate(looks, sensor=series.sensor, method="batch", estimate=[unknown])
    scale = np.sqrt(np.diag(covariance))
    error = np.append(np.asarray(found.point_m) - run.anchor_m, found.value / sigma) - best.x
    # Positions are linear between samples: scipy's differences across the kinks limit the agreement, not the solution.
    assert np.abs(error / scale).max() < 1e-3
    np.testing.assert_allclose(found.estimate.covariance[0, 0], sigma**2 * covariance[3, 3], rtol=1e-3)
    assert abs(found.value[0] - late) < 4 * sigma * scale[3] and scale[3] < 0.1
    assert found.is_sound


@pytest.mark.slow  # XLA takes a minute for a filter with refraction
def test_the_density_of_the_air_is_found(series):
    """From looks of 60 to 78 deg off nadir; only there its effect differs from that of the height."""
    run = draw(7, path="fly", off_nadir_rad=np.radians(60.0), spacing_m=2000.0)
    true = tianshan.sensor(tianshan.true_records(run.scene))
    sensor = wj.Sensor(dict(zip(true.names, true.links, strict=True)), true.camera, wj.Refraction(1.2))
    shot = wj.Shot(time_s=run.time_s)
    pixel = wj.project(sensor, shot, np.tile(run.target_m, (40, 1))).pixel_px
    pixel = pixel + np.random.default_rng(2).normal(0, 2, (40, 2))
    standard = wj.Sensor(dict(zip(true.names, true.links, strict=True)), true.camera, wj.Refraction())
    unknown = wj.Unknown("air", "refraction.scale", 1.0, 0.3)
    found = run.locate(wj.Looks(shot, pixel, (2.0, 2.0)), sensor=standard, estimate=[unknown])
    sigma = np.sqrt(found.estimate.covariance[0, 0])
    assert sigma < 0.1 and abs(found.value[0] - 1.2) < 4 * sigma
    error = np.asarray(found.world_from_enu).T @ (np.asarray(found.point_m) - run.target_m)
    assert error @ np.linalg.solve(found.covariance_enu_m2, error) < 21.1
    assert found.is_sound

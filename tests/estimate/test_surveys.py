"""A point's survey is one error, however many rays see it: against generalised least squares with the dense covariance.

Four points 200 m below six stations of a frame camera, surveyed to half a metre (2 px in the image, where noise is 0.4 px): what
one believes of the surveys decides what one believes of the answer.
"""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import scipy.stats

import whiskjax as wj
from tests.differences import differences

POINTS, STATIONS = 4, 6
RNG = np.random.default_rng(3)
POSITION_M = np.column_stack([RNG.uniform(-30, 30, (STATIONS, 2)), RNG.uniform(180, 220, STATIONS)])
TURN_RAD = RNG.uniform(-0.2, 0.2, STATIONS)
QUATERNION = np.column_stack([np.zeros((STATIONS, 2)), np.sin(TURN_RAD / 2), np.cos(TURN_RAD / 2)])
SENSOR = wj.Sensor(
    {"pose": wj.PosePerImage(POSITION_M, QUATERNION), "mount": wj.Mount(angles_rad=[0.0, 0.0, 0.0])},
    wj.FrameCamera(1000.0, (0.0, 0.0)),
)
UNKNOWNS = [
    *(wj.Unknown(f"turn {axis}", f"mount.angles_rad[{i}]", 0.0, 0.01) for i, axis in enumerate("xyz")),
    wj.Unknown("focal", "camera.focal_px", scale=10.0),
]
START, SIZE = np.array([0.0, 0.0, 0.0, 1000.0]), np.array([0.01, 0.01, 0.01, 10.0])
# Image by image, and in no order: rays of one point stand apart.
IMAGE, OF = RNG.permutation(np.array(np.meshgrid(np.arange(STATIONS), np.arange(POINTS))).reshape(2, -1), axis=1)
N = len(OF)
SHOT = wj.Shot(image=IMAGE)
POINT_M = np.column_stack([RNG.uniform(-60, 60, (POINTS, 2)), RNG.uniform(0, 30, POINTS)])
ROOT_M = 0.5 * RNG.normal(size=(POINTS, 3, 3)) / math.sqrt(3)
SURVEY_M2 = ROOT_M @ ROOT_M.swapaxes(1, 2)
SIGMA_PX = RNG.uniform(0.3, 0.5, (N, 2))
NAMES, UNNAMED = [f"P{p}" for p in OF], ()


@jax.jit
def images(values, point_m):
    """Where given points are imaged, (n, 2)."""
    return wj.project(wj.assign(SENSOR, UNKNOWNS, values), SHOT, point_m, throw=False).pixel_px


def draw(seed, runs):
    """Truths from the priors, points where their surveys leave them, noise: unknowns (runs, 4) and pixels (runs, n, 2)."""
    rng = np.random.default_rng(seed)
    truth = np.column_stack([rng.normal(size=(runs, 3)) * SIZE[:3], rng.uniform(998, 1002, runs)])
    point = POINT_M + np.einsum("pij,rpj->rpi", ROOT_M, rng.normal(size=(runs, POINTS, 3)))
    pixel = np.asarray(jax.vmap(images)(truth, point[:, OF]))
    return truth, pixel + rng.normal(size=(runs, N, 2)) * SIGMA_PX


PIXEL_PX = draw(1, 1)[1][0]


def observed(pixel_px=PIXEL_PX, names=NAMES, covariance_m2=SURVEY_M2, is_control=None):
    control = np.ones(N, bool) if is_control is None else is_control
    return wj.Observations(SHOT, POINT_M[OF], pixel_px, SIGMA_PX, control, covariance_m2[OF], points=names)


def calibrated(seen, **how):
    return wj.calibrate(SENSOR, seen, UNKNOWNS, **how)


class Dense:
    """Generalised least squares with one covariance of all pixel coordinates, by the derivatives where the sensor starts."""

    def __init__(self, used=None):
        self.used = np.arange(N) if used is None else np.flatnonzero(used)
        by = np.asarray(jax.jacfwd(lambda p: images(START, p))(POINT_M[OF]))[np.arange(N), :, np.arange(N)]
        self.covariance_px2 = np.diag(SIGMA_PX[self.used].ravel() ** 2)
        for a, i in enumerate(self.used):
            for b, j in enumerate(self.used):
                if OF[i] == OF[j]:
                    self.covariance_px2[2 * a : 2 * a + 2, 2 * b : 2 * b + 2] += by[i] @ SURVEY_M2[OF[i]] @ by[j].T
        self.whitens = np.linalg.inv(np.linalg.cholesky(self.covariance_px2))

    def residuals(self, u, pixel_px):
        left = (pixel_px - np.asarray(images(START + SIZE * u, POINT_M[OF])))[self.used].ravel()
        return np.concatenate([self.whitens @ left, u[:3]])

    def jacobian(self, u, pixel_px=None):
        rows = np.asarray(jax.jacfwd(lambda u: images(START + SIZE * u, POINT_M[OF]))(u))[self.used]
        return np.concatenate([-self.whitens @ rows.reshape(-1, 4), np.eye(4)[:3]])

    def solved(self, pixel_px=PIXEL_PX):
        """Whitened unknowns, their covariance, and the cost."""
        tolerances = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
        u = scipy.optimize.least_squares(self.residuals, np.zeros(4), self.jacobian, args=(pixel_px,), **tolerances).x
        j = self.jacobian(u)
        u = u - np.linalg.lstsq(j, self.residuals(u, pixel_px), rcond=None)[0]
        return u, np.linalg.inv(j.T @ j), (self.residuals(u, pixel_px) ** 2).sum()


def compare(estimate, dense):
    """To 1e-8 sigma, and of the covariance and the cost."""
    u, covariance, cost = dense
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(((estimate.value - START) / SIZE - u) / sigma, 0, atol=1e-8)
    found = estimate.covariance / np.outer(SIZE * sigma, SIZE * sigma)
    np.testing.assert_allclose(found, covariance / np.outer(sigma, sigma), rtol=0, atol=1e-8)
    assert estimate.cost == pytest.approx(cost, rel=1e-8)


@pytest.fixture(scope="module")
def answer():
    return calibrated(observed())


@pytest.fixture(scope="module")
def dense():
    return Dense().solved()


def test_an_answer_is_generalised_least_squares(answer, dense):
    compare(answer.estimate, dense)
    assert answer.estimate.freedom == answer.fit.degrees_of_freedom == 2 * N + 3 - 4
    np.testing.assert_allclose(answer.posterior.covariance, answer.estimate.covariance, rtol=1e-9)
    # It matters: rays that count as so many surveys promise, of some combination, half the variance that is the least possible.
    alone = calibrated(observed(names=UNNAMED)).estimate.covariance
    size = np.outer(SIZE, SIZE)
    assert scipy.linalg.eigh(alone / size, answer.estimate.covariance / size, eigvals_only=True)[0] < 0.5


def test_left_out_rays_say_nothing_of_their_points():
    """Two rays of each point decide, of one point one; check rays stand beside what these leave of the survey of their points."""
    control = np.zeros(N, bool)
    for p in range(POINTS):
        control[np.flatnonzero(OF == p)[: 2 - (p == 0)]] = True
    found = calibrated(observed(is_control=control))
    compare(found.estimate, Dense(control).solved())
    # Their joint prediction: conditional mean and covariance of all check coordinates, given those that decided.
    whole, told, decide = Dense().covariance_px2, *(np.flatnonzero(np.repeat(of, 2)) for of in (~control, control))
    gain = whole[np.ix_(told, decide)] @ np.linalg.inv(whole[np.ix_(decide, decide)])
    rows = -np.asarray(jax.jacfwd(lambda v: images(v, POINT_M[OF]))(found.value)).reshape(2 * N, 4)
    left, moved = found.residual_after_px.ravel(), rows[told] - gain @ rows[decide]
    left = left[told] - gain @ left[decide]
    spread = whole[np.ix_(told, told)] - gain @ whole[np.ix_(decide, told)] + moved @ found.estimate.covariance @ moved.T
    assert found.fit.check.freedom == len(told)
    assert found.fit.check.chi_square == pytest.approx(left @ np.linalg.solve(spread, left), rel=1e-7)


def test_every_way_to_calibrate_weighs_alike(answer):
    """Batches, redrawn measurements, jit with names that the compiler does not see, vmap."""
    seen, sigma = observed(), answer.estimate.sigma
    size = np.outer(sigma, sigma)
    stacked = jax.tree.map(lambda a: np.stack([a] * 2), seen)
    ways = {
        "batch": wj.calibrate_batch([(SENSOR, seen)] * 2, UNKNOWNS).estimate,
        "redrawn": wj.calibrate_redrawn(SENSOR, seen, UNKNOWNS, np.stack([PIXEL_PX] * 2)).estimate,
        "vmap": jax.jit(jax.vmap(lambda of: calibrated(of).estimate))(stacked),
        "jit": jax.tree.map(lambda a: np.asarray(a)[None], eqx.filter_jit(lambda of: calibrated(of).estimate)(seen)),
    }
    for name, found in ways.items():
        np.testing.assert_allclose((found.value[0] - answer.value) / sigma, 0, atol=1e-8, err_msg=name)
        np.testing.assert_allclose(found.covariance[0] / size, answer.estimate.covariance / size, atol=1e-8, err_msg=name)
        assert found.cost[0] == pytest.approx(answer.estimate.cost, rel=1e-9), name
        assert found.freedom[0] == answer.estimate.freedom, name


def test_a_compiled_function_knows_whose_rays_are_whose():
    """One compiled function, two namings of the same rays: names are no part of it, what they say of the points is."""
    traces = []

    @jax.jit
    def value(seen):
        traces.append(1)
        return calibrated(seen).value

    for names in (NAMES, [f"Q{i % 5}" for i in range(N)]):
        point = POINT_M[OF] if names is NAMES else np.tile(POINT_M[0], (N, 1)) + RNG.uniform(-30, 30, (5, 3))[np.arange(N) % 5]
        covariance = SURVEY_M2[OF] if names is NAMES else np.tile(SURVEY_M2[0], (N, 1, 1))
        seen = wj.Observations(SHOT, point, PIXEL_PX, SIGMA_PX, np.ones(N, bool), covariance, points=names)
        np.testing.assert_allclose((value(seen) - calibrated(seen, throw=False).value) / SIZE, 0, atol=1e-8)
    assert len(traces) == 1


def test_a_point_seen_once_is_what_it_was():
    """Names that are all different, and none, give the same numbers to the last bit."""
    named, unnamed = (calibrated(observed(names=names)) for names in ([f"{i}" for i in range(N)], UNNAMED))
    np.testing.assert_array_equal(named.value, unnamed.value)
    np.testing.assert_array_equal(named.estimate.covariance, unnamed.estimate.covariance)
    assert named.estimate.cost == unnamed.estimate.cost


def test_points_that_are_exact_in_some_direction_or_all():
    """Where the surveys have no error it is none that is shared; a height without error has a derivative all the same."""
    exact = calibrated(observed(covariance_m2=np.zeros_like(SURVEY_M2)))
    none = calibrated(dataclasses.replace(observed(), point_covariance_m2=None))
    np.testing.assert_allclose(exact.value, none.value, rtol=0, atol=1e-12)
    np.testing.assert_allclose(exact.estimate.covariance, none.estimate.covariance, rtol=1e-10)
    assert exact.estimate.cost == pytest.approx(none.estimate.cost, rel=1e-12)

    def by(variance_m2):
        one = jnp.diag(jnp.array([0.04, 0.09, 0.0])) + variance_m2 * jnp.diag(jnp.array([0.0, 0.0, 1.0]))
        return calibrated(observed(covariance_m2=jnp.tile(one, (POINTS, 1, 1)))).value / SIZE

    slope = jax.jit(jax.jacfwd(by))(0.0)
    # From zero on there is one side only: a three-point forward difference.
    h = 1e-5
    at = [np.asarray(jax.jit(by)(i * h)) for i in range(3)]
    np.testing.assert_allclose(slope, (-3 * at[0] + 4 * at[1] - at[2]) / (2 * h), rtol=0, atol=1e-4 * np.abs(slope).max())


def test_derivatives_are_differences():
    """By the pixels, by where the points are, and by how well they were surveyed; forwards and backwards."""
    into = RNG.normal(size=(N, 2)), RNG.normal(size=(POINTS, 3))

    @jax.jit
    def of(t):
        seen = wj.Observations(SHOT, (POINT_M + t[1] * into[1])[OF], PIXEL_PX + t[0] * into[0], SIGMA_PX, np.ones(N, bool),
                               jnp.exp(t[2]) * SURVEY_M2[OF], points=NAMES)  # fmt: skip
        estimate = calibrated(seen).estimate
        return jnp.concatenate([estimate.value / SIZE, estimate.sigma / SIZE, estimate.cost[None]])

    expected = differences(of, np.zeros(3), 0.2)
    largest = np.abs(expected).max(axis=0)
    for found in (jax.jit(jax.jacfwd(of))(np.zeros(3)), jax.jit(jax.jacrev(of))(np.zeros(3))):
        np.testing.assert_allclose((np.asarray(found) - expected) / largest, 0, atol=1e-6)
    assert (largest > 1e-3).all()


def test_the_covariance_tells_the_truth():
    """Surveys and noise drawn as they are stated, in 400 runs: errors in their own covariance are chi-square, four numbers a run.
    Counted anew for every ray they are not, and neither is the cost.
    """
    runs = 400
    truth, pixel_px = draw(5, runs)
    low, high = scipy.stats.chi2(4 * runs).ppf([0.0005, 0.9995])
    freedom = 2 * N + 3 - 4
    least, most = scipy.stats.chi2(freedom * runs).ppf([0.0005, 0.9995])
    shown = {}
    for names in (NAMES, UNNAMED):
        found = wj.calibrate_redrawn(SENSOR, observed(names=names), UNKNOWNS, pixel_px).estimate
        error, size = (found.value - truth) / SIZE, np.outer(SIZE, SIZE)
        nees = np.einsum("ri,ri->r", error, np.linalg.solve(found.covariance / size, error[..., None])[..., 0])
        shown[bool(names)] = low < nees.sum() < high, least < found.cost.sum() < most
        said = "one survey a point" if names else "one a ray"
        print(f"{said:20s} NEES {nees.mean():.2f} of 4, cost {found.cost.mean():.1f} of {freedom}")
    assert shown == {True: (True, True), False: (False, False)}


def test_a_far_bound_of_a_loss_is_least_squares_and_a_near_one_has_its_slope_zero(answer):
    """The loss acts on independent residuals, ray by ray: in units of their noise, by scipy's root of the dense matrix."""
    far = calibrated(observed(), loss=wj.Huber(1e6))
    np.testing.assert_allclose((far.value - answer.value) / answer.estimate.sigma, 0, atol=1e-8)
    spoilt = PIXEL_PX.copy()
    spoilt[7] += [6.0, -5.0]
    dense, bound = Dense(), 1.5
    noise = SIGMA_PX.ravel()
    whitens = np.linalg.inv(scipy.linalg.sqrtm(dense.covariance_px2 / np.outer(noise, noise)).real) / noise

    def cost(u):
        left = (spoilt - images(START + SIZE * u, POINT_M[OF])).ravel()
        squared = ((whitens @ left).reshape(N, 2) ** 2).sum(axis=1)
        s = jnp.sqrt(squared)
        huber = jnp.where(s > bound, bound * s - bound**2 / 2, squared / 2)
        return huber.sum() + 0.5 * (u[:3] ** 2).sum()

    found = calibrated(observed(spoilt), loss=wj.Huber(bound))
    u = (found.value - START) / SIZE
    slope, curvature = jax.grad(cost)(u), jax.hessian(cost)(u)
    np.testing.assert_allclose(np.linalg.solve(curvature, slope) * SIZE / answer.estimate.sigma, 0, atol=1e-6)
    assert found.robust_weight[7] < 0.5 and found.robust_weight[7] == found.robust_weight.min()


def test_blunders_of_single_rays_are_found_among_rays_of_one_point(answer):
    """Two rays off by ten of their sigmas: the others of their points stay, and the answer is that of the others."""
    wrong = [int(np.flatnonzero(OF == 0)[1]), int(np.flatnonzero(OF == 2)[4])]
    spoilt = PIXEL_PX.copy()
    spoilt[wrong] += [[5.0, 0.0], [-3.0, 4.0]]
    found = calibrated(observed(spoilt), blunders=wj.Blunders())
    assert np.flatnonzero(~found.used).tolist() == sorted(wrong)
    compare(found.estimate, Dense(found.used).solved())


def test_one_point_has_one_survey():
    point = POINT_M[OF] + np.where(np.arange(N) == 9, 1.0, 0.0)[:, None]
    with pytest.raises(wj.WhiskjaxError, match=r"observation 9, point P\d: another point_m than observation \d, point P\d"):
        dataclasses.replace(observed(), point_m=point)
    with pytest.raises(wj.WhiskjaxError, match="another point_covariance_m2"):
        twice = (1 + (np.arange(N) == 9))[:, None, None]
        dataclasses.replace(observed(), point_covariance_m2=observed().point_covariance_m2 * twice)


def test_points_of_a_flight_are_those_of_its_tables(flight, tmp_path):
    """Two images of one point, in Python and from a folder: one point, whose survey error is one."""
    measured = flight.measurements
    point = measured.point.copy()
    point[[3, 7]] = point[[140, 141]]
    twice = dataclasses.replace(flight, measurements=dataclasses.replace(measured, point=point))
    for of in (twice, wj.read_flight(wj.write_flight(twice, tmp_path / "twice"))):
        seen = of.observations()
        assert (np.bincount(seen.point) == 2).sum() == 2 and len(np.unique(seen.point)) == len(seen) - 2
        names = np.array(seen.points)
        np.testing.assert_array_equal(names[:, None] == names, seen.point[:, None] == seen.point)


def test_rays_keep_their_points():
    """When some are taken, when all is replaced but the names, and by number where there are no names."""
    seen = observed()
    np.testing.assert_array_equal(seen.point[:, None] == seen.point, OF[:, None] == OF)
    some = seen.take(np.arange(5, N))
    np.testing.assert_array_equal(some.point[:, None] == some.point, OF[5:, None] == OF[5:])
    numbered = dataclasses.replace(observed(names=UNNAMED), point=OF)
    np.testing.assert_array_equal(dataclasses.replace(numbered, pixel_px=PIXEL_PX + 1).point, numbered.point)
    np.testing.assert_array_equal(calibrated(numbered).value, calibrated(seen).value)
    assert observed(names=UNNAMED).point is None and observed(names=[f"{i}" for i in range(N)]).point is None
    assert seen.take([int(np.flatnonzero(OF == p)[0]) for p in range(POINTS)]).point is None

"""Many calibrations in one call: each lane is the calibration of its own run, whatever happens in the others."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import whiskjax as wj
from whiskjax.estimate import many
from whiskjax.estimate.checks import CHECKS
from whiskjax.estimate.lanes import solve_lanes
from whiskjax.estimate.problem import pose_problem, weigh
from whiskjax.flights import haian
from whiskjax.rules.results import codes_of, message_of

SIGMA = np.concatenate(haian.PRIOR_SIGMA)


def said(batch):
    return [message_of(int(code)) for code in codes_of(batch.result)]


@pytest.fixture(scope="module")
def flights(flight):
    return [flight, haian.simulate(12), haian.simulate(13)]


@pytest.fixture(scope="module")
def one_by_one(flights):
    """By Levenberg-Marquardt."""
    return [wj.calibrate(f.sensor, f.observations(), f.unknowns) for f in flights]


@pytest.fixture(scope="module")
def batch(flights):
    """From a generator."""
    return wj.calibrate_batch(((f.sensor, f.observations()) for f in flights), flights[0].unknowns, chunk=3)


def test_each_lane_is_the_calibration_of_its_run(batch, one_by_one):
    assert batch.is_successful.all() and said(batch) == [""] * 3
    for i, alone in enumerate(one_by_one):
        np.testing.assert_allclose((batch.value[i] - alone.value) / SIGMA, 0, atol=1e-8)
        np.testing.assert_allclose(batch.estimate.covariance[i], alone.posterior.covariance, rtol=1e-8)
        np.testing.assert_allclose(batch.estimate.sigma[i], alone.posterior.sigma, rtol=1e-8)
        np.testing.assert_allclose(batch.residual_before_px[i], alone.residual_before_px, atol=1e-8)
        np.testing.assert_allclose(batch.residual_after_px[i], alone.residual_after_px, atol=1e-6)
        np.testing.assert_allclose(batch.estimate.prior_share[i], alone.estimate.prior_share, rtol=1e-8)
        assert batch.estimate.cost[i] == pytest.approx(alone.estimate.cost, rel=1e-9)
        assert batch.estimate.freedom[i] == alone.estimate.freedom
    assert batch.estimate.names == one_by_one[0].estimate.names and batch.estimate.places == one_by_one[0].estimate.places
    assert [x.name for x in batch.unknowns] == [x.name for x in one_by_one[0].unknowns]


def test_a_batch_has_the_verdicts_of_its_runs(batch, one_by_one, flights):
    """Of all checks that ask for the estimate alone; and a run whose noise is three times what was said fails alone."""
    own = [{check.kind: int(check.figures(alone.evidence)[0]) for check in CHECKS} for alone in one_by_one]
    for kind in ("solution", "consistency", "correlation", "prior alone", "far from the prior"):
        assert batch.grades[kind].tolist() == [found[kind] for found in own]
    assert batch.is_sound.all()
    f = flights[0]
    seen, noise = f.observations(), np.random.default_rng(5).normal(size=(2, 231, 2))
    pixel = seen.pixel_px - one_by_one[0].residual_after_px + noise * seen.sigma_px * np.array([1.0, 3.0])[:, None, None]
    assert wj.calibrate_redrawn(f.sensor, seen, f.unknowns, pixel).is_sound.tolist() == [True, False]


def test_one_run_of_a_batch_is_knowledge_and_all_of_them_are_none(batch, flights):
    one = jax.tree.map(lambda a: a[1], batch.estimate)
    assert [(x.name, x.mean, x.sigma) for x in one.unknowns] == [
        (x.name, batch.value[1, i], batch.estimate.sigma[1, i]) for i, x in enumerate(flights[0].unknowns)
    ]
    with pytest.raises(wj.WhiskjaxError, match="calibrate: unknowns\\[0\\] is the answer of many runs"):
        wj.calibrate(flights[0].sensor, flights[0].observations(), batch)


def test_the_chunk_does_not_matter(flights, batch):
    """A chunk of 2 leaves the third lane alone, and one to be filled up."""
    runs = [(f.sensor, f.observations()) for f in flights]
    other = wj.calibrate_batch(runs, flights[0].unknowns, chunk=2)
    np.testing.assert_allclose((other.value - batch.value) / SIGMA, 0, atol=1e-12)
    np.testing.assert_allclose(other.estimate.covariance, batch.estimate.covariance, rtol=1e-9)
    np.testing.assert_allclose(other.residual_after_px, batch.residual_after_px, atol=1e-8)
    np.testing.assert_array_equal(codes_of(other.result), codes_of(batch.result))


def test_shares_come_back_in_the_order_of_the_runs(flights, batch, monkeypatch):
    """Seven runs in shares of three: the last is one lane, filled up."""
    monkeypatch.setattr(many, "_SHARE", 3)
    order = [2, 0, 1, 1, 2, 0, 1]
    found = wj.calibrate_batch(((flights[i].sensor, flights[i].observations()) for i in order), flights[0].unknowns, chunk=3)
    np.testing.assert_allclose((found.value - batch.value[order]) / SIGMA, 0, atol=1e-12)
    np.testing.assert_allclose(found.residual_after_px, batch.residual_after_px[order], atol=1e-8)
    assert found.is_successful.all() and found.estimate.cost.shape == (7,)


def at(observations, which, time_s):
    time = np.array(observations.shot.time_s)
    time[which] = time_s
    return dataclasses.replace(observations, shot=dataclasses.replace(observations.shot, time_s=time))


def test_a_run_that_cannot_be_imaged_spoils_no_other(flights, batch):
    """Control points in a gap of the POS, before its start, and behind the camera: each lane says so."""
    first, good, last = flights
    observations = first.observations()
    point = observations.point_m.copy()
    point[4] *= 1.01
    for wrong, message in (
        (at(observations, 3, 30.0), "time lies in a gap"),
        (at(observations, 3, -500.0), "time lies outside the recorded samples"),
        (dataclasses.replace(observations, point_m=point), "point lies behind the camera"),
    ):
        runs = [(good.sensor, good.observations()), (first.sensor, wrong), (last.sensor, last.observations())]
        found = wj.calibrate_batch(runs, first.unknowns, chunk=3)
        np.testing.assert_array_equal(found.is_successful, [True, False, True])
        assert message in said(found)[1]
        np.testing.assert_allclose((found.value - batch.value[[1, 0, 2]])[[0, 2]] / SIGMA, 0, atol=1e-12)


def test_a_check_point_that_cannot_be_imaged_is_no_success(flights):
    """Its residual would be that of a pose interpolated across the gap."""
    good = [(f.sensor, f.observations()) for f in flights[:2]]
    observations = flights[2].observations()
    check = int(np.flatnonzero(~observations.is_control)[0])
    found = wj.calibrate_batch([*good, (flights[2].sensor, at(observations, check, 30.0))], flights[0].unknowns, chunk=3)
    np.testing.assert_array_equal(found.is_successful, [True, True, False])


def test_a_run_that_does_not_converge_says_so(flights, batch):
    """One step only: enough from the solution, too few from zero; the weights are those of the start, so their round first."""
    first = flights[0]
    near = first.sensor
    for _ in range(2):
        runs = [(near, first.observations())] * 3
        near = wj.assign(first.sensor, first.unknowns, wj.calibrate_batch(runs, first.unknowns, chunk=3).value[0])
    runs = [(near, first.observations()), (first.sensor, first.observations()), (near, first.observations())]
    found = wj.calibrate_batch(runs, first.unknowns, steps=1, chunk=3)
    np.testing.assert_array_equal(found.is_successful, [True, False, True])
    assert "did not converge" in said(found)[1]
    # The weights at the start differ by the change of a metre's size in pixels: far below a sigma.
    np.testing.assert_allclose((found.value - batch.value[0])[[0, 2]] / SIGMA, 0, atol=1e-4)


def copies(observations):
    """The first point of each swing in place of all of its points."""
    swing = np.asarray(observations.shot.swing)
    i = np.array([np.flatnonzero(swing == s)[0] for s in swing])
    shot = dataclasses.replace(observations.shot, time_s=np.asarray(observations.shot.time_s)[i])
    moved = {"point_m": observations.point_m[i], "pixel_px": observations.pixel_px[i]}
    return dataclasses.replace(observations, shot=shot, **moved)


def test_a_run_whose_data_determine_too_little_says_so(flights):
    """Without priors, two points a flight: rank 4 of 15, in one lane of three. Priors elsewhere would hide it."""
    free = [dataclasses.replace(x, mean=None, sigma=None, scale=x.sigma) for x in flights[0].unknowns]
    good, bad = ((flights[0].sensor, o) for o in (flights[0].observations(), copies(flights[0].observations())))
    found = wj.calibrate_batch([good, bad, good], free, chunk=3)
    assert "do not determine" in said(found)[1]
    alone = wj.calibrate(*bad, free, throw=False)
    assert message_of(int(codes_of(alone.result))) == said(found)[1]
    # The condition number without priors is 1e7 (normal matrix): the others are determined, and equal.
    np.testing.assert_array_equal(found.value[0], found.value[2])
    assert np.isfinite(found.value[0]).all()
    assert "do not determine" not in said(found)[0]


def test_runs_of_another_layout_are_named(flights):
    """A point less, a control and a check point exchanged, another order: what is padded to the same size all the same."""
    first, second = ((f.sensor, f.observations()) for f in flights[:2])
    check = int(np.flatnonzero(~second[1].is_control)[0])
    shorter = second[1].take(np.arange(231) != check)
    role = np.where(np.isin(np.arange(231), [0, check]), ~second[1].is_control, second[1].is_control)
    roles = dataclasses.replace(second[1], is_control=role)
    shuffled = second[1].take(np.random.default_rng(0).permutation(231))
    for number, wrong in ((1, shorter), (2, roles), (1, shuffled)):
        runs = [first, second, second]
        runs[number] = (second[0], wrong)
        with pytest.raises(wj.WhiskjaxError, match=f"run {number} has another chain than run 0, or its observations are others"):
            wj.calibrate_batch(runs, flights[0].unknowns, chunk=3)


def test_bad_input_is_named(flights):
    sensor, observations, unknowns = flights[0].sensor, flights[0].observations(), flights[0].unknowns
    with pytest.raises(wj.WhiskjaxError, match="there are no runs"):
        wj.calibrate_batch(iter([]), unknowns)
    for chunk in (0, -1):
        with pytest.raises(wj.WhiskjaxError, match="chunk"):
            wj.calibrate_batch([(sensor, observations)], unknowns, chunk=chunk)
    nothing = dataclasses.replace(observations, is_control=np.zeros(231, bool))
    with pytest.raises(wj.WhiskjaxError, match="at least one control point is needed"):
        wj.calibrate_batch([(sensor, nothing)], unknowns, chunk=3)
    for shape in ((231, 2), (3, 230, 2), (3, 231, 3), (0, 231, 2)):
        with pytest.raises(wj.WhiskjaxError, match=r"pixel_px has shape .*, expected \(runs, 231, 2\)"):
            wj.calibrate_redrawn(sensor, observations, unknowns, np.zeros(shape))
    late = at(observations, 3, 30.0)
    with pytest.raises(wj.SensorError, match=r"observation 3, image L1, point L1-04: .*gap"):
        wj.calibrate_redrawn(sensor, late, unknowns, observations.pixel_px[None])
    with pytest.raises(wj.SensorError, match=r"observation 3, image L1, point L1-04: .*gap"):
        wj.images_of(sensor, late, unknowns, np.zeros((1, 15)))
    for shape in ((15,), (2, 14)):
        with pytest.raises(wj.WhiskjaxError, match=r"values has shape .*, expected \(runs, 15\)"):
            wj.images_of(sensor, observations, unknowns, np.zeros(shape))


def test_redrawn_measurements_are_runs_of_their_own(flights, batch):
    """27 lanes in chunks of 25: the second chunk is filled up. The drawn pixels are not in the observations handed over."""
    sensor, observations, unknowns = flights[0].sensor, flights[0].observations(), flights[0].unknowns
    noise = np.random.default_rng(1).normal(size=(27, 231, 2)) * observations.sigma_px
    pixel = observations.pixel_px + noise
    found = wj.calibrate_redrawn(sensor, observations, unknowns, pixel, chunk=25)
    assert found.is_successful.all() and found.value.shape == (27, 15)
    some = [0, 24, 26]
    runs = [(sensor, dataclasses.replace(observations, pixel_px=pixel[i])) for i in some]
    expected = wj.calibrate_batch(runs, unknowns, chunk=3)
    np.testing.assert_allclose((found.value[some] - expected.value) / SIGMA, 0, atol=1e-11)
    np.testing.assert_allclose(found.estimate.covariance[some], expected.estimate.covariance, rtol=1e-8)
    np.testing.assert_allclose(found.estimate.cost[some], expected.estimate.cost, rtol=1e-10)
    np.testing.assert_allclose(found.residual_before_px[some], expected.residual_before_px, atol=1e-8)
    np.testing.assert_allclose(found.residual_after_px[some], expected.residual_after_px, atol=1e-7)
    np.testing.assert_array_equal(found.estimate.freedom[some], expected.estimate.freedom)
    # 27 different draws: no lane stands for another.
    assert (np.diff(np.sort(found.estimate.cost)) > 0).all()


def test_images_of_other_values_are_projections(flights):
    sensor, observations, unknowns = flights[0].sensor, flights[0].observations(), flights[0].unknowns
    values = np.random.default_rng(2).normal(size=(3, 15)) * SIGMA * 0.3
    found = wj.images_of(sensor, observations, unknowns, values)
    for value, images in zip(values, found, strict=True):
        expected = wj.project(wj.assign(sensor, unknowns, value), observations.shot, observations.point_m).pixel_px
        # Rounding of ECEF coordinates, 1e-9 m at 3.5 px a metre, some operations long.
        np.testing.assert_allclose(images, expected, rtol=0, atol=1e-7)


def test_images_of_the_calibration_leave_its_residuals(flight, calibration):
    found = wj.images_of(flight.sensor, flight.observations(), flight.unknowns, calibration.value[None])[0]
    np.testing.assert_allclose(flight.observations().pixel_px - found, calibration.residual_after_px, atol=1e-7)


# A camera 100 m above six points, in each lane turned otherwise: three angles with priors and the focal length without.
POINTS_M = np.random.default_rng(6).uniform([-30, -30, -5], [30, 30, 5], (6, 3))
TURNS_RAD = np.random.default_rng(7).normal(0, 0.02, (5, 3))
NOISE_PX = np.random.default_rng(8).normal(0, 1.0, (5, 6, 2))
STATION = wj.Sensor(
    {"station": wj.Mount(lever_arm_m=[0.0, 0.0, 100.0]), "turned": wj.Mount(angles_rad=[0.0, 0.0, 0.0])},
    wj.LineCamera(1000.0),
)
UNKNOWNS = [
    *(wj.Unknown(f"turn {axis}", f"turned.angles_rad[{i}]", 0.0, 0.02) for i, axis in enumerate("xyz")),
    wj.Unknown("focal", "camera.focal_px", scale=10.0),
]


def image(angles_rad, focal_px):
    """Collinearity: x = -f q_x / q_z, y = -f q_y / q_z, looking along -z."""
    q = (POINTS_M - [0, 0, 100]) @ Rotation.from_euler("XYZ", angles_rad).as_matrix()
    return -focal_px * q[:, :2] / q[:, 2:]


def lane(pixel):
    seen = wj.Observations(wj.Shot(), POINTS_M, pixel, np.full((6, 2), 2.0), np.ones(6, bool))
    problem, start, indices = pose_problem(STATION, seen, UNKNOWNS)
    return weigh(problem, np.tile([0.5, 0.0, 0.5], (6, 1)), indices), start


@pytest.fixture(scope="module")
def stacked():
    pixels = [image(turn, 1010.0) + noise for turn, noise in zip(TURNS_RAD, NOISE_PX, strict=True)]
    problems, starts = zip(*(lane(pixel) for pixel in pixels), strict=True)
    whole = jax.tree.map(lambda *leaves: jnp.stack(leaves) if eqx.is_array(leaves[0]) else leaves[0], *problems)
    return pixels, whole, np.stack(starts)


def test_lanes_of_a_made_up_problem_are_scipys(stacked):
    pixels, problem, starts = stacked
    found = eqx.filter_jit(solve_lanes)(problem, jnp.asarray(starts), 8, 2)
    for i, pixel in enumerate(pixels):

        def residuals(u, pixel=pixel):
            r = (pixel - image(0.02 * u[:3], 1000 + 10 * u[3])) / 2.0
            return np.concatenate([r.ravel(), u[:3]])

        best = least_squares(residuals, np.zeros(4), xtol=1e-15, ftol=1e-15, gtol=1e-15, jac="3-point")
        np.testing.assert_allclose(found.u[i], best.x, atol=1e-7)
        np.testing.assert_allclose(found.covariance[i], np.linalg.inv(best.jac.T @ best.jac), atol=1e-6)
        assert found.cost[i] == pytest.approx(2 * best.cost, rel=1e-9)
        np.testing.assert_allclose(np.stack(found.residual_px[0], -1)[i, :6], 2 * residuals(best.x)[:12].reshape(6, 2), atol=1e-5)
    assert (codes_of(found.result) == 0).all()


def test_one_start_may_serve_all_lanes(stacked):
    _, problem, starts = stacked
    solve = eqx.filter_jit(solve_lanes)
    shared = solve(problem, jnp.asarray(starts[0]), 8, 5)
    own = solve(problem, jnp.asarray(starts), 8, 2)
    np.testing.assert_allclose(shared.u, own.u, atol=1e-12)


def test_each_run_starts_from_its_own_sensor(flights):
    """Without a prior an unknown counts from the sensor's own number, which is another one in each run."""
    flight = flights[0]
    free = dataclasses.replace(flight.unknowns[-1], mean=None, sigma=None, scale=0.01)
    unknowns = [*flight.unknowns[:-1], free]
    starts = np.radians([-0.2, 0.3])
    runs = [(wj.assign(flight.sensor, [free], [start]), flight.observations()) for start in starts]
    found = wj.calibrate_batch(runs, unknowns)
    assert found.is_successful.all()
    for i, (sensor, observations) in enumerate(runs):
        alone = wj.calibrate(sensor, observations, unknowns)
        np.testing.assert_allclose((found.value[i] - alone.value) / SIGMA, 0, atol=1e-8)

"""POS samples to poses against scipy: linear and cubic Hermite positions, slerp, delays, gaps; and one pose for each image."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, interp1d
from scipy.spatial.transform import Rotation, Slerp

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from whiskjax.chain.trajectory import ecef_from_body
from whiskjax.rules.results import codes_of, is_successful

R = wj.RESULTS
POSITION_M = 4e-9  # rounding of ECEF
TURN = 1e-13  # entries of a rotation

RNG = np.random.default_rng(11)
N = 30
EPOCH_S = 500.0
TIME_S = EPOCH_S + np.cumsum(RNG.uniform(0.5, 1.5, N)) * 0.1
LAT, LON = 0.7 + 1e-6 * np.cumsum(RNG.normal(1, 0.1, (2, N)), axis=1)
HEIGHT_M = 3000 + np.cumsum(RNG.normal(size=N))
ROLL, PITCH = RNG.uniform(-0.5, 0.5, (2, N))
HEADING = np.linspace(3.0, 3.3, N) % (2 * np.pi)  # through south
VELOCITY_NED = RNG.normal([60.0, 20.0, 0.0], 1.0, (N, 3))

POSITION = oracles.ecef(LAT, LON, HEIGHT_M)
TO_ECEF = oracles.ecef_from_ned(LAT, LON)
ATTITUDE = TO_ECEF * oracles.body_in_ned(ROLL, PITCH, HEADING)
VELOCITY = TO_ECEF.apply(VELOCITY_NED)
T = np.concatenate([TIME_S[[0, 7, -1]], np.linspace(TIME_S[0] + 0.1, TIME_S[-1] - 0.1, 40)])


@eqx.filter_jit
def arrays(link, shot):
    pose = link.pose(shot)
    return pose.matrix, pose.origin_m


def geodetic(**options):
    return wj.Trajectory.from_geodetic(TIME_S, LAT, LON, HEIGHT_M, ROLL, PITCH, HEADING, max_gap_s=0.2, **options)


def assert_pose(link, t, position, attitude):
    matrix, origin = arrays(link, wj.Shot(time_s=t))
    np.testing.assert_allclose(origin, position, rtol=0, atol=POSITION_M)
    np.testing.assert_allclose(matrix, attitude.as_matrix(), rtol=0, atol=TURN)


def test_positions_are_linear_and_attitudes_slerp():
    linear, slerp = interp1d(TIME_S, POSITION, axis=0), Slerp(TIME_S, ATTITUDE)
    assert_pose(geodetic(), T, linear(T), slerp(T))


def test_positions_are_hermite_where_velocities_exist():
    hermite, slerp = CubicHermiteSpline(TIME_S, POSITION, VELOCITY), Slerp(TIME_S, ATTITUDE)
    # The two interpolations differ by metres here.
    assert np.abs(hermite(T) - interp1d(TIME_S, POSITION, axis=0)(T)).max() > 0.1
    assert_pose(geodetic(velocity_ned_mps=VELOCITY_NED), T, hermite(T), slerp(T))
    world = wj.Trajectory(TIME_S, POSITION, ATTITUDE.as_quat(), velocity_mps=VELOCITY, max_gap_s=0.2)
    assert_pose(world, T, hermite(T), slerp(T))


def test_the_sign_of_a_quaternion_does_not_matter():
    q = ATTITUDE.as_quat() * RNG.choice([-1, 1], N)[:, None] * RNG.uniform(0.9, 1.1, N)[:, None]
    assert_pose(
        wj.Trajectory(TIME_S, POSITION, q, max_gap_s=0.2), T, interp1d(TIME_S, POSITION, axis=0)(T), Slerp(TIME_S, ATTITUDE)(T)
    )


def test_attitudes_far_apart_turn_the_short_way():
    q = Rotation.from_rotvec([[0, 0, 0.0], [0, 0, 3.0], [3.0, 0, 0], [0, 0, 0]])
    link = wj.Trajectory(np.arange(4.0), np.zeros((4, 3)), q.as_quat(), max_gap_s=2.0)
    t = np.linspace(0, 3, 43)
    assert_pose(link, t, np.zeros((43, 3)), Slerp(np.arange(4.0), q)(t))


def test_two_equal_attitudes_stay():
    link = wj.Trajectory([0.0, 1.0], np.zeros((2, 3)), [[0, 0, 0, 1.0]] * 2, max_gap_s=2.0)
    assert_pose(link, np.array([0.5]), np.zeros((1, 3)), Rotation.identity(1))
    assert_derivatives(lambda v: link.pose(wj.Shot(v[0])).rotation[0][0], [0.5], 1e-2, 1e-14, zero=True)


DELAY_S, ATTITUDE_DELAY_S = 0.05, 0.07


def test_delays_add_to_the_time_of_the_shot():
    """The value valid at the shot was stamped later by the delay; the attitude's is on top of the whole POS's."""
    t = T[3:-4]
    link = geodetic(delay_s=DELAY_S, attitude_delay_s=ATTITUDE_DELAY_S)
    linear, slerp = interp1d(TIME_S, POSITION, axis=0), Slerp(TIME_S, ATTITUDE)
    assert_pose(link, t, linear(t + DELAY_S), slerp(t + DELAY_S + ATTITUDE_DELAY_S))
    assert_pose(geodetic(attitude_delay_s=ATTITUDE_DELAY_S), t, linear(t), slerp(t + ATTITUDE_DELAY_S))


def test_an_attitude_stamped_late_is_found_by_a_positive_delay():
    """A recorder that stamps the attitude 0.07 s after it was valid; the positive delay undoes it."""
    rate = 0.8
    # At each stamp stands the attitude of 0.07 s before.
    q = Rotation.from_rotvec(np.outer(TIME_S - EPOCH_S - ATTITUDE_DELAY_S, [0, 0, rate]))
    link = wj.Trajectory(TIME_S, POSITION, q.as_quat(), max_gap_s=0.2, attitude_delay_s=ATTITUDE_DELAY_S)
    t = T[3:-4]
    truth = Rotation.from_rotvec(np.outer(t - EPOCH_S, [0, 0, rate]))
    assert_pose(link, t, interp1d(TIME_S, POSITION, axis=0)(t), truth)


def codes(link, t):
    return codes_of(link.check(wj.Shot(time_s=np.asarray(t))))


def test_nothing_is_extrapolated_and_no_gap_is_bridged():
    time = np.array([0.0, 1.0, 2.0, 12.0, 13.0])
    outside, gap, fine = (codes_of(r) for r in (R.time_outside_trajectory, R.time_in_gap, R.successful))

    def trajectory(**delays):
        return wj.Trajectory(time, np.zeros((5, 3)), [[0, 0, 0, 1.0]] * 5, max_gap_s=1.5, **delays)

    np.testing.assert_array_equal(codes(trajectory(), [-1e-9, 0.0, 2.0, 2.1, 11.9, 12.0, 13.0, 13.1, np.nan]),
                                  [outside, fine, fine, gap, gap, fine, fine, outside, outside])  # fmt: skip
    # It is the delayed time that has to be recorded; the attitude's own too.
    np.testing.assert_array_equal(
        codes(trajectory(delay_s=0.5), [-0.5, -0.6, 1.6, 12.4, 12.6]), [fine, outside, gap, fine, outside]
    )
    np.testing.assert_array_equal(codes(trajectory(attitude_delay_s=0.5), [-0.1, 0.0, 1.6, 12.6]), [outside, fine, gap, outside])
    np.testing.assert_array_equal(
        codes(trajectory(delay_s=-1.0, attitude_delay_s=0.5), [1.0, 0.9, 12.5, 13.5, 13.6]), [fine, outside, gap, fine, outside]
    )


def test_derivatives_with_respect_to_time_and_delays():
    def f(x):
        link = eqx.tree_at(lambda k: (k.delay_s, k.attitude_delay_s), start, (x[1], x[2]))
        pose = link.pose(wj.Shot(time_s=x[0]))
        return pose.matrix, pose.origin_m

    start = geodetic(velocity_ned_mps=VELOCITY_NED, delay_s=0.01, attitude_delay_s=0.002)
    inside = (TIME_S[[3, 12, 20]] + TIME_S[[4, 13, 21]]) / 2 - 0.01
    x = [[t, 0.01, 0.002] for t in inside]
    # 1 ms steps stay between samples; ECEF rounding 4e-9 m, and rotations turn by 1e-2 rad.
    assert_derivatives(f, x, step=[1e-3, 1e-3, 1e-3], tolerance=[1e-12] * 9 + [2e-8] * 3)


def test_derivatives_with_respect_to_the_samples():
    def f(x):
        link = eqx.tree_at(lambda k: [*k.position_m, *k.velocity_mps], start, [x[:N], *parts[1:3], x[N:], *parts[4:]])
        return link.pose(wj.Shot(time_s=T[5:8])).origin_m

    start = geodetic(velocity_ned_mps=VELOCITY_NED)
    parts = [*start.position_m, *start.velocity_mps]
    assert_derivatives(f, np.concatenate([parts[0], parts[3]]), step=100.0, tolerance=2e-8)


GOOD = {"time_s": TIME_S[:3], "position_m": POSITION[:3], "quaternion_xyzw": np.eye(4)[:3], "max_gap_s": 1.0}


@pytest.mark.parametrize(
    "change, message",
    [
        ({"position_m": POSITION[:2]}, r"Trajectory: position_m has shape \(2, 3\), expected \(n, 3\) with n = 3"),
        ({"quaternion_xyzw": np.eye(4)}, r"quaternion_xyzw has shape \(4, 4\), expected \(n, 4\) with n = 3"),
        ({"velocity_mps": VELOCITY[:4]}, r"velocity_mps has shape \(4, 3\), expected \(n, 3\) with n = 3"),
        ({"position_m": np.full((3, 3), np.nan)}, r"position_m holds no finite number at index \(0, 0\)"),
        ({"velocity_mps": [[0, 0, 0], [0, np.inf, 0], [0, 0, 0]]}, r"velocity_mps holds no finite number at index \(1, 1\)"),
        ({"quaternion_xyzw": [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 0]]}, "quaternion of sample 2 has length 0"),
        ({"time_s": [0.0, 1.0, 1.0]}, "Trajectory: .*sample 2.* repeats"),
    ],
)
def test_what_is_wrong_with_the_samples_is_named(change, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.Trajectory(**{**GOOD, **change})


@pytest.mark.parametrize(
    "column, value, message",
    [
        (1, 120.5, r"lat_rad is 120.5 at index \(4,\).*radians are expected.*latitude before longitude"),
        (1, np.radians(120.5), r"lat_rad is 2.103\d* at index \(4,\).*latitude before longitude"),
        (2, 120.5, r"lon_rad is 120.5 at index \(4,\).*radians are expected"),
        (4, np.radians(2000.0), r"roll_rad is 34.9\d* at index \(4,\)"),
        (5, 45.0, r"pitch_rad is 45 at index \(4,\)"),
        (6, 30.0, r"heading_rad is 30 at index \(4,\)"),
        (4, np.nan, r"roll_rad holds no finite number at index \(4,\)"),
        (3, np.nan, r"height_m holds no finite number at index \(4,\)"),
    ],
)
def test_degrees_and_swapped_columns_are_refused(column, value, message):
    columns = [c.copy() for c in (TIME_S, LAT, LON, HEIGHT_M, ROLL, PITCH, HEADING)]
    columns[column][4] = value
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.Trajectory.from_geodetic(*columns, max_gap_s=0.2)


def test_columns_of_different_length_are_refused():
    with pytest.raises(wj.WhiskjaxError, match="heading"):
        wj.Trajectory.from_geodetic(TIME_S, LAT, LON, HEIGHT_M, ROLL, PITCH, HEADING[:-1], max_gap_s=0.2)


def test_a_shot_without_a_time_is_refused_with_the_remedy():
    with pytest.raises(wj.WhiskjaxError, match="time_s"):
        geodetic().pose(wj.Shot(image=0))


TURN_RAD, SHIFT_M = RNG.normal(0, 0.1, (N, 3)), RNG.normal(0, 1, (N, 3))
IMAGE = np.array([3, 0, N - 1, 3])


def test_one_pose_per_image():
    assert_image_poses(wj.PosePerImage(POSITION, -2 * ATTITUDE.as_quat()), POSITION[IMAGE], ATTITUDE[IMAGE])


def assert_image_poses(link, position, attitude):
    matrix, origin = arrays(link, wj.Shot(image=IMAGE))
    np.testing.assert_allclose(origin, position, rtol=0, atol=POSITION_M)
    np.testing.assert_allclose(matrix, attitude.as_matrix(), rtol=0, atol=TURN)
    for i, image in enumerate(IMAGE):
        one = link.pose(wj.Shot(image=int(image)))
        np.testing.assert_allclose(one.origin_m, position[i], rtol=0, atol=POSITION_M)


def test_small_motions_of_image_poses_lie_in_the_body_frame():
    """p_world = R exp([turn]x) p + t + R shift."""
    link = wj.PosePerImage(POSITION, ATTITUDE.as_quat(), TURN_RAD, SHIFT_M)
    moved = ATTITUDE[IMAGE] * Rotation.from_rotvec(TURN_RAD[IMAGE])
    assert_image_poses(link, POSITION[IMAGE] + ATTITUDE[IMAGE].apply(SHIFT_M[IMAGE]), moved)
    only_shift = wj.PosePerImage(POSITION, ATTITUDE.as_quat(), shift_m=SHIFT_M)
    assert_image_poses(only_shift, POSITION[IMAGE] + ATTITUDE[IMAGE].apply(SHIFT_M[IMAGE]), ATTITUDE[IMAGE])


def test_derivatives_of_image_poses():
    def f(x):
        link = wj.PosePerImage(POSITION, ATTITUDE.as_quat())
        small = jnp.tile(x[:3], (N, 1)), jnp.tile(x[3:], (N, 1))
        link = eqx.tree_at(lambda k: (k.turn_rad, k.shift_m), link, small, is_leaf=lambda v: v is None)
        pose = link.pose(wj.Shot(image=4))
        return pose.matrix, pose.origin_m

    x = [[0.0] * 6, [0.1, -0.2, 0.3, 1.0, 2.0, 3.0]]
    assert_derivatives(f, x, step=[1e-2] * 3 + [10.0] * 3, tolerance=[1e-11] * 9 + [2e-8] * 3)


def test_unknown_images_are_flagged():
    link = wj.PosePerImage(POSITION, ATTITUDE.as_quat())
    result = link.check(wj.Shot(image=np.array([-1, 0, N - 1, N])))
    np.testing.assert_array_equal(is_successful(result), [False, True, True, False])
    assert bool(link.check(wj.Shot(image=N)) == R.unknown_key)


def test_a_shot_without_an_image_is_refused_with_the_remedy():
    with pytest.raises(wj.WhiskjaxError, match="image"):
        wj.PosePerImage(POSITION, ATTITUDE.as_quat()).pose(wj.Shot(time_s=0.0))


@pytest.mark.parametrize(
    "position, quaternion, message",
    [
        (POSITION[:2], np.eye(4)[:3], r"quaternion_xyzw has shape \(3, 4\), expected \(images, 4\) with images = 2"),
        (POSITION[0], np.eye(4)[:1], r"PosePerImage: position_m has shape \(3,\)"),
        (POSITION[:1] * np.nan, np.eye(4)[:1], r"position_m holds no finite number at index \(0, 0\)"),
        (POSITION[:2], np.array([[0, 0, 0, 1], [0, 0, np.nan, 1]]), r"quaternion_xyzw holds no finite number at index \(1, 2\)"),
        (POSITION[:2], np.array([[0, 0, 0, 1.0], [0, 0, 0, 0]]), "quaternion of image 1"),
    ],
)
def test_what_is_wrong_with_image_poses_is_named(position, quaternion, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.PosePerImage(position, quaternion)


def test_one_navigation_record_as_components():
    pose = ecef_from_body(LAT, LON, HEIGHT_M, ROLL, PITCH, HEADING)
    np.testing.assert_allclose(pose.matrix, ATTITUDE.as_matrix(), rtol=0, atol=TURN)
    np.testing.assert_allclose(pose.origin_m, POSITION, rtol=0, atol=POSITION_M)
    x = [[LAT[0], LON[0], HEIGHT_M[0], ROLL[0], PITCH[0], HEADING[0]]]
    step, tolerance = [1e-3, 1e-3, 100.0, 1e-2, 1e-2, 1e-2], [1e-11] * 9 + [3e-8] * 3

    def f(x):
        pose = ecef_from_body(*x)
        return pose.matrix, pose.origin_m

    assert_derivatives(f, x, step, tolerance)

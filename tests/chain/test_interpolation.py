"""Cubic interpolation of POS and encoders, against scipy's splines and the motion that was recorded."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

import whiskjax as wj
from tests.derivatives import assert_derivatives

STEP_S = 0.02
TIME_S = np.arange(101) * STEP_S
WOBBLE_RAD, WOBBLE_HZ = np.radians(3.0), 1.0


def wobble(t):
    """A turn of 3 deg, 1 Hz about an axis that turns as well, on a steady heading: the attitude of a light aircraft."""
    phase = 2 * np.pi * WOBBLE_HZ * np.asarray(t)
    small = WOBBLE_RAD * np.stack([np.sin(phase), np.cos(phase), 0.3 * np.sin(2 * phase)], axis=-1) / 1.2
    return Rotation.from_rotvec([0.3, -0.2, 1.1]) * Rotation.from_rotvec(small)


def path(t):
    t = np.asarray(t)
    return np.stack([60 * t, 3 * np.sin(2 * t), 1000 + 2 * np.cos(3 * t)], axis=-1)


def trajectory(t=TIME_S, interpolation="cubic", gap=0.03, **more):
    return wj.Trajectory(t, path(t), wobble(t).as_quat(), max_gap_s=gap, interpolation=interpolation, **more)


@jax.jit
def posed(link, t):
    pose = link.pose(wj.Shot(time_s=t))
    return pose.matrix, jnp.stack(jnp.broadcast_arrays(*pose.translation), axis=-1)


def off_deg(link, t):
    """Angle between the interpolated and the true attitude."""
    return np.degrees((Rotation.from_matrix(np.asarray(posed(link, t)[0])) * wobble(t).inv()).magnitude())


INSIDE = np.linspace(0.2, TIME_S[-1] - 0.2, 997)


def test_a_wobble_is_interpolated_to_a_hundred_thousandth_of_a_degree():
    turn = lambda t: Rotation.from_rotvec(WOBBLE_RAD * np.sin(2 * np.pi * WOBBLE_HZ * np.asarray(t))[:, None] * [0, 1, 0])
    for interpolation, low, high in (("cubic", 0, 1e-5), ("linear", 5.5e-3, 6.5e-3)):
        link = wj.Trajectory(TIME_S, path(TIME_S), turn(TIME_S).as_quat(), max_gap_s=0.03, interpolation=interpolation)
        found = Rotation.from_matrix(np.asarray(posed(link, INSIDE)[0]))
        assert low < np.degrees((found * turn(INSIDE).inv()).magnitude()).max() < high
    assert off_deg(trajectory(), INSIDE).max() < 1e-5  # about an axis that turns as well, with twice the frequency in yaw


def test_the_ends_err_less_than_scipys_rotation_spline():
    """RotationSpline begins and ends with the mean rate of the first and last interval; here with that of four samples."""
    ends = np.concatenate([np.linspace(0, 0.06, 61), TIME_S[-1] - np.linspace(0, 0.06, 61)])
    theirs = np.degrees((RotationSpline(TIME_S, wobble(TIME_S))(ends) * wobble(ends).inv()).magnitude())
    assert off_deg(trajectory(), ends).max() < 0.2 * theirs.max()


def test_attitudes_are_those_of_scipys_rotation_spline_away_from_the_ends():
    ours = Rotation.from_matrix(np.asarray(posed(trajectory(), INSIDE)[0]))
    assert np.degrees((ours * RotationSpline(TIME_S, wobble(TIME_S))(INSIDE).inv()).magnitude()).max() < 2e-6


def test_positions_are_those_of_scipys_cubic_spline():
    t = np.linspace(0, TIME_S[-1], 531)
    np.testing.assert_allclose(posed(trajectory(), t)[1], CubicSpline(TIME_S, path(TIME_S))(t), rtol=0, atol=1e-11)


def test_samples_are_met():
    rotation, position = posed(trajectory(), TIME_S)
    np.testing.assert_allclose(position, path(TIME_S), rtol=0, atol=1e-12)
    np.testing.assert_allclose(rotation, wobble(TIME_S).as_matrix(), rtol=0, atol=1e-14)


def test_rate_and_acceleration_are_continuous_where_linear_ones_jump():
    knots = TIME_S[5:-5]

    def jumps(link):
        def vector(t):  # rows of the rotation and the position: whatever an image depends on
            rotation, position = posed(link, t)
            return jnp.concatenate([rotation.ravel(), position])

        rate = jax.jacfwd(vector)
        second = jax.jacfwd(rate)
        hair = 1e-9
        return [
            np.abs(np.asarray(jax.jit(jax.vmap(f))(knots + hair)) - np.asarray(jax.jit(jax.vmap(f))(knots - hair))).max()
            for f in (rate, second)
        ]

    of_rate, of_second = jumps(trajectory())
    assert of_rate < 1e-4 and of_second < 1e-3
    assert jumps(trajectory(interpolation="linear"))[0] > 1e-2


@pytest.mark.parametrize("length", [1, 2, 3, 4, 7])
def test_no_spline_crosses_a_gap(length):
    """A piece alone, behind a gap, is the spline of its own samples; one of a single sample is that sample."""
    t = np.concatenate([TIME_S[:20], 5 + TIME_S[:length], 10 + TIME_S[:20]])
    link = trajectory(t)
    piece = 5 + TIME_S[:length]
    inside = np.linspace(piece[0], piece[-1], 11)
    rotation, position = posed(link, inside)
    kind = {1: None, 2: 1, 3: 2}.get(length, 3)
    if kind is None:
        expected = np.broadcast_to(path(piece), position.shape)
    elif kind < 3:
        expected = np.stack([np.polyval(np.polyfit(piece - 5, c, kind), inside - 5) for c in path(piece).T], axis=-1)
    else:
        expected = CubicSpline(piece, path(piece))(inside)
    np.testing.assert_allclose(position, expected, rtol=0, atol=2e-9)
    np.testing.assert_allclose(rotation[0], wobble(piece[0]).as_matrix(), rtol=0, atol=1e-13)
    np.testing.assert_allclose(rotation[-1], wobble(piece[-1]).as_matrix(), rtol=0, atol=1e-13)
    codes = wj.RESULTS.time_in_gap == link.check(wj.Shot(time_s=np.array([3.0, piece[0]])))
    np.testing.assert_array_equal(codes, [True, False])


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_shapes(shape):
    t = 0.5 + 0.1 * np.arange(np.prod(shape, dtype=int)).reshape(shape) / 7
    rotation, position = posed(trajectory(), t)
    assert rotation.shape == shape + (3, 3) and position.shape == shape + (3,)
    each = jax.vmap(lambda t: posed(trajectory(), t)[1])(t.ravel())
    np.testing.assert_allclose(position.reshape(-1, 3), each, rtol=0, atol=1e-12)


def test_derivatives_by_time_and_delays():
    def pose(v):
        link = trajectory(delay_s=v[1], attitude_delay_s=v[2])
        pose = link.pose(wj.Shot(time_s=v[0]))
        return jnp.concatenate([pose.matrix.ravel(), jnp.stack(pose.translation)])

    tolerance = np.concatenate([np.full(9, 2e-9), np.full(3, 1e-8)])
    assert_derivatives(pose, np.array([[0.513, 0.004, 0.002]]), np.full(3, 1e-3), tolerance)


def test_an_encoder_is_scipys_cubic_spline():
    angle = 0.6 * np.sin(9 * TIME_S) + 2 * TIME_S
    turn = wj.Turn("z", wj.Encoder(TIME_S, angle, 0.03, interpolation="cubic"), delay_s=0.003)
    t = np.linspace(0.01, 1.9, 333)
    rotation = np.asarray(posed(turn, t)[0])
    found = np.unwrap(np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]))
    np.testing.assert_allclose(found, CubicSpline(TIME_S, angle)(t + 0.003), rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "make", [trajectory, lambda interpolation: wj.Encoder([0.0, 1.0], [0.0, 0.1], 2.0, interpolation=interpolation)]
)
def test_other_words_are_refused(make):
    with pytest.raises(wj.WhiskjaxError, match=r"interpolation is 'linear' or 'cubic', not 'spline'"):
        make(interpolation="spline")


def test_velocities_and_a_spline_contradict_each_other():
    with pytest.raises(wj.WhiskjaxError, match="a cubic spline takes its velocities from the positions"):
        trajectory(velocity_mps=np.tile([60.0, 0.0, 0.0], (len(TIME_S), 1)))


@pytest.mark.parametrize("t", [TIME_S[:12], np.concatenate([TIME_S[:7], 5 + TIME_S[:3], 10 + TIME_S[:2]])])
def test_splines_through_traced_samples(t):
    """They are those of the host, and follow the samples: position, attitude and the angle of an encoder."""
    way = np.random.default_rng(2).normal(size=(len(t), 7)) * np.array([1, 1, 1, 0.01, 0.01, 0.01, 0.1])
    inside = np.array([0.013, t[2] + 0.003, t[-2] + 0.01])
    recorded = wobble(t)

    def of(v, make=jnp):
        """Rotations by a small rotation vector to first order: normalised by the trajectory."""
        position, turn = path(t) + v[0] * way[:, :3], 0.5 * v[1] * way[:, 3:6]
        x, y, z, w = recorded.as_quat().T
        a, b, c = turn.T
        q = make.stack(
            [x + w * a + y * c - z * b, y + w * b + z * a - x * c, z + w * c + x * b - y * a, w - x * a - y * b - z * c]
        )
        link = wj.Trajectory(t, position, q.T, max_gap_s=0.03, interpolation="cubic")
        turn = wj.Turn("z", wj.Encoder(t, 0.7 + 0.3 * np.sin(t) + v[2] * way[:, 6], 0.03, wraps=False, interpolation="cubic"))
        rotation, position = posed(link, inside)
        return jnp.concatenate([rotation.ravel(), position.ravel(), posed(turn, inside)[0][:, 1, 0]])

    v = np.array([0.5, 0.7, 0.3])
    np.testing.assert_allclose(jax.jit(of)(v), of(v, np), rtol=0, atol=1e-11)
    assert_derivatives(jax.jit(of), v, np.full(3, 0.1), 1e-8)

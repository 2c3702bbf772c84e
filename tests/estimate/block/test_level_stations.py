"""Errors of stations along east, north and up beside others along the frame's axes, against dense problems of textbook form."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pyproj import Transformer
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.estimate.block.conftest import SCENE
from tests.estimate.block.frames import frames
from tests.estimate.block.textbook import PRIOR, SIGMA, Textbook, epochs_of
from whiskjax.estimate.block.station_errors import at_stations
from whiskjax.flights import songshan

# Attitude wanders about the body's axes and shakes anew at every station; GNSS is off along level axes, for minutes and for good;
# the arm to the antenna swings along the body's axes.
WANDER_RAD, SHAKE_RAD = np.radians([0.005, 0.004, 0.010]), np.radians([0.002, 0.003, 0.001])
SLOW_M, BIAS_M, SWING_M = np.array([0.05, 0.04, 0.12]), np.array([0.02, 0.03, 0.06]), np.array([0.010, 0.005, 0.008])
ERRORS = (
    wj.FrameErrors("pos_error", WANDER_RAD, (0, 0, 0), (60.0, 60.0, 120.0, 0, 0, 0), anew="strip"),
    wj.FrameErrors("pos_error", SHAKE_RAD, SWING_M),
    wj.FrameErrors("pos_error", (0, 0, 0), SLOW_M, 200.0, anew="strip", axes="level"),
    wj.FrameErrors("pos_error", (0, 0, 0), BIAS_M, np.inf, axes="level"),
)
LEVEL = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def body_from_level(body, time_s):
    """Rotations from east, north, up into the body, (n, 3, 3); the axes of the flight's local world are level.

    The last orientation image lies 2 s behind the record, whose last turn goes on for so long.
    """
    knots, attitude = np.asarray(body.knots.time_s), Rotation.from_quat(np.stack([np.asarray(c) for c in body.quaternion], -1))
    i = np.clip(np.searchsorted(knots, time_s, side="right") - 1, 0, len(knots) - 2)
    share = (time_s - knots[i]) / (knots[i + 1] - knots[i])
    turn = (attitude[i].inv() * attitude[i + 1]).as_rotvec()
    return (attitude[i] * Rotation.from_rotvec(share[:, None] * turn)).inv().as_matrix()


class Level(Textbook):
    """The same problem; the record errs as `ERRORS` say."""

    def __init__(self, scene, block, body, epochs):
        super().__init__(scene, block, body, epochs)
        t, strip = np.concatenate(epochs), np.repeat(np.arange(len(epochs)), [len(e) for e in epochs])
        away, same = np.abs(t[:, None] - t), strip[:, None] == strip
        white, n = np.eye(len(t)), len(t)
        turn = block_diag(
            *(
                w**2 * np.where(same, np.exp(-away / tau), 0) + s**2 * white
                for w, s, tau in zip(WANDER_RAD, SHAKE_RAD, (60.0, 60.0, 120.0), strict=True)
            )
        )
        shift = block_diag(*(s**2 * white for s in SWING_M)).reshape(3, n, 3, n)
        level = np.where(same, np.exp(-away / 200.0), 0)[None] * SLOW_M[:, None, None] ** 2 + BIAS_M[:, None, None] ** 2
        into = body_from_level(body, t)
        shift = shift + np.einsum("iak,kij,jbk->aibj", into, level, into)
        whole = block_diag(turn, shift.reshape(3 * n, 3 * n))
        self.record = np.linalg.solve(np.linalg.cholesky(whole), np.eye(6 * n))

    def residuals(self, z):
        rays, _, unknown, control = jnp.split(
            super().residuals(z), np.cumsum([2 * len(self.block), self.shape[0], self.shape[1]])
        )
        motion, *_ = self.parts(z)
        return jnp.concatenate([rays, self.record @ motion.T.ravel(), unknown, control])


@pytest.fixture(scope="module")
def found(drawn):
    return wj.adjust(drawn.sensor, drawn.block, songshan.unknowns(SCENE), errors=ERRORS, surface=LEVEL, retime=False)


@pytest.fixture(scope="module")
def dense(drawn):
    book = Level(SCENE, drawn.block, drawn.sensor["body"], epochs_of(SCENE))
    return book, *book.solve(drawn.point_m)


def test_level_errors_are_those_of_the_dense_problem(found, dense):
    """Cost, unknowns, motions and points, all within a millionth of their sigma, and the sigmas."""
    book, z, cost, covariance = dense
    a, b, _ = book.shape
    motion, unknown, point = book.parts(z)
    sigma = np.sqrt(np.diag(covariance))
    assert found.cost == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose((found.value - unknown) / (sigma[a : a + b] * PRIOR), 0, atol=1e-6)
    np.testing.assert_allclose((found.point_m - point) / sigma[a + b :].reshape(-1, 3), 0, atol=1e-6)
    link, of_motion = found.sensor["pos_error"], sigma[:a].reshape(6, -1).T * SIGMA
    np.testing.assert_allclose((np.concatenate([link.turn_rad, link.shift_m], 1) - motion) / of_motion, 0, atol=1e-6)
    np.testing.assert_allclose(found.trust.stations, of_motion, rtol=1e-6)
    np.testing.assert_allclose(found.trust.sigma, sigma[a : a + b] * PRIOR, rtol=1e-6)


def test_equal_sigmas_have_no_axes():
    """Of images in a local world: a ball along level axes is the same ball along the frame's."""
    sensor, block, *_ = frames()
    same = [wj.FrameErrors("photo", (1e-3,) * 3, (1.0,) * 3, axes=axes) for axes in ("level", "frame")]
    one, other = (wj.adjust(sensor, block, errors=[e], surface=LEVEL) for e in same)
    np.testing.assert_allclose(one.point_m, other.point_m, rtol=0, atol=1e-7)
    assert one.cost == pytest.approx(other.cost, rel=1e-9) and one.freedom == other.freedom
    one, other = (wj.adjust(sensor, block, errors=[e], surface=LEVEL, reweigh=wj.Reweigh(priors=True)).components for e in same)
    np.testing.assert_allclose(one.factor, other.factor, rtol=1e-6)
    np.testing.assert_array_equal(one.count, other.count)
    np.testing.assert_allclose(one.log_sigma, other.log_sigma, rtol=1e-6)
    with pytest.raises(wj.WhiskjaxError, match="of which nobody said what is up"):
        wj.adjust(sensor, block, errors=same[:1])


def test_level_is_that_of_the_ellipsoid():
    """Images anywhere on the Earth: rows whiten the covariance that pyproj's latitudes and longitudes turn."""
    rng = np.random.default_rng(8)
    lon, lat = rng.uniform(-3, 3, 5), rng.uniform(-1.4, 1.4, 5)
    place = np.stack(Transformer.from_crs(4979, 4978, always_xy=True).transform(lon, lat, np.full(5, 2e3), radians=True), -1)
    attitude = Rotation.random(5, random_state=rng)
    sensor = wj.Sensor({"photo": wj.PosePerImage(place, attitude.as_quat())}, wj.FrameCamera(100.0, (0.0, 0.0)))
    east = np.stack([-np.sin(lon), np.cos(lon), 0 * lon], -1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    into = attitude.inv().as_matrix() @ np.stack([east, np.cross(up, east), up], -1)
    level, own = np.array([0.02, 0.03, 0.08]), np.array([0.01, 0.0, 0.02])
    said = wj.FrameErrors("photo", (1e-4, 2e-4, 0.0), own), wj.FrameErrors("photo", (0, 0, 0), level, axes="level")
    found = at_stations("adjust", said, sensor)
    assert found is not None
    root = found.roots(sensor) / np.repeat(np.where(found.sigma > 0, found.sigma, 1.0), 5).reshape(2, 1, 15)
    for i in range(5):
        at = i + 5 * np.arange(3)
        expected = into[i] @ np.diag(level**2) @ into[i].T + np.diag(own**2)
        np.testing.assert_allclose(np.linalg.inv((root[1].T @ root[1])[np.ix_(at, at)]), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(root[0].T @ root[0]), np.diag(np.repeat([1e-8, 4e-8, 1.0], 5)), atol=1e-15)


def test_a_motion_without_error_is_refused():
    sensor, block, *_ = frames()
    for e in (
        wj.FrameErrors("photo", (1e-3,) * 3, (0, 0, 1.0), axes="level"),
        wj.FrameErrors("photo", (0, 0, 0), (1.0,) * 3, np.inf, axes="level"),
    ):
        with pytest.raises(wj.WhiskjaxError, match=r"errors of photo are singular|errs by a constant"):
            wj.adjust(sensor, block, errors=[e], surface=LEVEL)


def test_it_follows_the_record():
    """Level axes are those of the recorded attitude: under jit as eagerly, with the derivative that differences have."""
    sensor, block, *_ = frames()
    errors = [wj.FrameErrors("photo", (1e-3,) * 3), wj.FrameErrors("photo", (0, 0, 0), (1.0, 0.5, 2.0), axes="level")]

    def points(t):
        x, y, z, w = sensor["photo"].quaternion
        moved = eqx.tree_at(lambda s: s.links[0].quaternion, sensor, (x + 1e-3 * t, y - 2e-3 * t, z, w))
        return wj.adjust(moved, block, errors=errors, surface=LEVEL).point_m

    compiled = jax.jit(points)
    np.testing.assert_allclose(compiled(0.4), points(0.4), rtol=0, atol=1e-6)
    slope = jax.jit(jax.jacfwd(points))(0.4)
    expected = (compiled(0.5) - compiled(0.3)) / 0.2
    np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def test_two_steps_know_what_is_up():
    """Errors that are the same ball along level axes and along the frame's make the same two-step solution."""
    sensor, block, *_ = frames()
    mounted = wj.Sensor({"photo": sensor["photo"], "mount": wj.Mount()}, sensor.camera)
    kappa = wj.Unknown("kappa", "mount.angles_rad[2]", 0.0, 1e-2)
    same = [wj.FrameErrors("photo", (1e-3,) * 3, (1.0,) * 3, axes=axes) for axes in ("level", "frame")]
    one, other = (wj.two_step(mounted, block, [kappa], errors=[e], mounts=["kappa"], surface=LEVEL) for e in same)
    assert one.has_converged and other.has_converged
    np.testing.assert_allclose(one.values[-1], other.values[-1], rtol=0, atol=1e-9)
    assert one.rate == pytest.approx(other.rate, rel=1e-6)
    with pytest.raises(wj.WhiskjaxError, match="of which nobody said what is up"):
        wj.two_step(mounted, block, [kappa], errors=same[:1], mounts=["kappa"])

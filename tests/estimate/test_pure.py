"""A calibration is a pure function: one small scene, and every way in that a derivative or a batch may come by."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.differences import differences

# Control points around a station that moves past them at 100 m and is looked through from a tilted mount.
RNG = np.random.default_rng(12)
N = 9
POINT_M = np.column_stack([RNG.uniform(-40, 40, N), RNG.uniform(-40, 40, N), RNG.uniform(-5, 15, N)])
TIME_S = np.linspace(0.5, 2.5, N)
RECORD_M = np.array([[-10.0, 0, 100], [-3, 1, 101], [4, 0, 100], [11, -1, 99]])
UNKNOWNS = [
    *(wj.Unknown(f"turn {axis}", f"mount.angles_rad[{i}]", 0.0, 0.02) for i, axis in enumerate("xyz")),
    wj.Unknown("focal", "camera.focal_px", scale=10.0),
]
TRUTH = [0.011, -0.02, 0.015, 1008.0]
SIZE = np.array([0.02, 0.02, 0.02, 10.0])
COVARIANCE_M2 = np.tile(np.diag([0.01, 0.01, 0.04]), (N, 1, 1))
WAYS = ("pixels", "points", "sensor number", "prior sigma", "record")
# How far one unit of each way goes: pixels, metres, metres, of itself, metres.
UNIT = (1.0, 0.5, 0.5, 0.3, 0.5)
INTO = [RNG.normal(size=(N, 2)), RNG.normal(size=(N, 3)), RNG.normal(size=3), np.ones(()), RNG.normal(size=(4, 3))]


RECORD = wj.Trajectory(np.arange(4.0), RECORD_M, np.tile([0.0, 0, 0, 1], (4, 1)), max_gap_s=1.0)


def sensor(moved_m=None, lever_m=(0.3, -0.2, 0.5)):
    record = RECORD
    if moved_m is not None:  # records are looked at when they are made, and are arrays from then on
        position = tuple(p + m for p, m in zip(RECORD.position_m, moved_m.T, strict=True))
        record = eqx.tree_at(lambda link: link.position_m, RECORD, position)
    mount = wj.Mount(lever_arm_m=lever_m, angles_rad=[0.0, 0.0, 0.0])
    return wj.Sensor({"body": record, "mount": mount}, wj.LineCamera(1000.0))


def measured(noise_px=0.7):
    exact = wj.project(wj.assign(sensor(), UNKNOWNS, TRUTH), wj.Shot(time_s=TIME_S), POINT_M, throw=False).pixel_px
    return np.asarray(exact) + noise_px * RNG.normal(size=(N, 2))


PIXEL_PX = measured()


def inputs(t):
    """What goes in when each way is gone by its amount, (5,)."""
    pixels, points, lever, sigma, record = (a * u * d for a, u, d in zip(t, UNIT, INTO, strict=True))
    first = dataclasses.replace(UNKNOWNS[0], sigma=0.02 * jnp.exp(sigma))
    seen = wj.Observations(
        wj.Shot(time_s=TIME_S),
        POINT_M + points,
        PIXEL_PX + pixels,
        np.full((N, 2), 0.7),
        np.arange(N) < N - 2,
        COVARIANCE_M2,
        points=[f"P{i}" for i in range(N)],
    )
    return sensor(record, jnp.array([0.3, -0.2, 0.5]) + lever), seen, [first, *UNKNOWNS[1:]]


def answer(t, loss=None):
    """Values and sigmas of the unknowns over their size, the cost and a residual, (10,)."""
    found = wj.calibrate(*inputs(t), loss=loss)
    estimate = found.estimate
    of = (estimate.value / SIZE, estimate.sigma / SIZE, jnp.atleast_1d(estimate.cost), found.residual_after_px[0, :1])
    return jnp.concatenate([jnp.asarray(part) for part in of])


ZERO = np.zeros(len(WAYS))
# Compiled once; differences and batches ask the public verb again and again.
traced = jax.jit(answer)


@pytest.fixture(scope="module")
def jacobian():
    return np.asarray(jax.jit(jax.jacfwd(answer))(ZERO))


def test_jit_is_the_eager_calibration():
    np.testing.assert_allclose(traced(ZERO), answer(ZERO), rtol=1e-9, atol=1e-9)


def test_vmap_is_one_calibration_after_the_other():
    several = RNG.normal(size=(3, len(WAYS)))
    found = jax.jit(jax.vmap(answer))(several)
    np.testing.assert_allclose(found, [answer(t) for t in several], rtol=1e-8, atol=1e-8)


def test_derivatives_are_differences(jacobian):
    expected = differences(traced, ZERO, 0.2)
    reverse = np.asarray(jax.jit(jax.jacrev(answer))(ZERO))
    largest = np.abs(expected).max(axis=0)
    print(f"\n{'by':16s}{'jacfwd':>12s}{'jacrev':>12s}   largest deviation from differences, of the largest entry")
    for i, way in enumerate(WAYS):
        off = [np.abs(found[:, i] - expected[:, i]).max() / largest[i] for found in (jacobian, reverse)]
        print(f"{way:16s}{off[0]:12.1e}{off[1]:12.1e}")
        assert max(off) < 1e-6, way
    assert (largest > 1e-3).all()


def test_second_derivatives_are_differences_of_first():
    def first(t):
        return answer(t)[0]

    slope = jax.jit(jax.grad(first))
    found = np.asarray(jax.jit(jax.hessian(first))(ZERO))
    expected = differences(slope, ZERO, 0.2)
    print(f"\nhessian of turn x: {np.abs(found - expected).max() / np.abs(expected).max():.1e} of the largest entry")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-9 * np.abs(found).max())


def test_the_whole_hessian_not_gauss_newtons(jacobian):
    """Large residuals bend the cost: without their curvature the derivative would be wrong by far more than asked."""
    spoilt = dataclasses.replace(inputs(ZERO)[1], pixel_px=PIXEL_PX + 60 * RNG.normal(size=(N, 2)))

    def by(a):
        moved = dataclasses.replace(spoilt, pixel_px=spoilt.pixel_px + a[0] * INTO[0])
        return wj.calibrate(sensor(), moved, UNKNOWNS).value / SIZE

    found = jax.jit(jax.jacfwd(by))(np.zeros(1))
    expected = differences(jax.jit(by), np.zeros(1), 0.5)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_a_robust_loss_is_differentiated_too():
    """Its weights move with the data: the cost is the robust one, and its whole Hessian counts."""
    loss = wj.Cauchy(1.5)

    def by(a):
        moved = dataclasses.replace(inputs(ZERO)[1], pixel_px=PIXEL_PX + a[0] * INTO[0])
        return wj.calibrate(sensor(), moved, UNKNOWNS, loss=loss).value / SIZE

    found = jax.jit(jax.jacfwd(by))(np.zeros(1))
    expected = differences(jax.jit(by), np.zeros(1), 0.1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_what_searches_on_the_host_says_so():
    for more in ({"blunders": wj.Blunders()}, {"reweigh": wj.Reweigh()}):
        with pytest.raises(wj.WhiskjaxError, match="on the host"):
            jax.jit(lambda t, more=more: wj.calibrate(*inputs(t), **more).value)(ZERO)


def test_under_tracing_nothing_is_raised_and_the_result_says_why():
    def result(height_m):
        seen = dataclasses.replace(inputs(ZERO)[1], point_m=POINT_M + np.tile([0.0, 0.0, 1.0], (N, 1)) * height_m)
        return wj.calibrate(sensor(), seen, UNKNOWNS).result

    found = eqx.filter_jit(result)(jnp.asarray(300.0))
    assert bool(found == wj.RESULTS.point_behind_camera)


def test_an_answer_of_jit_tells_people_what_an_eager_one_does():
    """The diagnosis is worked out when somebody looks, from arrays that came out of a compiled function."""
    eager = wj.calibrate(*inputs(ZERO))
    compiled = eqx.filter_jit(lambda t: wj.calibrate(*inputs(t)))(jnp.asarray(ZERO))
    assert compiled.is_sound == eager.is_sound
    assert compiled.warnings == eager.warnings
    assert compiled.fit.degrees_of_freedom == eager.fit.degrees_of_freedom
    np.testing.assert_allclose(compiled.reliability.redundancy, eager.reliability.redundancy, atol=1e-9)


def test_names_compile_nothing():
    """Observations that differ in their names and in nothing else share one compiled function."""
    traces = []

    @jax.jit
    def of(seen):
        traces.append(1)
        return wj.calibrate(sensor(), seen, UNKNOWNS).value

    seen = inputs(ZERO)[1]
    of(seen)
    of(dataclasses.replace(seen, points=[f"Q{i}" for i in range(N)]))
    assert len(traces) == 1

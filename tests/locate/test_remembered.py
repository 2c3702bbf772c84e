"""Errors that looks have in common, against a plain loop with dense matrices: constant, wandering, in level axes, drawn anew."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.locate.conftest import SIGMA_ENU_M
from tests.locate.textbooks import EXACT, MOTIONS, TABLE_1, assert_in_sigmas, differentiated, enu, noise_of
from whiskjax.flights import tianshan

INF = float("inf")
LOOKS = 40
STRIP = np.repeat([0, 1, 2], [15, 15, 10])  # one after the other
SWING = np.arange(LOOKS) % 2  # comes back
TURN, SHIFT, ROLL, PITCH = 0, 3, 6, 7  # of the textbook's motions

# Statements, and the same for the textbook: (motion, sigma, correlation time, key, whether in level axes).
STATES = {
    "constant": (
        [wj.FrameErrors("body", (2e-4, 0, 3e-4), (5.0, 0, 4.0), INF)],
        [(TURN, 2e-4, INF, None, 0), (TURN + 2, 3e-4, INF, None, 0), (SHIFT, 5.0, INF, None, 0), (SHIFT + 2, 4.0, INF, None, 0)],
    ),
    "wandering": (
        [
            wj.FrameErrors("gimbal_pitch", (0, 4e-4, 0), correlation_s=20.0),
            wj.FrameErrors("gimbal_roll", (3e-4, 0, 0), correlation_s=7.0),
        ],
        [(PITCH, 4e-4, 20.0, None, 0), (ROLL, 3e-4, 7.0, None, 0)],
    ),
    "by strip": (
        [wj.FrameErrors("body", (2e-4, 0, 0), (0, 5.0, 0), (30.0, 0, 0, 0, INF, 0), anew="strip")],
        [(TURN, 2e-4, 30.0, STRIP, 0), (SHIFT + 1, 5.0, INF, STRIP, 0)],
    ),
    "by swing": (
        [wj.FrameErrors("body", (2e-4, 0, 0), (0, 5.0, 0), (30.0, 0, 0, 0, INF, 0), anew="swing")],
        [(TURN, 2e-4, 30.0, SWING, 0), (SHIFT + 1, 5.0, INF, SWING, 0)],
    ),
    "level": (
        [wj.FrameErrors("body", (0, 0, 3e-4), (5.0, 0, 9.0), (0, 0, 40.0, INF, 0, INF), axes="level")],
        [(TURN + 2, 3e-4, 40.0, None, 1), (SHIFT, 5.0, INF, None, 1), (SHIFT + 2, 9.0, INF, None, 1)],
    ),
}
STATES["all of them"] = tuple([x for c in ("constant", "wandering", "by strip") for x in STATES[c][i]] for i in (0, 1))

CASES = ("by swing", "level", "all of them")


def kernel(run, tau, key):
    """The textbook's correlation between looks."""
    dt = np.abs(run.time_s[:, None] - run.time_s[None, :])
    same = np.ones(dt.shape) if key is None else (key[:, None] == key[None, :]).astype(float)
    return same * np.exp(-dt / tau)


def column(run, k, motion, level):
    """What a unit of the state turns and shifts at look k, as one of the textbook's motions."""
    unit = np.eye(MOTIONS)[motion]
    if level:
        into = run.chain.ecef_from_body[k].T @ enu(run.chain.platform[k])
        unit = np.concatenate([into @ unit[:3], into @ unit[3:6], [0.0, 0.0]])
    return unit


def effects(run, k, x, states):
    """Derivative of the pixel of the recorded pose by each state."""
    by_motion = differentiated(lambda w: run.image(k, x, w), EXACT)
    return np.stack([by_motion @ column(run, k, m, level) * sigma for m, sigma, _, _, level in states], axis=-1)


def expanded(states):
    """A state for each value of a key that comes back, which acts at its own looks."""
    out = []
    for m, sigma, tau, key, level in states:
        values = [None] if key is not SWING else [0, 1]
        out += [
            (m, sigma, tau, None if v is not None else key, level, np.ones(LOOKS) if v is None else (key == v)) for v in values
        ]
    return out


def filtered(run, states):
    """The extended filter with the errors behind the target, full matrices; the pixel is linear in them."""
    states = expanded(states)
    m = len(states)
    kernels = [kernel(run, tau, key) for _, _, tau, key, _, _ in states]
    x, p = np.zeros(3 + m), np.block([[run.prior, np.zeros((3, m))], [np.zeros((m, 3)), np.eye(m)]])
    kept = []
    for k in range(LOOKS):
        phi = np.array([1.0, 1.0, 1.0] + [c[k, k - 1] if k else 0.0 for c in kernels])
        x, p = phi * x, phi[:, None] * p * phi[None, :] + np.diag(1 - phi**2)
        effect = effects(run, k, x[:3], [s[:5] for s in states]) * np.array([s[5][k] for s in states])
        rows = np.hstack([differentiated(lambda s, k=k: run.image(k, s, EXACT), x[:3]), -effect])
        s = rows @ p @ rows.T + noise_of(run.image, k, x[:3], 2.0, TABLE_1)
        innovation = run.pixel_px[k] - (run.image(k, x[:3], EXACT) - effect @ x[3:])
        gain = p @ rows.T @ np.linalg.inv(s)
        x, p = x + gain @ innovation, p - gain @ s @ gain.T
        kept.append((x[:3], p[:3, :3], innovation, s))
    return [np.array(part) for part in zip(*kept, strict=True)]


def solved(run, states, z, used):
    """Gauss-Newton with the covariance of all looks: state, its covariance, cost, residuals, and the residuals' covariance."""
    x, information = np.zeros(3), np.linalg.inv(run.prior)
    take = np.repeat(used, 2)
    for step in range(9):
        rows = np.concatenate([differentiated(lambda s, k=k: run.image(k, s, EXACT), x) for k in range(LOOKS)])
        residual = np.concatenate([z[k] - run.image(k, x, EXACT) for k in range(LOOKS)])
        r = np.zeros((2 * LOOKS, 2 * LOOKS))
        for k in range(LOOKS):
            r[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = noise_of(run.image, k, x, 2.0, TABLE_1)
        by_look = np.array([effects(run, k, x, states) for k in range(LOOKS)])
        for i, (_, _, tau, key, _) in enumerate(states):
            g = by_look[:, :, i]
            r += np.einsum("ka,kl,lb->kalb", g, kernel(run, tau, key), g).reshape(r.shape)
        w = np.zeros(r.shape)
        w[np.ix_(take, take)] = np.linalg.inv(r[np.ix_(take, take)])
        covariance = np.linalg.inv(rows.T @ w @ rows + information)
        if step < 8:
            x = x + covariance @ (rows.T @ w @ residual - information @ x)
    cost = residual @ w @ residual + x @ information @ x
    left = np.eye(2 * LOOKS) - rows @ covariance @ rows.T @ w
    spread = left @ r @ left.T + rows @ covariance @ information @ covariance @ rows.T
    blocks = np.array([spread[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(LOOKS)])
    return x, covariance, cost, residual.reshape(LOOKS, 2), blocks


def looks_of(run, pixel_px=None):
    shot = wj.Shot(time_s=run.time_s, strip=STRIP, swing=SWING)
    return wj.Looks(shot, run.pixel_px if pixel_px is None else pixel_px, (2.0, 2.0))


def located(run, case, pixel_px=None, **options):
    errors = [*tianshan.frame_errors(), *STATES[case][0]]
    return run.locate(looks_of(run, pixel_px), errors=errors, throw=False, **options)


@pytest.mark.parametrize("case", CASES)
def test_filter(run, case):
    found = located(run, case, method="extended")
    state, covariance, innovation, spread = filtered(run, STATES[case][1])
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert np.abs((np.asarray(found.looks.point_m) - run.anchor_m - state) / sigma).max() < 1e-6
    axes = enu(np.asarray(found.line_m))
    expected = axes.T @ covariance @ axes
    assert_in_sigmas(found.looks.covariance_enu_m2, expected, expected, 1e-6)
    scale = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    assert np.abs((np.asarray(found.looks.innovation_px) - innovation) / scale).max() < 1e-6
    assert_in_sigmas(found.looks.innovation_covariance_px2, spread, spread, 1e-6)
    # What looks have in common does not average out: the target is known less well than with white errors alone.
    white = run.locate(method="extended", errors=tianshan.frame_errors(), throw=False)
    assert found.accuracy().se90_m > white.accuracy().se90_m


@pytest.mark.parametrize("case", CASES)
def test_batch(run, case):
    found = located(run, case, method="batch")
    state, covariance, cost, residual, spread = solved(run, STATES[case][1], run.pixel_px, np.ones(LOOKS, dtype=bool))
    assert np.abs((np.asarray(found.point_m) - run.anchor_m - state) / np.sqrt(np.diag(covariance))).max() < 1e-6
    axes = enu(np.asarray(found.line_m))
    assert_in_sigmas(found.covariance_enu_m2, axes.T @ covariance @ axes, axes.T @ covariance @ axes, 1e-6)
    np.testing.assert_allclose(found.chi_square, cost, rtol=1e-6)
    np.testing.assert_allclose(found.looks.innovation_px, residual, rtol=0, atol=1e-4)
    assert_in_sigmas(found.looks.innovation_covariance_px2, spread, spread, 1e-6)


@pytest.mark.parametrize("case", ["by swing"])
def test_filter_and_batch_agree(run, case):
    """The iterated filter ends where least squares of all looks does, within what linearising look by look leaves."""
    one, all_looks = located(run, case), located(run, case, method="batch")
    sigma = np.sqrt(np.diag(np.asarray(all_looks.covariance_enu_m2)))
    away = np.asarray(all_looks.world_from_enu).T @ (np.asarray(one.point_m) - np.asarray(all_looks.point_m))
    assert (np.abs(away) < 0.05 * sigma).all()
    assert_in_sigmas(one.covariance_enu_m2, all_looks.covariance_enu_m2, all_looks.covariance_enu_m2, 0.05)
    assert one.is_sound and all_looks.is_sound


def test_a_look_that_is_left_out_was_predicted_by_those_that_share_its_errors(run):
    pixel = run.pixel_px.copy()
    pixel[9] += [4000.0, -3000.0]
    found = located(run, "all of them", pixel, method="batch", gate=1e-4)
    assert found.gated == (9,)
    used = np.arange(LOOKS) != 9
    state, covariance, _, _, spread = solved(run, STATES["all of them"][1], pixel, used)
    assert np.abs((np.asarray(found.point_m) - run.anchor_m - state) / np.sqrt(np.diag(covariance))).max() < 1e-6
    assert_in_sigmas(found.looks.innovation_covariance_px2, spread, spread, 1e-6)


RUNS = 300


@pytest.mark.parametrize("method", ["iterated", "batch"])
def test_covariances_are_honest_where_errors_are_drawn_from_the_very_statements(run, method):
    """Encoders with a constant and a wandering error, jitter in roll: 300 runs drawn and located in one compiled function."""
    errors = [
        wj.FrameErrors("gimbal_pitch", (0, 3e-4, 0), correlation_s=INF),
        wj.FrameErrors("gimbal_roll", (3e-4, 0, 0), correlation_s=25.0),
        wj.FrameErrors("gimbal_roll", (1e-4, 0, 0)),
    ]
    true, time_s = tianshan.true_records(run.scene), run.time_s

    def one(key):
        drawing, noise, guessed = jax.random.split(key, 3)
        off = wj.draw_errors(errors, drawing, wj.Shot(time_s=time_s))
        angles = true.gimbal_roll_rad + off["gimbal_roll"].turn[0], true.gimbal_pitch_rad + off["gimbal_pitch"].turn[1]
        recorded = tianshan.Recorded(*(getattr(true, n) for n in list(vars(true))[:6]), *angles)
        start = run.target_m + enu(run.target_m) @ (jax.random.normal(guessed, (3,), float) * 300.0)
        looks = wj.Looks(wj.Shot(time_s=time_s), 2.0 * jax.random.normal(noise, (LOOKS, 2), float), (2.0, 2.0))
        guess = wj.Guess.around(start, np.full(3, 300.0))
        found = wj.locate(tianshan.sensor(recorded), looks, guess=guess, errors=errors, method=method, throw=False)
        away = found.world_from_enu.T @ (found.point_m - run.target_m)
        return away @ jnp.linalg.solve(found.covariance_enu_m2, away), found.chi_square

    nees, chi_square = map(np.asarray, jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(4), RUNS)))
    low, high = wj.nees_band(3, RUNS)
    assert low < nees.mean() < high
    assert abs(chi_square.mean() - 2 * LOOKS) < 5 * np.sqrt(4 * LOOKS / RUNS) + (3 if method == "batch" else 0)


def test_sigmas_and_times_have_derivatives(run):
    """Of the variance of the target's height, forward against differences."""

    def of(sigma, tau):
        errors = [*tianshan.frame_errors(), wj.FrameErrors("gimbal_pitch", (0, sigma, 0), correlation_s=tau)]
        return run.locate(errors=errors, method="extended", throw=False).covariance_enu_m2[2, 2]

    at = (jnp.asarray(3e-4), jnp.asarray(20.0))
    found = jax.jacfwd(of, argnums=(0, 1))(*at)
    for i in (0, 1):
        step = 1e-4 * at[i]
        ends = [of(*[a + s * step if i == j else a for j, a in enumerate(at)]) for s in (1.0, -1.0)]
        np.testing.assert_allclose(found[i], (ends[0] - ends[1]) / (2 * step), rtol=1e-6)


def test_what_looks_cannot_have_is_refused(run):
    lasting = wj.FrameErrors("body", (1e-4, 0, 0), correlation_s=INF, anew="view")
    with pytest.raises(wj.WhiskjaxError, match="the shot has no view, for which errors of body are drawn anew"):
        run.locate(errors=[lasting])
    with pytest.raises(wj.WhiskjaxError, match="locate: the poses of body are free"):
        run.locate(errors=[wj.FrameErrors("body", (INF, INF, INF))])

    def traced(strip):
        looks = wj.Looks(wj.Shot(time_s=run.time_s, strip=strip), run.pixel_px, (2.0, 2.0))
        return run.locate(
            looks, errors=[wj.FrameErrors("body", (1e-4, 0, 0), correlation_s=INF, anew="strip")], throw=False
        ).point_m

    with pytest.raises(wj.WhiskjaxError, match="that key of the looks is traced; keys are static"):
        jax.jit(traced)(jnp.asarray(STRIP))


def test_level_axes_need_to_know_what_is_up():
    poses = wj.PosePerImage(np.array([[0.0, 0, 900], [300.0, 0, 900]]), np.tile([0.0, 0, 0, 1], (2, 1)))
    sensor = wj.Sensor({"body": poses}, wj.FrameCamera(1000.0, (0.0, 0.0)))
    looks = wj.Looks(wj.Shot(image=np.arange(2)), [[1e5 / 900, 0.0], [-2e5 / 900, 0.0]], (1.0, 1.0))
    errors = [wj.FrameErrors("body", shift_sigma_m=(0, 0, 1.0), correlation_s=INF, axes="level")]
    guess = wj.Guess.around((100.0, 0.0, 0.0), SIGMA_ENU_M)
    with pytest.raises(wj.WhiskjaxError, match="errors of body are in level axes, but the world is a local one"):
        wj.locate(sensor, looks, guess=guess, errors=errors)
    found = wj.locate(sensor, looks, guess=guess, errors=errors, surface=wj.Plane((0.0, 0, 0), (0.0, 0, 1)), throw=False)
    # A common error of height is one of the target's height, to the full.
    without = wj.locate(sensor, looks, guess=guess, surface=wj.Plane((0.0, 0, 0), (0.0, 0, 1)), throw=False)
    more = found.covariance_enu_m2[2, 2] - without.covariance_enu_m2[2, 2]
    np.testing.assert_allclose(more, 1.0, rtol=0.02)

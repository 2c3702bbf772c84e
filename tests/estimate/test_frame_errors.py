"""How a frame errs: what is structural, what a statement's covariance is, and which statements are refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj

INF = float("inf")
TIME_S = np.array([3.0, 0.0, 0.5, 9.0, 3.0])
STRIP = np.array([0, 0, 1, 1, 0])
SHOTS = wj.Shot(time_s=TIME_S, strip=STRIP)
SIGMA = np.array([1e-3, 0.0, 2e-3, 0.1, 0.2, 0.3])
TAU_S = (0.0, 2.0, 7.0, INF, 2.0, 0.0)


def kernel(i, j, tau):
    """The textbook's: white, exponential, constant."""
    dt = abs(TIME_S[i] - TIME_S[j])
    return float(i == j) if tau == 0 else 1.0 if tau == INF else np.exp(-dt / tau)


@pytest.mark.parametrize("anew", ["flight", "strip"])
def test_covariance_is_that_of_the_textbook(anew):
    """sigma_i sigma_j exp(-|dt| / tau), and nothing where the error was drawn anew."""
    each = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    errors = wj.FrameErrors("body", SIGMA[:3].tolist(), (each, 0.2, 0.3), TAU_S, anew=anew)
    expected = np.zeros((6, 5, 5))
    for k in range(6):
        sigma = each if k == 3 else np.full(5, SIGMA[k])
        for i in range(5):
            for j in range(5):
                same = anew == "flight" or STRIP[i] == STRIP[j]
                expected[k, i, j] = sigma[i] * sigma[j] * kernel(i, j, TAU_S[k]) * same
    np.testing.assert_allclose(errors.covariance(SHOTS), expected, rtol=1e-14, atol=0)
    np.testing.assert_allclose(jax.jit(lambda e, s: e.covariance(s))(errors, SHOTS), expected, rtol=1e-14, atol=0)


def test_covariance_has_derivatives_by_its_numbers():
    """By a sigma and a correlation time, against differences."""

    def of(sigma, tau):
        return wj.FrameErrors("body", (sigma, 0, 0), correlation_s=tau).covariance(SHOTS)[0]

    for k, (step, at) in enumerate(((1e-6, 1e-3), (1e-5, 4.0))):
        numbers = [1e-3, 4.0]
        ends = [of(*[n + s * step * at * (i == k) for i, n in enumerate(numbers)]) for s in (1, -1)]
        expected = (ends[0] - ends[1]) / (2 * step * at)
        found = jax.jacfwd(of, argnums=k)(*map(jnp.asarray, numbers))
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


def test_a_number_zero_is_structural_and_an_array_of_zero_a_value():
    errors = wj.FrameErrors("body", (0, 0.0, np.array(0.0)), (jnp.zeros(3), 1.0, 0))
    assert errors.acting == (2, 3, 4)
    # Values may change without a new compilation; what is structural may not.
    traces = []

    @jax.jit
    def of(errors):
        traces.append(None)
        return errors.turn_sigma_rad[2] + errors.shift_sigma_m[1]

    of(errors)
    of(wj.FrameErrors("body", (0, 0, np.array(1e-3)), (jnp.ones(3), 2.0, 0)))
    assert len(traces) == 1


def test_memory_is_known_before_tracing():
    assert wj.FrameErrors("body", correlation_s=0).memory == ("white",) * 6
    assert wj.FrameErrors("body", correlation_s=INF).memory == ("constant",) * 6
    assert wj.FrameErrors("body", correlation_s=[0, 1, 2, INF, 0, 3]).memory == (
        *("white", "fading", "fading", "constant", "white", "fading"),
    )


REFUSED = {
    "two axes": ({"turn_sigma_rad": (1e-3, 1e-3)}, "about or along each of three axes"),
    "degrees": ({"turn_sigma_rad": (0.0, 0.0, 8.0)}, "turn_sigma_rad is 8, beyond"),
    "negative": ({"shift_sigma_m": (0.1, -0.1, 0.0)}, "shift_sigma_m is -0.1; it must be 0 or more"),
    "no number": ({"shift_sigma_m": (0.1, np.nan, 0.0)}, "shift_sigma_m is nan; it must be 0 or more"),
    "negative time": ({"correlation_s": -1.0}, "correlation_s is -1; it must be 0 or more"),
    "no time": ({"correlation_s": np.nan}, "correlation_s is nan"),
    "three times": ({"correlation_s": (1.0, 1.0, 1.0)}, "correlation_s has 3 entries; one time is expected, or six"),
    "hardly a time": ({"correlation_s": 1e-200}, "correlation_s of turn x is 1e-200 s: 0 is new at every exposure"),
    "anew": ({"anew": "day"}, "anew is 'day'; it is one of flight, image, swing, view, strip"),
    "axes": ({"axes": "ned"}, "axes is 'ned'; it is one of frame, level"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_means_nothing_is_refused(case):
    given, message = REFUSED[case]
    with pytest.raises(wj.WhiskjaxError, match=f"FrameErrors: .*{message}"):
        wj.FrameErrors("body", **given)


def test_a_key_that_shots_do_not_carry_is_named():
    with pytest.raises(wj.WhiskjaxError, match="the shot has no swing, for which errors of body are drawn anew"):
        wj.FrameErrors("body", (1e-3, 0, 0), correlation_s=INF, anew="swing").covariance(SHOTS)
    with pytest.raises(wj.WhiskjaxError, match="the shot has no time_s, by which errors of body are forgotten"):
        wj.FrameErrors("body", (1e-3, 0, 0), correlation_s=1.0).covariance(wj.Shot(image=np.arange(3)))

"""Ground to image over windows in which points are seen more than once, against a scan of the textbook formula through time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.chain.one_way import sweeping

R = wj.RESULTS
HZ, SPAN_S, SPEED_MPS, HEIGHT_M, FOCAL_PX = 500.0, 6.0, 50.0, 1000.0, 1000.0
TIME_S = np.arange(0, SPAN_S + 0.5 / HZ, 1 / HZ)
N = 40


def mirror(rate, active):
    """From -25 to 25 deg in the active part of each period, and back in the rest: between two samples where there is none."""
    phase = (TIME_S * rate + 1e-9) % 1
    back = np.where(active < 1, (phase - active) / max(1 - active, 1e-9), 0)
    return np.radians(25) * np.where(phase < active, 2 * phase / active - 1, 1 - 2 * back)


def instrument(angle_rad, half_px, axis):
    """Level flight along x; a mirror about the flight axis x with the line along it, or a line across, that pitches about y."""
    position = np.stack([SPEED_MPS * TIME_S, 0 * TIME_S, HEIGHT_M + 0 * TIME_S], -1)
    turn = np.zeros((len(TIME_S), 4))
    turn[:, 3] = 1.0
    links = {}
    if axis == "x":
        links["scan"] = wj.Turn("x", wj.Encoder(TIME_S, angle_rad, 2 / HZ))
    else:
        turn[:, 1], turn[:, 3] = np.sin(angle_rad / 2), np.cos(angle_rad / 2)
    body = wj.Trajectory(TIME_S, position, turn, max_gap_s=2 / HZ)
    return wj.Sensor({"body": body} | links, wj.LineCamera(FOCAL_PX, samples_px=(-half_px, half_px), along=axis))


def sightings(angle_rad, half_px, axis, point, window):
    """Times when a point lies on the line, in front of the camera and on the detector: changes of sign on a fine grid.

    A step back from one sample to the next, as far as the whole scan, is not scanned through.
    """
    t = np.arange(*window, 2e-5)
    angle = np.interp(t, TIME_S, angle_rad)
    x, y, z = point[0] - SPEED_MPS * t, point[1], point[2] - HEIGHT_M
    s, c = np.sin(angle), np.cos(angle)
    if axis == "x":
        along, across, depth = x, c * y + s * z, c * z - s * y
    else:
        along, across, depth = y, c * x - s * z, c * z + s * x
    i = np.flatnonzero((across[1:] < 0) != (across[:-1] < 0))
    part = across[i] / (across[i] - across[i + 1])
    times = t[i] + part * 2e-5
    sample = -FOCAL_PX * np.interp(times, t, along * np.ones_like(t)) / depth[i]
    leap = np.abs(np.diff(angle_rad))[np.searchsorted(TIME_S, times, side="right") - 1] > np.radians(40)
    return times[(depth[i] < 0) & (np.abs(sample) <= half_px + 0.5) & ~leap]


def ground(seed, count=N, reach_m=460.0):
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(60, 240, count), rng.uniform(-reach_m, reach_m, count), rng.uniform(-20, 20, count)], -1)


WAVE = np.radians(3.0) * np.sin(2 * np.pi * TIME_S / 1.3) + np.radians(1.0) * np.sin(2 * np.pi * TIME_S / 0.37)
# Angle, half the detector, axis; the swath of a line across is 1 km.
CASES = {
    "2 scans a second": (mirror(2.0, 0.8), 5.0, "x"),
    "a wider detector": (mirror(2.0, 0.8), 10.0, "x"),
    "quick flyback": (mirror(2.0, 0.96), 12.0, "x"),
    "flyback between two samples": (mirror(2.0, 1.0), 12.5, "x"),
    "7 scans a second": (mirror(7.0, 0.7), 4.5, "x"),
    "turbulence": (WAVE, 500.0, "y"),
}
WINDOWS = [(0.0, 1.0), (0.5, 5.5), (2.03, 2.41), (1.0, 2.0)]
SUCCESS, NONE, MANY = "seen once", "not seen", "seen more than once"


def outcome(result):
    results, names = (R.successful, R.outside_swath, R.seen_more_than_once), (SUCCESS, NONE, MANY)
    return np.select([np.asarray(result == r) for r in results], names, "something else")


@pytest.mark.parametrize("case", CASES)
def test_the_one_sighting_is_found_and_several_are_refused(case):
    angle, half, axis = CASES[case]
    sensor, points = instrument(angle, half, axis), ground(61)
    told = set()
    for window in WINDOWS:
        seen = [sightings(angle, half, axis, point, window) for point in points]
        found = wj.ground_to_image(sensor, wj.Shot(), points, window, throw=False)
        expected = np.array([(NONE, SUCCESS, MANY)[min(len(times), 2)] for times in seen])
        np.testing.assert_array_equal(outcome(found.result), expected)
        once = expected == SUCCESS
        times = np.array([times[0] for times, one in zip(seen, once, strict=True) if one])
        np.testing.assert_allclose(found.time_s[once], times, rtol=0, atol=1e-9)
        assert np.isnan(found.time_s[~once]).all()
        told |= set(expected)
    assert told >= {SUCCESS, MANY}, "the case tells nothing"


def made(case):
    angle, half, axis = CASES[case]
    return instrument(angle, half, axis)


def test_a_refusal_says_what_to_do():
    sensor, points = made("a wider detector"), ground(61)
    with pytest.raises(wj.SensorError, match="seen more than once within the given time window: give a narrower window"):
        wj.ground_to_image(sensor, wj.Shot(), points, (0.0, 6.0))


@pytest.mark.parametrize(
    "case, window, one_way",
    [
        ("2 scans a second", (1.01, 1.39), True),
        ("2 scans a second", (1.01, 1.41), False),
        ("turbulence", (1.0, 2.0), False),
        ("turbulence", (1.03, 1.05), True),
    ],
)
def test_where_the_line_sweeps_one_way(case, window, one_way):
    start, stop = jnp.asarray(window)
    sweep = jax.jit(sweeping)(made(case), wj.Shot(), start, stop)
    assert bool(sweep.goes_one_way(jnp.asarray(HEIGHT_M), stop - start)) == one_way


@pytest.mark.parametrize("window", [(1.01, 1.39), (1.01, 3.39)], ids=["one way", "to and fro"])
def test_many_points_are_found_as_few_are(window):
    """A shorter way to the same answer, where the line sweeps one way."""
    sensor, points = made("2 scans a second"), ground(63, 30 * N)
    many = wj.ground_to_image(sensor, wj.Shot(), points, window, throw=False)
    few = [wj.ground_to_image(sensor, wj.Shot(), part, window, throw=False) for part in points.reshape(30, N, 3)]
    np.testing.assert_array_equal(outcome(many.result), np.concatenate([outcome(found.result) for found in few]))
    np.testing.assert_allclose(many.time_s, np.concatenate([found.time_s for found in few]), rtol=0, atol=1e-12)
    assert 30 < np.isfinite(many.time_s).sum() < len(points)


def test_what_is_seen_at_the_very_end_of_the_window_is_seen():
    sensor, points = made("2 scans a second"), ground(61)
    whole = wj.ground_to_image(sensor, wj.Shot(), points, WINDOWS[1], throw=False)
    seen = np.flatnonzero(np.asarray(whole.result == R.successful))
    time = np.asarray(whole.time_s)[np.resize(seen, N)]
    for window in ((time, time + 0.03), (time - 0.03, time), (time, time)):
        found = wj.ground_to_image(sensor, wj.Shot(), points[np.resize(seen, N)], window)
        np.testing.assert_allclose(found.time_s, time, rtol=0, atol=1e-12)
        assert ((found.time_s >= window[0]) & (found.time_s <= window[1])).all()


def test_points_alone_and_in_a_batch():
    sensor, points = made("2 scans a second"), ground(61)
    batch = wj.ground_to_image(sensor, wj.Shot(), points, WINDOWS[1], throw=False)
    alone = jax.jit(jax.vmap(lambda p: wj.ground_to_image(sensor, wj.Shot(), p, WINDOWS[1], throw=False)))(points)
    np.testing.assert_array_equal(outcome(alone.result), outcome(batch.result))
    np.testing.assert_allclose(alone.time_s, batch.time_s, rtol=0, atol=1e-12)


def test_one_point_seen_by_two_lines():
    """The keys alone have a batch: a three-line camera's views of one point."""
    sensor = made("turbulence")
    views = wj.By("view", {f"{offset:g}": wj.LineCamera(FOCAL_PX, offset_px=offset, along="y") for offset in (-60.0, 60.0)})
    level = wj.Trajectory(TIME_S, np.stack(sensor["body"].position_m, -1), np.tile([0.0, 0, 0, 1], (len(TIME_S), 1)), max_gap_s=1)
    found = wj.ground_to_image(wj.Sensor({"body": level}, views), wj.Shot(view=np.array([0, 1])), [150.0, 30.0, 0.0], (0.0, 6.0))
    # x = f (X - v t) / h is imaged at -+60 px.
    np.testing.assert_allclose(found.time_s, [(150 + 60) / SPEED_MPS, (150 - 60) / SPEED_MPS], rtol=0, atol=1e-9)

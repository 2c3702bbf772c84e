"""What no platform can fly is refused, and what platforms do fly is not: fighters, satellites, drones, real navigation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles
from whiskjax.chain.possible import ImpossibleMotion, refuse_impossible_speed


def geodetic(hz, n=200):
    """A level flight to the north-east at 60 m/s: latitude, longitude, height, roll, pitch, heading, in radians and metres."""
    t = np.arange(n) / hz
    lat, lon = 0.55 + 42.0 * t / 6.37e6, 2.1 + 42.0 * t / (6.37e6 * np.cos(0.55))
    wave = 0.02 * np.sin(t / 3)
    return [1e5 + t, lat, lon, 1500 + np.sin(t), wave, 0.01 + wave, 0.7 + wave]


def trajectory(records, gap_s=100.0, **options):
    return wj.Trajectory.from_geodetic(*records, max_gap_s=gap_s, **options)


def spoilt(hz, fields, rows, value):
    records = geodetic(hz)
    for k in fields:
        records[k][rows] = value
    return records


EVERYTHING, HEIGHT, HEADING = range(1, 7), [3], [6]
SPOILT = {
    "zeros": ((EVERYTHING, 77, 0.0), "sample 77 lies .* km from sample 76, .* and .* from sample 78"),
    "zeros in the first": ((EVERYTHING, 0, 0.0), "sample 1 lies .* km from sample 0"),
    "zeros in the last": ((EVERYTHING, -1, 0.0), "sample 199 lies .* km from sample 198"),
    "zeros before it knew": ((EVERYTHING, slice(0, 30), 0.0), "sample 30 lies .* km from sample 29"),
    "height -9999": ((HEIGHT, 50, -9999.0), r"sample 50 lies 11\.5 km from sample 49"),
    "height 0": ((HEIGHT, 50, 0.0), r"sample 50 lies 150\d m from sample 49"),
    "two heights 0": ((HEIGHT, slice(50, 52), 0.0), r"sample 50 lies 150\d m from sample 49"),
    "a height that stays": ((HEIGHT, slice(50, None), 3000.0), r"sample 50 lies 1\d\d\d m from sample 49"),
}


@pytest.mark.parametrize("hz", [1.0, 50.0, 200.0])
@pytest.mark.parametrize("case", SPOILT)
def test_a_wrong_record_is_named(case, hz):
    edit, message = SPOILT[case]
    with pytest.raises(ImpossibleMotion, match=f"trajectory: {message}.*no platform can fly.*-9999"):
        trajectory(spoilt(hz, *edit))


@pytest.mark.parametrize("hz", [50.0, 200.0])
def test_a_wrong_attitude_is_named(hz):
    with pytest.raises(ImpossibleMotion, match=r"sample 50 is turned by 4\d\.\d+ deg against sample 49, .* take the record out"):
        trajectory(spoilt(hz, HEADING, 50, 0.0))
    with pytest.raises(ImpossibleMotion, match=r"sample 50 is turned by 9\d\.?\d* deg against sample 49"):
        trajectory(spoilt(hz, HEADING, slice(50, None), 2.3))


def test_what_a_gap_parts_is_not_compared():
    """Strips of one flight, in one record, kilometres apart."""
    records = geodetic(50.0)
    records[0][100:] += 5.0
    records[1][100:] += 0.01
    trajectory(records, gap_s=0.1)
    with pytest.raises(ImpossibleMotion, match=r"sample 100 lies 63.* km from sample 99"):
        trajectory(records, gap_s=10.0)


def test_times_in_another_unit():
    records = geodetic(50.0)
    records[0] = records[0][0] + (records[0] - records[0][0]) / 3600
    message = r"from sample 0 to sample 199 it is 23\d\.\d m in 0\.0011\d* s.*times in seconds"
    with pytest.raises(ImpossibleMotion, match=message):
        trajectory(records)


def circle(t, radius_m, speed_mps):
    angle = speed_mps / radius_m * t
    return radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * t], -1), oracles.about("z", angle).as_quat()


def flown():
    """Motions that happen, by name: times, positions, quaternions."""
    rng = np.random.default_rng(3)
    for hz in (0.1, 1.0, 50.0, 400.0):
        t = np.arange(600) / hz
        yield f"a turn of 9 g, {hz} Hz", t, *circle(t, 300**2 / 88.0, 300.0)
        yield f"an orbit 400 km up, {hz} Hz", t, *circle(t, 6.778e6, 7670.0)
    t = np.arange(400) / 100.0
    roll = np.radians(360.0 * np.clip((t - 1.0) / 0.4, 0, 1))  # 900 deg/s
    yield "a drone that flips", t, np.stack([3 * t, 0 * t, 50 + 0 * t], -1), oracles.about("x", roll).as_quat()
    t = np.arange(2000) / 200.0
    straight, level = np.stack([60 * t, 0 * t, 1000 + 0 * t], -1), oracles.about("z", 0 * t)
    noise = Rotation.from_rotvec(np.radians(0.1) * rng.normal(size=(2000, 3)))
    yield "noise of 5 cm and 0.1 deg", t, straight + rng.normal(0, 0.05, straight.shape), (level * noise).as_quat()
    saw = 20.0 * ((t % 1.0) > 0.5)[:, None] * [1.0, 0, 0]
    yield "positions corrected by 20 m", t, straight + saw, level.as_quat()
    t = np.cumsum(rng.uniform(1e-6, 0.01, 500))
    wandering = np.stack([60 * t, 0 * t, 0 * t], -1) + rng.normal(0, 0.02, (500, 3))
    yield "stamps that jitter", t, wandering, oracles.about("x", 0 * t).as_quat()
    yield "standing still", np.arange(50.0), np.zeros((50, 3)), np.tile([0, 0, 0, 1.0], (50, 1))


@pytest.mark.parametrize("case", list(flown()), ids=lambda case: case[0])
def test_what_platforms_do_is_flown(case):
    _, t, position, quaternion = case
    wj.Trajectory(t, position, quaternion, max_gap_s=100.0)
    refuse_impossible_speed(t, position, 100.0)


def test_records_scattered_on_purpose_are_taken_in_python_and_refused_of_a_recording():
    """Made-up positions all over the Earth serve to check formulas; in a recording every other zero is a fault."""
    rng = np.random.default_rng(5)
    t, position = np.arange(10.0), oracles.ecef(*rng.uniform(-1, 1, (2, 10)), 1000.0)
    wj.Trajectory(t, position, Rotation.random(10, rng=rng).as_quat(), max_gap_s=2.0)
    with pytest.raises(ImpossibleMotion, match=r"sample 1 lies .* km from sample 0, 1 s before it"):
        refuse_impossible_speed(t, position, 2.0)


# Velocities of a climbing turn, and what people make of them. North, east, down.


def turning(n=600, hz=20.0, noise_m=0.03):
    t, rng = np.arange(n) / hz, np.random.default_rng(4)
    course = 0.3 + t / 15
    north, east = 60 * 15 * (np.sin(course) - np.sin(0.3)), -60 * 15 * (np.cos(course) - np.cos(0.3))
    height = 1500 + 40 * np.sin(t / 8)
    rough = rng.normal(0, noise_m, (3, n))
    radius = 6.36e6
    lat, lon = 0.55 + (north + rough[0]) / radius, 2.1 + (east + rough[1]) / (6.384e6 * np.cos(0.55))
    velocity = np.stack([60 * np.cos(course), 60 * np.sin(course), -5 * np.cos(t / 8)], -1)
    level = 0 * t
    return [t, lat, lon, height + rough[2], level, level, level], velocity


MADE_OF_IT = {
    "km/h": (lambda v: 3.6 * v, "seem to be in km/h"),
    "knots": (lambda v: v / (1852 / 3600), "seem to be in knots"),
    "feet": (lambda v: v / 0.3048, "seem to be in feet per second"),
    "mm/s": (lambda v: 1e3 * v, "seem to be in mm/s"),
    "km/s": (lambda v: 1e-3 * v, "seem to be in km/s"),
    "up for down": (lambda v: v * [1, 1, -1], "along up it has the opposite sign"),
    "south for north": (lambda v: v * [-1, 1, 1], "along north it has the opposite sign"),
    "east before north": (lambda v: v[:, [1, 0, 2]], "those along east and north are exchanged"),
    "east, north, up": (lambda v: v[:, [1, 0, 2]] * [1, 1, -1], "east and north are exchanged, and along up it has the opposite"),
    "zeros": (lambda v: 0 * v, r"the positions move at 60\.\d* m/s, the velocities are 0 m/s"),
    "turned by 60 deg": (lambda v: oracles.about("z", np.full(len(v), 1.05)).apply(v), "lead elsewhere"),
}


@pytest.mark.parametrize("case", MADE_OF_IT)
def test_velocities_of_another_kind_are_told(case):
    made, message = MADE_OF_IT[case]
    records, velocity = turning()
    with pytest.raises(ImpossibleMotion, match=message) as caught:
        trajectory(records, velocity_ned_mps=made(velocity))
    assert caught.value.what == "velocity"


def test_world_velocities_whose_axes_are_exchanged():
    records, velocity = turning()
    made = oracles.ecef_from_ned(records[1], records[2])
    position, world = oracles.ecef(*records[1:4]), made.apply(velocity)
    quaternion = made.as_quat()
    wj.Trajectory(records[0], position, quaternion, max_gap_s=1.0, velocity_mps=world)
    with pytest.raises(ImpossibleMotion, match="those along x and y are exchanged"):
        wj.Trajectory(records[0], position, quaternion, max_gap_s=1.0, velocity_mps=world[:, [1, 0, 2]])
    local = np.stack([20 * records[0], 5 * np.sin(records[0] / 3), 100 + 0 * records[0]], -1)
    rate = np.stack([20 + 0 * records[0], 5 / 3 * np.cos(records[0] / 3), 0 * records[0]], -1)
    wj.Trajectory(records[0], local, quaternion, max_gap_s=1.0, velocity_mps=rate)
    with pytest.raises(ImpossibleMotion, match="along y it has the opposite sign"):
        wj.Trajectory(records[0], local, quaternion, max_gap_s=1.0, velocity_mps=rate * [1, -1, 1])


@pytest.mark.parametrize("noise_m", [0.0, 0.03, 1.0])
def test_right_velocities_are_taken(noise_m):
    records, velocity = turning(noise_m=noise_m)
    trajectory(records, velocity_ned_mps=velocity + np.random.default_rng(6).normal(0, 0.1, velocity.shape))
    few = [column[:4] for column in records]
    trajectory(few, velocity_ned_mps=velocity[:4])


def test_one_wrong_velocity_is_named():
    records, velocity = turning()
    velocity[40] = -9999
    with pytest.raises(ImpossibleMotion, match=r"sample 40 differs by 1\.7\d+e\+04 m/s from sample 39, .* and .* from sample 41"):
        trajectory(records, velocity_ned_mps=velocity)


def test_numbers_that_overflow_are_refused_without_a_warning():
    position = np.zeros((8, 3))
    position[3, 0] = 1e200
    with pytest.raises(ImpossibleMotion, match="sample 3 lies"):
        wj.Trajectory(np.arange(8.0), position, np.tile([0, 0, 0, 1.0], (8, 1)), max_gap_s=2.0)

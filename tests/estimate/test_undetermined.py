"""What the whiskbroom says where the data cannot say it all: named, with what can still be determined."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from whiskjax.flights import haian

RIGHT = "omega_pos_right, phi_pos_right, kappa_pos_right"
TRUTH = np.concatenate(haian.TABLE_4)


def said(answer):
    """Whatever is no note: the warnings are the first of it."""
    return [reason.text for reason in answer.reasons if reason.grade != "note"]


def without_priors(unknowns):
    return [dataclasses.replace(x, mean=None, sigma=None, scale=x.sigma) for x in unknowns]


def only(observations, which):
    """The control points of a mask; the others become check points, so that nothing is compiled anew."""
    return dataclasses.replace(observations, is_control=observations.is_control & which)


def assert_directions_are_true(observations, answer):
    """What is said to move together leaves the images where they are; each part alone would not.

    Failed when written: "u_gps moves by 0.2 m and changes no residual", because the angle against it is small in its prior
    sigma. Parts that do less than a tenth of what the largest does are not named: what remains is less than a third of it.
    """
    names = [x.name for x in answer.unknowns]
    for direction in answer.posterior.null_space:
        if set(direction) <= set(answer.posterior.untouched):
            continue
        parts = np.array([[value * (name == other) for other in names] for name, value in direction.items()])
        steps = 1e-4 * np.stack([np.zeros(len(names)), *parts, parts.sum(axis=0)])  # short enough to be linear
        images = wj.images_of(answer.sensor, observations, answer.unknowns, answer.value + steps)
        moved = np.abs(images[1:] - images[0])[:, observations.is_control].max(axis=(1, 2))
        assert len(direction) > 1
        assert moved[-1] < 0.3 * moved[:-1].max()


def test_only_left_images(flight):
    observations = flight.observations()
    left = only(observations, np.char.startswith(np.array(observations.images), "L"))
    answer = wj.calibrate(flight.sensor, left, flight.unknowns)
    assert f"no control observation depends on {RIGHT}" in said(answer)
    assert any("determine 12 of 15 combinations" in w and "w_gps, omega_pos_left" in w for w in said(answer))
    assert answer.posterior.untouched == tuple(RIGHT.split(", ")) and answer.posterior.rank == 12
    for name in RIGHT.split(", "):
        assert any(w.startswith("fixed by their priors alone") and name in w for w in said(answer))
    with pytest.raises(wj.SensorError, match=f"do not determine these unknowns: {RIGHT}.*priors.*Determined are u_gps, v_gps"):
        wj.calibrate(flight.sensor, left, without_priors(flight.unknowns))


def test_all_points_at_one_scan_angle(flight):
    """One line: 6 of the 15 combinations, which are those of one exposure of a frame camera."""
    observations = flight.observations()
    time, sample = np.full(231, float(np.asarray(observations.shot.time_s)[0])), np.linspace(-900, 900, 231)
    shot = dataclasses.replace(observations.shot, time_s=time, swing=np.zeros(231, int))
    pixel = np.stack([sample, np.zeros(231)], -1)
    ground = wj.image_to_ground(wj.assign(flight.sensor, flight.unknowns, TRUTH), shot, pixel, wj.HeightSurface(10.0))
    one = dataclasses.replace(observations, shot=shot, point_m=np.asarray(ground.point_m), pixel_px=pixel)
    answer = wj.calibrate(flight.sensor, one, flight.unknowns)
    assert answer.posterior.rank <= 6
    assert f"no control observation depends on {RIGHT}" in said(answer)
    assert any(f"determine {answer.posterior.rank} of 15 combinations" in w for w in said(answer))
    assert any("do not determine u_gps, " in w for w in said(answer))
    assert_directions_are_true(one, answer)
    with pytest.raises(wj.SensorError, match=r"do not determine these unknowns: u_gps.*determine . of 15 combinations"):
        wj.calibrate(flight.sensor, one, without_priors(flight.unknowns))


def test_two_points(flight):
    observations = flight.observations()
    two = only(observations, np.isin(np.arange(231), [0, 40]))
    answer = wj.calibrate(flight.sensor, two, flight.unknowns)
    assert answer.posterior.rank == 4 and answer.posterior.untouched == tuple(RIGHT.split(", "))
    assert any("determine 4 of 15 combinations" in w for w in said(answer))
    assert_directions_are_true(two, answer)
    free = without_priors(flight.unknowns)
    with pytest.raises(wj.SensorError, match=r"do not determine these unknowns: u_gps.*determine 4 of 15 combinations"):
        wj.calibrate(flight.sensor, two, free)
    loose = wj.calibrate(flight.sensor, two, free, throw=False)
    assert "there are no more measurements and priors than unknowns: nothing checks the fit" in said(loose)
    assert not any("nan" in w for w in said(loose)) and not loose.is_sound


@pytest.mark.parametrize("sigma", [0.0, -0.2])
def test_a_prior_sigma_that_is_not_positive(flight, sigma):
    with pytest.raises(wj.WhiskjaxError, match=f"unknown u_gps: sigma .*must be a positive number, not {sigma}"):
        dataclasses.replace(flight.unknowns[0], sigma=sigma)


def test_an_image_without_a_swing(flight):
    nameless = [dataclasses.replace(image, swing=None) if image.name == "R1" else image for image in flight.images]
    with pytest.raises(wj.FlightError, match="image R1 has no swing, but the sensor tells left, right apart: fill in its swing"):
        dataclasses.replace(flight, images=nameless).observations()
    observations = flight.observations()
    none = dataclasses.replace(observations, shot=dataclasses.replace(observations.shot, swing=None))
    with pytest.raises(wj.WhiskjaxError, match="no swing, which tells left and right apart"):
        wj.calibrate(flight.sensor, none, flight.unknowns)
    # An index that stands for no swing.
    swing = np.where(np.array(observations.images) == "R1", -1, np.asarray(observations.shot.swing))
    absent = dataclasses.replace(observations, shot=dataclasses.replace(observations.shot, swing=swing))
    with pytest.raises(wj.SensorError, match=r"observation 75, image R1, point R1-01: .*swing.*\(75 of 231 observations fail\)"):
        wj.calibrate(flight.sensor, absent, flight.unknowns)


def test_identical_points(flight):
    """One measurement given again and again determines what one does, and says no more about its own errors."""
    observations = flight.observations()
    i = np.zeros(231, int)
    same = observations.take(i)
    same = dataclasses.replace(same, is_control=observations.is_control)
    answer = wj.calibrate(flight.sensor, same, flight.unknowns)
    assert answer.warnings[0].startswith("observation 0, image L1, point L1-01 is given 130 times: copies count as independent")
    assert answer.posterior.rank == 2
    assert any("determine 2 of 15 combinations" in w for w in said(answer))
    assert_directions_are_true(same, answer)
    with pytest.raises(wj.SensorError, match=r"do not determine these unknowns: u_gps.*determine 2 of 15 combinations"):
        wj.calibrate(flight.sensor, same, without_priors(flight.unknowns))


def test_a_point_given_twice_among_others(flight):
    observations = flight.observations()
    twice = observations.take(np.where(np.arange(231) == 7, 6, np.arange(231)))
    answer = wj.calibrate(flight.sensor, twice, flight.unknowns)
    assert answer.warnings[0].startswith("observation 6, image L1, point L1-07 is given 2 times: copies")
    assert not any("is given" in w for w in wj.calibrate(flight.sensor, observations, flight.unknowns).warnings)

"""Errors that nobody modelled, made on purpose: the verdict fails, and names what was spoiled. And the columns behind it."""

import dataclasses

import jax
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.chain.address import make_room, parse, put, read
from whiskjax.chain.free_numbers import free_numbers
from whiskjax.estimate.suspects import suspects
from whiskjax.flights import haian, tianshan

KINDS = ("one measurement", "a group shifted", "a group too large", "a curve in the residuals", "residuals hang together")


@pytest.fixture(scope="module")
def flight():
    return haian.simulate(5, truth=haian.draw_truth(jax.random.key(5)))


def solved(flight, change=None, sensor=None, **more):
    seen = flight.observations()
    pixel = seen.pixel_px.copy()
    if change is not None:
        pixel = pixel + change(seen)
    seen = dataclasses.replace(seen, pixel_px=pixel, **more)
    return wj.calibrate(flight.sensor if sensor is None else sensor, seen, flight.unknowns, errors=flight.errors, throw=False)


def of_image(seen, name):
    return np.asarray(seen.images) == name


def along(seen, value, axis=0):
    return np.stack([value, 0 * value] if axis == 0 else [0 * value, value], axis=1)


def wave(seen):
    """Errors of 3 px that follow one another slowly in time."""
    rng, time = np.random.default_rng(0), np.asarray(seen.shot.time_s)
    gap = np.abs(time[:, None] - time[None, :])
    return along(seen, 3 * np.linalg.cholesky(np.exp(-gap / 0.3) + 1e-9 * np.eye(len(time))) @ rng.normal(size=len(time)))


SPOILED = {
    "one by 40 px": (lambda seen: along(seen, 40.0 * (np.arange(len(seen)) == 7)), "one measurement", "observation 7"),
    "one image in turn": (
        lambda seen: along(seen, 12.0 * of_image(seen, "L1") * (-1) ** np.arange(len(seen))), "a group too large", "L1",
    ),
    "errors in time": (wave, "residuals hang together", "time"),
}  # fmt: skip


def test_a_clean_flight_is_sound(flight):
    answer = solved(flight)
    assert answer.is_sound and not {reason.kind for reason in answer.reasons} & set(KINDS)


@pytest.mark.parametrize("how", SPOILED)
def test_what_is_spoiled_is_named(flight, how):
    change, kind, name = SPOILED[how]
    answer = solved(flight, change)
    (reason,) = [one for one in answer.reasons if one.kind == kind]
    assert reason.grade == "failure" and not answer.is_sound
    assert any(name in str(value) for value in (*reason.figures, *reason.figures.values()))


def with_error(sensor, place, size):
    address = parse(place)
    sensor = make_room(sensor, address)
    return put(sensor, [address], [read(sensor, address) - size])


@pytest.mark.parametrize(
    ("place", "size"), [("body.attitude_delay_s", 0.02), ("body.delay_s", 0.02), ("gps_arm.angles_rad[1]", 0.005)]
)
def test_a_number_that_was_wrong_is_named_with_the_value_it_would_take(flight, place, size):
    """Errors that the data can tell: the first that is named, or one that looks the same in the residuals."""
    answer = solved(flight, sensor=with_error(flight.sensor, place, size))
    (reason,) = [one for one in answer.reasons if one.kind == "a number taken as known"]
    assert reason.grade == "failure" and parse(place).text in reason.figures["numbers"]
    found, i = answer.evidence.suspicions, answer.evidence.suspects.names.index(parse(place).text)
    usual = answer.evidence.suspects.usual[i]
    assert abs(found.size[i] * usual - size) < 4 * found.sigma[i] * usual


def test_an_error_that_the_data_cannot_show_is_among_those_that_stay_silent(flight):
    """A scan angle read 1 ms late looks like the boresight that is estimated: the fit is as good, and the answer is wrong."""
    answer = solved(flight, sensor=with_error(flight.sensor, "scan.delay_s", 1e-3))
    (reason,) = [one for one in answer.reasons if one.kind == "silent errors"]
    assert answer.is_sound and reason.grade == "caution" and reason.figures["numbers"][0] == "scan.delay_s"


def test_a_contradicted_prior_fails_the_answer(flight):
    """kappa of the left swing 20 sigma off: the data know it far better."""
    off = [dataclasses.replace(x, mean=x.mean + 20 * x.sigma) if x.name == "phi_pos_left" else x for x in flight.unknowns]
    answer = wj.calibrate(flight.sensor, flight.observations(), off, errors=flight.errors)
    (reason,) = [one for one in answer.reasons if one.kind == "far from the prior"]
    assert reason.grade == "failure" and "phi_pos_left" in reason.figures["sigmas"]


def test_near_copies_are_copies(flight):
    """Every observation again, a millionth of a pixel away and under another name: information counted twice."""
    seen = flight.observations()
    both = np.concatenate([np.arange(len(seen))] * 2)
    again = seen.take(both)
    shifted = np.where(np.arange(len(both))[:, None] < len(seen), 0.0, 1e-6)
    points = (*seen.points, *(f"{name}, again" for name in seen.points))
    again = dataclasses.replace(again, pixel_px=again.pixel_px + shifted, points=points, point=np.arange(len(both)))
    answer = wj.calibrate(flight.sensor, again, flight.unknowns, errors=flight.errors)
    (reason,) = [one for one in answer.reasons if one.kind == "copies"]
    assert reason.grade == "failure" and set(reason.figures["times"]) == {2}


def test_looks_given_twice_but_for_a_trifle_are_copies():
    """Those that are the same to the last digit are counted once (tests/locate/test_verdict.py)."""
    flight = tianshan.simulate(2)
    looks, _ = flight.looks([0])
    twice = np.sort(np.concatenate([np.arange(len(looks))] * 2))
    shot = dataclasses.replace(looks.shot, time_s=looks.shot.time_s[twice], image=np.arange(len(twice)) // 2)
    answer = wj.locate(
        flight.sensor,
        wj.Looks(shot, looks.pixel_px[twice] + 1e-6 * (np.arange(len(twice)) % 2)[:, None], (2.0, 2.0)),
        surface=wj.HeightSurface(1000.0),
        sigma_enu_m=(1500.0,) * 3,
        errors=flight.errors,
    )
    assert not answer.is_sound and "copies" in {one.kind for one in answer.reasons if one.grade == "failure"}


def test_columns_are_differences():
    """What each number does to the pixel, beside projecting with it changed a little; every point on its line."""
    flight = haian.simulate(5, noise=False)
    seen, sensor = flight.observations(), wj.assign(flight.sensor, flight.unknowns, np.concatenate(haian.TABLE_4))
    exact = np.asarray(wj.project(sensor, seen.shot, seen.point_m, throw=False).pixel_px)
    found = suspects(sensor, seen.shot, seen.point_m, exact, ())
    assert set(found.names) == {place.text for place in free_numbers(sensor)}
    for k, name in enumerate(found.names):
        if "delay" in name or "deformation" in name:
            continue  # of a delay the column is a difference itself; half a width of one pixel makes steps tiny
        address, step = parse(name), 1e-4 if name.endswith(("_px", "_m", "]")) else 1e-6
        room = make_room(sensor, address)
        late, early = (
            np.asarray(
                wj.project(
                    put(room, [address], [read(room, address) + side * step]), seen.shot, seen.point_m, throw=False
                ).pixel_px
            )
            for side in (1, -1)
        )
        difference = (late - early) / (2 * step)
        largest = max(np.abs(difference).max(), 1e-3)
        np.testing.assert_allclose(found.columns_px[:, :, k], difference, atol=2e-5 * largest, err_msg=name)

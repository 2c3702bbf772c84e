"""Errors that nobody modelled, made on purpose: the verdict fails, and names what was spoiled. And the columns behind it."""

import dataclasses

import jax
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.chain.address import make_room, parse, put, read
from whiskjax.chain.free_numbers import free_numbers
from whiskjax.estimate.reason import warnings
from whiskjax.estimate.suspects import record_frame, suspects
from whiskjax.flights import haian, songshan, tianshan

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
    ("place", "size"),
    [("body.attitude_delay_s", 0.02), ("body.delay_s", 0.02), ("gps_arm.angles_rad[1]", 0.005), ("scan.gain", 0.002)],
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


def test_all_that_stays_silent_is_told_in_three_things(flight):
    """Numbers of one part belong together, and the datum is always among them: it is no number of the instrument."""
    (reason,) = [one for one in solved(flight).reasons if one.kind == "silent errors"]
    assert len(reason.figures["numbers"]) == 3 and reason.figures["numbers"][2].startswith("datum")
    assert {"scan.delay_s", "scan.zero_deg"} <= set(reason.figures["alike"][0])
    assert reason.figures["moves"][0] >= reason.figures["moves"][1] > 1


def test_check_points_tell_a_number_that_control_alone_does_not(flight):
    """A delay that control points of two swings hardly see, and those of the others see well."""
    answer = solved(flight, sensor=with_error(flight.sensor, "body.delay_s", 0.01))
    evidence = answer.evidence
    alone = dataclasses.replace(evidence, everything=None).suspicions
    i = evidence.suspects.names.index("body.delay_s")
    assert evidence.suspicions.sigma[i] < 0.7 * alone.sigma[i]
    assert abs(evidence.suspicions.size[i] * 0.01 - 0.01) < 4 * evidence.suspicions.sigma[i] * 0.01


def test_poses_that_nobody_stated_are_taken_as_exact(flight):
    """With errors of the poses stated nobody takes them as exact."""
    plain = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    assert "poses of body" in plain.evidence.suspects.kin
    assert "poses of body" not in solved(flight).evidence.suspects.kin


def test_residuals_that_are_all_zero_test_nothing():
    flight = haian.simulate(5, noise=False)
    unknowns = haian.unknowns(haian.Truth(*haian.TABLE_4))
    answer = wj.calibrate(flight.sensor, flight.observations(), unknowns, errors=flight.errors)
    (reason,) = [one for one in answer.reasons if one.kind == "consistency"]
    assert reason.grade == "caution" and "all zero" in reason.text


def test_what_could_not_be_tested_is_told(flight):
    """One image, one of its groups with two rows, and too few measurements to follow anything."""
    seen = flight.observations()
    some = seen.take(np.flatnonzero(of_image(seen, "L1"))[:12])
    some = dataclasses.replace(some, is_control=np.ones(12, dtype=bool), images=["L1"] * 10 + ["R1"] * 2)
    answer = wj.calibrate(flight.sensor, some, flight.unknowns, errors=flight.errors)
    (reason,) = [one for one in answer.reasons if one.kind == "not tested"]
    assert reason.grade == "note" and "image R1" in reason.figures["groups"] and "time" in reason.figures["along"]
    assert "its datum above all" in next(one.text for one in answer.reasons if one.kind == "check points")
    alone = wj.calibrate(flight.sensor, dataclasses.replace(some, images=["L1"] * 12), flight.unknowns, errors=flight.errors)
    (reason,) = [one for one in alone.reasons if one.kind == "not tested"]
    assert "image L1" in reason.figures["groups"]


def test_nobody_reads_more_than_five_warnings():
    told = [wj.Reason(f"kind {i}", "failure" if i < 2 else "caution", f"sentence {i}", {}) for i in range(8)]
    found = warnings([*told, wj.Reason("more", "note", "all is well", {})])
    assert found[:4] == tuple(f"sentence {i}" for i in range(4)) and len(found) == 5
    assert found[4] == "and, in .reasons: kind 4, kind 5, kind 6, kind 7" and warnings(told[:5])[-1] == "sentence 4"
    # One cause fails many checks, and the first caution may name it.
    told = [reason._replace(grade="failure" if i < 6 else "caution") for i, reason in enumerate(told)]
    assert warnings(told)[:4] == ("sentence 0", "sentence 1", "sentence 2", "sentence 6")


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


def test_errors_are_stated_of_a_frame_that_takes_them():
    """What a verdict says can be given: of songshan the corrections that `adjust` estimates, of haian the trajectory itself."""
    scene = songshan.Scene("B")
    block = songshan.sensor(scene, songshan.Path.draw(jax.random.key(0)).recorded(scene.data.strips, 1.0))
    assert record_frame(block) == songshan.frame_errors(scene)[0].frame == "pos_error"
    assert record_frame(haian.simulate(1).sensor) == haian.frame_errors()[0].frame == "body"


def test_columns_are_differences():
    """What each number does to the pixel, beside projecting with it changed a little; every point on its line."""
    flight = haian.simulate(5, noise=False)
    seen, sensor = flight.observations(), wj.assign(flight.sensor, flight.unknowns, np.concatenate(haian.TABLE_4))
    exact = np.asarray(wj.project(sensor, seen.shot, seen.point_m, throw=False).pixel_px)
    found = suspects(sensor, seen.shot, seen.point_m, exact, (), np.ones(len(seen), dtype=bool))
    places = {place.text for place in free_numbers(sensor)}
    assert [name for name in found.names if name not in places] == [
        *(f"poses of body, {part} {axis}" for part in ("turn", "shift") for axis in "xyz"),
        *(f"datum, {axis}" for axis in ("east", "north", "up")),
    ]
    _assert_shared_columns(found, sensor, seen)
    for k, name in enumerate(found.names):
        if name not in places:
            continue
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


def _assert_shared_columns(found, sensor, seen):
    """Of a turned or shifted body, by a mount behind it; of all points moved east, north and up."""

    def pixels(turn_rad=(0, 0, 0), shift_m=(0, 0, 0), by_m=0.0):
        moved = sensor.after("body", "off", wj.Mount(lever_arm_m=np.array(shift_m, float), angles_rad=np.array(turn_rad, float)))
        return np.asarray(wj.project(moved, seen.shot, seen.point_m + by_m, throw=False).pixel_px)

    east_north_up = np.asarray(wj.enu_rotation(haian.LAT_RAD, haian.LON_RAD))
    for axis, along in enumerate(np.eye(3)):
        ways = {
            f"turn {'xyz'[axis]}": lambda s, along=along: pixels(turn_rad=1e-6 * s * along),
            f"shift {'xyz'[axis]}": lambda s, along=along: pixels(shift_m=1e-3 * s * along),
            ("east", "north", "up")[axis]: lambda s, axis=axis: pixels(by_m=1e-3 * s * east_north_up[:, axis]),
        }
        for (part, of), step in zip(ways.items(), (1e-6, 1e-3, 1e-3), strict=True):
            (k,) = [k for k, name in enumerate(found.names) if name.endswith(f", {part}")]
            difference = (of(1) - of(-1)) / (2 * step)
            # East at the middle of the points is not quite east at each of them.
            np.testing.assert_allclose(found.columns_px[:, :, k], difference, atol=2e-3 * np.abs(difference).max(), err_msg=part)

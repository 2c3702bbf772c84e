"""A few of the mistakes on the simulated scenes (all of them: `python -m tests.doctor`), what a diagnosis says, bad input."""

import dataclasses
import itertools

import numpy as np
import pytest

import whiskjax as wj
from tests.doctor.scenes import SIMULATED
from tests.doctor.spoils import is_cure, named

# Of each scene those that nothing but its own instrument knows.
CASES = [
    ("haian", "sign of roll"),
    ("haian", "axes permuted"),
    ("haian", "images 18 s late"),
    ("haian", "a wrong point"),
    ("tianshan", "convergence of 1.7 deg"),
    ("tianshan", "encoder sign"),
    ("tianshan", "coordinates exchanged"),
    ("tianshan", "encoders 2 s early"),
]


@pytest.fixture(scope="module")
def scenes():
    """Each is simulated once."""
    made = {}

    def scene(name):
        if name not in made:
            made[name] = SIMULATED[name]()
        return made[name]

    return scene


@pytest.mark.slow
@pytest.mark.parametrize("scene, mistake", CASES)
def test_right_remedy_comes_first(scenes, scene, mistake):
    spoil = named(mistake)
    found = wj.examine(spoil.make(scenes(scene)))
    assert not found.is_sound
    right = [each for each in found.best if is_cure(spoil, each.name)]
    assert right, [each.name for each in found.best]
    assert right[0].explains
    if found.as_given is not None:
        assert found.as_given.place > 1
        assert found.as_given.cost - right[0].cost > 25
    assert right[0].name in found.warnings[0]


@pytest.fixture(scope="module")
def sound(scenes):
    """A flight without a mistake, and what is found."""
    flight = scenes("haian")
    return flight, wj.examine(flight)


def test_sound_flight_is_best_as_given(sound):
    flight, found = sound
    assert found.is_sound and found.warnings == ()
    assert found.as_given in found.best
    assert "nothing explains the data better" in found.reasons[0].text
    role = np.asarray(flight.points.roles)[flight.measurements.point]
    assert found.observations == found.of_observations == (role == "control").sum()


def test_findings_are_in_order(sound):
    _, found = sound
    places = [each.place for each in found.findings]
    assert places == sorted(places) and places[0] == 1
    by_place = {p: [each.cost for each in found.findings if each.place == p] for p in places}
    ordered = [by_place[p] for p in sorted(by_place)]
    assert all(max(before) < min(after) for before, after in itertools.pairwise(ordered))
    assert all(each.residual_after_px < each.residual_before_px for each in found.findings)


def test_cured_flight_calibrates(scenes):
    """What the advice says is what `apply` does: the flight is sound again."""
    spoiled = named("convergence of 1.7 deg").make(scenes("haian"))
    found = wj.examine(spoiled)
    cure = next(each for each in found.best if each.name == "convergence")
    assert cure.unit == "deg"
    assert abs(cure.value - 1.7) < 4 * cure.value_sigma
    assert f"{cure.value:+.4f}" in cure.advice
    flight = cure.apply(spoiled)
    assert wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, errors=flight.errors).is_sound


def test_lines_that_nothing_recorded_do_not_end_it(scenes):
    """A flight that cannot even be evaluated as it is."""
    flight = scenes("haian")
    m = flight.measurements
    away = dataclasses.replace(flight, measurements=dataclasses.replace(m, line_px=m.line_px + 1e5))
    found = wj.examine(away)
    assert not found.is_sound
    assert found.as_given is None
    assert "line table" in found.refused["as given"]


def test_one_point_without_unknowns(scenes):
    """The gimbal's target alone, where nothing is to be estimated."""
    flight = scenes("tianshan")
    assert not flight.unknowns and len(flight.points.names) == 1
    found = wj.examine(flight)
    assert found.is_sound
    assert found.as_given.strays == []


def test_check_points_decide_where_there_is_no_control(scenes):
    flight = scenes("tianshan")
    flight = dataclasses.replace(flight, points=dataclasses.replace(flight.points, roles=["check"]))
    found = wj.examine(flight)
    assert found.is_sound
    assert any("check points" in remark for remark in found.remarks)


def test_points_without_coordinates_are_refused(scenes):
    flight = scenes("tianshan")
    points = dataclasses.replace(flight.points, roles=["tie"], position_m=np.full((1, 3), np.nan))
    with pytest.raises(wj.FlightError, match="examine: no measured point has coordinates"):
        wj.examine(dataclasses.replace(flight, points=points))


def test_what_is_no_flight_is_refused():
    with pytest.raises(wj.WhiskjaxError, match="examine: flight is a str, but Flight is expected"):
        wj.examine("examples/haian")

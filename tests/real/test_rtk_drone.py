"""rtk_drone_nadir: a robust loss finds the blunder that the source leaves in."""

import numpy as np
import pytest

from tests.real import reach_rtk_drone

SET = reach_rtk_drone.SET


@pytest.fixture(scope="module")
def solved(reached_on):
    return reach_rtk_drone.calibrate(reached_on(SET).folders[0])


def test_blunder_alone_is_put_aside(solved):
    marks = list(zip(solved.observations.images, solved.observations.points, strict=True))
    assert marks[int(np.argmin(solved.robust_weight))] == reach_rtk_drone.BLUNDER
    aside, *others = np.sort(solved.robust_weight)
    assert aside < 0.01
    assert others[0] > 0.5
    assert solved.is_sound


def test_interior_stays_near_its_prior_and_marks_fit(solved):
    away = np.sort(np.linalg.norm(solved.residual_after_px, axis=1))
    assert away[-1] > 1500
    assert away[-2] < 60
    assert np.median(away) < 30
    value = dict(zip([x.name for x in solved.unknowns], solved.value, strict=True))
    assert abs(value["focal length"] - 4394) < 3 * 60
    assert 9 < np.degrees(value["pitch"]) < 10.5


def test_command_says_what_the_library_says(reached_on, solved, calibrate_by_command):
    results = calibrate_by_command(reached_on(SET).folders[0], "--loss", "cauchy")
    assert [(d["image"], d["point"]) for d in results["down_weighted"]["observations"]] == [reach_rtk_drone.BLUNDER]
    expected = [v * x.unit.factor for x, v in zip(solved.unknowns, solved.value, strict=True)]
    np.testing.assert_allclose([p["value"] for p in results["parameters"]], expected, rtol=1e-9)

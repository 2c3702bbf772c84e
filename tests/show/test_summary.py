"""The summary: plain data, in the units that it states, and true to the calibration."""

import dataclasses
import json

import numpy as np
import pytest

from tests.show.invented import invented
from whiskjax.estimate.check_points import CheckTest
from whiskjax.estimate.reason import probability
from whiskjax.estimate.unknown import Unknown
from whiskjax.estimate.variance_components import Components
from whiskjax.files.schema import UnknownTable
from whiskjax.files.unknowns import unknowns_from_toml
from whiskjax.rules import RESULTS
from whiskjax.show.calibration.residuals import gather
from whiskjax.show.calibration.summary import summarise
from whiskjax.show.tables import weights


def test_is_plain_data(summary):
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_parameters_are_in_their_unit(summary, calibration):
    degrees = 180 / np.pi
    by_name = {p["name"]: p for p in summary["parameters"]}
    for k, unknown in enumerate(calibration.unknowns):
        p = by_name[unknown.name]
        factor = degrees if p["unit"] == "deg" else 1.0
        assert p["unit"] == ("m" if unknown.name[0] in "uvw" else "deg")
        np.testing.assert_allclose(p["value"], factor * calibration.value[k], rtol=1e-12)
        np.testing.assert_allclose(p["sigma"], factor * calibration.posterior.sigma[k], rtol=1e-12)
        np.testing.assert_allclose(p["data_share"], 1 - (p["sigma"] / p["prior_sigma"]) ** 2, rtol=0, atol=1e-12)
        np.testing.assert_allclose(p["from_prior_sigmas"], (p["value"] - p["prior_mean"]) / p["prior_sigma"], rtol=1e-12)


def test_places_are_called_as_in_files(summary, calibration, flight):
    """What results print of an unknown is what flight.toml takes, and Python too: numbers are in the unit that they state."""
    for p, unknown in zip(summary["parameters"], calibration.unknowns, strict=True):
        prior = {key: p[key] for key in ("prior_mean", "prior_sigma")}
        (read,) = unknowns_from_toml([UnknownTable(name=p["name"], where=p["where"], **prior)], flight.sensor, 0.0)
        written = Unknown(p["name"], p["where"][0], p["prior_mean"], p["prior_sigma"])
        for again in (read, written):
            assert (again.name, again.places) == (unknown.name, unknown.places)
            np.testing.assert_allclose([again.mean, again.sigma], [unknown.mean, unknown.sigma], rtol=1e-14)
    assert {"sensor.angles_deg[0]", "sensor.lever_arm_m[2]"} <= {p["where"][0] for p in summary["parameters"]}


@pytest.mark.parametrize("stage", ["before", "after"])
@pytest.mark.parametrize("role", ["control", "check"])
@pytest.mark.parametrize("k", [0, 1])
def test_statistics_are_those_of_numpy(summary, calibration, flight, stage, role, k):
    residual = getattr(calibration, f"residual_{stage}_px")[:, k]
    is_role = calibration.observations.is_control == (role == "control")
    for image in [None, *(i.name for i in flight.images)]:
        here = is_role & (True if image is None else np.asarray(calibration.observations.images) == image)
        key = {"image": image, "role": role, "stage": stage, "axis": "xy"[k]}
        rows = [row for row in summary["residuals"] if key.items() <= row.items()]
        assert len(rows) == int(here.any())
        for row in rows:
            r = residual[here]
            assert row["n"] == len(r)
            expected = [r.mean(), r.std(ddof=1), np.abs(r).max(), np.sqrt((r**2).mean())]
            np.testing.assert_allclose([row[f"{s}_px"] for s in ("mean", "std", "max_abs", "rms")], expected, rtol=1e-12)


def test_says_what_a_careful_person_would(summary):
    assert summary["verdict"]["is_sound"]
    assert summary["determined"]["fixed_by_prior"] == ["omega_sen"]
    pairs = {frozenset((s["first"], s["second"])) for s in summary["correlation"]["strong"]}
    assert frozenset(("omega_pos_left", "omega_sen")) in pairs
    assert all(abs(s["correlation"]) > 0.9 for s in summary["correlation"]["strong"])
    assert summary["counts"]["control_observations"] == 130 and summary["counts"]["check_observations"] == 101
    assert any("omega_sen" in said for said in summary["warnings"])


def test_an_undetermined_unknown_has_no_sigma(undetermined):
    calibration, flight = undetermined
    summary = summarise(calibration, flight)
    json.dumps(summary, allow_nan=False)
    assert not summary["verdict"]["is_sound"]
    assert summary["determined"]["not_determined"] == ["omega_sen"]
    assert next(p for p in summary["parameters"] if p["name"] == "omega_sen")["sigma"] is None
    assert summary["verdict"]["reasons"][0]["figures"]["unknowns"] == ["omega_sen"]
    assert summary["determined"]["condition_of_data"] is None


def test_an_iteration_without_an_end_is_not_sound(calibration, flight):
    verdict = summarise(invented(calibration, result=RESULTS.not_converged), flight)["verdict"]
    assert verdict["word"] == "not sound"
    assert verdict["reasons"][0]["grade"] == "failure" and "did not converge" in verdict["reasons"][0]["text"]


def test_an_inconsistent_fit_is_not_sound(calibration, flight):
    fit = calibration.fit._replace(variance_factor=9.0, tail_probability=0.0, is_consistent=False)
    verdict = summarise(invented(calibration, fit=fit), flight)["verdict"]
    assert not verdict["is_sound"]
    said = verdict["reasons"][0]["text"]
    assert "3 times" in said and "more than chance explains" in said


def test_check_points_that_contradict_are_not_sound(calibration, flight):
    summary = summarise(calibration, flight)
    assert summary["check"]["agrees"] and summary["check"]["degrees_of_freedom"] == 202
    check = CheckTest(900.0, 202, 1e-90, ("observation 7, image R3, point R3-01",), (9.0,))
    odd = invented(calibration, fit=calibration.fit._replace(check=check))
    found = summarise(odd, flight)
    assert not found["verdict"]["is_sound"] and not found["check"]["agrees"]
    assert found["check"]["worst"] == [{"name": "observation 7, image R3, point R3-01", "sigmas": 9.0}]
    (said,) = [said for said in found["warnings"] if "contradict the answer" in said]
    assert "2.11 times" in said and "R3-01" in said


def test_a_weight_beyond_reason_is_not_sound(calibration, flight):
    parts = Components(("L1 x", "L1 y"), np.zeros(2, bool), np.full(2, 65), np.array([1.1, 70.0]), 0.09**2 * np.eye(2))
    found = summarise(dataclasses.replace(calibration, components=parts), flight)
    assert not found["verdict"]["is_sound"] and [row["is_plausible"] for row in found["weights"]] == [True, False]
    assert any("the errors of L1 y are 70 times larger" in said for said in found["warnings"])
    assert [row[2].alarm for row in weights(found).rows] == [False, True]


def test_sigmas_that_are_too_large_are_said_to_be(calibration, flight):
    fit = calibration.fit._replace(variance_factor=0.16, tail_probability=1.0)
    said = summarise(invented(calibration, fit=fit), flight)["warnings"]
    assert any("0.4 times" in one and "too large" in one for one in said)


def test_tie_points_and_empty_images_are_counted(calibration, flight):
    """A measurement of a tie point, and an image that only it is in."""
    m = flight.measurements
    more = {f.name: np.append(getattr(m, f.name), getattr(m, f.name)[0]) for f in dataclasses.fields(m)}
    more["point"][-1] = len(flight.points.names)
    points = dataclasses.replace(
        flight.points,
        names=[*flight.points.names, "a tie"],
        roles=[*flight.points.roles, "tie"],
        position_m=np.concatenate([flight.points.position_m, np.full((1, 3), np.nan)]),
        sigma_enu_m=np.concatenate([flight.points.sigma_enu_m, np.zeros((1, 3))]),
    )
    images = [*flight.images, dataclasses.replace(flight.images[0], name="alone")]
    more["image"][-1] = len(flight.images)
    flight = dataclasses.replace(flight, points=points, images=images, measurements=dataclasses.replace(m, **more))
    counts = summarise(calibration, flight)["counts"]
    assert counts["tie_observations_left_out"] == 1 and counts["images_without_observations"] == 1
    assert counts["images"] == 6 and counts["observations"] == 231


def test_down_weighted_observations_are_named(calibration, flight):
    weight = calibration.robust_weight.copy()
    control = np.flatnonzero(calibration.observations.is_control)
    check = np.flatnonzero(~calibration.observations.is_control)
    weight[[control[3], control[7], check[0]]] = 0.4, 0.1, 0.1
    found = summarise(invented(calibration, robust_weight=weight), flight)["down_weighted"]
    names = [calibration.observations.points[i] for i in (control[7], control[3])]
    assert found["count"] == 2 and [o["point"] for o in found["observations"]] == names


def test_refuses_the_wrong_flight(calibration, flight):
    roles = ["tie", *flight.points.roles[1:]]
    other = dataclasses.replace(flight, points=dataclasses.replace(flight.points, roles=roles))
    with pytest.raises(ValueError, match="the flight that it was made from"):
        gather(calibration, other)


def test_probability_for_people():
    assert probability(0.0187) == "0.019" and probability(4e-305) == "below 1e-6"

"""The summary of an adjusted block, its tables and its page: plain data, true to the adjustment, and the verdict first."""

import csv
import dataclasses
import json
import re

import numpy as np
import pytest

import whiskjax as wj
from tests.oracles import ecef_from_ned, geodetic
from tests.show.block_made_up import CASES, LIMITS, SIGMA_M, made, strips
from tests.show.test_report import Page
from whiskjax.flights.songshan_draw import start_s
from whiskjax.show.block.charts import draw_charts
from whiskjax.show.block.page import make_report
from whiskjax.show.block.sheets import NAMES, write_sheets
from whiskjax.show.block.summary import summarise
from whiskjax.show.block.tables import all_tables

ENU = ("east", "north", "up")


def enu_errors(adjusted):
    """Adjusted less given, east north up, by scipy's rotations."""
    off = adjusted.adjustment.point_m - adjusted.block.position_m
    if adjusted.flight.world.kind == "local":
        return off
    lat, lon, _ = geodetic(adjusted.adjustment.point_m)
    ned = np.einsum("nji,nj->ni", ecef_from_ned(lat, lon).as_matrix(), off)
    return ned[:, [1, 0, 2]] * [1, 1, -1]


@pytest.mark.parametrize("case", CASES)
def test_is_plain_data_and_agrees_with_the_adjustment(case):
    adjusted, summary = made(case), summarise(made(case))
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["verdict"]["is_sound"] == adjusted.adjustment.is_sound
    rays = summary["counts"]["rays"]
    assert rays["all"] == rays["control"] + rays["check"] + rays["tie"] == len(adjusted.block)
    points = summary["counts"]["points"]
    assert points["all"] + summary["counts"]["points_unseen"] == len(adjusted.flight.points.names)


@pytest.mark.parametrize("case", ["sound", "no control", "a point unseen", "lines over the Earth"])
def test_statistics_are_those_of_the_errors(case):
    adjusted, summary = made(case), summarise(made(case))
    rows = {(row["what"], row["axis"]): row for row in summary["statistics"]}
    for role in ("control", "check"):
        error = enu_errors(adjusted)[adjusted.block.role == role]
        error = error[np.isfinite(error).all(axis=1)]
        assert ((role, "up") in rows) == (len(error) > 0)
        for k, axis in enumerate(ENU) if len(error) else ():
            e, row = error[:, k], rows[role, axis]
            assert row["n"] == len(e)
            expected = [e.max(), e.min(), e.mean(), np.sqrt((e**2).mean())]
            found = [row[key] for key in ("max_m", "min_m", "mean_m", "rmse_m")]
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("case", ["sound", "lines over the Earth"])
def test_check_points_against_their_covariance(case):
    adjusted, check = made(case), summarise(made(case))["check"]
    chosen = adjusted.block.role == "check"
    error = enu_errors(adjusted)[chosen]
    variance = SIGMA_M**2 + np.asarray(adjusted.flight.points.sigma_enu_m)[chosen] ** 2
    assert check["mean_nees"] == pytest.approx((error**2 / variance).sum(axis=1).mean(), rel=1e-5)
    assert check["planimetry_rmse_m"] == pytest.approx(np.sqrt((error[:, :2] ** 2).sum(axis=1).mean()), rel=1e-6)
    assert check["height_rmse_m"] == pytest.approx(np.sqrt((error[:, 2] ** 2).mean()), rel=1e-6)


def test_limits():
    """Each limit by itself; a block without check points meets none."""
    met, missed, none = (summarise(made(case))["standard"] for case in ("sound", "limits missed", "no check"))
    assert met["passes"] and [row["limit_m"] for row in met["limits"]] == [LIMITS.planimetry_m, LIMITS.height_m]
    assert not missed["passes"] and [row["passes"] for row in missed["limits"]] == [False, True]
    assert not none["passes"] and [row["passes"] for row in none["limits"]] == [None, None]
    assert summarise(made("left out"))["standard"] is None
    assert any("strict: not met in planimetry" in c for c in summarise(made("limits missed"))["warnings"])
    # What a standard says does not make a result unsound.
    assert summarise(made("limits missed"))["verdict"]["is_sound"]


def test_unknowns_are_in_their_unit():
    rows = {row["name"]: row for row in summarise(made("sound"))["unknowns"]}
    assert rows["ex"]["unit"] == "deg" and rows["ex"]["prior_sigma"] == pytest.approx(1.0) and rows["ex"]["start"] == 0
    assert rows["ex"]["value"] == pytest.approx(0.3) and rows["u"]["value"] == pytest.approx(0.3) and rows["u"]["unit"] == "m"


def test_a_ray_left_out_is_named():
    summary = summarise(made("left out"))
    block = strips().block()
    (row,) = summary["left_out"]
    assert (row["image"], row["point"], row["x_px"]) == (block.images[200], block.points[block.point[200]], 50.0)
    assert all(abs(row["x_px"]) < 10 for row in summary["largest_residuals"]) and summary["weights"][0]["group"] == "tie rays"
    assert summary["counts"]["rays_left_out"] == 1


def test_direct_positioning_before_and_after():
    rows = [row for row in summarise(made("direct"))["statistics"] if row["what"].startswith("direct")]
    assert [row["what"] for row in rows] == ["direct, before"] * 3 + ["direct, after"] * 3
    for before, after in zip(rows[:3], rows[3:], strict=True):
        assert after["rmse_m"] == pytest.approx(before["rmse_m"] / 100, rel=1e-12)


def test_verdicts():
    """What the adjustment says comes first where it fails; what only its flight knows is added."""
    for case, kind in (("failed", "solution"), ("not consistent", "consistency")):
        summary, adjusted = summarise(made(case)), made(case)
        first = summary["verdict"]["reasons"][0]
        assert (first["kind"], first["grade"]) == (kind, "failure") and not summary["verdict"]["is_sound"]
        assert first["figures"] == adjusted.adjustment.reasons[0].figures
    assert any("1 point of the flight is seen by no image" in said for said in summarise(made("a point unseen"))["warnings"])
    told = summarise(made("sound"))["verdict"]["reasons"]
    assert ("limits", "note") in [(reason["kind"], reason["grade"]) for reason in told]


def test_residuals_on_the_ground():
    """A ray that meets the height of its point 0.3 m east and 0.2 m south of it says so."""
    for case in ("sound", "lines over the Earth"):
        adjusted = made(case)
        block, to_world = adjusted.block, adjusted.world_from_enu
        moved = adjusted.adjustment.point_m + to_world @ np.array([0.3, -0.2, 0.0])
        pixel = np.asarray(wj.project(adjusted.adjustment.sensor, block.shot, moved[block.point]).pixel_px)
        measured = dataclasses.replace(adjusted.adjustment, block=dataclasses.replace(block, pixel_px=pixel))
        ground = dataclasses.replace(adjusted, adjustment=measured).ground_m
        # Only rays that lie on the detector: made-up ties are anywhere in the block.
        on = np.abs(pixel[:, 1]) < 2000
        assert on.any()
        np.testing.assert_allclose(ground[on], np.broadcast_to([0.3, -0.2], ground[on].shape), rtol=0, atol=1e-5)


@pytest.mark.parametrize("case", CASES)
def test_page_says_the_verdict_first_and_refers_to_nothing_outside(case):
    summary = summarise(made(case), "whiskjax adjust somewhere")
    html = make_report(summary, draw_charts(made(case)))
    page = Page(html)
    assert not page.open and "http" not in re.sub(r"base64,[^\"]*", "", html)
    inside = {f"#{name}" for name in page.ids}
    assert all(r in inside or r.startswith("data:image/png;base64,") for r in page.references)
    assert f"This adjustment is {summary['verdict']['word']} ." in page.text.split("The block")[0]
    for table in all_tables(summary):
        assert all(cell.text in page.text for row in table.rows for cell in row)
    assert all(warning in page.text for warning in summary["warnings"]) and summary["command"] in page.text


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("case", ["sound", "lines over the Earth", "frames", "a point unseen", "trajectory kept"])
def test_sheets(case, tmp_path):
    adjusted = made(case)
    write_sheets(tmp_path, adjusted, summarise(adjusted))
    kept = case == "trajectory kept"
    assert {path.name for path in tmp_path.iterdir()} == set(NAMES) - ({"corrections.csv"} if kept else set())
    points = read_csv(tmp_path / "adjusted_points.csv")
    assert [row["point"] for row in points] == list(adjusted.flight.points.names)
    columns = ("x_m", "y_m", "z_m") if adjusted.flight.world.kind == "local" else ("lat_deg", "lon_deg", "height_m")
    seen = np.isfinite(adjusted.adjustment.point_m).all(axis=1)
    assert [row[columns[0]] != "" for row in points] == seen.tolist()
    sigma = [[float(row[f"sigma_{axis}_m"]) for axis in "enu"] for row, s in zip(points, seen, strict=True) if s]
    np.testing.assert_allclose(sigma, np.broadcast_to(SIGMA_M, (int(seen.sum()), 3)), rtol=1e-6)
    if columns[0] == "x_m":
        first = [float(points[0][name]) for name in columns]
        np.testing.assert_array_equal(first, adjusted.adjustment.point_m[0])
    residuals = read_csv(tmp_path / "residuals.csv")
    assert len(residuals) == len(adjusted.block) and {row["used"] for row in residuals} == {"yes"}
    np.testing.assert_array_equal([float(row["x_px"]) for row in residuals], adjusted.adjustment.residual_px[:, 0])
    if not kept:
        stations = read_csv(tmp_path / "corrections.csv")
        sigma = np.degrees(adjusted.adjustment.trust.stations[:, 2])
        np.testing.assert_allclose([float(row["sigma_turn_z_deg"]) for row in stations], sigma, rtol=1e-12)
        if case == "sound":
            assert [row["segment"] for row in stations] == ["east"] * 49 + ["west"] * 49
            assert float(stations[49]["time_s"]) == start_s(2)[1]

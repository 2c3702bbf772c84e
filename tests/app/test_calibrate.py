"""`whiskjax calibrate`, from a folder to a report: what it prints, writes, refuses and leaves behind."""

import csv
import json
import shutil

import numpy as np
import pytest

import whiskjax as wj
from tests.app.said import progress
from whiskjax.files.read import read_flight

WRITTEN = {
    "calibrated",
    "correlations.png",
    "parameters.csv",
    "prior_posterior.png",
    "report.html",
    "residual_trends.png",
    "residual_vectors.png",
    "residuals.csv",
    "results.json",
    "statistics.csv",
}


def names(folder):
    return {path.name for path in folder.iterdir()}


def json_of(out):
    return json.loads((out / "results.json").read_text(encoding="utf-8"))


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def edited(flight, tmp_path, file, change):
    """A copy of a flight folder in which one file is changed, as a list of lists of text."""
    folder = shutil.copytree(flight, tmp_path / "edited")
    path = folder / file
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    change(rows)
    path.write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
    return folder


@pytest.fixture
def optimistic(flight, tmp_path):
    """The flight with measurements said to be four times better than they are."""

    def change(rows):
        for row in rows[1:]:
            for name in ("sigma_line_px", "sigma_sample_px"):
                k = rows[0].index(name)
                row[k] = repr(float(row[k]) / 4)

    return edited(flight, tmp_path, "observations.csv", change)


def test_a_sound_result_ends_in_zero_and_is_all_there(calibrated):
    result, out = calibrated
    assert result.exit_code == 0
    progress(result.stderr)
    assert names(out) == WRITTEN
    assert names(out.parent) == {"haian"}
    assert json_of(out)["verdict"]["is_sound"]


def test_prints_the_numbers_of_results_json(calibrated):
    result, out = calibrated
    lines = result.stdout.splitlines()
    assert "This calibration is sound:" in lines
    for p in json_of(out)["parameters"]:
        words = next(line for line in lines if line.startswith(p["name"] + " ")).replace("−", "-").split()
        assert words[1] == p["unit"]
        value, sigma, share = float(words[5]), float(words[6]), float(words[7])
        assert abs(value - p["value"]) <= 0.05 * p["sigma"]
        assert abs(sigma - p["sigma"]) <= 0.05 * p["sigma"]
        assert abs(share - 100 * p["data_share"]) <= 0.05 + 1e-9
    for warning in json_of(out)["warnings"]:
        assert f"warning: {warning}" in lines


def test_tables_hold_the_figures_of_results_json(calibrated):
    _, out = calibrated
    data = json_of(out)
    written = {row["name"]: float(row["value"]) for row in read_csv(out / "parameters.csv")}
    assert written == {p["name"]: p["value"] for p in data["parameters"]}
    assert [float(row["rms_px"]) for row in read_csv(out / "statistics.csv")] == [row["rms_px"] for row in data["residuals"]]


def test_finds_the_truth_that_the_simulation_wrote(calibrated, flight):
    """The well-determined combinations of haian, within four of their sigmas."""
    _, out = calibrated
    truth = {row["name"]: float(row["value"]) for row in read_csv(flight / "truth.csv")}
    found = {p["name"]: p for p in json_of(out)["parameters"]}
    assert truth.keys() == found.keys()
    for name in ("kappa_pos_left", "kappa_pos_right", "phi_sen", "w_gps", "kappa_sen"):
        assert abs(found[name]["value"] - truth[name]) < 4 * found[name]["sigma"]
    together = ("omega_pos_left", "omega_sen")
    assert abs(sum(found[n]["value"] - truth[n] for n in together)) < 0.02  # deg


def test_the_calibrated_flight_is_a_flight_with_the_residuals_after(calibrated):
    _, out = calibrated
    flight = read_flight(out / "calibrated")
    observations = flight.observations()
    seen = wj.project(flight.sensor, observations.shot, observations.point_m).pixel_px
    rows = read_csv(out / "residuals.csv")
    after = np.array([[float(row["x_after_px"]), float(row["y_after_px"])] for row in rows])
    # Positions and angles go through degrees and metres: some 1e-9 m.
    np.testing.assert_allclose(observations.pixel_px - np.asarray(seen), after, rtol=0, atol=1e-5)
    assert flight.name.endswith("calibrated")


def test_an_unsound_result_is_written_and_ends_in_three(whiskjax, optimistic, tmp_path):
    out = tmp_path / "out"
    result = whiskjax("calibrate", optimistic, "--out", out)
    assert result.exit_code == 3
    assert "This calibration is not sound:" in result.stdout and "more than chance explains" in result.stdout
    assert names(out) == WRITTEN - {"calibrated"}
    verdict = json_of(out)["verdict"]
    assert not verdict["is_sound"] and any("more than chance" in reason["text"] for reason in verdict["reasons"])
    assert "not sound" in (out / "report.html").read_text(encoding="utf-8")


def test_a_second_run_replaces_its_own_files_only(whiskjax, calibrated, optimistic, tmp_path):
    out = shutil.copytree(calibrated[1], tmp_path / "again")
    (out / "my notes.txt").write_text("keep me")
    assert whiskjax("calibrate", optimistic, "--out", out).exit_code == 3
    assert names(out) == WRITTEN - {"calibrated"} | {"my notes.txt"}
    assert not json_of(out)["verdict"]["is_sound"]


def spoil_number(rows):
    rows[3][rows[0].index("line")] = "twelve"


def test_bad_input_ends_in_one_and_leaves_nothing(whiskjax, flight, tmp_path):
    folder = edited(flight, tmp_path, "observations.csv", spoil_number)
    result = whiskjax("calibrate", folder, "--out", tmp_path / "new" / "out")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr.startswith("whiskjax: error: observations.csv") and "line 4" in result.stderr
    assert "Traceback" not in result.stderr
    assert names(tmp_path) == {"edited"}


@pytest.mark.parametrize(
    ("file", "column", "value"),
    [
        ("observations.csv", "sigma_line_px", "1e200"),
        ("observations.csv", "sigma_sample_px", "1e-200"),
        ("points.csv", "sigma_u_m", "1e200"),
    ],
)
def test_a_sigma_of_no_size_ends_in_one(whiskjax, flight, tmp_path, file, column, value):
    def spoil(rows):
        rows[3][rows[0].index(column)] = value

    result = whiskjax("calibrate", edited(flight, tmp_path, file, spoil), "--out", tmp_path / "out")
    assert result.exit_code == 1 and result.stderr.startswith("whiskjax: error: ") and "sigma" in result.stderr
    assert "Traceback" not in result.stderr and names(tmp_path) == {"edited"}


def test_a_folder_that_is_no_flight(whiskjax, tmp_path):
    result = whiskjax("calibrate", tmp_path / "nowhere", "--out", tmp_path / "out")
    assert result.exit_code == 1 and "nowhere" in result.stderr
    assert names(tmp_path) == set()


def test_refuses_to_write_over_a_file_or_a_flight(whiskjax, flight, tmp_path):
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "out", flight):
        result = whiskjax("calibrate", flight, "--out", out)
        assert result.exit_code == 1 and "give" in result.stderr
    assert names(tmp_path) == {"file"}
    assert "results.json" not in names(flight)


@pytest.mark.parametrize("existed", [False, True])
def test_a_failure_while_writing_leaves_everything_as_it_was(whiskjax, calibrated, flight, tmp_path, monkeypatch, existed):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("whiskjax.show.calibration.page.make_report", full)
    out = tmp_path / "parent" / "out"
    if existed:
        shutil.copytree(calibrated[1], out)
        (out / "notes.txt").write_text("mine")
    result = whiskjax("calibrate", flight, "--out", out)
    assert result.exit_code == 1 and "No space left" in result.stderr
    if existed:
        assert names(out) == WRITTEN | {"notes.txt"} and json_of(out) == json_of(calibrated[1])
        assert names(out.parent) == {"out"}
    else:
        assert names(tmp_path) == set()


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--loss", "median"],
        ["--bound", "2"],
        ["--loss", "huber", "--bound", "-1"],
        ["--max-steps", "0"],
    ],
)
def test_wrong_usage_ends_in_two(whiskjax, flight, tmp_path, words):
    out = [] if not words else ["--out", tmp_path / "out"]
    assert whiskjax("calibrate", flight, *out, *words).exit_code == 2
    assert names(tmp_path) == set()

"""CSV files: the same figures as the summary, with all digits."""

import csv

import numpy as np

from whiskjax.show.calibration import sheets


def read(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def same(text, value):
    return text == "" if value is None else float(text) == value if isinstance(value, float) else text == str(value)


def test_parameters_and_statistics_have_all_digits(summary, tmp_path):
    sheets.write_parameters(tmp_path / "p.csv", summary)
    sheets.write_statistics(tmp_path / "s.csv", summary)
    for name, rows in (("p", summary["parameters"]), ("s", summary["residuals"])):
        for written, row in zip(read(tmp_path / f"{name}.csv"), rows, strict=True):
            assert all(same(written[key], row[key]) for key in written if key != "where")


def test_every_observation_is_there(residuals, calibration, tmp_path):
    sheets.write_residuals(tmp_path / "r.csv", residuals)
    rows = read(tmp_path / "r.csv")
    assert [row["point"] for row in rows] == list(calibration.observations.points)
    assert [row["role"] == "control" for row in rows] == calibration.observations.is_control.tolist()
    for stage, expected in (("before", calibration.residual_before_px), ("after", calibration.residual_after_px)):
        written = np.array([[float(row[f"x_{stage}_px"]), float(row[f"y_{stage}_px"])] for row in rows])
        np.testing.assert_array_equal(written, expected)
    assert {"line", "sample_px", "time_s", "weight"} <= rows[0].keys()

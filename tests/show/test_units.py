"""Every number that people are shown has a unit or needs none: headings of tables, columns of CSV files, figures of summaries."""

import csv
import re

import numpy as np
import pytest

from tests.show import block_made_up, target_made_up
from tests.show.test_tables import printed
from whiskjax.show.block import sheets as block_sheets
from whiskjax.show.block import tables as block_tables
from whiskjax.show.block.summary import summarise as summarise_block
from whiskjax.show.calibration import tables
from whiskjax.show.calibration.sheets import write_parameters, write_residuals, write_statistics
from whiskjax.show.target import tables as target_tables
from whiskjax.show.target.summary import summarise as summarise_target

UNIT = re.compile(r"(?<!\w)(px|lines|m|deg|s|sigmas?|%)(?!\w)")
# Counts and ratios. Some tables name the unit of a row in a column of its own.
WITHOUT = {
    "n", "rays", "points", "look", "figure", "values", "redundancy: mean", "redundancy: min", "weight", "correlation", "NIS",
    "sigma ×",
}  # fmt: skip
CSV_UNIT = re.compile(r"_(px|lines|m|deg|s|m_per_px)$")
CSV_WITHOUT = {
    "image", "n", "line", "px_per_line", "weight", "redundancy_x", "redundancy_y", "normalised_x", "normalised_y", "rays",
    "station", "look", "nis", "prior_mean", "prior_sigma", "start", "value", "sigma", "data_share", "from_prior_sigmas",
}  # fmt: skip
BLOCKS = ("direct", "left out", "frames", "lines over the Earth")


def missing_units(table):
    """Headings of columns of numbers that say no unit, and are no ratios or counts; a title may say it for all."""
    numbers = [heading for heading, is_number in zip(table.headings, table.is_number, strict=True) if is_number]
    all_told = UNIT.search(table.title) or "unit" in table.headings
    return [h for h in numbers if not all_told and not UNIT.search(h) and h not in WITHOUT]


def missing_in_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [name for name in rows[0] if is_number(rows, name) and not CSV_UNIT.search(name) and name not in CSV_WITHOUT]


def is_number(rows, name):
    try:
        return [float(row[name]) for row in rows if row[name] != ""] != []
    except ValueError:
        return False


def shown(summary):
    return (
        tables.parameters(summary), tables.residuals(summary), tables.sizes(summary), tables.largest(summary),
        tables.detectable(summary), tables.correlations(summary),
    )  # fmt: skip


def test_tables_of_a_calibration(summary):
    figures = ("x_px", "y_px", "normalised_x", "normalised_y")
    blunder = summary | {"blunders": [dict.fromkeys(("image", "point"), "a") | dict.fromkeys(figures, 1.0)]}
    for table in filter(None, (*shown(summary), tables.blunders(blunder))):
        assert missing_units(table) == [], table.title


@pytest.mark.parametrize("case", BLOCKS)
def test_tables_of_a_block(case):
    for table in block_tables.all_tables(summarise_block(block_made_up.made(case))):
        assert missing_units(table) == [], table.title


@pytest.mark.parametrize("case", ["gated", "an unknown"])
def test_tables_of_a_target(case):
    for table in target_tables.all_tables(summarise_target(target_made_up.made(case))):
        assert missing_units(table) == [], table.title


def test_csv_files(summary, residuals, tmp_path):
    write_parameters(tmp_path / "parameters.csv", summary)
    write_statistics(tmp_path / "statistics.csv", summary)
    write_residuals(tmp_path / "residuals.csv", residuals)
    target_tables.write_looks(tmp_path / "looks.csv", target_made_up.made("gated"))
    for case in ("direct", "frames"):
        (tmp_path / case).mkdir()
        block_sheets.write_sheets(tmp_path / case, block_made_up.made(case), summarise_block(block_made_up.made(case)))
    found = {str(path.relative_to(tmp_path)): missing_in_csv(path) for path in tmp_path.rglob("*.csv")}
    assert len(found) == 12 and not any(found.values()), found


def test_lines_are_told_apart_from_pixels(summary, residuals, tmp_path):
    """A line camera has lines in its tables and files, a frame camera none; the axes are called what they are."""
    assert summary["units"]["lines"] and "across it, both in focal-plane pixels" in summary["units"]["residuals"]
    assert {row["axis_name"] for row in summary["residuals"]} == {"along", "across"}
    assert "lines: across" in tables.sizes(summary).headings and "px: along" in tables.largest(summary).headings
    for case, lines in (("sound", True), ("frames", False)):
        made = block_made_up.made(case)
        told = summarise_block(made)
        assert ("lines" in told["units"]) == lines
        assert any("lines" in h for table in block_tables.all_tables(told) for h in table.headings) == lines
        block_sheets.write_sheets(tmp_path, made, told)
        header = (tmp_path / "residuals.csv").read_text(encoding="utf-8").split("\n")[0].split(",")
        assert ({"line", "y_lines", "px_per_line"} <= set(header)) == lines and ("row_px" in header) != lines
        assert {"x_m", "y_m", "x_m_per_px", "y_m_per_px"} <= set(header)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_figures_are_those_of_every_residual(summary, residuals):
    """RMS by image and role from residuals.csv's own columns; metres are pixels times their size, lines pixels over theirs."""
    by_place = {(r["image"], r["role"], r["axis"]): r for r in summary["residuals"] if r["stage"] == "after"}
    for i, image in enumerate(residuals.images):
        here = (residuals.image == i) & ~residuals.is_control
        for k, axis in enumerate("xy"):
            row = by_place[image.name, "check", axis]
            assert row["rms_m"] == pytest.approx(rms((residuals.after_px * residuals.scales.m_per_px)[here, k]), rel=1e-9)
        assert row["rms_lines"] == pytest.approx(rms((residuals.after_px[:, 1] / residuals.scales.px_per_line)[here]), rel=1e-9)
        assert by_place[image.name, "check", "x"]["rms_lines"] is None
    worst = summary["largest_residuals"][0]
    i = next(i for i in range(len(residuals)) if residuals.points[i] == worst["point"])
    # On level ground the two axes of a scanner are square to each other but for its pitch.
    assert worst["length_m"] == pytest.approx(np.hypot(worst["x_m"], worst["y_m"]), rel=0.05)
    assert worst["y_lines"] == pytest.approx(residuals.after_px[i, 1] / residuals.scales.px_per_line[i], rel=1e-12)


def test_figures_of_a_block_image_by_image():
    made = block_made_up.made("left out")
    used, image = made.adjustment.used, np.asarray(made.block.images)
    metres = made.adjustment.residual_px * made.scales.m_per_px
    rows = {row["image"]: row for row in summarise_block(made)["images"]}
    assert set(rows) == set(image)
    for name, row in rows.items():
        here = used & (image == name)
        assert row["rays"] == here.sum()
        assert row["rms_x_px"] == pytest.approx(rms(made.adjustment.residual_px[here, 0]), rel=1e-9)
        assert row["rms_y_m"] == pytest.approx(rms(metres[here, 1]), rel=1e-9)


def test_arrows_point_to_later_lines(residuals):
    """On the right swing of haian the offset grows with the line, on the left it falls; an arrow downwards is a later line."""
    arrows, lines = residuals.arrows("after"), residuals.scales.lines(residuals.after_px)
    np.testing.assert_array_equal(np.sign(arrows[:, 1]), np.sign(lines))
    np.testing.assert_array_equal(arrows[:, 0], residuals.after_px[:, 0])


@pytest.mark.parametrize("case", ["left out", "frames"])
def test_tables_of_residuals_fit_a_terminal(case):
    told = summarise_block(block_made_up.made(case))
    for table in filter(None, (make(told) for make in (block_tables.residuals, block_tables.sizes, block_tables.largest))):
        text = printed(table, 80)
        assert "…" not in text and all(cell.text in text for row in table.rows for cell in row)

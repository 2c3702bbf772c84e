"""The paper's figures as typed in: what they must satisfy among themselves, whoever typed them."""

import itertools

import numpy as np
import pytest

from whiskjax.flights import haian
from whiskjax.papers.whiskbroom.printed import BANDS, TABLE_1, TABLE_4, TABLES, Band, Column, is_absolute, tuned_by

FIGURES = {
    (printed.number, column, statistic, axis): values[2 * k + a]
    for printed in TABLES
    for statistic, values in (("mean", printed.mean_px), ("std", printed.std_px))
    for k, column in enumerate(printed.columns)
    for a, axis in enumerate("xy")
}


def test_counts():
    assert [printed.number for printed in TABLES] == [2, 3, 5, 6, 7, 7, 7, 7]
    assert len(FIGURES) == 8 + 8 + 12 + 12 + 4 * 12
    assert len(TABLE_1) == 12 and len(TABLE_4) == 15
    assert list(TABLE_4) == [x.name for x in haian.unknowns()]
    assert set(TABLE_1) == {name for name in TABLE_4 if not name.endswith("_right")}


def test_what_the_paper_prints_twice_agrees():
    """Table 2 and Table 6 before are one image (but for one sign); A, B, C of Table 3 are L1, R2, L2 of Table 7 within 0.5 px."""
    before = Column("L1", "none", "control")
    for statistic, axis in itertools.product(("mean", "std"), "xy"):
        two, six = (FIGURES[table, before, statistic, axis] for table in (2, 6))
        sign = -1 if (statistic, axis) == ("mean", "y") else 1
        assert sign * two == pytest.approx(six, abs=1.01e-5)
        for image, seven in (("R2", "CL"), ("L2", "CL")):
            three = FIGURES[3, Column(image, "A", "all"), statistic, axis]
            assert three == pytest.approx(FIGURES[7, Column(image, seven, "all"), statistic, axis], abs=0.5)


def test_the_determined_sums_of_both_parameter_tables_agree():
    """omega_pos + omega_sen is what the data determine: the paper's two estimates differ by 1e-4 deg, each by 0.02."""
    sums = [table["omega_pos_left"] + table["omega_sen"] for table in (TABLE_1, TABLE_4)]
    assert abs(sums[0] - sums[1]) < 1e-4 < 0.01 < abs(TABLE_1["omega_sen"] - TABLE_4["omega_sen"])


def test_signs_and_sizes():
    """Before, y is negative on left and positive on right swings, but for Table 2; with the other's parameters near -9.5."""
    for (table, column, statistic, axis), value in FIGURES.items():
        if statistic == "std":
            assert 1 < value < 12
        elif column.parameters == "none" and axis == "y" and table != 2:
            assert np.sign(value) == (-1 if column.image[0] == "L" else 1) and 505 < abs(value) < 518
        elif column.parameters == "none":
            assert -89 < value < -81 or table == 2
        elif column.is_cross and axis == "y":
            assert -10.2 < value < -8.9
        elif axis == "y":
            assert abs(value) < 0.8


def test_bands_are_of_printed_figures_and_hold_the_paper_but_for_the_gap_of_x():
    """Every band is of a figure in a table; the paper lies in each but the two that scenarios.md calls the 4 % gap."""
    printed = {key[1:]: value for key, value in FIGURES.items()}  # Table 6 comes after Table 2 and has the right sign
    outside = set()
    for (column, statistic, axis), band in BANDS.items():
        value = printed[column, statistic, axis]
        value = abs(value) if is_absolute(column, statistic) else value
        assert band.low < band.high
        if not band.low <= value <= band.high:
            outside.add((column.image, column.parameters, statistic, axis))
    assert outside == {("L1", "none", "mean", "x"), ("R1", "none", "mean", "x")}
    assert len(BANDS) == 21 and BANDS[Column("R3", "CR", "all"), "std", "x"] == Band(4.4, 7.3)


def test_tuned_are_focal_length_noise_and_drift_only():
    kinds = {t for _, column, statistic, axis in FIGURES for t in tuned_by(column, statistic, axis)}
    assert kinds == {"focal length", "image noise", "drift"}
    for image, parameters in (("L2", "CR"), ("R2", "CL"), ("R2", "A")):
        assert tuned_by(Column(image, parameters, "all"), "mean", "y") == ()
    assert "drift" in tuned_by(Column("R3", "CR", "all"), "std", "x")
    assert tuned_by(Column("L1", "none", "control"), "mean", "x") == ()

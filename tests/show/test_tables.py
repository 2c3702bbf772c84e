"""Tables: the figures of the summary, rounded and never cut."""

import copy
import io

import pytest
from rich.console import Console

from whiskjax.show.calibration import tables
from whiskjax.show.tables import Cell, decimals_of, fixed, for_terminal


def printed(table, width):
    out = io.StringIO()
    Console(file=out, width=width, highlight=False).print(for_terminal(table))
    return out.getvalue()


def value_of(text):
    return float(text.replace("−", "-").removesuffix(" %"))


def test_parameters_are_those_of_the_summary(summary):
    for row, p in zip(tables.parameters(summary).rows, summary["parameters"], strict=True):
        name, unit, _, value, sigma, share, shift = (cell.text for cell in row)
        assert (name, unit) == (p["name"], p["unit"])
        # Two digits of the sigma are shown, so rounding takes at most a twentieth of it.
        assert abs(value_of(value) - p["value"]) <= 0.05 * p["sigma"]
        assert abs(value_of(sigma) - p["sigma"]) <= 0.05 * p["sigma"]
        assert abs(value_of(share) - 100 * p["data_share"]) <= 0.05 + 1e-9
        assert abs(value_of(shift) - p["from_prior_sigmas"]) <= 0.05 + 1e-9


def test_residuals_are_those_of_the_summary(summary):
    by_place = {(r["image"] or "all", r["role"], r["axis_name"], r["stage"]): r for r in summary["residuals"]}
    image = role = None
    rows = tables.residuals(summary).rows
    for row in rows:
        texts = [cell.text for cell in row]
        image, role = texts[0] or image, texts[1] or role
        for stage, figures in (("before", texts[4:7]), ("after", texts[7:10])):
            expected = by_place[image, role, texts[3], stage]
            for text, key in zip(figures, ("mean_px", "std_px", "max_abs_px"), strict=True):
                assert abs(value_of(text) - expected[key]) <= 0.005 + 1e-9
    assert len(rows) == len(summary["residuals"]) // 2


@pytest.mark.parametrize("width", [80, 100, 200])
def test_nothing_is_cut(summary, width):
    for table in (tables.parameters(summary), tables.residuals(summary), tables.largest(summary), tables.correlations(summary)):
        text = printed(table, width)
        assert "…" not in text and max(map(len, text.splitlines())) <= width
        for row in table.rows:
            for cell in row:
                assert cell.text in text


def test_many_images_show_the_worst_and_say_so(summary):
    many = copy.deepcopy(summary)
    pattern = [row for row in many["residuals"] if row["image"] == "L1"]
    for i in range(60):
        many["residuals"] += [row | {"image": f"image_{i:03d}", "rms_px": 100.0 * (i == 41)} for row in pattern]
    many["counts"]["images"] = 66
    table = tables.residuals(many)
    names = {row[0].text for row in table.rows} - {"", "all"}
    assert len(names) == tables.IMAGES_SHOWN and "image_041" in names
    assert "12 of 66 images" in table.caption


def test_many_images_of_one_point_have_no_statistics_of_their_own(summary):
    single = copy.deepcopy(summary)
    pattern = [row | {"n": 1, "std_px": None} for row in single["residuals"] if (row["image"], row["role"]) == ("L1", "check")]
    single["residuals"] = [row for row in single["residuals"] if row["image"] is None]
    single["residuals"] += [row | {"image": f"image_{i:03d}"} for i in range(40) for row in pattern]
    single["counts"]["images"] = 40
    table = tables.residuals(single)
    assert {row[0].text for row in table.rows} == {"all", ""}
    assert "40 images have few points each" in table.caption


def test_alarms_are_marked(summary):
    share = tables.parameters(summary).headings.index("from data")
    assert [row[0].text for row in tables.parameters(summary).rows if row[share].alarm] == ["omega_sen"]


def test_an_undetermined_sigma_is_infinite(undetermined):
    from whiskjax.show.calibration.summary import summarise

    row = next(row for row in tables.parameters(summarise(*undetermined)).rows if row[0].text == "omega_sen")
    assert row[4] == Cell("∞", alarm=True)


@pytest.mark.parametrize(
    ("value", "decimals", "text"), [(-0.0001, 2, "0.00"), (-1.5, 1, "−1.5"), (None, 3, "–"), (12.346, 2, "12.35")]
)
def test_fixed(value, decimals, text):
    assert fixed(value, decimals) == text


@pytest.mark.parametrize(("sigma", "decimals"), [(0.030, 3), (2.1e-4, 5), (15.0, 0), (400.0, 0), (1.0, 1), (None, 6), (0.0, 6)])
def test_two_digits_of_a_sigma(sigma, decimals):
    assert decimals_of(sigma) == decimals

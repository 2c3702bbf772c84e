"""The study of Liu et al. (2019) as data, tables, words, drawings, a page, from made-up trials under the names of `measure`."""

import csv
import json
import re

import matplotlib
import numpy as np
import pytest

from tests.papers.location_made_up import OUTSIDE, SIZES, made
from tests.papers.study_checks import holds_all, text_of
from whiskjax.papers.location.charts import draw_charts
from whiskjax.papers.location.findings import findings
from whiskjax.papers.location.page import page as page_of
from whiskjax.papers.location.runs import SECTIONS
from whiskjax.papers.location.tables import summarise, tables, write_figures
from whiskjax.papers.page import make_report

NAMES = ["figure_6", "figure_7", "figure_8", "figure_9", "figure_10", "table_2", "estimators", "constant_errors"]
COMMAND = "whiskjax reproduce location --out there"
UNIT = re.compile(r"\((m|km|deg|no unit)\)$")


@pytest.fixture(scope="module")
def begun():
    """Sections in the order in which they began, and the study."""
    sections: list[str] = []
    return sections, made(sections=sections)


@pytest.fixture(scope="module")
def measured(begun):
    return begun[1]


@pytest.fixture(scope="module")
def summary(measured):
    return summarise(measured, SIZES, 1, COMMAND)


@pytest.fixture(scope="module")
def bad():
    return summarise(made(inside=False), SIZES, 1, COMMAND)


@pytest.fixture(scope="module")
def drawings(measured):
    return draw_charts(measured)


def test_sections_begin_in_order_and_have_figures(begun):
    sections, measured = begun
    assert tuple(sections) == SECTIONS
    assert tuple(dict.fromkeys(f.section for f in measured.figures)) == SECTIONS


def test_summary_is_plain_data(summary, measured):
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["command"] == COMMAND and summary["runs"] == {**SIZES._asdict(), "seed": 1}
    assert [f["reached"] for f in summary["figures"]] == [f.reached for f in measured.figures]
    assert len({(f["section"], f["what"]) for f in summary["figures"]}) == len(summary["figures"])


def test_verdict_counts_bands(summary, bad, measured):
    bands = sum(f.low is not None or f.high is not None for f in measured.figures)
    assert summary["verdict"] == {
        "is_inside": True, "word": "as the bands ask", "bands": bands, "bands_inside": bands, "outside": [],
    }  # fmt: skip
    verdict = bad["verdict"]
    assert not verdict["is_inside"] and verdict["word"] == "not in every band"
    assert (verdict["bands"], verdict["bands_inside"]) == (bands, bands - len(OUTSIDE))
    assert verdict["outside"] == [
        "Table 2, straight flight, 78 deg: mean error: 99.0 m, band 51 to 67",
        "estimators, iterated, full R: NEES of 3 states: 2.5e+07, band 2.65 to 3.45",
    ]
    for f in bad["figures"]:
        assert f["is_inside"] == (None if f["low"] is None and f["high"] is None else f["what"] not in OUTSIDE)


def test_one_table_a_section(bad):
    found = tables(bad)
    assert [t.title.removeprefix("Beyond the paper: ") for t in found] == list(SECTIONS)
    assert sum(len(t.rows) for t in found) == len(bad["figures"])
    assert all(t.caption.endswith(".") for t in found)
    rows = {row[0].text: row for t in found for row in t.rows}
    assert [cell.text for cell in rows["straight flight, 78 deg: mean error"]] == [
        "straight flight, 78 deg: mean error", "m", "30 to 32.5 (67 to 78 deg)", "51 to 67", "99.0", "OUTSIDE",
    ]  # fmt: skip
    assert {row[-1].text for row in rows.values()} == {"", "inside", "OUTSIDE"}
    assert [cell.text for cell in rows["off by 2200 m: larger mean error"]][3] == "≤ 10"
    assert [cell.text for cell in rows["smallest rise of the mean error from one km to the next"]][3] == "≥ 0"


def test_findings_speak_with_the_figures_of_the_summary(summary):
    value = {f["what"]: f["reached"] for f in summary["figures"]}
    words = " ".join(finding.here for finding in findings(summary))
    for what, form in {
        "orbit, 180 looks: mean error": "{:.2f} m",
        "75 deg off nadir: mean error": "{:.0f} m with looks 500 m apart",
        "iterated, full R: NEES of 3 states": "it is {:.2f}",
        "straight flight, 78 deg: mean error": "expects {:.0f} m",
        "45 deg: ground shift of one look": "{:.2f} m at 45 deg",
        "45 deg: height bias, orbit": "{:.2f} m is what we find",
    }.items():
        assert form.format(value[what]) in words
    assert len({finding.title for finding in findings(summary)}) == 7


def test_every_axis_has_a_label_with_its_unit(drawings):
    assert [drawing.name for drawing in drawings] == NAMES
    for drawing in drawings:
        assert drawing.caption.endswith(".") and len(drawing.caption) > 80
        assert drawing.figure.axes
        for axes in drawing.figure.axes:
            x, y = axes.get_xlabel(), axes.get_ylabel()
            named = x == "" and axes.get_xticklabels()[0].get_text() == "as printed"
            assert x == "looks" or named or UNIT.search(x), (drawing.name, x)
            assert UNIT.search(y), (drawing.name, y)


def test_clouds_are_to_scale_with_the_circle_that_holds_half(drawings, measured):
    panels = drawings[NAMES.index("figure_10")].figure.axes
    for axes, name in zip(panels, ("one look", "orbit"), strict=True):
        assert axes.get_aspect() == 1 and axes.get_xlim() == axes.get_ylim()
        circle = np.hypot(*np.array(axes.lines[1].get_data()))
        level = np.hypot(*measured.clouds[name][:, :2].T)
        assert ((level < circle[0]).sum(), (level > circle[0]).sum()) == (SIZES.circle / 2, SIZES.circle / 2)


def test_the_page_holds_every_drawing_and_every_figure_outside(bad, drawings):
    page = make_report(page_of(bad), bad, drawings)
    holds_all(page, bad, drawings, findings(bad))
    text = text_of(page)
    assert text.count(">OUTSIDE<") == len(OUTSIDE)
    assert 'class="verdict bad"' in page and "not in every band" in text


def test_a_page_whose_bands_are_all_kept_is_not_bad(summary):
    page = make_report(page_of(summary), summary, [])
    assert 'class="verdict bad"' not in page and "OUTSIDE" not in page and "as the bands ask" in page


def test_figures_are_written_with_all_digits(summary, tmp_path):
    write_figures(tmp_path / "figures.csv", summary)
    with (tmp_path / "figures.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["what"] for row in rows] == [f["what"] for f in summary["figures"]]
    assert [float(row["reached"]) for row in rows] == [f["reached"] for f in summary["figures"]]


def test_no_global_state(measured):
    before = dict(matplotlib.rcParams)
    draw_charts(measured)
    assert dict(matplotlib.rcParams) == before and not matplotlib._pylab_helpers.Gcf.figs

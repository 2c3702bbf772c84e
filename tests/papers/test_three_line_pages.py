"""The study of Wang et al. (2018) as data, tables, words, drawings, a page, from made-up blocks under the names of `measure`."""

import csv
import json
import re

import numpy as np
import pytest

from tests.papers.study_checks import holds_all
from tests.papers.three_line_made_up import OUTSIDE, SIZES, made
from whiskjax.papers.page import make_report
from whiskjax.papers.three_line.charts import draw_charts
from whiskjax.papers.three_line.findings import findings
from whiskjax.papers.three_line.page import page as page_of
from whiskjax.papers.three_line.printed import PRINTED, band
from whiskjax.papers.three_line.runs import NOISES, SECTIONS
from whiskjax.papers.three_line.tables import summarise, tables, write_tables

COMMAND = "whiskjax reproduce three-line --out there"
UNIT = re.compile(r"\((m|number)\)$")


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
    return summarise(measured, SIZES, 0, COMMAND)


@pytest.fixture(scope="module")
def bad():
    return summarise(made(inside=False), SIZES, 0, COMMAND)


@pytest.fixture(scope="module")
def drawings(measured):
    return draw_charts(measured)


def test_sections_begin_in_order(begun):
    sections, measured = begun
    assert tuple(sections) == SECTIONS
    assert tuple(dict.fromkeys(f.section for f in measured.figures)) == SECTIONS[4:]
    assert set(measured.rows) == {(row, noise) for row in PRINTED for noise in NOISES}


def test_summary_is_plain_data(summary, measured):
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["command"] == COMMAND and summary["runs"] == {**SIZES._asdict(), "seed": 0}
    assert len(summary["rows"]) == 3 * len(PRINTED) and len(summary["mounts"]) == 6 and len(summary["limits"]) == 6
    assert len({(f["section"], f["what"]) for f in summary["figures"]}) == len(measured.figures)


def test_verdict_counts_bands(summary, bad, measured):
    bands = sum(f.has_band for f in measured.figures)
    bands += sum(band(row, k).high is not None for row in PRINTED for k in range(3))
    good, verdict = summary["verdict"], bad["verdict"]
    assert (good["is_inside"], good["bands"], good["bands_inside"], good["outside"]) == (True, bands, bands, [])
    assert (verdict["is_inside"], verdict["bands_inside"]) == (False, bands - len(OUTSIDE) - 1)
    assert verdict["outside"] == [
        "Table 1, adjusted, Z: RMSE 0.500 m, band ≤ 0.14",
        "wrong ties, wrong tie points found: 12.50 %, band ≥ 85",
    ]


def test_tables_are_in_the_papers_order(bad):
    found = tables(bad)
    assert [t.title.split(".")[0] for t in found[:6]] == [f"Table {n}" for n in range(1, 7)]
    assert all(t.caption.endswith(".") for t in found)
    assert all(len(row) == len(t.headings) == len(t.is_number) for t in found for row in t.rows)
    first = [cell.text for cell in found[0].rows[0]]
    assert first[:6] == ["direct", "X", "6.340", "−4.739", "1.402", "3.897"] and first[-3:] == ["2.780", "", ""]
    assert sum(cell.text == "OUTSIDE" for t in found for row in t.rows for cell in row) == len(OUTSIDE) + 1


def test_findings_check_the_paper_by_computing(summary):
    words = " ".join(f"{finding.paper} {finding.here}" for finding in findings(summary))
    for said in (
        "Table 1 (direct): 6.487 m below 6.93 m and Table 2 (direct): 6.218 m below 6.386 m",
        "by 2.37 m",
        "2.75 km above ground",
        "0.0248 deg",
        "That is 0.87 m",
    ):
        assert said in words
    assert len({finding.title for finding in findings(summary)}) == 7


def test_drawings_have_axes_with_units(drawings):
    assert [drawing.name for drawing in drawings] == [f"figure_{n}" for n in range(6, 15)]
    for drawing in drawings:
        assert drawing.caption.endswith(".") and len(drawing.caption) > 80
        for axes in drawing.figure.axes:
            assert UNIT.search(axes.get_xlabel()) and UNIT.search(axes.get_ylabel())


def test_vectors_are_to_scale(drawings, measured):
    """The arrows of a panel are as long as the errors, by the key beside it."""
    plan = drawings[0].figure.axes[0]
    v = measured.vectors["A", "direct", "nominal"]
    *arrows, key = (c for c in plan.collections if hasattr(c, "U"))
    scale = float(key.U[0]) / float(plan.texts[0].get_text().split()[0])
    drawn = np.concatenate([np.stack([a.U, a.V], axis=-1) for a in arrows])
    order = np.concatenate([np.flatnonzero(~v.is_check), np.flatnonzero(v.is_check)])
    np.testing.assert_allclose(drawn / scale, v.error_m[order, :2], rtol=1e-12)


def test_the_page_holds_every_drawing_and_every_figure_outside(bad, drawings):
    page = make_report(page_of(bad), bad, drawings)
    holds_all(page, bad, drawings, findings(bad))
    assert 'class="verdict bad"' in page and len(drawings) == 9


def test_tables_are_written_with_all_digits(summary, tmp_path):
    write_tables(tmp_path, summary)
    for name, key in (("tables", "rows"), ("table_3", "mounts"), ("limits", "limits"), ("figures", "figures")):
        with (tmp_path / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == len(summary[key])
    assert [float(row["reached"]) for row in rows] == [f["reached"] for f in summary["figures"]]

"""The summary of a located target, its tables and its page: plain data, true to the location, and the verdict first."""

import json
import re

import numpy as np
import pytest

from tests.show.target_made_up import CASES, LOOKS, made
from tests.show.test_report import Page
from whiskjax.show.target.charts import draw_charts
from whiskjax.show.target.page import make_report
from whiskjax.show.target.summary import summarise
from whiskjax.show.target.tables import all_tables


@pytest.mark.parametrize("case", CASES)
def test_is_plain_data_and_agrees_with_the_location(case):
    sighting, summary = made(case), summarise(made(case))
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["verdict"]["is_sound"] == sighting.location.is_sound
    assert (summary["position"] is None) == (not sighting.is_answered)
    looks = summary["looks"]
    assert looks["used"] + looks["gated"] + looks["missed"] + looks["left_out"] == looks["looks"] == len(sighting)
    told = [reason["text"] for reason in summary["verdict"]["reasons"]]
    assert all(reason.text in told for reason in sighting.location.reasons)


@pytest.mark.parametrize("case", CASES)
def test_page_says_the_verdict_first_and_refers_to_nothing_outside(case):
    summary = summarise(made(case), "whiskjax locate somewhere") | {"maps": {"written": [], "reason": "of a test"}}
    html = make_report(summary, draw_charts(made(case)))
    page = Page(html)
    assert not page.open and "http" not in re.sub(r"base64,[^\"]*", "", html)
    inside = {f"#{name}" for name in page.ids}
    assert all(r in inside or r.startswith("data:image/png;base64,") for r in page.references)
    assert f"This location is {summary['verdict']['word']} ." in page.text.split("Looks")[0]
    for table in all_tables(summary):
        assert all(cell.text in page.text for row in table.rows for cell in row)
    assert all(reason["text"] in page.text for reason in summary["verdict"]["reasons"]) and summary["command"] in page.text
    assert "There is no map: of a test." in page.text


def test_names_cannot_become_markup():
    summary = summarise(made("sound")) | {"label": "<script>alert(1)</script>", "maps": {"written": [], "reason": ""}}
    html = make_report(summary, [])
    assert "<script>" not in html and "&lt;script&gt;" in html


def test_a_gross_error_is_the_largest_innovation():
    for case, state in (("gated", "gated"), ("not gated", "used")):
        worst = summarise(made(case))["largest_innovations"][0]
        assert (worst["look"], worst["image"], worst["state"]) == (7, "look-8", state)
    assert not summarise(made("not gated"))["verdict"]["is_sound"]
    assert summarise(made("gated"))["looks"]["used"] == LOOKS - 1


def test_one_look_gives_the_line():
    """Through the first guess, along the look: up to the platform."""
    sighting, summary = made("one look"), summarise(made("one look"))
    east, north, up = sighting.enu(sighting.platform_m[0])
    assert summary["line"]["azimuth_deg"] == pytest.approx(np.degrees(np.arctan2(east, north)) % 360, abs=1e-3)
    assert summary["line"]["elevation_deg"] == pytest.approx(np.degrees(np.arctan2(up, np.hypot(east, north))), abs=1e-3)
    assert any("the line: through latitude" in reason["text"] for reason in summary["verdict"]["reasons"])


def test_unknowns_are_in_their_unit():
    (row,) = summarise(made("an unknown"))["parameters"]
    assert row["unit"] == "deg" and row["prior_sigma"] == pytest.approx(np.degrees(1e-3))
    assert row["value"] == pytest.approx(np.degrees(float(made("an unknown").location.value[0])))


def test_what_a_careful_person_would_say():
    said = lambda case: [reason["text"] for reason in summarise(made(case))["verdict"]["reasons"] if reason["grade"] != "note"]
    assert not any("[[error]]" in text for text in said("sound"))
    assert any("[[error]]" in text for text in said("no noise"))
    assert any("did not pass the gate" in text for text in said("gated"))

"""The report: one file that needs nothing else, says the verdict first, and shows the figures of the summary."""

from html.parser import HTMLParser

import pytest

from whiskjax.show.calibration.figures import draw_all
from whiskjax.show.calibration.page import make_report
from whiskjax.show.calibration.residuals import gather
from whiskjax.show.calibration.summary import summarise
from whiskjax.show.calibration.tables import largest, parameters, residuals

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Elements, what they refer to, and whether every one is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.references, self.ids, self.words = [], [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        given = dict(attrs)
        self.references += [given[key] for key in ("src", "href", "srcset", "action", "data") if key in given]
        self.ids += [given["id"]] if "id" in given else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def html(summary, drawings):
    return make_report(summary, drawings)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


def test_refers_to_nothing_outside(html, page):
    assert not page.open
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    inside = {f"#{name}" for name in page.ids}
    assert all(r in inside or r.startswith("data:image/png;base64,") for r in page.references)
    assert "http" not in html.replace("http-equiv", "") and "@import" not in html and "url(" not in html
    assert sum(r.startswith("data:") for r in page.references) == 4


def test_fits_a_phone_and_the_night(html):
    assert 'name="viewport"' in html and "prefers-color-scheme: dark" in html and "max-width: 40rem" in html


def test_says_the_verdict_first(page, summary):
    first, rest = page.text.split("What was estimated", 1)
    assert "This calibration is sound ." in first
    assert "converged" in first and "omega_sen" in first
    assert all(warning in first for warning in summary["warnings"]) and summary["command"] in rest


def test_shows_the_figures_of_the_tables(page, summary):
    for table in (parameters(summary), residuals(summary), largest(summary)):
        for row in table.rows:
            for cell in row:
                assert cell.text in page.text
    assert all(warning in page.text for warning in summary["warnings"])


def test_an_unsound_result_says_so_and_why(undetermined):
    calibration, flight = undetermined
    summary = summarise(calibration, flight)
    page = Page(make_report(summary, draw_all(summary, gather(calibration, flight))))
    first = page.text.split("What was estimated")[0]
    assert "This calibration is not sound ." in first
    assert "do not determine these unknowns: omega_sen" in first
    assert "No residual changes when the unknowns move together" in page.text


def test_names_cannot_become_markup(summary, drawings):
    spoiled = summary | {"flight": "<script>alert(1)</script>"}
    html = make_report(spoiled, drawings)
    assert "<script>" not in html and "&lt;script&gt;" in html

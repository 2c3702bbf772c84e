"""`whiskjax reproduce location`: what it writes, says and ends in, with a study that took no time."""

import csv
import json

import pytest

from tests.app.said import progress
from tests.papers.location_made_up import OUTSIDE, made
from whiskjax.papers.location import runs

DRAWN = ("figure_6", "figure_7", "figure_8", "figure_9", "figure_10", "table_2", "estimators", "constant_errors")
WRITTEN = {"report.html", "results.json", "figures.csv", *(f"{name}.png" for name in DRAWN)}


@pytest.fixture
def measuring(monkeypatch):
    """Put a made-up study in the place of `measure`; what it was called with is kept."""

    def put(inside):
        asked = []

        def measure(sizes, seed, on_section):
            asked.append((sizes, seed))
            for section in runs.SECTIONS:
                on_section(section)
            return made(inside)

        monkeypatch.setattr("whiskjax.papers.location.reproduce.measure", measure)
        return asked

    return put


@pytest.mark.parametrize("inside, code", [(True, 0), (False, 3)])
def test_writes_everything_and_ends_as_the_bands_say(whiskjax, measuring, tmp_path, inside, code):
    asked, out = measuring(inside), tmp_path / "new" / "out"
    result = whiskjax("reproduce", "location", "--out", out, "--runs", 100, "--seed", 7)
    assert result.exit_code == code
    progress(result.stderr)
    assert asked == [(runs.Sizes(100, 1000, 60, 5), 7)]
    assert {path.name for path in out.iterdir()} == WRITTEN
    assert all((out / f"{name}.png").read_bytes().startswith(b"\x89PNG") for name in DRAWN)
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    verdict = results["verdict"]
    assert verdict["is_inside"] == inside and len(verdict["outside"]) == (0 if inside else len(OUTSIDE))
    assert results["command"] == f"whiskjax reproduce location --out {out} --runs 100 --seed 7"
    lines = result.stdout.splitlines()
    assert f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it." in lines
    assert [line for line in lines if line.startswith("  - outside:")] == [f"  - outside: {name}" for name in verdict["outside"]]
    assert all(section in result.stdout for section in runs.SECTIONS)
    with (out / "figures.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == len(results["figures"])
    assert ("Outside:" in (out / "report.html").read_text(encoding="utf-8")) == (not inside)


def test_results_of_an_earlier_run_are_replaced_and_all_else_stays(whiskjax, measuring, tmp_path):
    measuring(True)
    assert whiskjax("reproduce", "location", "--out", tmp_path, "--runs", 30).exit_code == 0
    (tmp_path / "mine.txt").write_text("mine")
    assert whiskjax("reproduce", "location", "--out", tmp_path, "--runs", 20).exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == WRITTEN | {"mine.txt"}
    assert json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["runs"]["runs"] == 20


def test_help_lists_both_papers(whiskjax):
    result = whiskjax("reproduce", "--help")
    assert result.exit_code == 0
    assert "whiskbroom" in result.stdout and "location" in result.stdout


@pytest.mark.parametrize("place", ["a file", "below a file", "a flight"])
def test_a_bad_place_is_refused_before_any_work(whiskjax, measuring, tmp_path, place):
    asked, taken = measuring(True), tmp_path / "taken"
    if place == "a flight":
        taken.mkdir()
        (taken / "flight.toml").write_text("")
    else:
        taken.write_text("mine")
    result = whiskjax("reproduce", "location", "--out", taken / "out" if place == "below a file" else taken)
    assert result.exit_code == 1 and result.stdout == ""
    assert result.stderr.startswith("whiskjax: error: --out ") and result.stderr.count("\n") == 1
    assert asked == [] and [path.name for path in tmp_path.iterdir()] == ["taken"]


@pytest.mark.parametrize("words", [[], ["--out", "out", "--runs", "19"], ["--out", "out", "--seed", "-1"]])
def test_wrong_usage_ends_in_two(whiskjax, measuring, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = measuring(True)
    assert whiskjax("reproduce", "location", *words).exit_code == 2
    assert asked == [] and not list(tmp_path.iterdir())


def test_a_failure_leaves_nothing(whiskjax, measuring, monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device")

    measuring(True)
    monkeypatch.setattr("whiskjax.papers.page.make_report", full)
    result = whiskjax("reproduce", "location", "--out", tmp_path / "new" / "out")
    assert result.exit_code == 1 and "No space left" in result.stderr
    assert not list(tmp_path.iterdir())

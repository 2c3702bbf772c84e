"""`whiskjax reproduce three-line`: what it writes, says and ends in, with a study that took no time."""

import json

import pytest

from tests.app.said import progress
from tests.papers.three_line_made_up import made
from whiskjax.papers.three_line import runs

SHEETS = {"tables.csv", "table_3.csv", "limits.csv", "figures.csv"}
WRITTEN = {"report.html", "results.json", *SHEETS, *(f"figure_{number}.png" for number in range(6, 15))}


@pytest.fixture
def measuring(monkeypatch):
    """Put a made-up study in the place of `measure`; what it was called with is kept."""

    def put(inside):
        asked, found = [], made(inside)

        def measure(sizes, seed, on_section):
            asked.append((sizes, seed))
            for section in runs.SECTIONS:
                on_section(section)
            return found

        monkeypatch.setattr("whiskjax.papers.three_line.reproduce.measure", measure)
        return asked

    return put


@pytest.mark.parametrize("inside, code", [(True, 0), (False, 3)])
def test_writes_everything_and_ends_as_the_bands_say(whiskjax, measuring, tmp_path, inside, code):
    asked, out = measuring(inside), tmp_path / "new" / "out"
    result = whiskjax("reproduce", "three-line", "--out", out, "--seed", 4, "--ties", 500)
    assert result.exit_code == code
    progress(result.stderr)
    assert asked == [(runs.Sizes(500, 500, 16), 4)]
    assert {path.name for path in out.iterdir()} == WRITTEN
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    verdict = results["verdict"]
    assert verdict["is_inside"] == inside
    assert results["command"] == f"whiskjax reproduce three-line --out {out} --seed 4 --seeds 16 --ties 500"
    lines = result.stdout.splitlines()
    assert f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it." in lines
    assert [line for line in lines if line.startswith("  - outside:")] == [f"  - outside: {name}" for name in verdict["outside"]]


def test_by_default_everything_is_full_size(whiskjax, measuring, tmp_path):
    asked = measuring(True)
    assert whiskjax("reproduce", "three-line", "--out", tmp_path).exit_code == 0
    assert asked == [(runs.Sizes(), 0)]


@pytest.mark.parametrize("words", [[], ["--out", "out", "--seeds", "1"], ["--out", "out", "--seed", "-1"]])
def test_wrong_usage_ends_in_two(whiskjax, measuring, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = measuring(True)
    assert whiskjax("reproduce", "three-line", *words).exit_code == 2
    assert asked == [] and not list(tmp_path.iterdir())


def test_a_bad_place_is_refused_before_any_work(whiskjax, measuring, tmp_path):
    asked, taken = measuring(True), tmp_path / "taken"
    taken.write_text("mine")
    result = whiskjax("reproduce", "three-line", "--out", taken)
    assert result.exit_code == 1 and result.stderr.startswith("whiskjax: error: --out ")
    assert asked == []

"""`whiskjax doctor`, from a folder that reading refuses to a report that says what to change."""

import json
import shutil

import pytest

import whiskjax as wj


@pytest.fixture(scope="module")
def spoiled(flight, tmp_path_factory):
    """A flight whose axes are written another way: no point lies in front of the camera."""
    folder = shutil.copytree(flight, tmp_path_factory.mktemp("spoiled") / "haian")
    toml = folder / "flight.toml"
    text = toml.read_text(encoding="utf-8")
    assert 'axes = "x -y -z"' in text
    toml.write_text(text.replace('axes = "x -y -z"', 'axes = "x y z"'), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def examined(whiskjax, spoiled, tmp_path_factory):
    out = tmp_path_factory.mktemp("doctor") / "out"
    return whiskjax("doctor", spoiled, "--out", out), out


def test_reading_refuses_it(spoiled):
    with pytest.raises(wj.FlightError, match="behind the camera"):
        wj.read_flight(spoiled)


def test_the_line_to_change_is_told(examined):
    result, out = examined
    assert result.exit_code == 3
    line = "flight.toml: chain[1] (frame 'flu'): axes = \"x -y -z\""
    assert line in result.stdout
    assert "This flight is not sound" in result.stdout
    told = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert told["findings"][0]["change"] == line and told["findings"][0]["place"] == 1
    assert told["findings"][0]["factor"] < 1.2 < told["as_given"]["factor"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "axes of flu: x -y -z" in page and "What to change" in page
    assert {path.name for path in out.iterdir()} == {"results.json", "report.html", "findings.csv"}
    rows = (out / "findings.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + len(told["findings"])


def test_a_sound_flight_is_best_as_it_is(whiskjax, flight, tmp_path):
    result = whiskjax("doctor", flight, "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert "nothing explains the data better" in result.stdout
    assert "What to change" not in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_bad_input_is_one_line(whiskjax, tmp_path):
    result = whiskjax("doctor", tmp_path / "nowhere", "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert result.stderr.startswith("whiskjax: error: ") and result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()

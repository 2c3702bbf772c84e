"""A standard of the user's own: two limits in a TOML file, and what is wrong in it is named."""

import pytest

from whiskjax.estimate.map_limits import Standard
from whiskjax.files.standard import read_standard
from whiskjax.rules import FlightError


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "limits.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_limits(file):
    assert read_standard(file('name = "ours"\nplanimetry_m = 0.3\nheight_m = 1')) == Standard("ours", 0.3, 1.0)
    assert read_standard(file('name = "ours"\nheight_m = 0.2')) == Standard("ours", None, 0.2)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("name 1", ("not valid TOML", "line 1")),
        ("planimetry_m = 0.3", ("name", "a text is expected")),
        ('name = "x"', ("planimetry_m, height_m or both",)),
        ('name = "x"\nheight = 0.3', ("height: no such key", "did you mean 'height_m'")),
        ('name = "x"\nheight_m = -1', ("height_m", "positive", "-1")),
        ('name = "x"\nheight_m = "3"', ("height_m", "positive", "'3'")),
        ('name = "x"\nheight_m = true', ("height_m", "positive", "True")),
        ('name = "x"\nheight_m = inf', ("height_m", "positive", "inf")),
    ],
)
def test_what_is_wrong_is_named(file, text, parts):
    path = file(text)
    with pytest.raises(FlightError) as caught:
        read_standard(path)
    assert all(part in str(caught.value) for part in (str(path), *parts)), caught.value

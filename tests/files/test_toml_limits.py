"""What TOML can hold and a flight cannot: nesting without end, numbers and words of thousands of characters, dates."""

import datetime

import pytest

import whiskjax as wj
from whiskjax.files.standard import read_standard
from whiskjax.files.toml_text import toml_text


def nested(depth, opening="[", closing="]", inside=""):
    return opening * depth + inside + closing * depth


ODD = {
    "lists": (nested(900), "nested more than 32 deep"),
    "fewer lists": (nested(40), "nested more than 32 deep"),
    "tables": (nested(900, "{a=", "}", "1"), "nested more than 32 deep"),
    "lists of tables": (nested(500, "[{a=", "}]", "1"), "nested more than 32 deep"),
    "a text": (f'"{"x" * 10**6}"', "a text of 1000000 characters"),
    "a decimal integer": ("1" * 5000, "not valid TOML: an integer of thousands of digits"),
    "a hexadecimal integer": ("0x" + "f" * 5000, "beyond 64 bits"),
    "an integer beyond float64": ("1" * 400, "beyond 64 bits"),
    "a date": ("2024-05-01", "datetime.date"),
    "a date that is none": ("2024-13-01", "not valid TOML"),
    "a time": ("07:32:00", "datetime.time"),
    "a key twice": ("{x = 1, x = 2}", "not valid TOML"),
    "infinite": ("1e999", "max_gap_s"),
    "many items": ("[" + "1," * 50_000 + "]", "max_gap_s"),
}


@pytest.mark.parametrize("case", ODD)
def test_odd_values(folder, case):
    value, message = ODD[case]
    said = folder.toml("max_gap_s = 0.02", f"max_gap_s = {value}").refused("flight.toml: ", message)
    assert len(said) < 1000


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format = 1", "format = true", ("format", "1")),
        (
            "[pos]",
            '[[error]]\nframe = "body"\nturn_sigma_deg = [400.0, 0.0, 0.0]\n[pos]',
            ("error[0]", "turn_sigma_deg[0]", "360 degrees at most are expected, or inf, not 400"),
        ),
        (
            "[pos]",
            "".join(f'[[error]]\nframe = "body"\nturn_sigma_deg = [{i}, 0.0, 0.0]\n' for i in (0.1, 0.1)) + "[pos]",
            ("error[1] (frame 'body')", "says exactly what one before it says"),
        ),
    ],
    ids=["a flag for a number", "a sigma beyond a turn", "the same errors twice"],
)
def test_values_that_mean_something_else(folder, old, new, said):
    folder.toml(old, new).refused("flight.toml: ", *said)


def test_deep_keys(folder):
    folder.toml("[pos]", f"[pos]\na{'.a' * 500} = 1").refused("flight.toml: ", "nested more than 32 deep")


def test_a_key_that_is_a_page(folder):
    folder.toml("[pos]", f"[pos]\n{'k' * 100_000} = 1").refused("flight.toml: pos.kkk", "a key of 100000 characters")


def test_many_wrong_keys_are_counted(folder):
    text = folder.toml("[pos]", "[pos]\n" + "\n".join(f"k{i} = 1" for i in range(500))).refused(
        "flight.toml: pos.k1", "and 450 more"
    )
    assert len(text.splitlines()) == 51


def test_notes_may_be_long(folder):
    notes = "A long flight. " * 1000
    text = (folder.path / "flight.toml").read_text().split("\n")
    text = [line if not line.startswith("notes") else f'notes = "{notes}"' for line in text]
    (folder.path / "flight.toml").write_text("\n".join(text))
    assert wj.read_flight(folder.path).notes == notes


@pytest.mark.parametrize("text", [f"name = 'x'\nheight_m = {v}" for v in (nested(900), "0x" + "f" * 400, "1979-05-27")])
def test_a_standard_is_read_by_the_same_rules(tmp_path, text):
    (tmp_path / "limits.toml").write_text(text)
    with pytest.raises(wj.FlightError, match=r"limits\.toml"):
        read_standard(tmp_path / "limits.toml")


def test_lists_that_do_not_fit_on_one_line_are_written_at_once():
    """Thirty numbers before a list were tried in 4^30 ways."""
    table = {"a": [*range(30), [1, 2]], "day": datetime.date(2024, 5, 1)}
    assert "[1, 2]" in toml_text(table)

"""flight.toml that no person writes ends in an error of ours."""

import pytest

from tests.files.made_up import scanner
from whiskjax import FlightError, read_flight, write_flight

SPOILED = {
    "arrays 900 deep": ("x = " + "[" * 900 + "]" * 900, "nested more than 32 deep"),
    "arrays 200,000 deep": ("x = " + "[" * 200_000 + "]" * 200_000, "nested more than 32 deep"),
    "inline tables": ("x = " + "{a=" * 300 + "1" + "}" * 300, "nested more than 32 deep"),
    "dotted keys": ("a" + ".a" * 500 + " = 1", "nested more than 32 deep"),
    "a huge integer": ("x = " + "9" * 5000, "not valid TOML"),
    "beyond 64 bits": ("x = " + "9" * 40, "an integer beyond 64 bits"),
    "a text of a million characters": ('x = "' + "a" * 1_000_000 + '"', "a text of 1000000 characters"),
    "a key twice": ("x = 1\nx = 2", "not valid TOML"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "scanner"
    write_flight(scanner(), path)
    return path


@pytest.mark.parametrize("what", SPOILED)
def test_is_refused(folder, what):
    path, (line, said) = folder / "flight.toml", SPOILED[what]
    whole = path.read_text()
    try:
        path.write_text(f"{line}\n{whole}")
        with pytest.raises(FlightError, match=f"flight.toml.*{said}"):
            read_flight(folder)
    finally:
        path.write_text(whole)

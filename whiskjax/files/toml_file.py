"""TOML files as nested tables, whatever stands in them."""

import tomllib
from pathlib import Path
from typing import Any, NoReturn

from ..rules import FlightError

# A camera by image, view, swing and strip, with a list of lists inside, is 14 deep. Python's own limit lies at some hundreds,
# and every library below meets it in its own way.
DEEPEST = 32
# Everything but notes is a word, and messages quote it.
LONGEST_TEXT = 1000


def read_toml(path: Path, name: str) -> dict[str, Any]:
    """A TOML file; `name` is what messages call it.

    **Raises:** `FlightError` where the file is no TOML, or holds what nobody writes: nesting without end, integers beyond TOML's
    64 bits, words of thousands of characters.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except RecursionError as error:
        raise FlightError(f"{name}: {_TOO_DEEP}") from error
    except ValueError as error:  # of TOML, of UTF-8, and of integers of more than 4300 digits
        if "integer string conversion" in str(error):
            raise FlightError(f"{name}: not valid TOML: an integer of thousands of digits") from error
        raise FlightError(f"{name}: not valid TOML: {error}") from error
    _check(data, name)
    return data


_TOO_DEEP = f"tables and lists are nested more than {DEEPEST} deep, which nothing in a flight is; look for brackets"


def _check(data: dict[str, Any], name: str) -> None:
    level: list[tuple[str, Any]] = [("", data)]
    for _ in range(DEEPEST + 1):
        inner: list[tuple[str, Any]] = []
        for place, node in level:
            if isinstance(node, dict):
                for key, value in node.items():
                    inside = f"{place}.{key}" if place else key
                    if len(key) > LONGEST_TEXT:
                        _fail(name, f"{inside[:100]}...", f"a key of {len(key)} characters, and nobody writes so many")
                    inner.append((inside, value))
            elif isinstance(node, list):
                inner += [(f"{place}[{i}]", value) for i, value in enumerate(node)]
            elif isinstance(node, str) and len(node) > LONGEST_TEXT and place != "notes":
                _fail(name, place, f"a text of {len(node)} characters, and nobody writes so many; only notes may be long")
            elif isinstance(node, int) and node.bit_length() > 64:
                _fail(name, place, "an integer beyond 64 bits, which TOML does not have")
        level = inner
    if level:
        raise FlightError(f"{name}: {_TOO_DEEP}")


def _fail(name: str, place: str, what: str) -> NoReturn:
    raise FlightError(f"{name}: {place}: {what}")

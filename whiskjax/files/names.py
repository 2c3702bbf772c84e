"""How messages list names and show values: which there are, which one was probably meant, and never a page of them."""

import difflib
from collections.abc import Iterable
from typing import Any


def listed(names: Iterable[str], most: int = 12) -> str:
    """The names with commas; of many the first ones and the count."""
    names = list(names)
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[:most])} ... ({len(names)} in all)"


def meant(name: str, names: Iterable[str]) -> str:
    """A question that names the closest name, with a space before it; empty where nothing is close."""
    close = difflib.get_close_matches(name, list(names), 1, 0.6)
    return f" (did you mean {close[0]!r}?)" if close else ""


def shown(value: Any, most: int = 100) -> str:
    """A value as Python writes it, of a long one the beginning."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no integers of more than 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= most else f"{text[:most]} ... ({len(text)} characters in all)"

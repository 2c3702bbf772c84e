"""How messages list names: which there are, and which one was probably meant."""

import difflib
from collections.abc import Iterable


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

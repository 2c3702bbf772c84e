"""A dict as TOML that people like to read: short lists on one line, every table with its own header."""

import re
from typing import Any

from ..rules import import_extra

# tomli_w puts each item on its own line; lists of numbers and of words read better on one. An item begins with no space: else
# each line could be taken apart in many ways, and a list that does not fit would be tried in all of them.
_FLAT_LIST = re.compile(r"\[\n((?: +[^ \[\]\n][^\[\]\n]*,\n)+) *\]")
_NESTED_LIST = re.compile(r"\[\n((?: +\[[^\[\]\n]*\],\n)+) *\]")


def toml_text(data: dict[str, Any]) -> str:
    """TOML in the order of the dict: plain keys first, then tables, and lists of tables with a header for each."""
    return _table("", data).lstrip("\n")


def _table(path: str, table: dict[str, Any]) -> str:
    tomli_w = import_extra("tomli_w", "files")
    plain = {k: v for k, v in table.items() if not _is_table(v) and not _is_tables(v)}
    text = tomli_w.dumps(plain)
    for pattern in (_FLAT_LIST, _NESTED_LIST):
        text = pattern.sub(lambda match: "[" + ", ".join(line.strip(" ,") for line in match[1].split("\n") if line) + "]", text)
    for key, value in table.items():
        name = path + ("." if path else "") + tomli_w.dumps({key: 0}).removesuffix(" = 0\n")
        if _is_table(value):
            # A table of tables needs no header of its own.
            header = "" if value and all(_is_table(v) for v in value.values()) else f"\n[{name}]\n"
            text += header + _table(name, value)
        elif _is_tables(value):
            text += "".join(f"\n[[{name}]]\n" + _table(name, item) for item in value)
    return text


def _is_table(value: Any) -> bool:
    return isinstance(value, dict)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)

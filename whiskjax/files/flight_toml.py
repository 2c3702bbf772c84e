"""flight.toml: from text to a checked `FlightTable`, with errors that say which key is wrong and what it should be."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..rules import FlightError
from .names import listed, meant, shown
from .toml_file import read_toml

if TYPE_CHECKING:
    from .schema import FlightTable

NAME = "flight.toml"
_MOST_ERRORS = 50
_NOW_ERROR = (
    "[[noise]] and [pos_errors] are one table now, [[error]] with frame, turn_sigma_deg, shift_sigma_m, correlation_s (0: new at "
    'every exposure, inf: constant), anew ("strip", ...) and axes; infinite sigmas are poses that nobody observed'
)


def load_flight_toml(folder: Path) -> "FlightTable":
    """Read and check a folder's flight.toml.

    **Raises:** `FlightError` naming every wrong key by its path (counting from 0, as in Python) and what was expected there;
    `ImportError` where pydantic is not installed.
    """
    from . import schema

    path = folder / NAME
    if not folder.is_dir():
        raise FlightError(f"{folder} is not a folder: a flight is a folder with a {NAME}")
    if not path.is_file():
        raise FlightError(
            f"{folder} holds no {NAME}, so it is not a flight folder; it holds {listed(_entries(folder)) or 'nothing'}"
        )
    data = read_toml(path, NAME)
    try:
        return schema.FlightTable.model_validate(data)
    except schema.pydantic.ValidationError as error:
        raise FlightError(_explain(data, error.errors(include_url=False))) from error


def _entries(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def _explain(data: dict[str, Any], errors: list[Any]) -> str:
    lines = []
    for error in errors[:_MOST_ERRORS]:
        path, model = _locate(data, error["loc"])
        lines.append(f"{NAME}: {path}: {_sentence(error, model)}")
    if len(errors) > _MOST_ERRORS:
        lines.append(f"{NAME}: and {len(errors) - _MOST_ERRORS} more")
    return "\n".join(dict.fromkeys(lines))


def _locate(data: Any, loc: tuple[int | str, ...]) -> tuple[str, Any]:
    """The path as a person would write it, and the model whose keys are allowed where it ends.

    The pieces that pydantic adds for the branch of a union are not in the data, and are left out.
    """
    from . import schema

    text, node, model = "", data, schema.FlightTable
    for i, piece in enumerate(loc):
        if isinstance(piece, int):
            text += f"[{piece}]"
            node = node[piece] if isinstance(node, list) and piece < len(node) else None
            frame = node.get("frame") if isinstance(node, dict) else None
            text += f" (frame {frame!r})" if isinstance(frame, str) else ""
        elif isinstance(node, dict) and piece in node:
            text += ("." if text else "") + piece
            node = node[piece]
            model = schema.TABLES.get(piece, model) if not isinstance(node, str) else model
        elif i == len(loc) - 1 and not _is_branch(node, piece):
            text += ("." if text else "") + piece
        if isinstance(node, dict):
            kind, link = node.get("kind"), node.get("link")
            if isinstance(link, str):
                model = schema.LINKS.get(link, model)
            elif isinstance(kind, str) and text.startswith("camera"):
                model = schema.CAMERAS.get(kind, model)
    return text or "the file", model


def _is_branch(node: Any, piece: str) -> bool:
    return isinstance(node, dict) and piece in (node.get("link"), node.get("kind"))


def _sentence(error: dict[str, Any], model: Any) -> str:
    kind, context = error["type"], error.get("ctx", {})
    keys = list(model.model_fields)
    if kind == "missing":
        return "this key is missing"
    if kind == "extra_forbidden" and error["loc"] in (("noise",), ("pos_errors",)):
        return _NOW_ERROR
    if kind == "extra_forbidden":
        return f"no such key{meant(error['loc'][-1], keys)}; expected here: {', '.join(keys)}"
    if kind == "union_tag_not_found":
        tag = str(context["discriminator"]).strip("'")
        return f"the key {tag} is missing, which says what this is"
    if kind == "union_tag_invalid":
        tag = str(context["discriminator"]).strip("'")
        return f"{tag} = {shown(context['tag'])} is unknown; expected {context['expected_tags']}"
    if kind == "value_error":
        return str(context["error"])
    if kind in ("too_short", "too_long") and context["field_type"] == "List":
        size = context.get("min_length", context.get("max_length"))
        return f"a list of {size} is expected, not {shown(error['input'])}"
    message = error["msg"].replace("Input should", "it should")
    return f"{message}, not {shown(error['input'])}"

"""Which files of a folder an earlier run wrote: results.json lists them with their SHA-256. All else is somebody else's."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.carry import check_carried
from ..rules.errors import FlightError

if TYPE_CHECKING:
    from ..show.plain import Summary

RESULTS = "results.json"
_FILES = "files"
_REMEDY = "move it away, or give another folder"


def results_text(summary: "Summary | dict[str, Any]") -> str:
    """results.json as text: every figure with all its digits."""
    return json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def sign(folder: Path) -> None:
    """List every file of a folder of results, its own results.json included, in results.json."""
    summary = json.loads((folder / RESULTS).read_text(encoding="utf-8"))
    found = {RESULTS: _hash_of(results_text(summary))}
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / RESULTS):
        found[path.relative_to(folder).as_posix()] = _hash(path)
    (folder / RESULTS).write_text(results_text(summary | {_FILES: found}), encoding="utf-8")


def of_others(folder: Path, ours: Iterable[str]) -> list[str]:
    """What lies in a folder that no run of ours wrote, and that goes along when its results are replaced.

    **Arguments:** `ours`: the names that the new run may write.

    **Raises:** `FlightError` where something of another origin has such a name, or was put into a folder of ours, or a file of
    ours was changed since: that would be lost; and where more lies there than is carried along.
    """
    listed = _listed(folder)
    taken = {*ours, *(name.split("/")[0] for name in listed)}
    others = []
    for name in sorted(os.listdir(folder)):
        if name in taken:
            _refuse_others(folder, name, listed)
        else:
            others.append(name)
    check_carried(folder, others)
    return others


def _refuse_others(folder: Path, name: str, listed: Mapping[str, str]) -> None:
    """Refuse an entry that is not, with all that it holds, as an earlier run wrote it."""
    path = folder / name
    if path.is_dir() and not path.is_symlink():
        inside = sorted(os.listdir(path))
        if not inside:
            raise FlightError(f"{folder}: {name} is there and not of an earlier run; {_REMEDY}")
        for entry in inside:
            _refuse_others(folder, f"{name}/{entry}", listed)
    elif name not in listed or path.is_symlink() or not path.is_file():
        raise FlightError(f"{folder}: {name} is there and not of an earlier run; {_REMEDY}")
    elif (_hash_of(_signed(path)) if name == RESULTS else _hash(path)) != listed[name]:
        raise FlightError(f"{folder}: {name} was changed since it was written; {_REMEDY}")


def _listed(folder: Path) -> dict[str, str]:
    """The files of the earlier run; none where there is no list that one of ours can have written."""
    files = _json(folder / RESULTS).get(_FILES)
    if not isinstance(files, dict):
        return {}
    return {name: digest for name, digest in files.items() if isinstance(digest, str)}


def _signed(path: Path) -> str:
    """What `sign` took for the contents of results.json: all but the list itself."""
    return results_text({key: value for key, value in _json(path).items() if key != _FILES})


def _json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _hash_of(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8")).hexdigest()

"""Where the peers' values are; they are not part of the repository."""

import json
from pathlib import Path
from typing import Any

from tests.real.sets import data_folder


def peer_values() -> Path:
    """The folder peer_values of the real data; its README.md lists values, sources, licences and tolerances."""
    return data_folder() / "peer_values"


def json_of(folder: Path, name: str) -> Any:
    """One of its JSON files."""
    return json.loads((folder / name).read_text(encoding="utf-8"))

"""Lower bounds: what pyproject.toml allows, what constraints-lowest.txt installs, and what is installed here.

`python -m tests.lowest` fails where this environment does not hold exactly the lowest versions (`make lowest`).
"""

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]


def bounds(extra: str = "app") -> dict[str, Version]:
    """The lowest version that pyproject.toml allows of everything that the core and an extra need, by name.

    **Raises:** `ValueError` where a requirement has no lower bound.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found: dict[str, Version] = {}
    todo, seen = [*project["dependencies"], f"{project['name']}[{extra}]"], set()
    while todo:
        requirement = Requirement(todo.pop())
        if requirement.name == project["name"]:
            more = requirement.extras - seen
            seen |= more
            todo += [text for name in more for text in project["optional-dependencies"][name]]
            continue
        lowest = [s.version for s in requirement.specifier if s.operator in (">=", "==")]
        if len(lowest) != 1:
            raise ValueError(f"pyproject.toml: {requirement} has no lower bound of the form name>=version")
        found[canonicalize_name(requirement.name)] = Version(lowest[0])
    return found


def pinned() -> dict[str, Version]:
    """The versions in constraints-lowest.txt, by name."""
    lines = (ROOT / "constraints-lowest.txt").read_text().splitlines()
    pins = [line.split("==") for line in lines if re.match(r"[A-Za-z0-9]", line)]
    return {canonicalize_name(name): Version(version) for name, version in pins}


def differences(lowest: dict[str, Version], there: dict[str, Version]) -> list[str]:
    """What is not there in exactly its lowest version."""
    return [f"{name}: {there.get(name, 'none')}, not {version}" for name, version in lowest.items() if there.get(name) != version]


def main() -> int:
    """Say whether this environment holds the lowest versions."""
    lowest = bounds()
    installed = {canonicalize_name(one.name): Version(one.version) for one in metadata.distributions()}
    wrong = differences(lowest, installed)
    print("\n".join(wrong) or f"the lowest versions of all {len(lowest)} requirements are installed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

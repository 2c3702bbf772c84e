"""The versions that `make lowest` installs are the lower bounds of pyproject.toml, and nothing else is in their file."""

import re

from packaging.version import Version

from tests.lowest import ROOT, bounds, differences, pinned


def test_what_is_installed_as_lowest_is_what_is_allowed():
    lowest = bounds()
    assert {"jax", "equinox", "numpy", "pydantic", "matplotlib", "typer"} <= set(lowest)  # core, files, plots and app
    assert not differences(lowest, pinned())


def test_a_bound_that_differs_is_found():
    assert differences({"jax": Version("0.10")}, {"jax": Version("0.10.0")}) == []
    assert differences({"jax": Version("0.10")}, {"jax": Version("0.10.1")}) == ["jax: 0.10.1, not 0.10"]
    assert differences({"jax": Version("0.10")}, {}) == ["jax: none, not 0.10"]


def test_the_file_holds_names_and_versions_only():
    for line in (ROOT / "constraints-lowest.txt").read_text().splitlines():
        assert re.fullmatch(r"#.*|[A-Za-z0-9._-]+==[0-9][\w.]*", line), line

"""Every test runs in float64, with implicit rank and dtype promotion refused; warnings are errors (pyproject.toml)."""

import pathlib

import hypothesis
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

hypothesis.settings.register_profile("whiskjax", deadline=None, max_examples=40, derandomize=True)
hypothesis.settings.load_profile("whiskjax")


@pytest.fixture(scope="module", autouse=True)
def few_mappings():
    """Linux grants a process 65530 memory mappings; each compiled function keeps some, and whoever runs out of them crashes."""
    yield
    maps = pathlib.Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > 20_000:
        jax.clear_caches()

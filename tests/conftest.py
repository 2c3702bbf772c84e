"""Every test runs in float64, with implicit rank and dtype promotion refused; warnings are errors (pyproject.toml)."""

import gc
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
def compiled_functions():
    """What thousands of compiled functions cost beyond their compilation.

    Linux grants a process 65530 memory mappings; each function keeps some, and whoever runs out of them crashes. And Python's
    garbage collector goes through all that has ever been traced, again and again: a third of the time of the later tests.
    """
    yield
    maps = pathlib.Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > 20_000:
        gc.unfreeze()
        jax.clear_caches()
    gc.collect()
    gc.freeze()

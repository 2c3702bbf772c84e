"""Every test runs in float64, with implicit rank and dtype promotion refused; warnings are errors (pyproject.toml)."""

import hypothesis
import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

hypothesis.settings.register_profile("whiskjax", deadline=None, max_examples=40, derandomize=True)
hypothesis.settings.load_profile("whiskjax")

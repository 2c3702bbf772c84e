"""How the command line starts JAX: in float64, with compiled functions kept from one run to the next."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """Where compiled functions are kept: $WHISKJAX_CACHE, else whiskjax in the user's cache folder."""
    if chosen := os.environ.get("WHISKJAX_CACHE"):
        return Path(chosen).expanduser()
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "whiskjax"


def start_jax() -> None:
    """Switch on float64 and the persistent compilation cache; call this before anything is computed.

    A cache folder that JAX was already given (JAX_COMPILATION_CACHE_DIR) is left alone unless WHISKJAX_CACHE is set. Where the
    folder cannot be made, everything works without it and only compiles again.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    if getattr(jax.config, "jax_compilation_cache_dir", None) is None or os.environ.get("WHISKJAX_CACHE"):
        try:
            folder = cache_folder()
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # RuntimeError: a user without a home
            return
        jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

"""The entry point in a process of its own: quick help, version, float64, and a cache that can be placed."""

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import jax
import pytest

from whiskjax.app.start import cache_folder, start_jax


@pytest.fixture
def settings():
    """JAX's configuration as it was, whatever the test did."""
    names = (
        "jax_compilation_cache_dir",
        "jax_persistent_cache_min_compile_time_secs",
        "jax_persistent_cache_min_entry_size_bytes",
    )
    before = {name: getattr(jax.config, name) for name in names}
    yield
    for name, value in before.items():
        jax.config.update(name, value)


def test_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("WHISKJAX_CACHE", str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine"
    monkeypatch.delenv("WHISKJAX_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "whiskjax"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "whiskjax"


def test_the_cache_is_where_it_was_asked_for(monkeypatch, tmp_path, settings):
    monkeypatch.setenv("WHISKJAX_CACHE", str(tmp_path / "a" / "b"))
    start_jax()
    assert jax.config.jax_compilation_cache_dir == str(tmp_path / "a" / "b")
    assert jax.config.read("jax_enable_x64")


def test_a_cache_that_cannot_be_made_does_no_harm(monkeypatch, tmp_path, settings):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WHISKJAX_CACHE", str(tmp_path / "file" / "cache"))
    start_jax()


def run(*words):
    environment = os.environ | {"PYTHONWARNINGS": "error", "COLUMNS": "100"}
    command = [sys.executable, "-m", "whiskjax.app.main", *words]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120, check=False)


def test_version_and_help():
    version = run("--version")
    assert version.returncode == 0 and version.stdout.strip() == f"whiskjax {metadata.version('whiskjax')}"
    assert version.stderr == ""


def test_help_names_verbs_and_exit_codes(whiskjax):
    text = whiskjax("--help").stdout
    assert all(word in text for word in ("calibrate", "simulate", "Exit codes", "not sound"))


def test_an_error_is_one_line_and_no_traceback(tmp_path):
    result = run("calibrate", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out"))
    assert result.returncode == 1 and result.stdout == ""
    assert result.stderr.startswith("whiskjax: error: ") and result.stderr.count("\n") == 1

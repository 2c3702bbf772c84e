"""What is said while people wait: where nobody reads along, a line every few seconds; and nothing where it cannot be said."""

import io
import os
import subprocess
import sys
import time

import jax.monitoring
import pytest

from tests.app.said import progress
from whiskjax.app import stages
from whiskjax.app.stages import Stages
from whiskjax.rules.progress import tell

LOWERED = "/jax/core/compile/jaxpr_to_mlir_module_duration"
COMPILED = "/jax/core/compile/backend_compile_duration"


class Terminal(io.StringIO):
    """A stream that says that somebody reads along."""

    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch):
    """A line every twentieth of a second."""
    monkeypatch.setattr(stages, "EVERY_S", 0.05)


def listen(monkeypatch, stream=None):
    """What standard error gets; called in the test itself, as pytest captures each of its phases anew."""
    stream = io.StringIO() if stream is None else stream
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def wait_for(stream, words, seconds=20.0):
    """Until a line with the words is there."""
    end = time.monotonic() + seconds
    while not any(words in line for line in stream.getvalue().splitlines()):
        assert time.monotonic() < end, f"{words!r} not in {stream.getvalue()!r}"
        time.sleep(0.01)


def test_lines_while_nothing_else_happens(quick, monkeypatch):
    heard = listen(monkeypatch)
    with Stages("read", "solve"):
        wait_for(heard, "whiskjax: read ... ")
        time.sleep(0.3)
    assert len(progress(heard.getvalue())) >= 3
    said = heard.getvalue()
    time.sleep(0.15)
    assert heard.getvalue() == said  # it ends with the work


def test_lines_say_stage_compiling_and_what_the_verb_tells(quick, monkeypatch):
    heard = listen(monkeypatch)
    with Stages("read", "solve", "draw") as shown:
        shown.enter("read")
        shown.enter("solve")
        wait_for(heard, "whiskjax: solve ... ")
        jax.monitoring.record_event_duration_secs(LOWERED, 0.1)
        wait_for(heard, "whiskjax: solve: compiling ... ")
        jax.monitoring.record_event_duration_secs(COMPILED, 0.1)
        tell("blunders: start 3 of 61")
        wait_for(heard, "whiskjax: solve: blunders: start 3 of 61 ... ")
        shown.enter("draw")
        wait_for(heard, "whiskjax: draw ... ")
    tell("nobody listens any more")
    jax.monitoring.record_event_duration_secs(LOWERED, 0.1)
    assert "nobody" not in heard.getvalue()


def test_the_events_are_those_that_jax_tells(monkeypatch):
    """A function that is compiled is said to be: the events have names that another version of JAX may change."""
    heard = []
    monkeypatch.setattr(Stages, "_changed", lambda self, is_news=False: heard.append(self._compiling.is_now))
    with Stages("solve"):
        jax.jit(lambda x: x * 3.0 + time.monotonic())(1.0)  # a constant of its own: never in the cache
    assert True in heard and heard[-1] is False


def test_what_is_over_at_once_is_not_said(monkeypatch):
    """So that bad input is answered by the error alone; and a new stage is said long before its five seconds."""
    stream = listen(monkeypatch)
    monkeypatch.setattr(stages, "SOON_S", 0.4)
    with Stages("read", "solve", "draw") as shown:
        for name in ("read", "solve", "draw"):
            shown.enter(name)
            time.sleep(0.01)
        assert stream.getvalue() == ""
        wait_for(stream, "whiskjax: draw ... ")
    assert len(progress(stream.getvalue())) == 1 and stages.EVERY_S == 5.0


def test_many_stages_are_counted(quick, monkeypatch):
    heard = listen(monkeypatch)
    names = [f"seed {k}" for k in range(20)]
    with Stages(*names) as shown:
        for name in names:
            shown.enter(name)
        wait_for(heard, "whiskjax: seed 19 (20 of 20) ... ")
    assert not any("seed 1 " in words for words, _ in progress(heard.getvalue()))  # not one for each


def test_a_bar_on_a_terminal(monkeypatch):
    """Words of files are plain text there too."""
    stream = listen(monkeypatch, Terminal())
    monkeypatch.setenv("TERM", "xterm")
    with Stages("read", "solve") as shown:
        shown.enter("solve")
        tell("[red]point :cat: [/]")
        time.sleep(0.2)
    assert "[red]point :cat: [/]" in stream.getvalue() and "whiskjax: " not in stream.getvalue()


@pytest.mark.parametrize("closed", ["none", "closed", "broken"])
def test_nothing_fails_where_nobody_can_hear(monkeypatch, closed):
    stream = None
    if closed == "closed":
        stream = io.StringIO()
        stream.close()
    if closed == "broken":
        read, write = os.pipe()
        os.close(read)
        stream = os.fdopen(write, "w", buffering=1)
    with monkeypatch.context() as patch:
        patch.setattr(stages, "EVERY_S", 0.01)
        patch.setattr(sys, "stderr", stream)
        with Stages("read", "solve") as shown:
            shown.enter("read")
            time.sleep(0.05)
            shown.enter("solve")
    if closed == "broken":
        with pytest.raises(BrokenPipeError):
            stream.close()


def test_standard_error_closed_by_the_shell(tmp_path):
    """The error goes nowhere: not to standard output, and not into a file that got its number."""
    command = f"{sys.executable} -m whiskjax.app.main calibrate {tmp_path}/nowhere --out {tmp_path}/out 2>&-"
    result = subprocess.run(["sh", "-c", command], stdout=subprocess.PIPE, text=True, timeout=120, check=False)
    assert result.returncode == 1 and result.stdout == "" and not list(tmp_path.iterdir())

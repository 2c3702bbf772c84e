"""What long computations say of themselves is heard by whoever asked, and by nobody else."""

import pytest

import whiskjax as wj
from whiskjax.rules.progress import tell


def test_the_innermost_listener_hears_and_silence_is_the_rule(capsys):
    outer, inner = [], []
    tell("nobody hears this")
    with wj.telling(outer.append):
        tell("one")
        with wj.telling(inner.append):
            tell("two")
        with wj.telling(None):
            tell("three")
        tell("four")
    tell("nor this")
    assert (outer, inner) == (["one", "four"], ["two"])
    assert capsys.readouterr().out == ""


def test_a_listener_that_raises_ends_the_computation_and_is_forgotten():
    class Enough(Exception):
        pass

    def listener(doing):
        raise Enough(doing)

    with pytest.raises(Enough, match="one"), wj.telling(listener):
        tell("one")
    tell("two")

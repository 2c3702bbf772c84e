"""Results are whole, old or new, wherever a run is killed and whoever writes beside it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("killed_runs.py")


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The counts of the program; about 35 kills at lines of either way, 100 at random moments, 100 pairs and 25."""
    words = [sys.executable, PROGRAM, tmp_path_factory.mktemp("killed"), "--every", "91", "--kills", "100", "--pairs", "100"]
    result = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.parametrize("how", ["at lines", "at lines, two renames"])
def test_killed_at_a_line_of_the_swap(found, how):
    count = found[how]
    assert count["kills"] == count["inside"] >= 25
    assert count["neither"] == 0 and count["old"] > 0 and count["new"] > 0
    # The next run ends whole and leaves nothing beside its results.
    assert count["not_mended"] == count["left_over"] == 0


def test_the_name_always_leads_to_a_folder_where_names_can_be_exchanged(found):
    """And where they cannot, the old one is back before the next run does anything (`look` asks as a verb does)."""
    assert found["at lines"]["missing"] == 0


def test_killed_at_random_moments(found):
    """A hundred kills from outside, fifty and more of them inside the swap, on both sides of the exchange."""
    count = found["at random"]
    assert count["kills"] >= 100 and count["inside"] >= 50
    assert min(count["before_exchange"], count["after_exchange"]) > 0
    assert count["neither"] == count["missing"] == count["left_over"] == 0


@pytest.mark.parametrize(("how", "pairs"), [("pairs", 100), ("pairs, two renames", 25)])
def test_two_runs_at_once(found, how, pairs):
    """Both end, and the folder is that of one of them."""
    count = found[how]
    assert count["pairs"] == pairs and count["failed"] == 0
    assert count["neither"] == count["missing"] == count["left_over"] == 0

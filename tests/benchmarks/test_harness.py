"""What the gate lets pass, and that a missing peer is a failure."""

import math
import sys

import jax.numpy as jnp
import pytest

from benchmarks import report
from benchmarks.peers import MissingPeer
from benchmarks.suite import Benchmark
from benchmarks.timing import Measured, race


def of(asked):
    return Benchmark("name", "what is measured", "peer", asked, "x", lambda: Measured(1.0))


@pytest.mark.parametrize(
    ("asked", "reached", "baseline", "why"),
    [
        (1.0, 0.9, None, ""),
        (1.0, 0.9, 0.8, ""),
        (1.0, 1.01, None, "slower than asked"),
        (1.0, math.nan, None, "slower than asked"),
        (3.0, 1.4, 1.0, "more than 1.3 times the baseline"),
        (None, 4.0, 4.0, ""),
        (None, 6.0, 4.0, "more than 1.3 times the baseline"),
    ],
)
def test_the_gate(asked, reached, baseline, why):
    assert report.verdict(of(asked), Measured(reached), baseline) == why


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(1.184, "x", "1.18x"), (0.0324, "x", "0.032x"), (2.0, "GB", "2.00 GB"), (1.934, "s", "1.93 s"), (math.nan, "x", "-")],
)
def test_figures_keep_two_digits(value, unit, text):
    assert report.figure(value, unit) == text


def test_a_missing_peer_fails_and_the_table_says_so():
    rows = [(of(1.0), "no peer: pyproj is not installed")]
    assert report.verdict(*rows[0], None)
    assert "FAILED: no peer: pyproj is not installed" in report.table(rows, {})


def test_a_missing_package_names_the_remedy(monkeypatch):
    from benchmarks import geodesy

    monkeypatch.setitem(sys.modules, "pymap3d", None)
    with pytest.raises(MissingPeer, match=r"pip install 'whiskjax\[bench\]'"):
        geodesy.to_geodetic_pymap3d()


def test_the_baseline_names_no_computer_and_no_path():
    assert set(report.machine()) == {"processor", "compiler", "python", "jax", "jaxlib", "numpy"}
    assert "/" not in "".join(report.machine().values()).replace("(R)", "")


def test_a_race_gives_the_ratio_of_two_programs():
    def work(size):
        return lambda: sum(range(size)) and jnp.zeros(())

    found = race(work(400_000), work(100_000), seconds=0.2)
    assert 2.5 < found.reached < 6.5
    assert found.ours_s is not None and found.ours_s > 0


@pytest.mark.parametrize(
    ("processor", "make", "model"),
    [
        ("Intel(R) Xeon(R) Processor", "Intel Xeon", ""),
        ("Intel(R) Xeon(R) Platinum 8481C CPU @ 2.70GHz (family 6, model 143)", "Intel Xeon", " (family 6, model 143)"),
        ("AMD EPYC 7B13 64-Core Processor (family 25, model 1)", "AMD EPYC", " (family 25, model 1)"),
        ("AMD EPYC", "AMD EPYC", ""),
        ("aarch64", "unknown", ""),
        ("", "unknown", ""),
    ],
)
def test_processors_of_one_make_and_model_share_a_baseline(processor, make, model):
    assert report.kind_of(processor) == (make, make + model)


def test_a_baseline_is_that_of_the_model_or_else_of_the_make(monkeypatch, tmp_path):
    monkeypatch.setattr(report, "BASELINE", tmp_path / "baseline.json")
    for name, reached in (("AMD EPYC 9", 0.5), ("AMD EPYC 9 (family 25, model 1)", 0.7), ("Intel(R) Xeon(R)", 2.0)):
        monkeypatch.setattr(report, "processor", lambda name=name: name)
        report.write_baseline([(of(None), Measured(reached))])
        assert report.read_baseline() == {"name": reached}
    for name, reached in (("AMD EPYC 7", 0.5), ("EPYC (family 25, model 1)", None), ("AMD EPYC (family 25, model 17)", 0.5)):
        monkeypatch.setattr(report, "processor", lambda name=name: name)
        assert report.read_baseline() == ({"name": reached} if reached else {})
    monkeypatch.setattr(report, "processor", lambda: "Apple M2")
    assert report.read_baseline() == {}

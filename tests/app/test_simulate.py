"""`whiskjax simulate`: the same seed is the same flight, and no flight is lost."""

import csv

import jax
import numpy as np
import pytest

from whiskjax.files.read import read_flight
from whiskjax.flights import songshan, tianshan


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_same_seed_is_the_same_folder(whiskjax, flight, tmp_path):
    result = whiskjax("simulate", "haian", "--seed", 5, "--out", tmp_path / "again")
    assert result.exit_code == 0 and "231 observations" in result.stdout
    assert contents(tmp_path / "again") == contents(flight)
    assert sum(map(len, contents(flight).values())) < 2e6


def test_options_reach_the_simulation(whiskjax, flight, tmp_path):
    words = ["--seed", 5, "--no-noise", "--no-drift", "--order", "pitch-scan", "--out", tmp_path / "other"]
    assert whiskjax("simulate", "haian", *words).exit_code == 0
    other, usual = read_flight(tmp_path / "other"), read_flight(flight)
    assert "noise-free" in other.name
    turns = [[name for name in f.sensor.names if name in ("scan", "pitch")] for f in (usual, other)]
    assert turns == [["scan", "pitch"], ["pitch", "scan"]]


def test_a_flight_is_replaced_only_by_force(whiskjax, tmp_path):
    words = ["simulate", "haian", "--out", tmp_path / "f", "--seed"]
    assert whiskjax(*words, 1).exit_code == 0
    before = contents(tmp_path / "f")
    refused = whiskjax(*words, 2)
    assert refused.exit_code == 1 and "holds a flight already" in refused.stderr
    assert contents(tmp_path / "f") == before
    assert whiskjax(*words, 2, "--force").exit_code == 0
    assert contents(tmp_path / "f") != before
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


def test_truth_is_in_the_units_of_its_column(flight):
    with (flight / "truth.csv").open(encoding="utf-8", newline="") as file:
        truth = {row["name"]: (float(row["value"]), row["unit"]) for row in csv.DictReader(file)}
    assert truth["omega_pos_left"] == (pytest.approx(2.7263512, abs=1e-12), "deg")
    assert truth["w_sen"] == (-2.0103571, "m")


def test_tianshan_is_the_flight_of_its_seed_and_path(whiskjax, tmp_path):
    words = ["simulate", "tianshan", "--seed", 3, "--path", "fly", "--looks", 5, "--out", tmp_path / "f"]
    result = whiskjax(*words)
    assert result.exit_code == 0 and "5 looks at the point target" in result.stdout
    flight, made = read_flight(tmp_path / "f"), tianshan.simulate(3, tianshan.Scene(path="fly", looks=5))
    assert flight.name == made.name and "fly" in flight.name
    np.testing.assert_array_equal(flight.measurements.sample_px, made.measurements.sample_px)
    assert jax.tree.leaves(list(flight.errors)) == jax.tree.leaves(list(made.errors))
    assert whiskjax(*words).exit_code == 1 and whiskjax(*words, "--force").exit_code == 0


@pytest.mark.parametrize("words", [["--looks", 1], ["--path", "loop"], ["--seed", -1]])
def test_wrong_words_for_tianshan(whiskjax, tmp_path, words):
    assert whiskjax("simulate", "tianshan", "--seed", 3, "--out", tmp_path / "f", *words).exit_code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [[], ["haian"], ["haian", "--seed", "1"], ["haian", "--seed", "-1", "--out", "x"], ["mars"]])
def test_wrong_usage_ends_in_two(whiskjax, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert whiskjax("simulate", *words).exit_code == 2
    assert not list(tmp_path.iterdir())


def test_songshan_is_the_flight_of_its_seed_and_set(whiskjax, tmp_path):
    words = ["simulate", "songshan", "--seed", 3, "--set", "B", "--noise", "paper-like", "--ties", 5, "--out", tmp_path / "f"]
    result = whiskjax(*words)
    assert result.exit_code == 0 and "2 strips, 40 control, 14 check, 5 tie points" in result.stdout
    flight, made = read_flight(tmp_path / "f"), songshan.simulate(songshan.Scene("B", "paper-like", ties=5), 3)
    assert flight.name == made.name and flight.errors == made.errors != ()
    np.testing.assert_array_equal(flight.measurements.sample_px, made.measurements.sample_px)
    assert whiskjax(*words).exit_code == 1


@pytest.mark.parametrize("words", [["--set", "C"], ["--noise", "loud"], ["--ties", -1]])
def test_wrong_words_for_songshan(whiskjax, tmp_path, words):
    assert whiskjax("simulate", "songshan", "--seed", 3, "--out", tmp_path / "f", *words).exit_code == 2
    assert not list(tmp_path.iterdir())

"""The runs that are raced: ours and the peers are given the same ones, and are the same filter."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from benchmarks import location, many_locations
from benchmarks.peers import location as cxx
from benchmarks.peers import numpy_matrices_location
from benchmarks.suite import BENCHMARKS
from whiskjax.flights import tianshan
from whiskjax.locate import locate as door

RUNS, LANES = 6, 3


@pytest.fixture(scope="module")
def data():
    return location.drawn(RUNS, location.LOOKS, 3)


@pytest.fixture(scope="module")
def recorded(data):
    return cxx.Recorded(*(np.asarray(a) for a in jax.tree.leaves(data)))


@pytest.mark.parametrize("full", location.NOISES.values(), ids=location.NOISES)
def test_ours_cxx_and_numpy_with_matrices_are_the_same_filter(data, recorded, full):
    found = location.arrays(jax.jit(location.locate(full))(location.in_chunks(data, LANES)))
    given = recorded, location.start_for_peer(), cxx.Sigmas(), full
    expected = cxx.prepared(*given)()
    for ours, numpy, its in zip(found, numpy_matrices_location.prepared(*given)(), expected, strict=True):
        np.testing.assert_allclose(ours, its, rtol=0, atol=location.SAME_M)
        np.testing.assert_allclose(numpy, its, rtol=0, atol=location.SAME_M)
    assert np.abs(np.diff(expected[0], axis=0)).max(axis=1).min() > 0.1  # other runs have other noise


def test_iterated_and_batch_find_the_target(data):
    chunks = location.in_chunks(data, LANES)
    ours = jax.jit(location.locate(True, location.iterated))(chunks)
    state, covariance = jax.jit(location.locate(True, location.batch))(chunks)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert state.shape == (RUNS, 3) and np.abs((location.arrays(ours)[0] - state) / sigma).max() < 0.5
    target = wj.geodetic_to_ecef(*np.radians(tianshan.TARGET[:2]), tianshan.TARGET.height_m)
    error = np.asarray(state) + np.asarray(location.guess().point_m) - np.asarray(target)
    assert np.linalg.norm(error, axis=1).max() < 30
    assert (location.RELINEARISED, location.STEPS) == (door._RELINEARISED["iterated"], door._BATCH_STEPS)


def test_chunks_hold_every_run_once(data):
    pixel = np.asarray(location.in_chunks(data, LANES)[1])
    assert pixel.shape == (RUNS // LANES, location.LOOKS, 2, LANES)
    np.testing.assert_array_equal(np.moveaxis(pixel, -1, 1).reshape(data[1].shape), data[1])


def test_what_was_asked():
    asked = {name: b.asked for name, b in BENCHMARKS.items() if name.startswith("location")}
    for noise in location.NOISES:
        assert asked[f"location.{noise}"] == 1.1
        assert asked[f"location.{noise}.numpy"] == 1 / 8
        assert asked[f"location.{noise}.dynamax"] == 1 / 4
    assert asked["location.both_cores"] == 1.2
    assert asked["location_10000x180.memory"] == 1.0


def test_a_process_of_its_own(monkeypatch):
    with pytest.raises(RuntimeError, match="the process of many_locations failed"):
        location._in_own_process("memory", [-1])
    monkeypatch.setattr(location, "_in_own_process", lambda task, cores: {"peak_gb": 0.5, "draw_s": 1.0, "locate_s": 0.1})
    assert location.memory().reached == 0.5


def test_memory_is_watched_share_by_share(monkeypatch):
    for name, value in {"MANY_RUNS": 4, "MANY_LOOKS": 5, "SHARE": 2, "LANES": 2}.items():
        monkeypatch.setattr(many_locations, name, value)
    found = many_locations.watch_memory()
    assert found["peak_gb"] > 0 and found["locate_s"] > 0


def test_threads_are_raced(monkeypatch):
    monkeypatch.setattr(location, "RUNS", 4)
    monkeypatch.setattr(location, "LANES", 2)
    monkeypatch.setattr(many_locations, "ROUNDS", 3)
    location.recorded_for_peer.cache_clear()
    found = many_locations.race_threads(2)
    location.recorded_for_peer.cache_clear()
    assert 0 < found["ours_s"] and 0 < found["peer_s"] and found["median"] > 0

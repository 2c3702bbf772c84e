"""clarreo_gimbal_pushbroom: the issue's bands, lines of sight by matrices, the names that no data can tell apart."""

import json

import numpy as np
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.real import convert_clarreo as clarreo
from tests.real import reach_clarreo

SET = reach_clarreo.SET


def test_figures(assert_met):
    assert_met(SET)


def test_inertial_vectors_turn_onto_the_earth_fixed_ones(source_of):
    frames, _ = clarreo.usable(source_of(SET))
    rotation = clarreo.earth_fixed_from_inertial(frames)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-12)
    for inertial, fixed in (("riss_j2000", "riss_ctrs"), ("rcprs_j2000", "rcprs_ctrs")):
        turned = np.einsum("nij,nj->ni", rotation, clarreo.vectors(frames, inertial))
        np.testing.assert_allclose(turned, clarreo.vectors(frames, fixed), rtol=0, atol=2e-4)  # given to 0.1 mm


def test_quaternions_are_those_of_scipy():
    turns = Rotation.random(200, rng=1)
    np.testing.assert_allclose(clarreo.from_quaternion(turns.as_quat()), turns.as_matrix(), atol=1e-14)
    again = clarreo.to_quaternion(turns.as_matrix())
    np.testing.assert_allclose(np.abs((again * turns.as_quat()).sum(axis=1)), 1.0, atol=1e-14)


def test_sight_with_given_mounts_is_a_product_of_matrices(source_of, reached_on):
    """The chain as the source writes it, frame by frame, from the inertial attitude to the earth-fixed line of sight."""
    source = source_of(SET)
    flight = wj.read_flight(reached_on(SET).folders[1])
    frames, _ = clarreo.usable(source)
    truth = {name: np.array(m) for name, m in json.loads((source / "alignment_dcms_truth.json").read_text()).items()}
    looks = np.array(json.loads((source / "config.json").read_text())["pixel_unit_vectors_hs"], dtype=float)
    lever = json.loads((source / "config.json").read_text())["lever_arm_cprs_minus_iss_body_m"]
    fixed = clarreo.earth_fixed_from_inertial(frames)
    az, el = frames.numbers("az_rad", "el_rad").T
    body = Rotation.from_quat(frames.numbers(*(f"q_j2000_sb_{c}" for c in "ijks"))).as_matrix()
    sample, station = clarreo.samples(source), clarreo.vectors(frames, "riss_ctrs")
    line = np.repeat(np.arange(len(frames)), len(looks))
    pixel = np.stack([np.tile(sample, len(frames)), np.zeros(line.size)], axis=-1)
    found = wj.ray(flight.sensor, flight.shot(np.zeros(line.size, dtype=int), line.astype(float)), pixel)
    origin, direction = (np.asarray(a).reshape(len(frames), len(looks), 3) for a in (found.origin_m, found.direction))
    for n in range(len(frames)):
        yoke = truth["C_YA_YC"] @ truth["C_YC_YE"]
        head = truth["C_CE_CC"] @ truth["C_CC_HC"] @ truth["C_HC_HS"]
        azimuth, elevation = Rotation.from_euler("y", -az[n]).as_matrix(), Rotation.from_euler("x", el[n]).as_matrix()
        from_body = fixed[n] @ body[n].T
        expected = looks @ (from_body @ truth["C_BC_BA"] @ azimuth @ yoke @ elevation @ head).T
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(direction[n], expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(origin[n], np.broadcast_to(station[n] + from_body @ lever, (len(looks), 3)), rtol=0, atol=1e-6)


def test_names_what_the_data_cannot_tell_apart(source_of, tmp_path):
    """The turn about y lies between base y and yoke y, the turn about x between yoke x and head x."""
    free = reach_clarreo.without_priors(source_of(SET), tmp_path / "flight")
    assert free.posterior.rank == 7
    assert {frozenset(names) for names in free.posterior.null_space} == {
        frozenset({"base y", "yoke y"}),
        frozenset({"yoke x", "head x"}),
    }
    assert not free.is_sound
    lost = {x.name for x, s in zip(free.unknowns, free.posterior.sigma, strict=True) if not np.isfinite(s)}
    assert lost >= {"base y", "yoke y", "yoke x", "head x"}

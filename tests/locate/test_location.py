"""What a location says of itself: accuracy, angles, coordinates, looks."""

import numpy as np
import pytest
from scipy import optimize, stats

import whiskjax as wj
from tests import oracles
from tests.locate.textbooks import enu, kalman
from whiskjax.flights import tianshan


@pytest.fixture(scope="module")
def found(run):
    return run.locate(method="extended", errors=tianshan.frame_errors())


def test_the_convergence_angle_is_the_largest_between_two_lines_of_sight(run, found):
    def angle(away):
        away = away / np.linalg.norm(away, axis=-1, keepdims=True)
        sine = np.linalg.norm(np.cross(away[:, None], away[None]), axis=-1)
        return np.arctan2(sine, away @ away.T).max()

    away = run.chain.platform - np.asarray(found.point_m)
    np.testing.assert_allclose(found.convergence_rad, angle(away), rtol=1e-9)
    pixel = run.pixel_px.copy()
    pixel[10:] = np.nan
    few = run.locate(run.looks_at(pixel), method="extended", errors=tianshan.frame_errors())
    away = run.chain.platform[:10] - np.asarray(few.point_m)
    np.testing.assert_allclose(few.convergence_rad, angle(away), rtol=1e-9)


def test_looks_that_hardly_converge_are_said(run):
    pixel = run.pixel_px.copy()
    pixel[2:] = np.nan
    few = run.locate(run.looks_at(pixel), method="extended", errors=tianshan.frame_errors(), throw=False)
    assert 0.02 < float(few.convergence_rad) < 0.06
    pixel = np.full((40, 2), np.nan)
    pixel[::40] = 0.0
    one = run.locate(run.looks_at(pixel), method="extended", errors=tianshan.frame_errors(), throw=False)
    assert float(one.convergence_rad) < 1e-15


def test_geodetic_coordinates_and_axes_are_those_of_proj(found):
    lat, lon, height = oracles.geodetic(np.asarray(found.point_m))
    np.testing.assert_allclose(found.geodetic, [np.degrees(lat), np.degrees(lon), height], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.geodetic[:2], np.degrees([lat, lon]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.world_from_enu, enu(np.asarray(found.point_m)), rtol=0, atol=1e-12)


def test_accuracy_is_exact_for_the_covariance(found):
    """CEP50 and CE90 by integrating the density over a circle, LE90 from the normal distribution."""
    c = np.asarray(found.covariance_enu_m2)
    a, b = np.linalg.eigvalsh(c[:2, :2])
    theta = np.linspace(0, 2 * np.pi, 20001)[:-1]
    shape = np.cos(theta) ** 2 / a + np.sin(theta) ** 2 / b

    def inside(radius):
        return np.mean((1 - np.exp(-0.5 * radius**2 * shape)) / shape) / np.sqrt(a * b)

    accuracy = found.accuracy()
    for got, share in ((accuracy.cep50_m, 0.5), (accuracy.ce90_m, 0.9)):
        radius = optimize.brentq(lambda r, share=share: inside(r) - share, 1e-3, 1e3)
        np.testing.assert_allclose(float(got), radius, rtol=1e-6)
    np.testing.assert_allclose(float(accuracy.le90_m), stats.norm.ppf(0.95) * np.sqrt(c[2, 2]), rtol=1e-6)


def test_the_weakest_direction_is_that_of_the_looks_alone(run):
    """Of a batch with R = (2 px)^2: the eigenvector of the information of the looks, by central differences of the textbook."""
    found = run.locate(method="batch", throw=False)
    state = np.asarray(found.line_m) - run.anchor_m
    steps = 0.5 * np.eye(3)  # metres; the differences are over one, and a residual counts in sigmas of 2 px
    rows = np.array(
        [[(run.image(k, state + e, [0] * 8) - run.image(k, state - e, [0] * 8)) / 2.0 for e in steps] for k in range(40)]
    )
    information = np.einsum("kia,kja->ij", rows, rows)
    values, vectors = np.linalg.eigh(information)
    assert abs(np.asarray(found.line_direction) @ vectors[:, 0]) > 1 - 1e-9
    np.testing.assert_allclose(found.line_sigma_m, 1 / np.sqrt(values[0]), rtol=1e-6)


def test_a_first_guess_is_where_the_first_measured_look_meets_the_surface(run):
    """scenarios.md: the first look onto the ellipsoid of 1000 m."""
    pixel = run.pixel_px.copy()
    pixel[:2] = np.nan
    guess = wj.first_guess(run.sensor, run.looks_at(pixel), wj.HeightSurface(1000.0), [100.0, 200.0, 300.0])
    point = np.asarray(guess.point_m)
    assert abs(oracles.exact_height(point) - 1000.0) < 1e-6
    np.testing.assert_allclose(run.chain.image(2, point), pixel[2], rtol=0, atol=1e-6)
    np.testing.assert_allclose(guess.covariance_enu_m2, np.diag([1e4, 4e4, 9e4]), rtol=1e-15)
    by_default = run.locate(
        run.looks_at(pixel),
        guess=None,
        surface=wj.HeightSurface(1000.0),
        sigma_enu_m=[100.0, 200.0, 300.0],
        method="extended",
        throw=False,
    )
    given = run.locate(run.looks_at(pixel), guess=guess, surface=wj.HeightSurface(1000.0), method="extended", throw=False)
    np.testing.assert_array_equal(by_default.line_m, given.line_m)


def test_sigmas_may_differ_from_look_to_look(run):
    """Looks ten times as uncertain weigh a hundredth: against scaling in the textbook."""
    sigma = np.where(np.arange(40)[:, None] % 2 == 0, [2.0, 3.0], [20.0, 10.0])
    found = run.locate(wj.Looks(wj.Shot(time_s=run.time_s), run.pixel_px, sigma), method="extended", throw=False)
    x, p = np.zeros(3), run.prior
    for k in range(40):
        step = kalman(lambda _, s, w, k=k: run.image(k, s, w), run.pixel_px[k : k + 1], x, p, sigma_px=sigma[k])
        x, p = step.state[0], step.covariance[0]
    assert np.abs((np.asarray(found.line_m) - run.anchor_m - x) / np.sqrt(np.diag(p))).max() < 1e-6

"""Sigmas and covariances by which nothing can be weighed are refused by name, what can be weighed is taken."""

import numpy as np
import pytest

import whiskjax as wj
from whiskjax.rules.spread import refuse_covariances, refuse_sigmas, refuse_sizes


def name(i):
    return f"thing {i}: its sigma"


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, 1e200, 1e-200, 1e13, 1e-13])
def test_the_first_sigma_of_no_size_is_named(value):
    sigma = np.ones((4, 2))
    sigma[2, 1] = value
    with pytest.raises(wj.WhiskjaxError, match=r"thing 2: its sigma is .*by which nothing can be weighed: 1e-12 to 1e.12"):
        refuse_sigmas(sigma, name)


def test_sigmas_of_any_use_are_taken():
    refuse_sigmas(np.array([1e-12, 1e-3, 1.0, 1e12]), name)
    refuse_sigmas(np.zeros(3), name, zero=True)
    refuse_sigmas(np.array([1e-60]), name, least=1e-100)
    with pytest.raises(wj.WhiskjaxError, match=r"thing 1.*or 0 where it is exact"):
        refuse_sigmas(np.array([0.0, -1.0]), name, zero=True)


def test_what_is_no_covariance_is_named():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(5, 3, 3))
    # Of every rank, and as products of rotations leave them.
    root[1, :, 1:], root[2], root[3, :, 2] = 0, 0, 0
    good = root @ root.swapaxes(1, 2)
    refuse_covariances(good, name)
    for value, what in (
        (np.diag([1.0, 1.0, -1e-6]), "its variance is -1e-06 in some direction"),
        (np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "its variance is -1 in some direction"),
        (np.diag([1.0, 1.0, 1e200]), r"by a variance of 1e\+200 nothing"),
        (np.diag([1.0, np.nan, 1.0]), "not a finite number"),
        (np.array([[1.0, 0.5, 0.0], [0.4, 1.0, 0.0], [0.0, 0.0, 1.0]]), "not symmetric, by 0.1"),
    ):
        bad = good.copy()
        bad[3] = value
        with pytest.raises(wj.WhiskjaxError, match=f"thing 3: its sigma is no covariance: .*{what}"):
            refuse_covariances(bad, name)


def test_places_where_nothing_is():
    refuse_sizes(np.array([[6.4e6, np.nan, -1e9]]), name)
    with pytest.raises(wj.WhiskjaxError, match=r"thing 1: its sigma holds -1e\+200"):
        refuse_sizes(np.array([[1.0, 2.0], [3.0, -1e200]]), name)

"""The filters on 40 looks of tianshan against a plain loop over full matrices, look by look."""

import numpy as np
import pytest

from tests.locate.textbooks import MOTIONS, TABLE_1, assert_in_sigmas, enu, kalman
from whiskjax.flights import tianshan

RELINEARISED = {"extended": 0, "iterated": 5}
CASES = {"paper": ((), np.zeros(MOTIONS)), "full": (tianshan.frame_errors(), TABLE_1)}


@pytest.fixture(scope="module", params=[(m, r) for m in RELINEARISED for r in CASES], ids="-".join)
def both(request, run):
    """Ours and the textbook's."""
    method, case = request.param
    noise, sigma_w = CASES[case]
    found = run.locate(method=method, errors=noise, throw=False)
    plain = kalman(run.image, run.pixel_px, np.zeros(3), run.prior, sigma_w=sigma_w, relinearised=RELINEARISED[method])
    return found, plain


def test_states_and_covariances_after_every_look(both, run):
    found, plain = both
    sigma = np.sqrt(np.diagonal(plain.covariance, axis1=1, axis2=2))
    error = np.asarray(found.looks.point_m) - run.anchor_m - plain.state
    assert np.abs(error / sigma).max() < 1e-6
    axes = enu(np.asarray(found.line_m))
    assert_in_sigmas(found.looks.covariance_enu_m2, axes.T @ plain.covariance @ axes, axes.T @ plain.covariance @ axes, 1e-6)


def test_innovations_before_every_look(both):
    found, plain = both
    # Pixels: rounding of ECEF, 1e-9 m, is 1e-8 px at 14 km; states that differ by 1e-6 sigma make the rest.
    scale = np.sqrt(np.diagonal(plain.innovation_covariance, axis1=1, axis2=2))
    assert np.abs((np.asarray(found.looks.innovation_px) - plain.innovation) / scale).max() < 1e-6
    assert_in_sigmas(found.looks.innovation_covariance_px2, plain.innovation_covariance, plain.innovation_covariance, 1e-6)
    np.testing.assert_allclose(found.looks.nis, plain.nis, rtol=0, atol=1e-5 * plain.nis.max())
    np.testing.assert_allclose(found.chi_square, plain.nis.sum(), rtol=1e-6)


def test_the_end_is_that_of_the_last_look(both):
    found, _ = both
    np.testing.assert_array_equal(found.line_m, found.looks.point_m[-1])
    np.testing.assert_allclose(found.covariance_enu_m2, found.looks.covariance_enu_m2[-1], rtol=1e-9, atol=1e-9)
    assert found.freedom == 80
    assert np.asarray(found.looks.is_used).all()
    eigenvalues = np.linalg.eigvalsh(np.asarray(found.looks.covariance_enu_m2))
    assert (eigenvalues > 0).all()

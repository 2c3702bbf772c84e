"""The filter of location.cpp by Stone Soup: a Python loop over runs and looks.

The target stands still: each posterior is the next prediction, without a predictor.
"""

import datetime
from collections.abc import Callable
from math import cos, sin
from typing import Any

import numpy as np

from . import MissingPeer
from .location import FOCAL_PX, Located, Recorded, Sigmas, Start
from .numpy_location import angles, camera_from_ecef, look_at, noise, platform

try:
    from stonesoup.base import Property
    from stonesoup.models.base import GaussianModel
    from stonesoup.models.measurement import MeasurementModel
    from stonesoup.types.array import CovarianceMatrix, StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction
    from stonesoup.updater.kalman import ExtendedKalmanUpdater
except ModuleNotFoundError as error:
    raise MissingPeer("Stone Soup is not installed: pip install 'whiskjax[bench]'") from error


class GimballedCamera(MeasurementModel, GaussianModel):
    """One look, linearised once at the state that it is made for."""

    predicted: Any = Property(doc="Pixel")
    derivatives: Any = Property(doc="(2, 3)")
    noise_covar: Any = Property(doc="(2, 2)")

    @property
    def ndim_meas(self) -> int:
        return 2

    def function(self, state, noise=False, **_) -> StateVector:
        return self.predicted

    def jacobian(self, state, **_) -> np.ndarray:
        return self.derivatives

    def covar(self, **_) -> CovarianceMatrix:
        return self.noise_covar


def prepared(recorded: Recorded, start: Start, sigmas: Sigmas, full: bool) -> Callable[[], Located]:
    """The filter as a call."""
    numbers = np.moveaxis(recorded.numbers(), 0, -1)
    registration = CovarianceMatrix(sigmas.pixel_px**2 * np.eye(2))
    guess = start.guess_ecef_m.tolist()
    updater = ExtendedKalmanUpdater(None, use_joseph_cov=True)
    time = datetime.datetime(2019, 1, 1)

    def run() -> Located:
        found = [one(looks) for looks in numbers.tolist()]
        return np.array([x for x, _ in found]), np.array([P for _, P in found])

    def one(looks: list[list[float]]) -> Located:
        x, P = StateVector(np.zeros(3)), CovarianceMatrix(start.covariance_m2)
        for look in looks:
            *turns, beta = [(sin(angle), cos(angle)) for angle in angles(look)]
            rows = camera_from_ecef(*turns)
            position = platform(turns[0], turns[1], look[2])
            offset = [float(x[i, 0]) - (position[i] - guess[i]) for i in range(3)]
            a, b, per_m, hm, hn = look_at(rows, offset)
            R = registration
            if full:
                mm, mn, nn = noise(sigmas, turns[4], beta, a, b, per_m)
                R = CovarianceMatrix([[mm, mn], [mn, nn]])
            model = GimballedCamera(3, (0, 1, 2), StateVector([FOCAL_PX * a, FOCAL_PX * b]), np.array([hm, hn]), R)
            prediction = GaussianStatePrediction(x, P, timestamp=time)
            detection = Detection(StateVector(look[8:]), timestamp=time, measurement_model=model)
            posterior: Any = updater.update(SingleHypothesis(prediction, detection))
            x, P = posterior.state_vector, posterior.covar
        return np.asarray(x)[:, 0], np.asarray(P)

    return run

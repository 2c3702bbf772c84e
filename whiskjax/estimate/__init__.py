"""Estimation that never asks which instrument: unknowns and priors, least squares, posterior, diagnosis, calibration."""

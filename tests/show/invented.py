"""Calibrations that say something else than they found."""

import dataclasses

import numpy as np


def invented(calibration, *, result=None, robust_weight=None, fields=None, **told):
    """The calibration with another result, weights or fields, and with `told` in place of what it would work out."""
    changed = dict(fields or {})
    if result is not None:
        changed["estimate"] = dataclasses.replace(changed.get("estimate", calibration.estimate), result=result)
    if robust_weight is not None:
        changed["_share"] = np.asarray(robust_weight)
    found = dataclasses.replace(calibration, **changed)
    found.__dict__.update(told)  # where a cached property keeps what it worked out
    return found

"""A diagnosis as plain data: every figure that is printed or written comes from this one place."""

from ...doctor.diagnosis import Diagnosis, Finding
from ..plain import Summary, number, verdict, versions


def summarise(diagnosis: Diagnosis, command: str = "") -> Summary:
    """Everything worth telling about a diagnosis.

    **Arguments:** `command`: how it was made, for the reader who wants to repeat it.
    """
    given = diagnosis.as_given
    return {
        "flight": diagnosis.flight.name,
        "command": command,
        "verdict": verdict(diagnosis.reasons),
        "units": {
            "residuals": "px, the median length of measured - projected",
            "chi_square": "of a robust fit with its priors; 1 a degree of freedom is noise",
            "cost": "the chi-square, and what leaving out, not imaging and growing sigmas cost; findings are ranked by it",
            "value": "each in its own unit",
        },
        "counts": {
            "measurements": diagnosis.observations,
            "measurements_with_coordinates": diagnosis.of_observations,
            "tried": diagnosis.tried,
            "refused": len(diagnosis.refused),
        },
        "as_given": None if given is None else _finding(given),
        "findings": [_finding(found) for found in diagnosis.findings],
        "refused": dict(diagnosis.refused),
        "remarks": list(diagnosis.remarks),
        "versions": versions("jax", "numpy"),
    }


def _finding(found: Finding) -> Summary:
    known = lambda value: None if value is None else number(value)
    return {
        "place": found.place,
        "name": found.name,
        "sentence": found.remedy.sentence,
        "change": found.advice,
        "median_residual_before_px": known(found.residual_before_px),
        "median_residual_after_px": known(found.residual_after_px),
        "chi_square": number(found.chi_square),
        "degrees_of_freedom": found.freedom,
        "factor": number(found.factor),
        "cost": number(found.cost),
        "value": known(found.value),
        "value_sigma": known(found.value_sigma),
        "unit": found.unit,
        "strays": list(found.strays),
    }

"""The catalogue: everything that the doctor tries on a flight."""

from ..flights.flight import Flight
from .attitude_remedies import attitude_remedies
from .axes_remedies import axes_remedies
from .encoder_remedies import encoder_remedies
from .image_remedies import image_remedies
from .point_remedies import point_remedies
from .remedy import Remedy
from .time_remedies import time_remedies


def conventions(flight: Flight) -> list[Remedy]:
    """Every remedy that means something for a flight; wrong images and points are suspected later, by what they leave."""
    return [
        *attitude_remedies(flight),
        *encoder_remedies(flight),
        *image_remedies(flight),
        *point_remedies(flight),
        *time_remedies(flight),
        *axes_remedies(flight),
    ]

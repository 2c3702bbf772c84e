"""The figures of a calibration, in the order in which a report shows them."""

from ..plain import Summary
from ..style import Drawing
from .correlation_map import draw_correlations
from .residuals import Residuals
from .shrinkage import draw_shrinkage
from .trends import draw_trends
from .vectors import draw_vectors


def draw_all(summary: Summary, residuals: Residuals) -> list[Drawing]:
    """Residual vectors, residuals along the image, prior and posterior, correlations (for two unknowns and more)."""
    drawings = [draw_vectors(residuals), draw_trends(residuals), draw_shrinkage(summary)]
    if len(summary["parameters"]) > 1:
        drawings.append(draw_correlations(summary))
    return drawings

"""What the summary of Liu et al. (2019) has to tell."""

from ...show.plain import Summary
from ..page import Paper
from .findings import findings
from .tables import tables

_ABOUT = (
    "Liu et al. (2019) locate a ground target from many oblique looks of a gimballed camera, without a range finder, by an "
    "extended Kalman filter. Every look has recorded navigation and gimbal angles with errors of their own (their Table 1)."
    " Errors are estimate − truth. The paper prints neither focal length nor path nor spacing of the looks; the simulation "
    "supplies them (10 µrad a pixel, 500 m between looks)."
)


def page(summary: Summary) -> Paper:
    """All of it, in the order in which it is shown."""
    runs = summary["runs"]
    made_of = f"{runs['runs']} runs a figure, {runs['circle']} for Figure 10, seed {runs['seed']}."
    drawn = "Figures 6 to 10, Table 2 and the estimators"
    return Paper(_ABOUT, (made_of,), tables(summary), drawn, findings(summary))

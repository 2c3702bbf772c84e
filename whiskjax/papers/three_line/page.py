"""What the summary of Wang et al. (2018) has to tell."""

from ...show.plain import Summary
from ..page import Paper
from .findings import AGREEMENT, findings
from .tables import tables

_ABOUT = (
    "Wang et al. (2018) calibrate the lever arm, the boresight and the detector lines of an airborne three-line camera over"
    " the Songshan test field by a block adjustment with thousands of tie points. Here the flights are simulated twice: "
    "nominal (points 0.3 px, ties 0.5 px, as the paper says it measured) and paper-like (3.5 and 2 px and three times the "
    "vibration, which is what its residuals say)."
)


def page(summary: Summary) -> Paper:
    """All of it, in the order in which it is shown."""
    runs = summary["runs"]
    made_of = (
        f"Tables and Figures 6 to 14: seed {runs['seed']}, {runs['ties'] or '14,157 and 8,802'} tie points; beyond them "
        f"{runs['few_ties']} tie points or all, and {runs['few_seeds']} to {runs['seeds']} seeds."
    )
    return Paper(_ABOUT, (made_of,), tables(summary), "Figures 6 to 14", findings(summary), AGREEMENT)

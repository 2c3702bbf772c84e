"""What the summary of Jin et al. (2024) has to tell."""

from ...show.plain import Summary
from ..page import Paper
from .answer_tables import NAMES, answers_table
from .findings import agreement, findings
from .tables import bands, in_order, swings

_ABOUT = (
    "Jin et al. (2024) calibrate an airborne infrared scanner that swings left and right: lever arms and angles of camera "
    "and POS, with one set of IMU boresight angles for each swing. The paper prints neither focal length nor geometry nor "
    "noise; the simulated flight supplies them. Residuals are measured − projected, in pixels. It names two things as open,"
    " the weights and the drift of the parameters; they, gross errors, the choice of the model and errors of the POS are "
    "tried on this flight, each over many seeds."
)


def page(summary: Summary) -> Paper:
    """All of it, in the order in which it is shown."""
    seeds, verdict = summary["seeds"], summary["verdict"]
    last = seeds["first"] + seeds["count"] - 1
    made_of = [
        f"{seeds['count']} simulated flights, seeds {seeds['first']} to {last}; a figure is inside when its median over "
        "the seeds is.",
        f"{verdict['without_band_paper_in_range']} of the paper's {verdict['without_band']} figures without a band lie within "
        "the 5 % to 95 % range of the seeds.",
    ]
    beyond = None
    if summary["open_questions"]:
        beyond = answers_table(summary["open_questions"])
        made_of.append(
            f"Of what the paper leaves open, {verdict['open_met']} of {verdict['open_asked']} figures with a band are inside it."
        )
    first, *others = findings(summary)
    return Paper(
        about=_ABOUT,
        made_of=made_of,
        tables=(bands(summary), *in_order(summary)),
        drawn="Figures 3 to 7",
        findings=(first._replace(table=swings(summary)), *others),
        agreement=agreement(summary),
        beyond=beyond,
        drawn_beyond=NAMES,
    )

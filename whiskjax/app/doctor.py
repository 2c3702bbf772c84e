"""`whiskjax doctor`: what is wrong with a flight whose measurements do not fit."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .start import start_jax
from .terminal import print_answer

if TYPE_CHECKING:
    from ..show.plain import Summary

_OURS = ("results.json", "report.html", "findings.csv")


@answers_failures
def doctor(
    flight: Annotated[Path, typer.Argument(help="The flight folder (flight.toml and its tables).", show_default=False)],
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
) -> None:
    """Find out what is wrong with a flight that does not fit.

    Tries what people get wrong, one thing at a time: signs and orders of angles, axes, image axes and units, clocks, heights,
    encoders, single points and images. Prints what explains the data, with residuals before and after and the line to change.
    Exits with 0 where the flight is best as it is.
    """
    refuse_place(out, _OURS, flight)
    start_jax()
    from .stages import Stages

    with Stages("read", "examine", "write") as stages:
        stages.enter("read")
        from ..doctor.examine import examine
        from ..files.read import read_unchecked
        from ..show.diagnosis.page import make_report
        from ..show.diagnosis.summary import summarise
        from ..show.diagnosis.tables import write_findings

        # Points behind the camera and times outside the record are what it is asked about: they are no reason to refuse.
        found, _ = read_unchecked(flight)
        stages.enter("examine")
        diagnosis = examine(found)
        stages.enter("write")
        summary = summarise(diagnosis, command_text(["whiskjax", "doctor", str(flight), "--out", str(out)]))
        with result_folder(out, _OURS) as folder:
            write_findings(folder / "findings.csv", summary)
            write_report(folder, summary, [], make_report(summary))
    _print(summary, out)
    raise typer.Exit(0 if diagnosis.is_sound else NOT_SOUND)


def _print(summary: "Summary", out: Path) -> None:
    from ..show.diagnosis.tables import changes, findings, head

    lines = head(summary)
    if changes(summary) is not None:
        for row in summary["findings"]:
            if row["place"] == 1:
                lines += [f"{row['name']}: {row['sentence']}", f"  -> {row['change']}"]
    print_answer("flight", summary, lines, (findings(summary),), f"Written to {out}: report.html, results.json, findings.csv")

"""`whiskjax calibrate`: estimate a flight's unknowns from its control points, and show how far to trust them."""

import dataclasses
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .start import start_jax
from .terminal import print_answer

if TYPE_CHECKING:
    from ..estimate.calibration import Calibration
    from ..flights.flight import Flight
    from ..show.plain import Summary
    from ..show.style import Drawing

_BOUND = 2.5
_OURS = (
    "results.json",
    "report.html",
    "parameters.csv",
    "statistics.csv",
    "residuals.csv",
    "residual_vectors.png",
    "residual_trends.png",
    "prior_posterior.png",
    "correlations.png",
    "calibrated",
)


class Loss(StrEnum):
    """How much an observation far from the others may pull."""

    none = "none"
    huber = "huber"
    cauchy = "cauchy"


@answers_failures
def calibrate(
    flight: Annotated[Path, typer.Argument(help="The flight folder (flight.toml and its tables).", show_default=False)],
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
    loss: Annotated[Loss, typer.Option(help="Robust loss against blunders.")] = Loss.none,
    bound: Annotated[float | None, typer.Option(help=f"Where the robust loss sets in, in sigmas [default: {_BOUND}].")] = None,
    blunders: Annotated[bool, typer.Option("--blunders", help="Find gross errors, leave them out and name them.")] = False,
    reweigh: Annotated[bool, typer.Option("--reweigh", help="Find the sigmas of images from the data.")] = False,
    max_steps: Annotated[int, typer.Option(min=1, help="Steps after which the iteration is given up.")] = 100,
) -> None:
    """Estimate a flight's unknowns from its control points.

    Prints values with their sigmas, what the data determined and what only the prior says, residuals before and after, and a
    verdict. Writes results.json, report.html, CSV tables, PNG figures and, where the result is sound, the calibrated flight.
    """
    if bound is not None and loss is Loss.none:
        raise typer.BadParameter("it belongs to --loss huber or cauchy", param_hint="--bound")
    if bound is not None and not 0 < bound < float("inf"):
        raise typer.BadParameter("it is a positive number of sigmas", param_hint="--bound")
    if loss is not Loss.none and (blunders or reweigh):
        raise typer.BadParameter(
            "a robust loss and --blunders or --reweigh answer the same question; use one", param_hint="--loss"
        )
    refuse_place(out, _OURS, flight)
    start_jax()
    from .stages import Stages

    with Stages("read", "compile and solve", "draw and write") as stages:
        stages.enter("read")
        from ..estimate.blunders import Blunders
        from ..estimate.calibrate import calibrate as solve
        from ..estimate.losses import Cauchy, Huber
        from ..estimate.variance_components import Reweigh
        from ..files.read import read_flight
        from ..show.calibration.figures import draw_all
        from ..show.calibration.residuals import gather
        from ..show.calibration.summary import summarise

        found = read_flight(flight)
        stages.enter("compile and solve")
        kinds = {Loss.none: lambda _: None, Loss.huber: Huber, Loss.cauchy: Cauchy}
        robust = kinds[loss](_BOUND if bound is None else bound)
        calibration = solve(
            found.sensor,
            found.observations(),
            found.unknowns,
            errors=[one for one in found.errors if not any(one.free)],
            surface=found.world.surface(0.0),
            loss=robust,
            blunders=Blunders() if blunders else None,
            reweigh=Reweigh() if reweigh else None,
            max_steps=max_steps,
            throw=False,
        )
        stages.enter("draw and write")
        summary = summarise(calibration, found, _command(flight, out, loss, bound, blunders, reweigh, max_steps))
        drawings = draw_all(summary, gather(calibration, found))
        with result_folder(out, _OURS) as folder:
            _write(folder, calibration, found, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if calibration.is_sound else NOT_SOUND)


def _command(flight: Path, out: Path, loss: Loss, bound: float | None, blunders: bool, reweigh: bool, max_steps: int) -> str:
    words = ["whiskjax", "calibrate", str(flight), "--out", str(out)]
    words += ["--loss", loss.value] if loss is not Loss.none else []
    words += ["--bound", f"{bound:g}"] if bound is not None else []
    words += ["--blunders"] * blunders + ["--reweigh"] * reweigh
    words += ["--max-steps", str(max_steps)] if max_steps != 100 else []
    return command_text(words)


def _write(folder: Path, calibration: "Calibration", flight: "Flight", summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..files.write import write_flight
    from ..show.calibration.page import make_report
    from ..show.calibration.residuals import gather
    from ..show.calibration.sheets import write_parameters, write_residuals, write_statistics

    write_parameters(folder / "parameters.csv", summary)
    write_statistics(folder / "statistics.csv", summary)
    write_residuals(folder / "residuals.csv", gather(calibration, flight))
    write_report(folder, summary, drawings, make_report(summary, drawings))
    if calibration.is_sound:
        calibrated = dataclasses.replace(flight, sensor=calibration.sensor, name=f"{flight.name}, calibrated")
        write_flight(calibrated, folder / "calibrated")


def _print(summary: "Summary", out: Path) -> None:
    from ..show.calibration.tables import blunders, largest, parameters, residuals, sizes
    from ..show.tables import weights

    counts: dict[str, Any] = summary["counts"]
    head = [
        f"{counts['control_observations']} control and {counts['check_observations']} check observations in "
        f"{counts['images']} image{'' if counts['images'] == 1 else 's'}, {summary['determined']['unknowns']} unknowns"
    ]
    if counts["tie_observations_left_out"]:
        head.append(f"{counts['tie_observations_left_out']} observations of tie points, which have no coordinates, take no part")
    tables = (parameters(summary), residuals(summary), sizes(summary), weights(summary), blunders(summary), largest(summary))
    calibrated = "" if summary["verdict"]["is_sound"] else " (no calibrated flight: the result is not sound)"
    written = f"Written to {out}: report.html, results.json, tables and figures{calibrated}"
    print_answer("calibration", summary, head, tables, written)

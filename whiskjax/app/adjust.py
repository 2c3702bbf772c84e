"""`whiskjax adjust`: strips of images adjusted together from control and tie points, and how far to trust the result."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..rules import FlightError
from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .start import start_jax
from .terminal import print_answer

if TYPE_CHECKING:
    from ..estimate.map_limits import Standard
    from ..show.block.adjusted import Adjusted
    from ..show.plain import Summary
    from ..show.style import Drawing

_OURS = (
    "results.json",
    "report.html",
    "unknowns.csv",
    "adjusted_points.csv",
    "residuals.csv",
    "corrections.csv",
    "residual_vectors.png",
    "point_errors.png",
    "detector_residuals.png",
    "trajectory_corrections.png",
    "point_sigmas.png",
    "adjusted",
)
_STEPS = 30


@answers_failures
def adjust(
    flight: Annotated[Path, typer.Argument(help="The flight folder (flight.toml and its tables).", show_default=False)],
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
    blunders: Annotated[bool, typer.Option("--blunders", help="Find wrong rays, leave them out and name them.")] = False,
    reweigh: Annotated[bool, typer.Option("--reweigh", help="Estimate sigmas of rays, control and POS from the data.")] = False,
    direct: Annotated[
        bool, typer.Option("--direct", help="Also position points directly, strip by strip, before and after.")
    ] = False,
    profile: Annotated[
        str | None,
        typer.Option(
            help="Hold the check points against GB/T 23236 at a map scale (1000, 2000 or 5000; with --terrain), or a TOML "
            "file of limits."
        ),
    ] = None,
    terrain: Annotated[
        str | None, typer.Option(help="For a map scale: flat, hilly, mountainous or alpine.", show_default=False)
    ] = None,
    max_steps: Annotated[int, typer.Option(min=1, help="Largest number of steps.")] = _STEPS,
) -> None:
    """Adjust strips of images together from control and tie points.

    Estimates the flight's unknowns, the course of its POS errors and every point. Prints tables and a verdict; writes
    results.json, report.html, CSV tables, PNG figures and, of a sound result, the flight with its adjusted sensor.
    """
    refuse_place(out, _OURS, flight)
    command = lambda terrain: _command(flight, out, blunders, reweigh, direct, profile, terrain, max_steps)
    standard = _standard(profile, terrain, command)
    start_jax()
    from .stages import Stages

    with Stages("read", "compile and adjust", "draw and write") as stages:
        stages.enter("read")
        from ..estimate.block.adjust import adjust as solve
        from ..estimate.block.direct import direct_positioning
        from ..estimate.block.station_errors import has_stations
        from ..estimate.blunders import Blunders
        from ..estimate.variance_components import Reweigh
        from ..files.read import read_flight
        from ..show.block.adjusted import Adjusted

        found = read_flight(flight)
        block = found.block()
        stages.enter("compile and adjust")
        before = direct_positioning(found.sensor, block) if direct else None
        adjustment = solve(
            found.sensor,
            block,
            found.unknowns,
            errors=[one for one in found.errors if has_stations(one, found.sensor)],
            blunders=Blunders() if blunders else None,
            reweigh=Reweigh(priors=True) if reweigh else None,
            surface=found.world.surface(0.0),
            max_steps=max_steps,
            throw=False,
        )
        both = None if before is None else (before, direct_positioning(adjustment.sensor, block))
        adjusted = Adjusted(found, adjustment, both, standard)
        stages.enter("draw and write")
        from ..show.block.charts import draw_charts
        from ..show.block.summary import summarise

        summary = summarise(adjusted, command(terrain))
        drawings = draw_charts(adjusted)
        with result_folder(out, _OURS) as folder:
            _write(folder, adjusted, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if adjustment.is_sound else NOT_SOUND)


def _standard(profile: str | None, terrain: str | None, command: Callable[[str | None], str]) -> "Standard | None":
    """What the check points are to meet.

    A map scale has limits by terrain, and no terrain is assumed: which it is follows from the slopes of a whole sheet, which the
    points of a block do not tell, and with a wrong one a map would pass whose heights are four times too far off.

    **Arguments:** `command`: the command with some terrain, for the message.
    """
    if profile is None:
        if terrain is not None:
            raise typer.BadParameter("the limits of a terrain need a map scale: --profile 1000", param_hint="--terrain")
        return None
    from ..estimate.map_limits import PROFILE
    from ..files.standard import read_standard

    if not profile.isdecimal():
        if terrain is not None:
            raise typer.BadParameter("a file has its own limits, without a terrain", param_hint="--terrain")
        if not Path(profile).is_file():
            raise FlightError(f"--profile {profile!r}: no such file; give a map scale, as 1000, or a TOML file of limits")
        return read_standard(Path(profile))
    scales, terrains = (list(dict.fromkeys(of)) for of in zip(*PROFILE.limits, strict=True))
    if int(profile) not in scales:
        known = ", ".join(map(str, scales))
        raise FlightError(f"--profile {profile}: {PROFILE.name}, has 1 to {known}; give one of them, or a TOML file of limits")
    known = ", ".join(map(str, terrains))
    if terrain is None:
        heights = ", ".join(f"{PROFILE.limits[int(profile), ground].height_m:g}" for ground in terrains)
        raise FlightError(
            f"--profile {profile} needs --terrain, on which its limits depend: {known} (largest RMSE in height: {heights} m); "
            f"for {terrains[1]} ground: {command(terrains[1])}"
        )
    if terrain not in terrains:
        raise FlightError(f"--terrain: one of {known} is expected, not {terrain!r}")
    return PROFILE.standard(int(profile), terrain)


def _command(
    flight: Path,
    out: Path,
    blunders: bool,
    reweigh: bool,
    direct: bool,
    profile: str | None,
    terrain: str | None,
    max_steps: int,
) -> str:
    words = ["whiskjax", "adjust", str(flight), "--out", str(out)]
    words += ["--blunders"] * blunders + ["--reweigh"] * reweigh + ["--direct"] * direct
    for option, value in (("--profile", profile), ("--terrain", terrain)):
        words += [option, value] if value is not None else []
    words += ["--max-steps", str(max_steps)] if max_steps != _STEPS else []
    return command_text(words)


def _write(folder: Path, adjusted: "Adjusted", summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..files.write import write_flight
    from ..show.block.page import make_report
    from ..show.block.sheets import write_sheets

    write_sheets(folder, adjusted, summary)
    write_report(folder, summary, drawings, make_report(summary, drawings))
    if adjusted.adjustment.is_sound:
        flight = adjusted.flight
        write_flight(
            dataclasses.replace(flight, sensor=adjusted.adjustment.sensor, name=f"{flight.name}, adjusted"), folder / "adjusted"
        )


def _print(summary: "Summary", out: Path) -> None:
    from ..show.block.tables import all_tables

    fit = summary["fit"]
    factor = "" if fit["variance_factor"] is None else f"; variance factor {fit['variance_factor']:.3f}"
    head = [f"{summary['solver']['steps']} steps{factor}; {fit['degrees_of_freedom']} degrees of freedom"]
    flight = ", adjusted/ (the flight with its new sensor)" if summary["verdict"]["is_sound"] else ""
    written = f"Written to {out}: report.html, results.json, CSV tables, figures{flight}"
    print_answer("adjustment", summary, head, all_tables(summary), written)

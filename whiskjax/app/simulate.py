"""`whiskjax simulate`: write a simulated flight as a flight folder."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..rules import FlightError
from .failure import answers_failures
from .start import start_jax

simulate = typer.Typer(no_args_is_help=True, help="Write a simulated flight as a flight folder.")


class Order(StrEnum):
    """Which of the two turns comes first, counted from the platform."""

    scan_pitch = "scan-pitch"
    pitch_scan = "pitch-scan"


@simulate.command()
@answers_failures
def haian(
    seed: Annotated[int, typer.Option(min=0, help="Of everything random: the same seed is the same flight.")],
    out: Annotated[Path, typer.Option(help="The folder to write.")],
    noise: Annotated[bool, typer.Option(help="Errors of POS, points and image measurements.")] = True,
    drift: Annotated[bool, typer.Option(help="IMU boresight of the last pair of images has drifted.")] = False,
    order: Annotated[Order, typer.Option(help="Order of the scan and the pitch turn.")] = Order.scan_pitch,
    force: Annotated[bool, typer.Option("--force", help="Replace a flight that is there already.")] = False,
) -> None:
    """The whiskbroom scanner with left and right swings: 6 images, 15 unknowns (Jin et al. 2024).

    The folder also gets truth.csv, the parameters that a calibration should find; nothing reads it.
    """
    _refuse_place(out, force)
    start_jax()
    from ..files.write import flight_folder, write_files
    from ..flights import haian as simulated
    from ..show.calibration.sheets import write_truth
    from .stages import Stages

    with Stages("simulate"):
        flight = simulated.simulate(seed, noise=noise, drift=drift, scan_first=order is Order.scan_pitch)
        with flight_folder(out, overwrite=force) as folder:
            write_files(flight, folder)
            write_truth(folder / "truth.csv", simulated.unknowns(mean=simulated.TABLE_4))
    size = sum(path.stat().st_size for path in out.iterdir())
    typer.echo(
        f"{flight.name}: {len(flight.images)} images, {len(flight.points.names)} points, {len(flight.measurements)} "
        f"observations, {len(flight.unknowns)} unknowns; {size / 1e6:.1f} MB in {out}"
    )


class Way(StrEnum):
    """How the aircraft flies past the target."""

    orbit = "orbit"
    race = "race"
    fly = "fly"


@simulate.command()
@answers_failures
def tianshan(
    seed: Annotated[int, typer.Option(min=0, help="Of everything random: the same seed is the same flight.")],
    out: Annotated[Path, typer.Option(help="The folder to write.")],
    path: Annotated[Way, typer.Option(help="Around the target, up and down a leg of 20 km, or straight past.")] = Way.orbit,
    looks: Annotated[int, typer.Option(min=2, help="How many, 500 m and 3 s apart.")] = 40,
    force: Annotated[bool, typer.Option("--force", help="Replace a flight that is there already.")] = False,
) -> None:
    """A gimballed camera that looks at one target from 10 km and 45 deg off nadir (Liu et al. 2019).

    The target is the check point "target", at its true position.
    """
    _refuse_place(out, force)
    start_jax()
    from ..files.write import write_flight
    from ..flights.tianshan import Scene
    from ..flights.tianshan import simulate as simulated
    from .stages import Stages

    with Stages("simulate"):
        flight = simulated(seed, Scene(path=path.value, looks=looks))
        write_flight(flight, out, overwrite=force)
    typer.echo(f"{flight.name}: {len(flight.measurements)} looks at the point {flight.points.names[0]}, in {out}")


class DataSet(StrEnum):
    """Two crossing pairs of strips, or one pair."""

    A = "A"
    B = "B"


class Noise(StrEnum):
    """Of points, ties and vibration: what the instrument can do, or what the paper's residuals ask for."""

    nominal = "nominal"
    paper_like = "paper-like"


@simulate.command()
@answers_failures
def songshan(
    seed: Annotated[int, typer.Option(min=0, help="Of everything random: the same seed is the same flight.")],
    out: Annotated[Path, typer.Option(help="The folder to write.")],
    data: Annotated[DataSet, typer.Option("--set", help="Two crossing pairs of strips, or one pair.")] = DataSet.A,
    noise: Annotated[Noise, typer.Option(help="What the instrument can do, or what the paper shows.")] = Noise.nominal,
    ties: Annotated[
        int | None, typer.Option(min=0, help="How many tie points; if not given, the paper's 14157 or 8802.", show_default=False)
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a flight that is there already.")] = False,
) -> None:
    """The three-line camera: strips with control, check and tie points, and POS errors (Wang et al. 2018)."""
    _refuse_place(out, force)
    start_jax()
    from ..files.write import write_flight
    from ..flights.songshan import Scene
    from ..flights.songshan import simulate as simulated
    from .stages import Stages

    with Stages("simulate"):
        flight = simulated(Scene(name=data.value, noise=noise.value, ties=ties), seed)
        write_flight(flight, out, overwrite=force)
    roles = list(flight.points.roles)
    counts = ", ".join(f"{roles.count(role)} {role}" for role in ("control", "check", "tie"))
    typer.echo(f"{flight.name}: {len(flight.strips)} strips, {counts} points, {len(flight.measurements)} rays, in {out}")


def _refuse_place(out: Path, force: bool) -> None:
    """Before the simulation: where no flight can be written, or where one is that --force does not replace."""
    from ..files.write import check_flight_place

    try:
        check_flight_place(out, overwrite=force)
    except FlightError as error:
        raise FlightError(f"--out {error}") from error

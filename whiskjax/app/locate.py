"""`whiskjax locate`: one target from all the looks at it, and how far to trust the answer."""

import fnmatch
import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..rules import FlightError, SensorError
from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .start import start_jax
from .terminal import print_answer

if TYPE_CHECKING:
    from ..estimate.unknown import Unknown
    from ..flights.flight import Flight
    from ..show.plain import Summary
    from ..show.style import Drawing
    from ..show.target.sighting import Sighting

_MAPS = ("target.geojson", "target.kml")
_OURS = (
    "results.json",
    "report.html",
    "looks.csv",
    "error_ellipse.png",
    "convergence.png",
    "innovations.png",
    *_MAPS,
)
_FAR_M = 1e9  # no target is so little known


class Method(StrEnum):
    """How the looks are put together."""

    extended = "extended"
    iterated = "iterated"
    batch = "batch"


@answers_failures
def locate(
    flight: Annotated[Path, typer.Argument(help="The flight folder (flight.toml and its tables).", show_default=False)],
    target: Annotated[
        str,
        typer.Option(
            help="The point of points.csv whose measurements are the looks. Several, with commas or as a shell pattern "
            "('centre-1?,centre-20'), stand for one target, whose given position is their mean."
        ),
    ],
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
    height: Annotated[
        float | None,
        typer.Option(
            help="Height (m, ellipsoidal) where the first look is cut for a guess; if not given, the mean of the control points."
        ),
    ] = None,
    height_sigma: Annotated[
        float | None,
        typer.Option(help="1-sigma (m) of --height, where that is the target's own: an observation beside the looks."),
    ] = None,
    sigma_enu: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="1-sigma of the first guess: east, north, up (m); if not given, from how slant the first look is."),
    ] = None,
    method: Annotated[Method, typer.Option(help="A filter over the looks, or all at once.")] = Method.iterated,
    gate: Annotated[
        float | None, typer.Option(help="Leave out looks that chance explains less often than this, as 0.001.")
    ] = None,
    estimate: Annotated[
        list[str] | None, typer.Option(help="An unknown of the flight to estimate with the target: name, pattern or 'all'.")
    ] = None,
    consider: Annotated[
        list[str] | None, typer.Option(help="One that is not estimated, but whose prior sigma counts: likewise.")
    ] = None,
) -> None:
    """Locate one target from all the looks at it, without a range finder.

    Prints the position with its accuracy, the test of the looks, and a verdict. Writes results.json, report.html, looks.csv, PNG
    figures, and, of a flight in ECEF, target.geojson and target.kml.
    """
    _refuse_numbers(height, height_sigma, sigma_enu, gate)
    refuse_place(out, _OURS, flight)
    start_jax()
    from .stages import Stages

    with Stages("read", "compile and locate", "draw and write") as stages:
        stages.enter("read")
        from ..files.read import read_flight

        found = read_flight(flight)
        points = _points(found, target)
        estimated, considered = _unknowns(found, estimate, "--estimate"), _unknowns(found, consider, "--consider")
        if both := [x.name for x in estimated if x in considered]:
            raise FlightError(f"{', '.join(both)}: an unknown is estimated or considered, not both")
        stages.enter("compile and locate")
        sighting = _locate(found, target, points, height, height_sigma, sigma_enu, method, gate, estimated, considered)
        stages.enter("draw and write")
        from ..show.target.charts import draw_charts
        from ..show.target.summary import summarise

        command = _command(flight, target, out, height, height_sigma, sigma_enu, method, gate, estimate, consider)
        summary = summarise(sighting, command)
        drawings = draw_charts(sighting)
        with result_folder(out, _OURS) as folder:
            _write(folder, sighting, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if summary["verdict"]["is_sound"] else NOT_SOUND)


def _refuse_numbers(
    height: float | None, height_sigma: float | None, sigma_enu: tuple[float, float, float] | None, gate: float | None
) -> None:
    """What the options cannot be, whatever the flight."""
    if height is not None and not math.isfinite(height):
        raise FlightError(f"--height {height:g}: a number of metres is expected")
    if height_sigma is not None and height is None:
        raise FlightError("--height-sigma says how well --height is known, which is not given")
    if height_sigma is not None and not 0 < height_sigma < _FAR_M:
        raise FlightError(f"--height-sigma {height_sigma:g}: a positive number of metres is expected")
    if sigma_enu is not None and not all(0 < sigma < _FAR_M for sigma in sigma_enu):
        given = " ".join(f"{sigma:g}" for sigma in sigma_enu)
        raise FlightError(f"--sigma-enu {given}: three positive numbers of metres make a covariance that is positive definite")
    if gate is not None and not 0 < gate < 1:
        raise FlightError(f"--gate {gate:g}: the gate is a probability between 0 and 1, as 0.001")


def _points(flight: "Flight", target: str) -> list[int]:
    """Indices of the points that the target's name, or its comma-separated names and patterns, mean."""
    from ..files.names import listed, meant

    names = list(flight.points.names)
    chosen = [target] if target in names else [word.strip() for word in target.split(",")]
    found: dict[int, None] = {}
    for word in chosen:
        fitting = [i for i, name in enumerate(names) if name == word] or [
            i for i, name in enumerate(names) if fnmatch.fnmatchcase(name, word)
        ]
        if not fitting:
            raise FlightError(f"--target: no point {word!r}{meant(word, names)}; points.csv has {listed(names)}")
        found |= dict.fromkeys(fitting)
    measured = set(flight.measurements.point.tolist())
    if not measured & set(found):
        raise FlightError(f"--target: observations.csv has no measurement of {target!r}: nobody looked at it")
    return list(found)


def _unknowns(flight: "Flight", patterns: list[str] | None, option: str) -> list["Unknown"]:
    """The flight's unknowns that names, patterns or "all" mean, in the order of the flight."""
    from ..files.names import listed, meant

    names = [x.name for x in flight.unknowns]
    chosen: set[str] = set()
    for pattern in patterns or ():
        # A name may look like a pattern: angles_deg[0].
        fitting = [pattern] if pattern in names else names if pattern == "all" else fnmatch.filter(names, pattern)
        if not fitting:
            known = f"flight.toml has {listed(names)}" if names else "flight.toml has no [[unknown]]"
            raise FlightError(f"{option}: no unknown {pattern!r}{meant(pattern, names)}; {known}")
        chosen |= set(fitting)
    return [x for x in flight.unknowns if x.name in chosen]


def _locate(
    flight: "Flight",
    target: str,
    points: list[int],
    height: float | None,
    height_sigma: float | None,
    sigma_enu: tuple[float, float, float] | None,
    method: Method,
    gate: float | None,
    estimated: list["Unknown"],
    considered: list["Unknown"],
) -> "Sighting":
    import numpy as np

    from ..locate.guess import first_guess
    from ..locate.locate import locate as solve
    from ..locate.slant_guess import slant_guess
    from ..show.target.sighting import Sighting

    looks, measurement = flight.looks(points, height)
    remarks = []
    if (np.diff(measurement) < 0).any():
        remarks.append("the looks were not in the order of time in observations.csv; they were sorted")
    if height is None:
        height = flight.control_height_m(points)
        if height is None:
            raise FlightError(
                "--height is needed: the flight has no control points, beside the target, whose mean height could stand for the "
                "target's; give the ellipsoidal height in metres at which the first look is to be cut for a first guess: "
                "--height 500"
            )
        remarks.append(f"the first look was cut at the mean height of the control points, {height:.1f} m (--height sets another)")
    surface = flight.world.surface(height)
    try:
        if sigma_enu is None:
            guess, off_vertical_rad = slant_guess(flight.sensor, looks, surface)
            across, _, up = np.sqrt(np.diag(guess.covariance_enu_m2))
            remarks.append(
                f"the first guess was given 1-sigmas of {across:g} m east and north and {up:g} m up, as its look is "
                f"{np.degrees(off_vertical_rad):.0f} deg off the vertical (--sigma-enu sets others)"
            )
        else:
            guess = first_guess(flight.sensor, looks, surface, np.array(sigma_enu))
    except SensorError as error:
        raise SensorError(f"{error}; it was cut at a height of {height:g} m, and --height sets another") from error
    # Beside a free pose a finite statement says how far its start was off, which is no error of a pose that was found since.
    free = dict.fromkeys(one.frame for one in flight.errors if any(one.free))
    counted = [one for one in flight.errors if one.frame not in free]
    if free:
        remarks.append(f"the poses of {', '.join(free)} were not recorded; they count as the flight holds them, as exact")
    location = solve(
        flight.sensor,
        looks,
        guess=guess,
        surface=surface,
        surface_sigma_m=height_sigma,
        errors=counted,
        method=method.value,
        estimate=estimated,
        consider=considered,
        gate=gate,
        throw=False,
    )
    return Sighting(
        flight=flight,
        target=target,
        points=points,
        looks=looks,
        measurement=measurement,
        location=location,
        guess=guess,
        surface_height_m=height,
        method=method.value,
        gate=gate,
        unknowns=[*estimated, *considered],
        estimated=len(estimated),
        remarks=remarks,
    )


def _command(
    flight: Path,
    target: str,
    out: Path,
    height: float | None,
    height_sigma: float | None,
    sigma_enu: tuple[float, float, float] | None,
    method: Method,
    gate: float | None,
    estimate: list[str] | None,
    consider: list[str] | None,
) -> str:
    words = ["whiskjax", "locate", str(flight), "--target", target, "--out", str(out)]
    words += ["--height", f"{height:g}"] if height is not None else []
    words += ["--height-sigma", f"{height_sigma:g}"] if height_sigma is not None else []
    words += ["--sigma-enu", *(f"{s:g}" for s in sigma_enu)] if sigma_enu is not None else []
    words += ["--method", method.value] if method is not Method.iterated else []
    words += ["--gate", f"{gate:g}"] if gate is not None else []
    for option, names in (("--estimate", estimate), ("--consider", consider)):
        for name in names or ():
            words += [option, name]
    return command_text(words)


def _write(folder: Path, sighting: "Sighting", summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..show.target.page import make_report
    from ..show.target.tables import write_looks

    summary["maps"] = _write_maps(folder, sighting, summary)
    write_looks(folder / "looks.csv", sighting)
    write_report(folder, summary, drawings, make_report(summary, drawings))


def _write_maps(folder: Path, sighting: "Sighting", summary: "Summary") -> "Summary":
    """GeoJSON and KML; the files that were written, or why there are none."""
    import jax
    import numpy as np

    from ..earth.ellipsoid import ecef_to_geodetic
    from ..files.located import LocatedTarget, write_geojson, write_kml
    from ..show.target.summary import properties

    if sighting.flight.world.is_flat:
        return {"written": [], "reason": "maps need latitude and longitude, and this flight lies in a local world"}
    if not sighting.is_answered:
        return {"written": [], "reason": "there is no answer to show"}
    lat, lon, height = jax.vmap(ecef_to_geodetic)(sighting.platform_m)
    located = LocatedTarget(
        sighting.label,
        **summary["position"],
        covariance_enu_m2=summary["covariance_enu_m2"],
        ce90_m=summary["accuracy"]["ce90_m"],
        le90_m=summary["accuracy"]["le90_m"],
        properties=properties(summary),
        track=np.stack([np.degrees(np.asarray(lon)), np.degrees(np.asarray(lat)), np.asarray(height)], axis=-1),
    )
    write_geojson(folder / _MAPS[0], [located])
    write_kml(folder / _MAPS[1], [located])
    return {"written": list(_MAPS), "reason": ""}


def _print(summary: "Summary", out: Path) -> None:
    from ..show.target.tables import all_tables

    head = [f"{summary['looks']['looks']} looks at {summary['label']}, method: {summary['method']}", *summary["remarks"]]
    maps = summary["maps"]
    written = f", {', '.join(maps['written'])}" if maps["written"] else f" (no map: {maps['reason']})"
    written = f"Written to {out}: report.html, results.json, looks.csv, figures{written}"
    print_answer("location", summary, head, all_tables(summary), written)

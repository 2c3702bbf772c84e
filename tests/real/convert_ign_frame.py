"""ign_frame: 68 frame images of an aerial survey, poses from the producer's adjustment, tie points, one surveyed point.

The attitude is written as it was delivered: omega, phi, kappa in the grid of Lambert-93, with the meridian convergence at each
image. The source has already undone the scale of the projection in the heights (h_ell_m).
"""

from collections.abc import Sequence
from pathlib import Path

from .sets import Converted, Rows, write_flight_folder

FOCAL_PX, PRINCIPAL_POINT_PX, SIZE_PX = 30975.0, (13210.0, 8502.0), (26460.0, 17004.0)
UNKNOWNS = ("omega", "phi", "kappa", "focal length", "principal column", "principal row")
_PLACES = (
    *(f"lens.angles_deg[{i}]" for i in range(3)),
    "camera.focal_px",
    "camera.principal_point_px[0]",
    "camera.principal_point_px[1]",
)

_TOML = """format = 1
name = "ign_frame"
epoch = "2023, exposure times not given"
notes = NOTES

[pixel]
first_pixel_centre = 0.0

[pos]
angles = "opk"
reference_point = "projection centre"

[[chain]]
frame = "photo"
link = "poses"

[[chain]]
frame = "lens"
link = "mount"
angles_deg = {angles_deg}
order = "xyz"

[camera]
kind = "frame"
focal_px = {focal_px!r}
principal_point_px = {principal_point_px}
size_px = {size_px}
"""

_UNKNOWN = """
[[unknown]]
name = "{name}"
where = "{where}"
scale = {scale}
"""


def convert(
    source: Path,
    out: Path,
    *,
    boresight_deg: Sequence[float] = (0.0, 0.0, 0.0),
    focal_px: float = FOCAL_PX,
    principal_point_px: Sequence[float] = PRINCIPAL_POINT_PX,
    tie_role: str = "control",
) -> Converted:
    """Write the set as a flight folder: the surveyed points are check points.

    **Arguments:** the start values, by default those of the producer. No unknown has a prior: the data determine all six.
    `tie_role`: of the producer's tie points: "control", where the producer intersected them, or "tie", without coordinates.
    """
    cameras, ties, produced = (Rows(source / f"{name}.csv") for name in ("cameras", "tie_obs", "tie_points_producer"))
    surveyed, marks = Rows(source / "gcp.csv"), Rows(source / "gcp_obs.csv")
    images, known = set(cameras.texts("image")), set(produced.texts("point")) | set(surveyed.texts("point"))
    counts, seen = {}, []
    for rows, what in ((ties, "measurements of tie points"), (marks, "measurements of surveyed points")):
        seen.append(rows.among(image=images, point=known))
        counts[f"{what} whose image or point is not in the set"] = len(rows) - len(seen[-1])

    def joined(column: str) -> list[str]:
        return [text for rows in seen for text in rows.texts(column)]

    def placed(column: str) -> list[str]:
        given = [""] * len(produced) if tie_role == "tie" else produced.texts(column)
        return given + surveyed.texts(column)

    points = {
        "point": produced.texts("point") + surveyed.texts("point"),
        "lat_deg": placed("lat_deg"),
        "lon_deg": placed("lon_deg"),
        "height_m": placed("h"),
        "role": [tie_role] * len(produced) + ["check"] * len(surveyed),
    }
    measured = sum(map(len, seen))
    scales = (0.1, 0.1, 0.1, 100.0, 100.0, 100.0)
    unknowns = [_UNKNOWN.format(name=n, where=w, scale=s) for n, w, s in zip(UNKNOWNS, _PLACES, scales, strict=True)]
    toml = _TOML.format(
        angles_deg=list(map(float, boresight_deg)),
        focal_px=float(focal_px),
        principal_point_px=list(map(float, principal_point_px)),
        size_px=list(SIZE_PX),
    )
    tables = {
        "images.csv": {
            "image": cameras.texts("image"),
            "columns": [int(SIZE_PX[0])] * len(cameras),
            "rows": [int(SIZE_PX[1])] * len(cameras),
        },
        "poses.csv": {
            "image": cameras.texts("image"),
            **{name: cameras.texts(name) for name in ("lat_deg", "lon_deg")},
            "height_m": cameras.texts("h_ell_m"),
            **{name: cameras.texts(name) for name in ("omega_deg", "phi_deg", "kappa_deg", "convergence_deg")},
        },
        "points.csv": points,
        # What the producer's own marks of tie points turn out to be worth.
        "observations.csv": {
            "image": joined("image"),
            "point": joined("point"),
            "line": joined("row"),
            "sample": joined("col"),
            "sigma_line_px": ["0.2"] * measured,
            "sigma_sample_px": ["0.2"] * measured,
        },
    }
    return write_flight_folder(out, toml + "".join(unknowns), tables, counts)

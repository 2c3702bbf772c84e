"""sxb_frame: five aerial frames over Strasbourg, surveyed control points, tie points, poses known to 100 m and a quarter turn.

The map grid of the survey is taken as a Cartesian world, as the source takes it.
"""

from pathlib import Path

from .sets import Converted, Rows, write_flight_folder

# 123.9392 mm, and 26.577 mm and 38.811 mm from the top left corner, of pixels of 0.006 mm.
FOCAL_PX, PRINCIPAL_POINT_PX, SIZE_PX = 123.9392 / 0.006, (4429.5, 6468.5), (8858, 12996)
CONTROL_SIGMA_PX, TIE_SIGMA_PX = 0.5, 1.0

_TOML = f"""format = 1
name = "sxb_frame"
epoch = "exposure times not given"
notes = NOTES

[world]
kind = "local"

# Image points and the principal point are counted from the top left corner of the image.
[pixel]
first_pixel_centre = 0.5

[pos]
angles = "opk"
reference_point = "projection centre"

[[chain]]
frame = "photo"
link = "poses"

[camera]
kind = "frame"
focal_px = {FOCAL_PX!r}
principal_point_px = {list(PRINCIPAL_POINT_PX)}
size_px = {list(map(float, SIZE_PX))}
"""


def convert(source: Path, out: Path) -> Converted:
    """Write the set as a flight folder: the surveyed points are control, all others are ties, the poses are the coarse starts."""
    photos, surveyed, marks, ties = (Rows(source / f"{name}.csv") for name in ("eo_start", "gcp", "gcp_obs", "tie_obs"))
    images, control = photos.texts("image"), surveyed.texts("point")
    marked, tied = marks.among(image=images, point=control), ties.among(image=images)
    counts = {
        "measurements of control points whose image or point is not in the set": len(marks) - len(marked),
        "measurements of tie points whose image is not in the set": len(ties) - len(tied),
    }
    tie = [name for name in dict.fromkeys(tied.texts("point")) if name not in control]
    sigma_px = [CONTROL_SIGMA_PX] * len(marked) + [TIE_SIGMA_PX] * len(tied)
    tables = {
        "images.csv": {"image": images, "columns": [SIZE_PX[0]] * len(images), "rows": [SIZE_PX[1]] * len(images)},
        "poses.csv": {
            "image": images,
            **{f"{axis}_m": photos.texts(f"{axis}c") for axis in "xyz"},
            **{name: photos.texts(name) for name in ("omega_deg", "phi_deg", "kappa_deg")},
        },
        "points.csv": {
            "point": control + tie,
            **{f"{axis}_m": surveyed.texts(axis) + [""] * len(tie) for axis in "xyz"},
            **{f"sigma_{up}_m": surveyed.texts(f"s{axis}") + [0.0] * len(tie) for up, axis in zip("enu", "xyz", strict=True)},
            "role": ["control"] * len(control) + ["tie"] * len(tie),
        },
        "observations.csv": {
            **{name: marked.texts(name) + tied.texts(name) for name in ("image", "point")},
            "line": marked.texts("row") + tied.texts("row"),
            "sample": marked.texts("col") + tied.texts("col"),
            "sigma_line_px": sigma_px,
            "sigma_sample_px": sigma_px,
        },
    }
    return write_flight_folder(out, _TOML, tables, counts)

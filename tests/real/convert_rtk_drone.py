"""rtk_drone_nadir: a drone with centimetre positions and no attitude; heading is the course, and the boresight takes the rest.

Nothing is known of roll, pitch and crab, so that marks fit to tens of pixels, not to one. One mark is a blunder of some 2000 px,
which the source leaves in: use a robust loss.
"""

from pathlib import Path

import numpy as np

from .sets import Converted, Rows, write_flight_folder

SIZE_PX = (5472, 3648)
# What an unknown roll, pitch and crab of some tenths of a degree, one by one, are worth.
SIGMA_PX = 25.0

_TOML = """format = 1
name = "rtk_drone_nadir"
epoch = "GPS time of week, seconds"
notes = NOTES

# Pixel marks are counted from the top left corner of the image.
[pixel]
first_pixel_centre = 0.5

[pos]
angles = "roll_pitch_heading"
reference_point = "camera"

[[chain]]
frame = "course"
link = "poses"

[[chain]]
frame = "boresight"
link = "mount"
angles_deg = [0.0, 0.0, 0.0]

[[chain]]
frame = "lens"
link = "axes"
axes = "y x -z"

[camera]
kind = "frame"
focal_px = 4394.0
principal_point_px = [2736.0, 1824.0]
size_px = [5472.0, 3648.0]
"""

_UNKNOWN = """
[[unknown]]
name = "{}"
where = "{}"
prior_mean = {}
prior_sigma = {}
"""

_UNKNOWNS = (
    ("roll", "boresight.angles_deg[0]", 0.0, 10.0),
    ("pitch", "boresight.angles_deg[1]", 0.0, 10.0),
    ("heading", "boresight.angles_deg[2]", 0.0, 10.0),
    ("focal length", "camera.focal_px", 4394.0, 60.0),
    ("principal column", "camera.principal_point_px[0]", 2736.0, 25.0),
    ("principal row", "camera.principal_point_px[1]", 1824.0, 25.0),
)


def convert(source: Path, out: Path) -> Converted:
    """Write the set as a flight folder: every image with a course, the surveyed points as control."""
    cameras, surveyed, marks = (Rows(source / f"{name}.csv") for name in ("cameras", "gcp", "gcp_obs"))
    with_course = np.isfinite(cameras.numbers("course_deg"))
    flown = cameras.where(with_course)
    images, points = set(flown.texts("image_no")), set(surveyed.texts("gcp"))
    usable = [i in images and p in points for i, p in zip(marks.texts("image_no"), marks.texts("gcp"), strict=True)]
    seen = marks.where(usable)
    counts = {
        "images without a course": int((~with_course).sum()),
        "marks in such images, or of points or images that are not in the set": len(marks) - len(seen),
    }
    count = len(flown)
    tables = {
        "images.csv": {
            "image": flown.texts("image_no"),
            "time_s": flown.texts("gps_tow_s"),
            "columns": [SIZE_PX[0]] * count,
            "rows": [SIZE_PX[1]] * count,
        },
        "poses.csv": {
            "image": flown.texts("image_no"),
            "lat_deg": flown.texts("lat_deg"),
            "lon_deg": flown.texts("lon_deg"),
            "height_m": flown.texts("h_ell_m"),
            "roll_deg": ["0"] * count,
            "pitch_deg": ["0"] * count,
            "heading_deg": flown.texts("course_deg"),
        },
        "points.csv": {
            "point": surveyed.texts("gcp"),
            "lat_deg": surveyed.texts("lat_deg"),
            "lon_deg": surveyed.texts("lon_deg"),
            "height_m": surveyed.texts("h_m"),
            "role": ["control"] * len(surveyed),
        },
        "observations.csv": {
            "image": seen.texts("image_no"),
            "point": seen.texts("gcp"),
            "line": seen.texts("row"),
            "sample": seen.texts("col"),
            "sigma_line_px": [SIGMA_PX] * len(seen),
            "sigma_sample_px": [SIGMA_PX] * len(seen),
        },
    }
    return write_flight_folder(out, _TOML + "".join(_UNKNOWN.format(*u) for u in _UNKNOWNS), tables, counts)

"""misb_uas: telemetry (MISB ST 0601) of a turret on an aircraft, two flights; the target of each packet is its own frame centre.

Heights above mean sea level stand in for ellipsoidal ones, for the sensor and the target alike, as in the source: the geoid
changes by centimetres over these few kilometres and cancels. The zoom gives every packet its focal length, from the horizontal
field of view and a nominal 640 columns.
"""

from pathlib import Path

import numpy as np

from .sets import Converted, Rows, write_flight_folder

COLUMNS = 640
# One number in pixels for all zooms and both flights: what the narrower lens shows once the delays are known. The telemetry's own
# resolution (1/128 deg) is far finer; zoomed out, the turret slews and points worse by as much as the lens is wider.
SIGMA_PX = 12.0
# Delays may grow to this while packets keep their place between samples; a longer interval between packets is a gap.
MARGIN_S, MAX_GAP_S = 0.3, 0.5

_TOML = """format = 1
name = "misb_uas {name}"
epoch = "{epoch_us} microseconds UTC after 1970-01-01"
notes = NOTES

[pixel]
first_pixel_centre = 0.0

[pos]
angles = "roll_pitch_heading"
reference_point = "sensor"
max_gap_s = {max_gap_s}

[[chain]]
frame = "aircraft"
link = "trajectory"

[[chain]]
frame = "turret"
link = "mount"
angles_deg = [0.0, 0.0, 0.0]

[[chain]]
frame = "azimuth"
link = "turn"
axis = "z"
encoder = "azimuth"

[[chain]]
frame = "elevation"
link = "turn"
axis = "y"
encoder = "elevation"

[[chain]]
frame = "lens"
link = "axes"
axes = "y -z -x"

[camera]
kind = "frame"
principal_point_px = [{column}, {row}]

[[unknown]]
name = "turret roll"
where = "turret.angles_deg[0]"
prior_mean = 0.0
prior_sigma = 2.0

[[unknown]]
name = "turret pitch"
where = "turret.angles_deg[1]"
prior_mean = 0.0
prior_sigma = 2.0

[[unknown]]
name = "turret heading"
where = "turret.angles_deg[2]"
prior_mean = 0.0
prior_sigma = 2.0

[[unknown]]
name = "attitude delay"
where = "aircraft.attitude_delay_s"
prior_mean = 0.0
prior_sigma = 0.1

[[unknown]]
name = "encoder delay"
where = ["azimuth.delay_s", "elevation.delay_s"]
prior_mean = 0.0
prior_sigma = 0.1
"""

_NEEDED = (
    *("platform_heading", "platform_pitch", "platform_roll", "sensor_lat", "sensor_lon", "sensor_alt_msl", "hfov", "vfov"),
    *("rel_az", "rel_el", "slant_range", "fc_lat", "fc_lon", "fc_elev"),
)


def packets(source: Path) -> tuple[Rows, dict[str, int]]:
    """The packets that a flight can be made of, and how many are not among them."""
    rows = Rows(source)
    full = np.isfinite(rows.numbers(*_NEEDED)).all(axis=1)
    complete = rows.where(full)
    time = np.array([int(text) for text in complete.texts("time_us")])
    newest = np.maximum.accumulate(time)
    later = np.append(True, time[1:] > newest[:-1])
    counts = {"packets with blank cells": int((~full).sum()), "packets not later than the one before": int((~later).sum())}
    return complete.where(later), counts


def seconds(rows: Rows) -> np.ndarray:
    """Time since the first packet; the difference is taken in whole microseconds, so that nothing is rounded."""
    time = [int(text) for text in rows.texts("time_us")]
    return np.array([(t - time[0]) / 1e6 for t in time])


def covered(time_s: np.ndarray) -> np.ndarray:
    """Whether the record goes on without a gap for the margin before and after each time."""
    gap = np.diff(time_s) > MAX_GAP_S
    ends = [(time_s[0] - MARGIN_S, time_s[0]), (time_s[-1], time_s[-1] + MARGIN_S)]
    ends += list(zip(time_s[:-1][gap], time_s[1:][gap], strict=True))
    usable = np.ones(time_s.shape, dtype=bool)
    for start, end in ends:
        usable &= (time_s + MARGIN_S <= start) | (time_s - MARGIN_S >= end)
    return usable


def convert(source: Path, out: Path) -> Converted:
    """Write one of the set's files (cheyenne.csv, truck.csv) as a flight folder.

    Every packet is an image, its frame centre a control point that was seen at the principal point.
    """
    rows, counts = packets(source)
    time = seconds(rows)
    used = covered(time)
    counts["packets near the ends of the record or a gap, as observations: delays would leave the record"] = int((~used).sum())
    observed = rows.where(used)
    hfov, vfov = rows.numbers("hfov"), rows.numbers("vfov")
    focal = 0.5 * COLUMNS / np.tan(np.radians(hfov) / 2)
    lines = round(COLUMNS * float(np.median(np.tan(np.radians(vfov) / 2) / np.tan(np.radians(hfov) / 2))))
    column, row = 0.5 * (COLUMNS - 1), 0.5 * (lines - 1)
    images, names = rows.texts("packet"), observed.texts("packet")
    toml = _TOML.format(name=source.stem, epoch_us=rows.texts("time_us")[0], max_gap_s=MAX_GAP_S, column=column, row=row)
    tables = {
        "pos.csv": {
            "time_s": time,
            "lat_deg": rows.texts("sensor_lat"),
            "lon_deg": rows.texts("sensor_lon"),
            "height_m": rows.texts("sensor_alt_msl"),
            "roll_deg": rows.texts("platform_roll"),
            "pitch_deg": rows.texts("platform_pitch"),
            "heading_deg": rows.texts("platform_heading"),
        },
        "encoders.csv": {"time_s": time, "azimuth_deg": rows.texts("rel_az"), "elevation_deg": rows.texts("rel_el")},
        "images.csv": {
            "image": images,
            "time_s": time,
            "focal_px": focal,
            "columns": [COLUMNS] * len(rows),
            "rows": [lines] * len(rows),
        },
        "points.csv": {
            "point": [f"centre-{name}" for name in names],
            "lat_deg": observed.texts("fc_lat"),
            "lon_deg": observed.texts("fc_lon"),
            "height_m": observed.texts("fc_elev"),
            "role": ["control"] * len(observed),
        },
        "observations.csv": {
            "image": names,
            "point": [f"centre-{name}" for name in names],
            "line": [row] * len(observed),
            "sample": [column] * len(observed),
            "sigma_line_px": [SIGMA_PX] * len(observed),
            "sigma_sample_px": [SIGMA_PX] * len(observed),
        },
    }
    return write_flight_folder(out, toml, tables, counts)

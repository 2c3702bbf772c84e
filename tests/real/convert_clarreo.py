"""clarreo_gimbal_pushbroom: a spectrometer on the Space Station behind two turns and three mounts; simulated by LASP.

Positions are given in an inertial and in the earth-fixed frame, attitudes in the inertial one only. The rotation from one to the
other is found for each frame from the vectors that are given in both (Wahba's problem, solved by singular values), so that no
model of the Earth's rotation is needed. The mounts start from zero; the file with their true matrices is read on request alone.
"""

import json
from decimal import Decimal
from pathlib import Path

import numpy as np

from .sets import Converted, Rows, write_flight_folder

# Pixels of a look table: 480 across the 10 degrees that the looks span, one instrument pixel each.
PIXELS_PER_DEG, MIDDLE_PX = 48.0, 240.0
SIGMA_PX = 0.1
MOUNTS = ("base", "yoke", "head")
IMAGE = "scan"

_TOML = """format = 1
name = "clarreo_gimbal_pushbroom"
epoch = "{epoch} GPS seconds"
notes = NOTES

[pixel]
first_pixel_centre = 0.0

[pos]
angles = "quaternion"
reference_point = "centre of mass of the Space Station"
max_gap_s = {max_gap_s!r}

[[chain]]
frame = "station"
link = "trajectory"

[[chain]]
frame = "pedestal"
link = "mount"
lever_arm_m = {lever_arm_m}

[[chain]]
frame = "base"
{base}

[[chain]]
frame = "azimuth"
link = "turn"
axis = "y"
encoder = "azimuth"
sign = -1

[[chain]]
frame = "yoke"
{yoke}

[[chain]]
frame = "elevation"
link = "turn"
axis = "x"
encoder = "elevation"

[[chain]]
frame = "head"
{head}

[[chain]]
frame = "lens"
link = "axes"
axes = "y x -z"

[camera]
kind = "looks"
"""

_UNKNOWN_MOUNT = """link = "mount"
angles_deg = [0.0, 0.0, 0.0]
order = "xyz"
"""

_UNKNOWN = """
[[unknown]]
name = "{name}"
where = "{where}"
"""


def usable(source: Path) -> tuple[Rows, int]:
    """The frames whose time, gimbal, attitude and position are all there, and the number of the others."""
    frames = Rows(source / "frames.csv")
    vectors_of = [f"{name}_{axis}" for name in ("riss_j2000", "riss_ctrs", "rcprs_j2000", "rcprs_ctrs") for axis in "xyz"]
    needed = ["gps_time_s", "az_rad", "el_rad", *(f"q_j2000_sb_{c}" for c in "ijks"), *vectors_of]
    full = np.isfinite(frames.numbers(*needed)).all(axis=1)
    return frames.where(full), int((~full).sum())


def looks_of(frames: Rows) -> list[int]:
    """The numbers of the looks that the file has columns for."""
    columns = frames.cells[0]
    return [n for n in range(1, len(columns)) if f"ellipsoid_pix{n}_lat_deg" in columns]


def samples(source: Path) -> np.ndarray:
    """The sample of each look, in the order in which the set numbers them."""
    _, y, z = np.array(json.loads((source / "config.json").read_text())["pixel_unit_vectors_hs"], dtype=float).T
    return MIDDLE_PX + PIXELS_PER_DEG * np.degrees(np.arctan2(y, z))


def vectors(frames: Rows, name: str) -> np.ndarray:
    """Three columns as vectors, (frames, 3)."""
    return frames.numbers(*(f"{name}_{axis}" for axis in "xyz"))


def earth_fixed_from_inertial(frames: Rows) -> np.ndarray:
    """For each frame the rotation that takes the inertial vectors to the earth-fixed ones best, (frames, 3, 3)."""
    pairs = [(f"{who}_j2000", f"{who}_ctrs") for who in ("riss", "rcprs")]
    pairs += [(f"bhat_j2000_pix{n}", f"bhat_ctrs_pix{n}") for n in looks_of(frames)]
    total = np.zeros((len(frames), 3, 3))
    for inertial, fixed in pairs:
        a, b = vectors(frames, inertial), vectors(frames, fixed)
        both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        a, b = (v[both] / np.linalg.norm(v[both], axis=1, keepdims=True) for v in (a, b))
        total[both] += b[:, :, None] * a[:, None, :]
    left, _, right = np.linalg.svd(total)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right


def from_quaternion(q: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions x, y, z, w, (n, 3, 3)."""
    x, y, z, w = q.T
    return np.moveaxis(
        np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        ),
        -1,
        0,
    )


def to_quaternion(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions x, y, z, w of rotation matrices: the eigenvector of the largest eigenvalue (Bar-Itzhack 2000)."""
    r = rotation
    k = np.zeros((len(r), 4, 4))
    k[:, :3, :3] = r + np.swapaxes(r, 1, 2) - np.trace(r, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    k[:, 3, :3] = k[:, :3, 3] = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=-1)
    k[:, 3, 3] = np.trace(r, axis1=1, axis2=2)
    return np.linalg.eigh(k)[1][:, :, -1]


def _given_mounts(source: Path) -> list[str]:
    truth = {name: np.array(m) for name, m in json.loads((source / "alignment_dcms_truth.json").read_text()).items()}
    groups = (("C_BC_BA",), ("C_YA_YC", "C_YC_YE"), ("C_CE_CC", "C_CC_HC", "C_HC_HS"))
    matrices = [np.linalg.multi_dot([np.eye(3), *(truth[name] for name in names)]) for names in groups]
    return [f'link = "rotation"\nmatrix = {m.tolist()}\n' for m in matrices]


def convert(
    source: Path, out: Path, *, given_mounts: bool = False, priors: bool = True, prior_sigma_deg: float = 2.0
) -> Converted:
    """Write the set as a flight folder: one image whose lines are the frames, and points on the ellipsoid as control.

    **Arguments:** `given_mounts`: with the true matrices, and nothing unknown; `priors`: whether the nine angles have priors of
    zero +- `prior_sigma_deg`.
    """
    frames, incomplete = usable(source)
    config = json.loads((source / "config.json").read_text())
    stamps = [Decimal(text) for text in frames.texts("gps_time_s")]
    time = np.array([float(stamp - stamps[0]) for stamp in stamps])
    inertial_from_body = np.swapaxes(from_quaternion(frames.numbers(*(f"q_j2000_sb_{c}" for c in "ijks"))), 1, 2)
    attitude = to_quaternion(earth_fixed_from_inertial(frames) @ inertial_from_body)

    # In the instrument's frame the looks lie about +z; the camera looks along -z, its x is the instrument's y.
    looks = np.array(config["pixel_unit_vectors_hs"], dtype=float)
    sample = samples(source)
    order = np.argsort(sample)

    points = {name: [] for name in ("point", "lat_deg", "lon_deg", "height_m", "role")}
    measured = {name: [] for name in ("image", "point", "line", "sample", "sigma_line_px", "sigma_sample_px")}
    missing = 0
    for n in looks_of(frames):
        lat, lon = (frames.texts(f"ellipsoid_pix{n}_{name}_deg") for name in ("lat", "lon"))
        for line, where in enumerate(zip(lat, lon, strict=True)):
            if not all(where):
                missing += 1
                continue
            name = f"frame{line}-look{n}"
            for column, value in zip(points, (name, *where, 0.0, "control"), strict=True):
                points[column].append(value)
            for column, value in zip(measured, (IMAGE, name, line, sample[n - 1], SIGMA_PX, SIGMA_PX), strict=True):
                measured[column].append(value)

    mounts = _given_mounts(source) if given_mounts else [_UNKNOWN_MOUNT] * 3
    known = f"prior_mean = 0.0\nprior_sigma = {prior_sigma_deg}\n" if priors else f"scale = {prior_sigma_deg}\n"
    unknowns = [
        _UNKNOWN.format(name=f"{mount} {axis}", where=f"{mount}.angles_deg[{i}]") + known
        for mount in MOUNTS
        for i, axis in enumerate("xyz")
    ]
    toml = _TOML.format(
        epoch=stamps[0],
        # Frames stand on samples, so that nothing is interpolated; the limit only says what a gap would be.
        max_gap_s=1.5 * float(np.median(np.diff(time))),
        lever_arm_m=list(map(float, config["lever_arm_cprs_minus_iss_body_m"])),
        **dict(zip(MOUNTS, mounts, strict=True)),
    )
    tables = {
        "pos.csv": {
            "time_s": time,
            **dict(zip(("x_m", "y_m", "z_m"), vectors(frames, "riss_ctrs").T, strict=True)),
            **dict(zip(("qx", "qy", "qz", "qw"), attitude.T, strict=True)),
        },
        "encoders.csv": {
            "time_s": time,
            "azimuth_deg": np.degrees(frames.numbers("az_rad")),
            "elevation_deg": np.degrees(frames.numbers("el_rad")),
        },
        "looks.csv": {"sample": sample[order], "x": looks[order, 1], "y": looks[order, 0], "z": -looks[order, 2]},
        "images.csv": {"image": [IMAGE], "columns": [int(2 * MIDDLE_PX)], "rows": [len(frames)]},
        "lines.csv": {"image": [IMAGE] * len(frames), "line": range(len(frames)), "time_s": time},
        "points.csv": points,
        "observations.csv": measured,
    }
    counts = {"frames with blank telemetry": incomplete, "looks that miss the ellipsoid (blank)": missing}
    return write_flight_folder(out, toml + "".join([] if given_mounts else unknowns), tables, counts)

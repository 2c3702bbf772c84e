"""flight.toml as pydantic models: what may stand in it, and nothing else. docs/flight-folder.md explains every key."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from ..rules import import_extra

if TYPE_CHECKING:
    import pydantic
else:
    pydantic = import_extra("pydantic", "files")

Field = pydantic.Field


def _a_number(value: float) -> float:
    if value != value:
        raise ValueError("a number, or inf, is expected, not nan")
    return value


def _within_a_turn(value: float) -> float:
    if 360 < value < float("inf"):
        raise ValueError(f"360 degrees at most are expected, or inf, not {value:g}")
    return value


Two = Annotated[list[float], Field(min_length=2, max_length=2)]
Three = Annotated[list[float], Field(min_length=3, max_length=3)]
# An angle, or how well one is known: more than a whole turn is another unit.
Degrees = Annotated[float, Field(ge=-360, le=360)]
ThreeDegrees = Annotated[list[Degrees], Field(min_length=3, max_length=3)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]
Five = Annotated[list[float], Field(min_length=5, max_length=5)]
Positive = Annotated[float, Field(gt=0)]
# inf is a pose that nobody recorded, or an error that is never forgotten.
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=True), pydantic.AfterValidator(_a_number)]
SigmaDegrees = Annotated[NotNegative, pydantic.AfterValidator(_within_a_turn)]
Sign = Literal[1, -1]
Key = Literal["image", "swing", "view", "strip"]
Interpolation = Literal["linear", "cubic"]


class Model(pydantic.BaseModel):
    """Strict: no unknown keys, no text that happens to be a number, no infinities."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class WorldTable(Model):
    """[world]: what coordinates mean."""

    kind: Literal["wgs84", "local"] = "wgs84"
    origin: Three | None = None
    height_datum: str = "ellipsoidal"


class PixelTable(Model):
    """[pixel]: how the files number pixels."""

    first_pixel_centre: float = 0.0

    @pydantic.field_validator("first_pixel_centre")
    @classmethod
    def _is_a_convention(cls, value: float) -> float:
        if value not in (0.0, 0.5, 1.0):
            raise ValueError("0, 0.5 or 1 is expected: the number that the files give the centre of the first pixel")
        return value


class PosTable(Model):
    """[pos]: what holds for all POS and pose files."""

    file: str = "pos.csv"
    angles: Literal["roll_pitch_heading", "opk", "quaternion"] = "roll_pitch_heading"
    reference_point: str = ""
    max_gap_s: Positive | None = None


class EncoderColumn(Model):
    """Which column of which file holds an encoder's angle."""

    column: str
    file: str = "encoders.csv"


def _as_column(value: Any) -> Any:
    return {"column": value} if isinstance(value, str) else value


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class Link(Model):
    """What all links have: the frame that they lead to, its name left out inside the options of a `by`."""

    frame: str = ""


class TrajectoryLink(Link):
    """link = "trajectory"."""

    link: Literal["trajectory"]
    file: str | None = None
    max_gap_s: Positive | None = None
    delay_s: float | None = None
    attitude_delay_s: float | None = None
    interpolation: Interpolation = "linear"


class PosesLink(Link):
    """link = "poses"."""

    link: Literal["poses"]
    file: str = "poses.csv"


class MountLink(Link):
    """link = "mount"."""

    link: Literal["mount"]
    lever_arm_m: Three | None = None
    angles_deg: ThreeDegrees | None = None
    order: str = "xyz"
    lever_sign: Sign = 1


class AxesLink(Link):
    """link = "axes"."""

    link: Literal["axes"]
    axes: str


class RotationLink(Link):
    """link = "rotation"."""

    link: Literal["rotation"]
    matrix: Annotated[list[Three], Field(min_length=3, max_length=3)]


class TurnLink(Link):
    """link = "turn"."""

    link: Literal["turn"]
    axis: Literal["x", "y", "z"]
    encoder: Annotated[EncoderColumn, pydantic.BeforeValidator(_as_column)]
    sign: Sign = 1
    delay_s: float | None = None
    zero_deg: float | None = None
    gain: Positive | None = None
    polynomial_deg: Annotated[list[Degrees], Field(min_length=1)] | None = None
    max_gap_s: Positive | None = None
    interpolation: Interpolation = "linear"
    wraps: bool | None = None


_BASIS_KEYS = {
    "bias": (),
    "drift": ("start_s", "span_s"),
    "orientation_images": ("start_s", "spacing_s", "nodes"),
    "spline": ("start_s", "spacing_s", "nodes"),
    "random_walk": ("nodes_s", "start_sigma"),
    "ornstein_uhlenbeck": ("nodes_s", "correlation_s"),
    "smooth": ("nodes_s", "correlation_s"),
}


class Basis(Model):
    """How a correction varies in time."""

    kind: Literal["bias", "drift", "orientation_images", "spline", "random_walk", "ornstein_uhlenbeck", "smooth"]
    start_s: float | list[float] | None = None
    span_s: Positive | None = None
    spacing_s: Positive | None = None
    nodes: Annotated[int, Field(ge=4)] | list[Annotated[int, Field(ge=4)]] | None = None
    nodes_s: Annotated[list[float], Field(min_length=2)] | None = None
    start_sigma: Annotated[float, Field(ge=0)] | None = None
    correlation_s: Positive | None = None

    @pydantic.model_validator(mode="after")
    def _has_its_numbers(self) -> "Basis":
        needs = _BASIS_KEYS[self.kind]
        for name in dict.fromkeys(key for keys in _BASIS_KEYS.values() for key in keys):
            if (getattr(self, name) is not None) != (name in needs):
                raise ValueError(f"a {self.kind} basis has {' and '.join(needs) or 'no further key'}")
        if self.kind == "drift" and isinstance(self.start_s, list):
            raise ValueError("a drift has one start_s")
        return self


class CorrectionLink(Link):
    """link = "correction"."""

    link: Literal["correction"]
    basis: Basis
    turn_deg: list[ThreeDegrees] | None = None
    shift_m: list[Three] | None = None


class ByLink(Link):
    """link = "by"."""

    link: Literal["by"]
    key: Key
    options: "dict[str, AnyLink]"


AnyLink = Annotated[
    TrajectoryLink | PosesLink | MountLink | AxesLink | RotationLink | TurnLink | CorrectionLink | ByLink,
    Field(discriminator="link"),
]


class FrameCameraTable(Model):
    """kind = "frame"."""

    kind: Literal["frame"]
    principal_point_px: Two
    focal_px: Positive | None = None
    distortion: Five | None = None
    size_px: Two | None = None


class LineCameraTable(Model):
    """kind = "line"."""

    kind: Literal["line"]
    focal_px: Positive
    principal_sample_px: float
    offset_px: float = 0.0
    along: Literal["x", "y"] = "x"
    along_sign: Sign = 1
    across_sign: Sign = 1
    deformation_px: Annotated[list[Four], Field(min_length=2, max_length=2)] | None = None
    half_width_px: Positive = 1.0
    samples_px: Two | None = None
    wave_px: Annotated[list[Two], Field(min_length=2, max_length=2)] | None = None
    wavelength_px: Positive | None = None


class LooksCameraTable(Model):
    """kind = "looks"."""

    kind: Literal["looks"]
    file: str = "looks.csv"


class ByCameraTable(Model):
    """kind = "by"."""

    kind: Literal["by"]
    key: Key
    options: "dict[str, AnyCamera]"


AnyCamera = Annotated[
    FrameCameraTable | LineCameraTable | LooksCameraTable | ByCameraTable,
    Field(discriminator="kind"),
]


class RefractionTable(Model):
    """[refraction]: light is bent on its way to the ground."""

    scale: Annotated[float, Field(ge=0)] = 1.0
    wavelength_um: Positive = 0.55


class UnknownTable(Model):
    """[[unknown]]: one number to be estimated, in the units of the file."""

    name: Annotated[str, Field(min_length=1)]
    where: Annotated[list[str], Field(min_length=1), pydantic.BeforeValidator(_as_list)]
    prior_mean: float | None = None
    prior_sigma: Positive | None = None
    scale: Positive | None = None

    @pydantic.model_validator(mode="after")
    def _prior_or_scale(self) -> "UnknownTable":
        if (self.prior_mean is None) != (self.prior_sigma is None) or (self.prior_sigma is None) == (self.scale is None):
            raise ValueError("either prior_mean and prior_sigma, or scale is expected")
        return self


class ErrorTable(Model):
    """[[error]]: how the recorded pose of a frame errs."""

    frame: str
    turn_sigma_deg: Annotated[list[SigmaDegrees], Field(min_length=3, max_length=3)] | None = None
    shift_sigma_m: Annotated[list[NotNegative], Field(min_length=3, max_length=3)] | None = None
    correlation_s: NotNegative | Annotated[list[NotNegative], Field(min_length=6, max_length=6)] = 0.0
    anew: Literal["flight", "strip", "image", "swing", "view"] = "flight"
    axes: Literal["frame", "level"] = "frame"

    @pydantic.model_validator(mode="after")
    def _has_a_sigma(self) -> "ErrorTable":
        if self.turn_sigma_deg is None and self.shift_sigma_m is None:
            raise ValueError("turn_sigma_deg, shift_sigma_m or both are expected: three sigmas each, about or along x, y, z")
        return self


def _no_flag(value: object) -> object:
    if value is True:
        raise ValueError("Input should be 1")  # as which Python takes it
    return value


class FlightTable(Model):
    """The whole of flight.toml."""

    format: Annotated[Literal[1], pydantic.BeforeValidator(_no_flag)]
    name: str
    epoch: str = ""
    notes: str = ""
    world: WorldTable = WorldTable()
    pixel: PixelTable = PixelTable()
    pos: PosTable = PosTable()
    chain: Annotated[list[AnyLink], Field(min_length=1)]
    camera: AnyCamera
    refraction: RefractionTable | None = None
    unknown: list[UnknownTable] = Field(default_factory=list)
    error: list[ErrorTable] = Field(default_factory=list)


ByLink.model_rebuild()
ByCameraTable.model_rebuild()
FlightTable.model_rebuild()

LINKS = {
    "trajectory": TrajectoryLink,
    "poses": PosesLink,
    "mount": MountLink,
    "axes": AxesLink,
    "rotation": RotationLink,
    "turn": TurnLink,
    "by": ByLink,
    "correction": CorrectionLink,
}
CAMERAS = {"frame": FrameCameraTable, "line": LineCameraTable, "looks": LooksCameraTable, "by": ByCameraTable}
TABLES = {
    "world": WorldTable,
    "pixel": PixelTable,
    "pos": PosTable,
    "refraction": RefractionTable,
    "unknown": UnknownTable,
    "error": ErrorTable,
    "encoder": EncoderColumn,
    "basis": Basis,
}

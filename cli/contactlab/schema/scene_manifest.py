"""The manifest of a scene: how its model is simulated and judged."""

from math import pi
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from contactlab.schema.drive import Drive
from contactlab.schema.requirement import Requirements
from contactlab.schema.strict_model import Model, Number, Term, Whole, Word, about
from contactlab.schema.sweep_schema import Effects

_Limit = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class InitialValue(Model):
    """One external condition of a run, and how it sets the start state."""

    default: float
    unit: str
    description: str
    sets: dict[str, str] = about(
        "Coordinate to expression over initial values: `ball.z: drop_height + 0.05`. "
        "Coordinates are JOINT for a slide or hinge, JOINT.v for its velocity, and for a free "
        "joint JOINT.x, .y, .z, .qw, .qx, .qy, .qz, .vx, .vy, .vz, .wx, .wy, .wz.",
        default_factory=dict,
    )


class StructureValue(Model):
    """One number of the MJCF that changes the model's structure, set before it is compiled."""

    default: float
    unit: str
    description: str
    element: str = about("Path of the element, as xml.etree understands it.")
    attribute: str
    integer: bool = False
    least: float | None = about(
        "Smallest value; if not given, any above 0, or 1 for integers.", default=None
    )
    text: str = about(
        "The attribute's text: {} stands for the value, and braces may hold an "
        "expression over its name: `-{} {}` is a range, `0 {width / 2} 0` a position.",
        default="{}",
    )


class ControlEntry(Model):
    """A control, or a force on a body, over time: linear between knots.

    It is constant before the first knot and after the last. Two knots at one time are a jump to
    the later value.
    """

    at: tuple[Term, ...] = about(
        "Times of the knots [s]; each a number or an expression.", min_length=1
    )
    to: tuple[Term, ...] = about(
        "Values at the knots; each a number or an expression.", min_length=1
    )

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        if len(self.at) != len(self.to):
            message = f"{len(self.at)} times and {len(self.to)} values; give each time one value"
            raise ValueError(message)
        return self


class HoldEntry(Model):
    """The hold of the scene's subject: its times and its holder."""

    start: Term = about("Start of the hold [s].", alias="from")
    stop: Term = about("End of the hold [s].", alias="to")
    relative_to: str | None = about("The body that holds it; the world if not given.", default=None)


class PairEntry(Model):
    """Contact pairs to monitor (two geoms, two bodies, or neighbors in a chain of geoms)."""

    geoms: tuple[str, str] | None = None
    bodies: tuple[str, str] | None = None
    chain: tuple[str, ...] | None = about(
        "Geom names or patterns; each geom is paired with the next.", default=None
    )
    slots: int | None = about(
        "Contacts recorded per step; derived from the shapes if not given.",
        default=None,
        ge=1,
        le=64,
    )


class Perturbation(Model):
    """Perturbation of the start state by a seed: a uniform offset in [-scale, scale] for each."""

    coordinates: tuple[str, ...] | dict[str, Annotated[Number, Field(gt=0)]] = about(
        "names, or names with a size of each in units of the scale"
    )
    scale: float = about("m, rad, m/s or rad/s, depending on the coordinate.", default=1.0, gt=0)


class OracleEntry(Model):
    """The closed form that the scene is measured against."""

    name: str
    tolerance: float = Field(gt=0)
    derivation: str = about("Source of the tolerance.")


_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "rad": 1.0, "deg": pi / 180, **_TIMES}
"""Units that a recording may have, in m, rad and s."""


class RecordingUnits(Model):
    """Units of a recording's columns; rates are per second."""

    length: Literal["m", "cm", "mm"]
    angle: Literal["rad", "deg"]
    time: Literal["s", "ms", "us", "ns"]


class RecordingFrame(Model):
    """Pose of a recording's frame in the world."""

    position: tuple[Number, Number, Number] = about("its origin [m]")
    quaternion: tuple[Number, Number, Number, Number] = about("its orientation: w, x, y, z")


class RecordedStart(Model):
    """The row of a recorded run that its simulation starts from; the first unless it says more."""

    time: Annotated[Number, Field(ge=0)] = about("seconds after the first row", default=0.0)
    before_contact: Annotated[Whole, Field(ge=0)] | None = about(
        "rows before the bounding sphere of a free body touches something; with the velocity of "
        "its flight until then, if that has four rows or more",
        default=None,
    )
    lag: Annotated[Whole, Field(ge=0)] = about(
        "number of rows from the velocity of the flight to the pose", default=0
    )


class Recording(Model):
    """Recorded motion that runs start from and are compared with."""

    file: Word = about("a .csv, .parquet, .arrow, .npz or .mcap file next to the manifest")
    run: Word | None = about("column of the number of the recorded run", default=None)
    time: Word = about("column of the time", default="time")
    columns: dict[str, Word] = about(
        "coordinate, or ACTUATOR.ctrl, to its column; left out, columns are named so", default={}
    )
    units: RecordingUnits
    frame: Literal["world"] | RecordingFrame = about("of positions and velocities", default="world")
    turning: Literal["body", "world"] = about("frame of angular velocities", default="body")
    start: RecordedStart = RecordedStart()
    leave_out: tuple[Whole, ...] = about("recorded runs that are not used", default=())


class SceneManifest(Model):
    """Simulation and judgement of a scene's model (`scene.yaml` next to the MJCF)."""

    version: Literal[1]
    title: str = ""
    description: str = ""
    model: str = about("The MJCF or URDF file, relative to here.", default="scene.xml")
    environment: Word | None = about(
        "Source of the model instead: FILE.py:FACTORY, or an id of Gymnasium.", default=None
    )
    duration: float | None = about(
        "Simulated time of a run [s]; by default that of the model's task.", default=None, gt=0
    )
    subject: str | None = about("The body that the mass axis sets.", default=None)
    keyframe: str | None = about(
        "Keyframe to start from, or qpos0; by default the one of the model without a manifest.",
        default=None,
    )
    pairs: tuple[PairEntry, ...] = ()
    initial: dict[str, InitialValue] = Field(default_factory=dict)
    structure: dict[str, StructureValue] = Field(default_factory=dict)
    control: dict[str, ControlEntry] = about(
        "Coordinates ACTUATOR.ctrl, or BODY.fx, .fy, .fz, .tx, .ty, .tz, to their "
        "values over time; expressions are over initial values.",
        default_factory=dict,
    )
    drive: Drive = about(
        "Drive of a run besides `control`, unless the sweep sets another.", default="none"
    )
    recording: Recording | None = about(
        "Recorded motion: each of its runs is a value of the axis `recorded_run`.", default=None
    )
    hold: HoldEntry | None = None
    perturb: Perturbation | None = None
    must: Requirements = about(
        "Requirements of every run, in words: `held(mug, by: hand)`, `still(box, 1 mm)`, "
        "`upright(torso)`, `passes(peg, hole)`, `stays(box, 10 mm)`; of contact, `sticks(box)`, "
        "`slides(floor-box, first)`, `rolls(ball)`, `apart(finger-palm)`, "
        "`presses(pad-box, 1..5 N)`, `shallow(floor-*, 1 mm)`.",
        default=(),
        exclude_if=lambda must: not must,
    )
    oracle: OracleEntry | None = None
    effects: Effects = about(
        "`auto` (the default) leaves out parts that provably change nothing, `all` leaves "
        "out nothing; or effect name to true or false, with `base` for the others.",
        default_factory=dict,
    )
    tolerances: dict[str, _Limit] = Field(default_factory=dict)
    thresholds: dict[str, _Limit] = Field(default_factory=dict)

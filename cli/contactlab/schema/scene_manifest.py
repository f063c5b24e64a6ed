"""The manifest of a scene: how its model is simulated and judged."""

from typing import Literal, Self

from pydantic import Field, model_validator

from contactlab.schema.drive import Drive
from contactlab.schema.pair_expectation import ExpectedModes, PairExpectation, Term
from contactlab.schema.strict_model import Model
from contactlab.schema.sweep_schema import Effects


class InitialValue(Model):
    """One external condition of a run, and how it sets the start state."""

    default: float
    unit: str
    description: str
    sets: dict[str, str] = Field(
        default_factory=dict,
        description="Coordinate to expression over initial values: `ball.z: drop_height + 0.05`. "
        "Coordinates are JOINT for a slide or hinge, JOINT.v for its velocity, and for a free "
        "joint JOINT.x, .y, .z, .qw, .qx, .qy, .qz, .vx, .vy, .vz, .wx, .wy, .wz.",
    )


class StructureValue(Model):
    """One number of the MJCF that changes the model's structure, set before it is compiled."""

    default: float
    unit: str
    description: str
    element: str = Field(description="Path of the element, as xml.etree understands it.")
    attribute: str
    integer: bool = False
    least: float | None = Field(
        default=None, description="Smallest value; if not given, any above 0, or 1 for integers."
    )
    text: str = Field(
        default="{}",
        description="The attribute's text: {} stands for the value, and braces may hold an "
        "expression over its name: `-{} {}` is a range, `0 {width / 2} 0` a position.",
    )


class ControlEntry(Model):
    """A control, or a force on a body, over time: linear between knots.

    It is constant before the first knot and after the last. Two knots at one time are a jump,
    at which the later value holds.
    """

    at: tuple[Term, ...] = Field(
        min_length=1, description="Times of the knots [s]; each a number or an expression."
    )
    to: tuple[Term, ...] = Field(
        min_length=1, description="Values at the knots; each a number or an expression."
    )

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        if len(self.at) != len(self.to):
            message = f"{len(self.at)} times and {len(self.to)} values; give each time one value"
            raise ValueError(message)
        return self


class HoldEntry(Model):
    """When the scene's subject is held, and by what."""

    start: Term = Field(alias="from", description="Start of the hold [s].")
    stop: Term = Field(alias="to", description="End of the hold [s].")
    relative_to: str | None = Field(
        default=None, description="The body that holds it; the world if not given."
    )


class PairEntry(PairExpectation):
    """Contact pairs to monitor (two geoms, two bodies, or neighbours in a chain of geoms).

    What it expects holds for them; without them, for pairs that other entries monitor.
    """

    geoms: tuple[str, str] | None = None
    bodies: tuple[str, str] | None = None
    chain: tuple[str, ...] | None = Field(
        default=None, description="Geom names or patterns; each geom is paired with the next."
    )
    slots: int | None = Field(
        default=None,
        ge=1,
        le=64,
        description="Contacts recorded per step; derived from the shapes if not given.",
    )

    @property
    def monitors(self) -> bool:
        """Whether it names pairs to monitor."""
        return not (self.geoms is None and self.bodies is None and self.chain is None)


class Perturbation(Model):
    """How a seed perturbs the start state: a uniform offset in [-scale, scale] for each."""

    coordinates: tuple[str, ...]
    scale: float = Field(gt=0, description="m, rad, m/s or rad/s, depending on the coordinate.")


class OracleEntry(Model):
    """The closed form that the scene is measured against."""

    name: str
    tolerance: float = Field(gt=0)
    derivation: str = Field(description="Where the tolerance comes from.")


class SceneManifest(Model):
    """How a scene's model is simulated and judged (`scene.yaml` beside the MJCF)."""

    version: Literal[1]
    title: str
    description: str
    model: str = Field(default="scene.xml", description="The MJCF or URDF file, relative to here.")
    duration: float = Field(gt=0, description="Simulated time of a run [s].")
    subject: str | None = Field(default=None, description="The body that the mass axis sets.")
    keyframe: str | None = Field(default=None, description="Keyframe to start from.")
    pairs: tuple[PairEntry, ...] = ()
    initial: dict[str, InitialValue] = Field(default_factory=dict)
    structure: dict[str, StructureValue] = Field(default_factory=dict)
    control: dict[str, ControlEntry] = Field(
        default_factory=dict,
        description="Coordinates ACTUATOR.ctrl, or BODY.fx, .fy, .fz, .tx, .ty, .tz, to their "
        "values over time; expressions are over initial values.",
    )
    drive: Drive = Field(
        default="none",
        description="What drives a run besides `control`, unless the sweep says otherwise.",
    )
    hold: HoldEntry | None = None
    perturb: Perturbation | None = None
    modes: ExpectedModes = Field(
        default=ExpectedModes(), description="`mode: {first, last}` of all monitored pairs."
    )
    oracle: OracleEntry | None = None
    effects: Effects = Field(
        default_factory=dict,
        description="`auto` (the default) leaves out what provably changes nothing, `all` leaves "
        "out nothing; or effect name to true or false, with `base` for the others.",
    )
    tolerances: dict[str, float] = Field(default_factory=dict)
    thresholds: dict[str, float] = Field(default_factory=dict)

"""A scene's manifest: what is asked of its model."""

from typing import Literal

from pydantic import Field

from contactlab.schema.model import Model


class InitialValue(Model):
    """One thing the world chooses before a run, and where it goes in the start state."""

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
    """One number of the MJCF that changes the model's structure, written before it is parsed."""

    default: float
    unit: str
    description: str
    element: str = Field(description="Path of the element, as xml.etree understands it.")
    attribute: str
    integer: bool = False


class PairEntry(Model):
    """Graded contact pairs: two geoms, two bodies, or neighbours in a chain of geoms."""

    geoms: tuple[str, str] | None = None
    bodies: tuple[str, str] | None = None
    chain: tuple[str, ...] | None = Field(
        default=None, description="Geom names or patterns; each geom is paired with the next."
    )
    slots: int | None = Field(
        default=None, ge=1, le=64, description="Contacts recorded; by the shapes if not given."
    )


class Perturbation(Model):
    """What a seed changes in the start state: a uniform offset in [-scale, scale] for each."""

    coordinates: tuple[str, ...]
    scale: float = Field(gt=0, description="m, rad, m/s or rad/s, as the coordinate has it.")


class ExpectedModes(Model):
    """Whether the graded pairs should stick or slide when first and last in contact."""

    first: Literal["stick", "slide"] | None = None
    last: Literal["stick", "slide"] | None = None


class OracleEntry(Model):
    """The closed form that the scene is held against."""

    name: str
    tolerance: float = Field(gt=0)
    derivation: str = Field(description="Where the tolerance comes from.")


class SceneManifest(Model):
    """What is asked of a scene's model (`scene.yaml` beside the MJCF)."""

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
    perturb: Perturbation | None = None
    modes: ExpectedModes = ExpectedModes()
    oracle: OracleEntry | None = None
    tolerances: dict[str, float] = Field(default_factory=dict)
    thresholds: dict[str, float] = Field(default_factory=dict)

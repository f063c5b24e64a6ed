"""One run as it is drawn: bodies, their poses over time, and the forces at their contacts."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats, Integers


class Form(StrEnum):
    """The form of a shape."""

    box = "box"
    ellipsoid = "ellipsoid"
    cylinder = "cylinder"
    mesh = "mesh"


@dataclass(frozen=True)
class BodyShape:
    """A rigid part of a body.

    Attributes:
        name: unique in the model.
        body: index of its body.
        form: what it is; a cylinder's axis is its z axis.
        size: (3,) full extents along its own axes [m]; ones for a mesh.
        position: (3,) of its centre in the body's frame [m].
        rotation: (4,) unit quaternion w, x, y, z to the body's frame.
        colour: (4,) red, green, blue and opacity, 0 to 1.
        vertices: (V, 3) of a mesh in its own frame [m]; else none.
        triangles: (T, 3) indices of a mesh's vertices; else none.
    """

    name: str
    body: int
    form: Form
    size: Floats
    position: Floats
    rotation: Floats
    colour: Floats
    vertices: Floats
    triangles: Integers


@dataclass(frozen=True)
class ContactForces:
    """K contact forces, each shown in one frame, in the order of the frames.

    Attributes:
        frame: (K,) index of the frame.
        pair: (K,) index of the monitored pair.
        mode: (K,) STICK or SLIDE, of the pair.
        position: (K, 3) contact point, world frame [m].
        force: (K, 3) force on the pair's second side, world frame [N].
    """

    frame: NDArray[np.intp]
    pair: NDArray[np.intp]
    mode: NDArray[np.int8]
    position: Floats
    force: Floats

    def of(self, frame: int) -> slice:
        """Return where the forces of a frame are."""
        start, stop = np.searchsorted(self.frame, (frame, frame + 1))
        return slice(int(start), int(stop))


@dataclass(frozen=True)
class BodyMotion:
    """F frames of a run with B bodies, the first of which is the world.

    Attributes:
        bodies: (B) their names.
        moving: (B,) whether each can move.
        shapes: what they look like.
        rows: (F,) the state row of each frame.
        time: (F,) simulated time [s].
        positions: (F, B, 3) of the bodies' frames, world frame [m].
        rotations: (F, B, 4) unit quaternions w, x, y, z to the world frame.
        pairs: names of the monitored pairs.
        forces: contact forces; of each pair and frame those of the step with the largest, up to
            the next frame.
        centre: (3,) of the sphere that holds what is worth looking at, world frame [m].
        radius: of that sphere [m].
        scale: length of an arrow for a newton [m/N].
        longest: length at which arrows are cut [m].
    """

    bodies: tuple[str, ...]
    moving: NDArray[np.bool_]
    shapes: tuple[BodyShape, ...]
    rows: NDArray[np.intp]
    time: Floats
    positions: Floats
    rotations: Floats
    pairs: tuple[str, ...]
    forces: ContactForces
    centre: Floats
    radius: float
    scale: float
    longest: float

    @property
    def arrows(self) -> Floats:
        """(K, 3) the contact forces as arrows, world frame [m]."""
        arrows = self.forces.force * self.scale
        lengths = np.linalg.norm(arrows, axis=1, keepdims=True)
        return arrows * np.minimum(1.0, self.longest / np.maximum(lengths, np.finfo(float).tiny))

"""Where a model's joints lie in its configuration, and how long their degrees of freedom are."""

from dataclasses import dataclass

from contactlab.contact.arrays import Floats


@dataclass(frozen=True)
class Joints:
    """The joints of a model, by the form of their part of qpos.

    Attributes:
        scalars: places in qpos of slides and hinges.
        lengths: (scalars,) what turns their difference into metres: 1 for a slide [1], for a
            hinge the reach of what it moves [m].
        points: where the position of a free joint starts in qpos.
        rotations: where a unit quaternion starts in qpos.
        reaches: (rotations,) what turns their angle into metres: the reach of what turns [m].
    """

    scalars: tuple[int, ...]
    lengths: Floats
    points: tuple[int, ...]
    rotations: tuple[int, ...]
    reaches: Floats

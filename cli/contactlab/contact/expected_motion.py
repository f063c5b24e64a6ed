"""Required motion of bodies in a group of runs, and their poses in runs."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from contactlab.contact.required_words import MotionWord
from contactlab.contact.trace_arrays import Floats

Placing = Callable[[Floats], tuple[Floats, Floats]]
"""Takes configurations (M, nq); returns positions (M, 3) [m] and rotations (M, 4), unit quaternions
w x y z, of a body in the frame of another."""


@dataclass(frozen=True)
class ExpectedMotion:
    """Required motion of a body in n runs, judged by its pose in the frame of a body or site."""

    name: str  # the text of the requirement
    word: MotionWord
    window: Floats  # (n, 2) start and end [s]
    limit: float  # [m], or [rad] for an angle
    angular: bool
    placing: tuple[Placing, ...]  # for each run; in the world's frame unless held or passing
    up: Floats  # (n, 3) unit vector against gravity; along z without gravity [world]
    axis: Floats  # (n, 3) the same in the frame of the body in the model's default pose
    reach: float  # reach of the body from its frame [m]
    pairs: tuple[int, ...] = ()  # for a held body: the pairs between it and its holder

    def select(self, rows: list[int]) -> "ExpectedMotion":
        """Return the requirement for some of the runs."""
        return replace(
            self,
            window=self.window[rows],
            up=self.up[rows],
            axis=self.axis[rows],
            placing=tuple(self.placing[row] for row in rows),
        )

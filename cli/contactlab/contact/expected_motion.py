"""What bodies should do in a group of runs, and where runs have them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from contactlab.contact.required_words import MotionWord
from contactlab.contact.trace_arrays import Floats

Placing = Callable[[Floats], tuple[Floats, Floats]]
"""Takes configurations (M, nq); returns positions (M, 3) [m] and rotations (M, 4), unit quaternions
w x y z, of a body in the frame of another."""


@dataclass(frozen=True)
class ExpectedMotion:
    """What a body should do in n runs; judged on its pose in the frame of a body or site."""

    name: str  # the words that say it
    word: MotionWord
    window: Floats  # (n, 2) from when to when [s]
    limit: float  # [m], or [rad] where it is one of an angle
    angular: bool
    placing: tuple[Placing, ...]  # of each run; in the world's frame unless held or passing
    up: Floats  # (n, 3) unit vector against gravity; along z without gravity [world]
    axis: Floats  # (n, 3) the same in the frame of the body in the model's default pose
    reach: float  # how far the body reaches from its frame [m]
    pairs: tuple[int, ...] = ()  # where a body is held: what it touches its holder with

    def select(self, rows: list[int]) -> "ExpectedMotion":
        """Return what some of the runs should do."""
        return replace(
            self,
            window=self.window[rows],
            up=self.up[rows],
            axis=self.axis[rows],
            placing=tuple(self.placing[row] for row in rows),
        )

"""The sweeps that are measured.

No effect is left out, so that the bare engine steps the same models, bit for bit.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """A sweep to measure.

    Attributes:
        name: what the table calls it.
        sweep: the sweep file's text, its seeds left open.
        rows: runs of each seed.
        seeds: the larger and the smaller size.
        part: the same for the loops in Python, in runs.
    """

    name: str
    sweep: str
    rows: int
    seeds: tuple[int, int]
    part: tuple[int, int]

    @property
    def runs(self) -> tuple[int, int]:
        """The larger and the smaller size in runs."""
        large, small = self.seeds
        return large * self.rows, small * self.rows


BALL = """\
version: 1
scene: ball_drop
axes:
  restitution: {values: [0.6, 0.75, 0.9], role: scenario}
  drop_height: {values: [0.5, 0.75, 1.0, 2.0], role: scenario}
effects: all
checks: none
"""
STACK = """\
version: 1
scene: box_stack
axes:
  boxes: [BOXES]
effects: all
checks: none
"""
# One body that falls: a step takes so little that all else shows.
FALL = """\
version: 1
scene: free_fall
effects: all
checks: none
"""
# Fifty boxes in columns, every pair of which is monitored.
COLUMNS = """\
version: 1
scene: columns
effects: all
checks: none
"""
# Those that take less time come first.
CASES = (
    Case("free fall", FALL, 1, (256, 64), (48, 16)),
    Case("five boxes", STACK.replace("BOXES", "5"), 1, (64, 16), (12, 4)),
    Case("ball", BALL, 12, (64, 16), (48, 16)),
    Case("50 boxes, all pairs", COLUMNS, 1, (48, 12), (6, 2)),
)

"""Where runs start, and what acts on them from outside."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from contactlab.contact import Floats


class Starts(NamedTuple):
    """Start states of n runs, and what acts on them.

    Controls followed by `applied` are the inputs. P of them are driven: each follows straight
    lines between its K knots, whatever it is at the start. The others are constant.

    Attributes:
        qpos: (n, nq) configuration.
        qvel: (n, nv) velocity.
        ctrl: (n, nu) control at the start.
        applied: (n, 6 nbody) force [N] and torque [N m] on each body at the start, world frame.
        driven: (n, P) places, among the inputs, of those that change over time.
        knots: (n, P, K) times of their knots [s], never decreasing.
        levels: (n, P, K) what they are at their knots.
        act: (n, na) activation of the actuators that have one, at the start.
    """

    qpos: Floats
    qvel: Floats
    ctrl: Floats
    applied: Floats
    driven: np.ndarray
    knots: Floats
    levels: Floats
    act: Floats

    def pick(self, run: int) -> "Starts":
        """Return the start state of one run, n being 1."""
        return self.rows([run])

    def rows(self, runs: Sequence[int]) -> "Starts":
        """Return the start states of some runs."""
        return Starts(*(array[list(runs)] for array in self))

    @classmethod
    def joined(cls, starts: Sequence["Starts"]) -> "Starts":
        """Return the start states of several, one after the other."""
        return cls(*(np.concatenate(arrays) for arrays in zip(*starts, strict=True)))

    def inputs(self, run: int, timestep: float, steps: np.ndarray) -> Floats:
        """Return (T, nu + 6 nbody) the inputs of one run during some steps.

        Step k has the inputs of time k timestep [s], counted rather than summed; k need not be
        whole. Before its first knot an input has the first level, after the last the last; where
        two knots are at one time, the later one counts.
        """
        constant = np.concatenate([self.ctrl[run], self.applied[run]])
        inputs = np.tile(constant, (len(steps), 1))
        lines = zip(self.driven[run], self.knots[run], self.levels[run], strict=True)
        for place, knots, levels in lines:
            inputs[:, place] = np.interp(steps * timestep, knots, levels)
        return inputs

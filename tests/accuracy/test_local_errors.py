"""Errors of restarts are those of a closed form: where they begin, how long they last, how many."""

from typing import Any

import numpy as np
import pytest

RATE, LONGEST, DURATION = 2.0, 0.04, 0.32  # 1/s, s, s
# What slows down alone: v' = -RATE v.
DECAY = f"""
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody><body><joint type="slide" damping="{RATE}"/>
    <geom size=".1" mass="1" contype="0" conaffinity="0"/></body></worldbody>
  <keyframe><key qvel="1"/></keyframe>
</mujoco>
"""
SWEEP = f"""
version: 1
scene: model.xml
duration: {DURATION}
drive: none
axes: {{timestep: [1.0e-2, 2.0e-2, {LONGEST}]}}
trace: none
checks: none
accuracy: {{error: local, refine: 4}}
"""


def test_restarts_err_as_a_decay_says(sweeper: Any) -> None:
    """Each lasts as long as the longest timestep, and they cover the run from start to end.

    From speed v, the way in a time T is v (1 - exp(-RATE T)) / RATE; Euler, which MuJoCo makes
    implicit in damping, divides v by 1 + RATE h before each of its T / h steps. The error is their
    difference, in proportion to v = exp(-RATE t) at the begin. There is a restart at each step that
    leaves as much time, since there are fewer than 32. The reference is RK4 at an eighth of the
    least step, off by (RATE h)^5 / 120 = 1e-15 a step.
    """
    (sweeper.folder / "model.xml").write_text(DECAY)
    sweeper.run(SWEEP)
    for row in sweeper.rows():
        step = row["timestep"]
        inside, total = round(LONGEST / step), round(DURATION / step)
        begins = step * np.arange(total - inside + 1)
        way = step * ((1 + RATE * step) ** -np.arange(1.0, inside + 1)).sum()
        errors = abs((1 - np.exp(-RATE * LONGEST)) / RATE - way) * np.exp(-RATE * begins)
        found = [row[f"error_{name}"] for name in ("peak", "mean", "final")]
        assert found == pytest.approx([errors.max(), errors.mean(), errors[-1]], rel=1e-7)

"""A box that turns as it slides: real rollouts."""

import numpy as np
import pytest

from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene


@pytest.mark.parametrize("direction", [0.0, 11.0, 22.5, 33.0, 45.0])
def test_a_slide_to_rest_is_one_switch_in_every_direction(direction: float) -> None:
    """The contacts of a turning box pull in different directions; it slides all the same."""
    scene = Scene.open("box_slide")
    run = scene.resolve({"direction": direction}, 0, None)
    base = scene.base(run.structure)
    prepared = base.prepare(run.list_edits())
    rollout = roll_out([prepared.model], scene.initial_states([run]), run.steps, Buffers())
    trace = make_trace(base, [prepared], rollout)
    setup = make_setup(base, scene.source.manifest, [run], [prepared.model], {})
    assert assess_runs(trace, setup).metrics["mode_switches"] * run.duration == np.array([1.0])

"""A run's model as it is written, without the sensors that record."""

from dataclasses import replace

import mujoco

from contactlab.scene.compile_model import compile_model
from contactlab.scene.effects import is_straight, remove
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.resolved import ResolvedRun
from contactlab.scene.scene import Scene


def compile_without_sensors(scene: Scene, run: ResolvedRun) -> mujoco.MjModel:
    """Compile the structure of a run without the sensors that record."""
    return compile_model(scene.source, run.structure, lambda spec: remove(spec, run.without))


def prepare_without_sensors(
    scene: Scene, run: ResolvedRun, start: InitialStates, compiled: mujoco.MjModel
) -> mujoco.MjModel:
    """Return a copy of a compiled structure with all that makes it the run's own model.

    Args:
        scene: the run's.
        run: the run.
        start: its start state, n being 1.
        compiled: its structure, from `compile_plain`.
    """
    base = replace(scene.base_of(run), model=compiled)
    straight = is_straight(compiled, start)
    return base.prepare(run.edits(), run.effect_request, straight=straight).model

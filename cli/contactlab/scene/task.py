"""Infers the task of a compiled model, which every study uses.

The task starts from the first of these that a model has: a named keyframe; the first keyframe with
controls, applied as its author wrote them. Otherwise it has two phases from the first keyframe, or
from the reference configuration.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.printable import first_names
from contactlab.scene.drive.signals import pushed_bodies
from contactlab.scene.model_names import name_of
from contactlab.schema.drive import Drive
from contactlab.schema.task import DEFAULT_TOLERANCE, QPOS0, SEEDS, Phase, Task

_REST_SECONDS, _EXCITATION_SECONDS = 1.0, 2.0


def keyframe_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names or addresses of a model's keyframes, without merely reserved ones."""
    names = (model.key(index).name for index in range(model.nkey))
    return tuple(name for name in names if name)


def has_controls(model: mujoco.MjModel, keyframe: str) -> bool:
    """Return whether a keyframe has controls, that is, any control other than 0."""
    return keyframe != QPOS0 and bool(np.any(model.key_ctrl[model.key(keyframe).id]))


def default_start_keyframe(model: mujoco.MjModel) -> str:
    """Return the first keyframe with controls; otherwise the first one; otherwise `QPOS0`."""
    keyframes = keyframe_names(model)
    own = (name for name in keyframes if has_controls(model, name))
    return next(own, next(iter(keyframes), QPOS0))


def infer_drive(model: mujoco.MjModel, keyframe: str) -> Drive:
    """Return the drive of a model from a start: its constant controls, or otherwise an exercise."""
    return "none" if has_controls(model, keyframe) else "exercise"


def describe_excitation(model: mujoco.MjModel) -> str:
    """Return the inputs of a model's excitation, in words."""
    inputs = (("sines", model.nu), ("pushes", len(pushed_bodies(model))))
    return " and ".join(word for word, count in inputs if count) or "rest: nothing to drive"


def rest_time(duration: float) -> float:
    """Return the rest time before the excitation [s]: a third of the duration, at most 1 s."""
    return min(_REST_SECONDS, duration / 3)


def check_motion(model: mujoco.MjModel) -> None:
    """Check that something moves. Raises a SceneError that tells how to fix the model."""
    if not model.nv or not np.any(model.body_mass[model.body_weldid > 0] > 0):
        raise SceneError(
            "the model has no movable body with mass, so there is nothing to judge; give a body a "
            "<joint/> or <freejoint/> and a geom, in a URDF a floating joint to a link named world"
        )


def infer_task(
    model: mujoco.MjModel,
    *,
    start: str | None = None,
    drive: Drive = "auto",
    duration: float | None = None,
    watch: Sequence[str] = (),
    within: tuple[float, str] | None = None,
    seeds: Sequence[int] = SEEDS,
    programmed: bool = False,
) -> Task:
    """Return the task of a compiled model; arguments replace inferred values.

    It takes 2 s, or 3 s if it has two phases: 1 s at rest, then 2 s of excitation. All bodies are
    observed, with a tolerance of 10 %. A SceneError names a keyframe or a body that the model
    lacks.
    """
    begin = start or default_start_keyframe(model)
    keyframes = (*keyframe_names(model), QPOS0)
    SceneError.unless_known(begin, keyframes, f"the model has no keyframe '{begin}'")
    bodies = [name_of(model, "body", index) for index in range(model.nbody)]
    for name in watch:
        has = first_names(f"it has: {', '.join(bodies[1:])}")
        message = f"the model has no body '{name}' to observe"
        SceneError.unless_known(name, bodies, message, f"; {has}")
    moving = infer_drive(model, begin) if drive == "auto" else drive
    two = moving == "exercise"
    held_duration = 2.0  # of a task with one phase [s], as long as an excitation
    seconds = duration or (_REST_SECONDS + _EXCITATION_SECONDS if two else held_duration)
    if two:
        rest = rest_time(seconds)
        phases = (
            Phase(name="rest", begin=0, end=rest),
            Phase(name="excitation", begin=rest, end=seconds),
        )
    else:
        name = "held" if moving in ("none", "hold") else "driven"
        phases = (Phase(name=name, begin=0, end=seconds),)
    share, unit = within or (DEFAULT_TOLERANCE, "1")
    return Task.model_validate(
        {
            "start": begin,
            "drive": moving,
            "own_controls": has_controls(model, begin),
            "programmed": programmed,
            "excitation": describe_excitation(model),
            "duration": float(seconds),
            "phases": phases,
            "observed": tuple(watch),
            "tolerance": float(share),
            "unit": unit,
            "seeds": tuple(seeds),
        }
    )

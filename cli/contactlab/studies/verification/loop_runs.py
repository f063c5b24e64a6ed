"""Builds the runs of a model under a policy, which acts in the loop of each of them.

A replay of recorded controls is another experiment: it says nothing about a loop that oscillates.
So original, changed model, reference and twin each have their own policy, called at its own rate.
"""

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import mujoco

from contactlab.modifications.model_changes import converge_solver
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.task import Task
from contactlab.studies.verification.runs import NUDGE, REFERENCE_RATE, PairedRun
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.stress_motions import TILT_DEGREES, tilt_model

Change = Callable[[mujoco.MjModel], mujoco.MjModel]


def has_policy(checked: CheckedModel) -> bool:
    """Return whether a policy drives a model's task."""
    return isinstance(checked.scene.drive.drive, PolicyDrive)


@dataclass(frozen=True)
class LoopRuns:
    """The closed loops of a model and a changed one.

    Attributes:
        original, changed: the models.
    """

    original: CheckedModel
    changed: CheckedModel

    def build_task_runs(self, name: str, task: Task) -> Iterator[PairedRun]:
        """Yield one run for each phase of a task."""
        yield from self._build_runs(name, task, copy.copy)

    def build_tilted_runs(self, task: Task) -> Iterator[PairedRun]:
        """Yield the task's phases with gravity tilted two ways."""
        for name, sign in (
            (f"task tilted by {TILT_DEGREES:g} degrees", 1.0),
            ("task tilted the other way", -1.0),
        ):
            yield from self._build_runs(name, task, partial(tilt_model, sign=sign))

    def _build_runs(self, name: str, task: Task, change: Change) -> Iterator[PairedRun]:
        own = self.original.values
        step = self.original.resolved.timestep
        fine = {**own, "timestep": step / REFERENCE_RATE}
        phases = (
            self.original.motions_of(task, change=change),
            self.changed.motions_of(task, change=change),
            self.original.motions_of(task, fine, lambda model: _converge_solver(change(model))),
            self.original.motions_of(task, change=lambda model: _nudge_masses(change(model))),
        )
        for original, changed, reference, twin in zip(*phases, strict=False):
            yield PairedRun(
                name=f"{name}, {original.name}",
                original=original,
                changed=changed,
                reference=reference,
                twin=twin,
                in_loop=True,
            )


def _converge_solver(model: mujoco.MjModel) -> mujoco.MjModel:
    # Delays are a part of the loop, and stay.
    converge_solver(model)
    return model


def _nudge_masses(model: mujoco.MjModel) -> mujoco.MjModel:
    # Starts belong to the scene, so masses are nudged instead of velocities.
    model.body_mass *= 1 + NUDGE
    model.body_inertia *= 1 + NUDGE
    return model

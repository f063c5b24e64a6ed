"""The model under check: opened, with the options of the command line, at its start."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from contactlab.engines import bytes_of_run
from contactlab.errors import SceneError
from contactlab.run.jobs import RUN_BYTES
from contactlab.run.vocabulary import Scenes
from contactlab.scene import (
    QPOS0,
    CompiledScene,
    InitialStates,
    PreparedModel,
    ResolvedRun,
    Scene,
    make_setup,
)
from contactlab.studies.check.options import read_options, whole_settings


@dataclass(frozen=True)
class Target:
    """A model under check.

    Attributes:
        reference: the model as it was asked for, and as sweeps name their scene.
        scenes: the scenes opened so far.
        given: the options `--set`, as typed.
        values: what they set, by axis.
        duration: simulated time of its own run [s].
    """

    reference: str
    scenes: Scenes
    given: tuple[str, ...]
    values: Mapping[str, object]
    duration: float

    @property
    def scene(self) -> Scene:
        """The model's scene."""
        return self.scenes.open(self.reference)

    @cached_property
    def resolved(self) -> ResolvedRun:
        """Everything that decides its own run."""
        return self.scene.resolve(self.values, 0, self.duration)

    @property
    def base(self) -> CompiledScene:
        """Its compiled structure."""
        return self.scene.base(self.resolved.structure)

    @cached_property
    def prepared(self) -> PreparedModel:
        """Its model with the options set."""
        return self.base.prepare(self.resolved.edits())

    @property
    def start(self) -> InitialStates:
        """Where its own run starts."""
        return self.scene.starts([self.resolved])

    @cached_property
    def free_masses(self) -> list[float]:
        """Masses of the bodies on free joints, each with all that hangs on it [kg]."""
        setup = make_setup(self.base, None, [self.resolved], [self.prepared.model], {})
        return [float(body.mass[0]) for body in setup.free_bodies]

    @property
    def subject_mass(self) -> float:
        """Mass of the scene's subject [kg], else of its heaviest free body, else 1 kg."""
        subject = self.base.targets.subject
        if subject is not None:
            return float(self.prepared.model.body_mass[subject])
        return max(self.free_masses, default=1.0)

    @property
    def hold_window(self) -> tuple[float, float] | None:
        """From when to when [s] the scene says that something is held, if it does."""
        holding = self.base.holding
        return None if holding is None else holding.window(self.resolved.initial)

    def fits(self, timestep: float, seconds: float) -> bool:
        """Say whether a run of so many seconds [s] at a timestep [s] can be held in memory."""
        return bytes_of_run(self.base.model, round(seconds / timestep)) <= RUN_BYTES

    @property
    def keyframe(self) -> str | None:
        """The keyframe that it starts from; None for its own start."""
        start = self.resolved.keyframe
        return None if start == QPOS0 else start

    def setting(self, name: str) -> Any:  # noqa: ANN401 - settings are of many kinds
        """Return one resolved setting."""
        return self.resolved.settings[name]


def open_target(reference: str, assign: Sequence[str]) -> Target:
    """Open a model for its checks.

    Args:
        reference: a shipped scene, a folder, a model file or a robot.
        assign: `NAME=VALUE` for axes of the scene, each one value, and for `duration`.

    Raises:
        SceneError: there is no such scene, or it does not compile.
        SweepFileError: an option is wrong; all that are, are named.
    """
    scenes = Scenes(Path())
    scene = scenes.open(reference)
    values, duration = read_options(scenes, reference, assign)
    _check_timestep(scene, values)
    return Target(
        reference=reference,
        scenes=scenes,
        given=tuple(assign),
        values=whole_settings(scene, values),
        duration=scene.duration if duration is None else duration,
    )


def _check_timestep(scene: Scene, values: Mapping[str, object]) -> None:
    """Raise SceneError unless the timestep is one that time can go on by."""
    timestep = scene.resolve(values, 0, None).timestep
    if not 0 < timestep < math.inf:
        raise SceneError(
            f"{scene.source.model}: its timestep is {timestep:g} s; write one above 0 there, "
            "or `--set timestep=`"
        )

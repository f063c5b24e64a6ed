"""Every axis that one scene offers."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from contactlab.errors import SceneError
from contactlab.mjcf import CONTACT
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.drive.located_drive import DRIVE_AXES
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.initial_states import QPOS0, keyframe_names
from contactlab.scene.model_edits import field_axis
from contactlab.scene.model_options import MODEL_ENGINE
from contactlab.scene.mujoco_versions import (
    accepting_unsupported,
    missing_flag_axis,
    refusing_unsupported,
)
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.setting_values import choice, integer, number, switch
from contactlab.schema.scene_manifest import InitialValue, SceneManifest, StructureValue
from contactlab.schema.vocabulary import AxisSpec, Catalogue


class EngineTraits(Protocol):
    """What a scene must know of an engine that may simulate its runs."""

    @property
    def summary(self) -> str:
        """The engine, in a few words."""
        ...

    @property
    def omits_unused_effects(self) -> bool:
        """Whether effects that provably change nothing may be left out of its models."""
        ...


Engines = Mapping[str, EngineTraits]


class SceneCatalogue:
    """The axes of a scene: its own initial and structure values, parameters, effects.

    Model fields such as `dof_damping[hinge]` are found, but not listed.
    """

    def __init__(
        self, base: CompiledScene, manifest: SceneManifest | None, engines: Engines
    ) -> None:
        self._model = base.model
        axes = _axes(base, manifest, engines)
        self._axes = {axis.name: refusing_unsupported(axis) for axis in axes}

    @property
    def names(self) -> Sequence[str]:
        """Names to list and to suggest."""
        return tuple(self._axes)

    def find(self, name: str) -> AxisSpec | None:
        """Return the axis of this name, or None."""
        try:
            known = self._axes.get(name) or DRIVE_AXES.get(name) or missing_flag_axis(name)
            return known or field_axis(self._model, name)
        except ValueError:
            return None


class LenientCatalogue:
    """The axes of a catalogue, which also accept values that only newer versions of MuJoCo have."""

    def __init__(self, own: Catalogue) -> None:
        self._own = own

    @property
    def names(self) -> Sequence[str]:
        """Names to list and to suggest."""
        return self._own.names

    def find(self, name: str) -> AxisSpec | None:
        """Return the axis of this name, or None."""
        axis = self._own.find(name)
        return axis and accepting_unsupported(axis)


def _axes(base: CompiledScene, manifest: SceneManifest | None, engines: Engines) -> list[AxisSpec]:
    axes = [
        parameter.axis
        for parameter in PARAMETERS.values()
        if parameter.sets not in CONTACT or base.pairs
    ]
    axes.append(_engine_axis(engines))
    if base.targets.subject is not None:
        body = base.model.body(base.targets.subject).name
        axes.append(
            AxisSpec("mass", "kg", f"mass of '{body}'; its inertia scales with it", number(above=0))
        )
    axes += [
        AxisSpec(name, "", f"effect: {effect.what}", switch)
        for name, effect in EFFECTS.items()
        if name not in PARAMETERS
    ]
    if starts := keyframe_names(base.model):
        words = (*starts, QPOS0)
        axes.append(AxisSpec("keyframe", "", "keyframe to start from", choice(words), words))
    own = _own_axes(manifest) if manifest else []
    if base.model.njnt and "joint_speed" not in {axis.name for axis in own}:
        text = "speed of every joint at the start, either way by seed"
        axes.append(AxisSpec("joint_speed", "rad/s", text, number(least=0)))
    taken = {"mass", "seed", "keyframe", *PARAMETERS, *EFFECTS}
    for name in (axis.name for axis in own):
        if name in taken:
            raise SceneError(f"'{name}' is the name of another axis; rename it")
        taken.add(name)
    return own + axes


def _engine_axis(engines: Engines) -> AxisSpec:
    names = tuple(engines) or (MODEL_ENGINE,)
    summaries = [engine.summary for engine in engines.values()] or ["MuJoCo"]
    text = f"what simulates the run: {', or '.join(summaries)}"
    return AxisSpec("engine", "", text, choice(names), names)


def _own_axes(manifest: SceneManifest) -> list[AxisSpec]:
    return [
        AxisSpec(name, entry.unit, entry.description, _own_parser(entry))
        for name, entry in (*manifest.initial.items(), *manifest.structure.items())
    ]


def _own_parser(entry: InitialValue | StructureValue) -> Callable[[object], object]:
    if isinstance(entry, InitialValue):
        return number()
    if entry.integer:
        return integer(1 if entry.least is None else math.ceil(entry.least))
    return number(above=0) if entry.least is None else number(least=entry.least)

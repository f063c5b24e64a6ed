"""Catalogue of every axis that one scene offers."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

from contactlab.errors import SceneError, did_you_mean
from contactlab.mjcf import AT_REST, CONTACT, MODEL_ENGINE
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.drive.located_drive import DRIVE_AXES
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_edits import LOOP_ENGINE, field_axis
from contactlab.scene.model_names import (
    coordinate_unit,
    free_body_heights,
    start_coordinates,
)
from contactlab.scene.mujoco_versions import in_this_version, missing_flags
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.task import keyframe_names
from contactlab.scene.variants import AS_WRITTEN, load_variants
from contactlab.schema.scene_manifest import InitialValue, SceneManifest, StructureValue
from contactlab.schema.setting_values import (
    choice_parser,
    integer_parser,
    number_parser,
    parse_switch,
)
from contactlab.schema.sweep_schema import effect_switches
from contactlab.schema.task import QPOS0
from contactlab.schema.vocabulary import DROP_HEIGHT, RECORDED_RUN, VARIANT, AxisSpec


class EngineTraits(Protocol):
    """Facts about an engine that a scene needs if the engine may simulate its runs."""

    summary: str  # the engine, in a few words
    # Whether effects that provably change nothing may be left out of its models.
    omits_unused_effects: bool


Engines = Mapping[str, EngineTraits]


class SceneCatalogue:
    """The axes of a scene: its initial and structure values, parameters, effects.

    Model fields such as `dof_damping[hinge]`, and coordinates of the start such as `trunk.z`,
    `trunk.vz`, `knee` and `knee.v`, are found but not listed.
    """

    def __init__(
        self,
        base: CompiledScene,
        manifest: SceneManifest | None,
        engines: Engines,
        recorded: Sequence[float] = (),
    ) -> None:
        self._model = base.model
        self._list_axes = {axis.name: axis for axis in _list_axes(base, manifest, engines)}
        if recorded:
            text = f"recorded run, out of {len(recorded)}, to start from and to compare with"
            parse, accepted = number_parser(allowed=recorded), tuple(recorded)
            self._list_axes[RECORDED_RUN] = AxisSpec(
                RECORDED_RUN, "", text, parse, accepted_values=accepted
            )
        self._start_axes = {
            axis.name: axis for axis in _list_start_axes(base) if axis.name not in self._list_axes
        }
        if DROP_HEIGHT in self._start_axes:
            self._list_axes[DROP_HEIGHT] = self._start_axes[DROP_HEIGHT]

    @property
    def names(self) -> Sequence[str]:
        """Names to list and to suggest."""
        return tuple(self._list_axes)

    @property
    def coordinate_names(self) -> Sequence[str]:
        """Names of the coordinates and velocities of the start that are axes."""
        return tuple(name for name in self._start_axes if name != DROP_HEIGHT)

    def sets_start(self, name: str) -> bool:
        """Return whether an axis sets a coordinate of the start, or raises free bodies."""
        return name in self._start_axes

    def find_axis(self, name: str, *, lenient: bool = False) -> AxisSpec | None:
        """Return the axis with a name, or None. If lenient, it accepts values of newer versions."""
        try:
            axis = self._list_axes.get(name) or DRIVE_AXES.get(name) or self._start_axes.get(name)
            if axis is None and name in missing_flags():
                axis = AxisSpec(name, "", "effect of newer versions of MuJoCo", parse_switch)
            axis = axis or field_axis(self._model, name)
        except ValueError:
            return None
        return axis and in_this_version(axis, lenient=lenient)

    def switched_effects(self, manifest: SceneManifest | None) -> dict[str, object]:
        """Return the effects that the scene itself switches.

        Raises a SceneError if one is unknown.
        """
        switched: dict[str, object] = {}
        for name, value in effect_switches(manifest.effects if manifest else {}).items():
            axis = self.find_axis(name) if name in EFFECTS else None
            if axis is None:
                raise SceneError(f"effects: no effect '{name}'{did_you_mean(name, EFFECTS)}")
            try:
                switched[name] = axis.parse(value)
            except ValueError as error:
                raise SceneError(f"effects: {name}: {error}") from error
        return switched


def _list_start_axes(base: CompiledScene) -> Iterator[AxisSpec]:
    heights = free_body_heights(base.model)
    for name, index in start_coordinates(base.model).items():
        text = "velocity at the start" if index >= base.model.nq else "coordinate at the start"
        conflicts = (DROP_HEIGHT,) if index in heights else ()
        unit = coordinate_unit(base.model, index)
        yield AxisSpec(name, unit, text, number_parser(), conflicts=conflicts)
    if heights:
        text = "height of the free bodies above their start as written"
        yield AxisSpec(DROP_HEIGHT, "m", text, number_parser())


def _list_axes(
    base: CompiledScene, manifest: SceneManifest | None, engines: Engines
) -> list[AxisSpec]:
    axes: list[AxisSpec] = [
        parameter
        for parameter in PARAMETERS.values()
        if parameter.sets not in (*CONTACT, *AT_REST) or base.pairs
    ]
    # Only the loop engine can record the model of a loop.
    own = str(base.settings["engine"])
    names = (own,) if own == LOOP_ENGINE else tuple(engines) or (MODEL_ENGINE,)
    text = "engine that simulates the run (see `contactlab list engines`)"
    axes.append(AxisSpec("engine", "", text, choice_parser(names), names))
    if base.targets.subject is not None:
        text = f"mass of '{base.model.body(base.targets.subject).name}'; its inertia scales with it"
        axes.append(AxisSpec("mass", "kg", text, number_parser(above=0)))
    axes += [
        AxisSpec(name, "", f"effect: {effect.what}", parse_switch)
        for name, effect in EFFECTS.items()
        if name not in PARAMETERS
    ]
    if starts := keyframe_names(base.model):
        words = (*starts, QPOS0)
        axes.append(AxisSpec("keyframe", "", "keyframe to start from", choice_parser(words), words))
    if manifest and manifest.environment:
        words = (AS_WRITTEN, *load_variants())
        text = "variant of an episode (see `contactlab success`)"
        axes.append(AxisSpec(VARIANT, "", text, choice_parser(words), words))
    own = [*manifest.initial.items(), *manifest.structure.items()] if manifest else []
    if base.model.njnt and "joint_speed" not in dict(own):
        text = "speed of every joint at the start; the seed decides the direction"
        axes.append(AxisSpec("joint_speed", "rad/s", text, number_parser(least=0)))
    if "perturbation" not in dict(own):
        text = "factor of the perturbation by a seed; 0 starts exactly as the scene defines"
        axes.append(AxisSpec("perturbation", "1", text, number_parser()))
    taken_names = {"mass", "seed", VARIANT, "keyframe", RECORDED_RUN, *PARAMETERS, *EFFECTS}
    for name, _ in own:
        if name in taken_names:
            raise SceneError(f"'{name}' is the name of another axis; rename it")
        taken_names.add(name)
    return [
        AxisSpec(name, option.unit, option.description, _value_parser(option))
        for name, option in own
    ] + axes


def _value_parser(entry: InitialValue | StructureValue) -> Callable[[object], object]:
    if isinstance(entry, InitialValue):
        return number_parser()
    if entry.integer:
        return integer_parser(1 if entry.least is None else math.ceil(entry.least))
    return number_parser(above=0) if entry.least is None else number_parser(least=entry.least)

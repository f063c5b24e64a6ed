"""Compiles a scene's model once for each structure, with the sensors that record a run."""

import copy
import json
from collections import OrderedDict, deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import cast
from weakref import WeakValueDictionary

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.errors import SceneError, did_you_mean
from contactlab.mjcf import AT_REST, CONTACT, OPTIONS
from contactlab.scene.compile_model import (
    SensorLayout,
    add_sensors,
    compile_model,
    find_layout,
    name_sensors,
)
from contactlab.scene.contact_at_rest import write_at_rest
from contactlab.scene.contact_pairs import (
    MonitoredPair,
    declared_pairs,
    detected_pairs,
    effective_parameters,
)
from contactlab.scene.drive.hold import Load
from contactlab.scene.effects.effect import EffectRequest, EffectState
from contactlab.scene.effects.effect_table import (
    EFFECTS,
    choose_effects,
    is_straight,
    remove_from_spec,
    turn_off_unused,
)
from contactlab.scene.effects.proofs import ModelFacts, RunState
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.keyframes import default_keyframe, place_mocap
from contactlab.scene.model_edits import (
    FLAG_NAMES,
    LOOP_ENGINE,
    EditTargets,
    base_settings,
    derive_fields,
    find_targets,
    is_as_written,
    nonuniform_settings,
    read_flags,
    write_settings,
)
from contactlab.scene.model_names import find_id, is_address, name_of
from contactlab.scene.motion_model import drop_drawn_data
from contactlab.scene.scene_source import BINARY, SceneSource
from contactlab.scene.task import keyframe_names
from contactlab.scene.timed_inputs import HoldSpec, find_hold
from contactlab.scene.variants import write_variant
from contactlab.schema.evidence import PairRecord
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.setting_values import Settings, as_number
from contactlab.schema.task import QPOS0
from contactlab.schema.vocabulary import VARIANT


@dataclass(frozen=True, eq=False)
class CompiledScene:
    """One compiled structure of a scene, the base of the models of its runs."""

    model: mujoco.MjModel  # the compiled model; never edited
    pairs: tuple[MonitoredPair, ...]  # the monitored pairs
    layout: SensorLayout  # addresses of the recording sensors
    settings: Settings  # every setting of the model as written
    flags: Mapping[str, bool]  # every flag of the model as written
    targets: EditTargets  # where contact and mass settings go
    nonuniform: frozenset[str]  # contact settings in which some target differs from `settings`
    # Whether momentum is conserved: nothing static, no actuator and no external field acts.
    free: bool
    holding: HoldSpec | None  # the holder of the subject and the time, if the manifest has them
    facts: ModelFacts  # facts of the structure that decide about its effects

    @property
    def size(self) -> int:
        """Memory of the model, and of each copy made for a run [bytes]; mostly meshes."""
        return int(mujoco.mj_sizeModel(self.model))

    @cached_property
    def motion_model(self) -> mujoco.MjModel:
        """The same without data that only drawing reads; its copies are cheap."""
        return drop_drawn_data(self.model)

    @cached_property
    def id_entries(self) -> Mapping[str, str]:
        """Text in the identity of a run for each setting as written, sorted by name."""
        return {name: self.id_entry(name, value) for name, value in sorted(self.settings.items())}

    @cached_property
    def _keyframes_are_unnamed(self) -> bool:
        return all(map(is_address, keyframe_names(self.model)))

    def id_entry(self, name: str, value: object) -> str:
        """Return the JSON of a setting in the identity of a run; empty for its usual value."""
        if name not in self.settings and is_as_written(self.model, name, value):
            return ""
        # If no keyframe has a name, ids equal those of versions that did not know keyframes.
        if name == "keyframe" and value == QPOS0 and self._keyframes_are_unnamed:
            return ""
        return f"{_cached_json(name)}:{_rounded_json(value)}"

    def prepare(
        self,
        edits: Mapping[str, object],
        effect_request: EffectRequest | None = None,
        start: InitialStates | None = None,
        load: Load | None = None,
    ) -> "PreparedModel":
        """Return a copy of the model with settings and effects written, under a load.

        The request decides the other effects. Without a request they stay unchanged. Proofs that
        depend on the initial state of the run (n is 1) fail without one.
        """
        model = copy.copy(self.model)
        keyframe = str({**self.settings, **edits}.get("keyframe", QPOS0))
        place_mocap(model, keyframe)
        derived = write_settings(model, edits, self.targets)
        for name in (
            edit for edit in edits if edit in EFFECTS and edit not in (*FLAG_NAMES, *OPTIONS)
        ):
            EFFECTS[name].switch.write(model, bool(edits[name]))
        if VARIANT in edits:
            write_variant(model, edits)
            derived = True
        if derived:
            derive_fields(model)
        for name in edits.keys() & AT_REST.keys():
            write_at_rest(model, self.pairs, name, as_number(edits[name]), keyframe)
        effects: dict[str, EffectState] = {}
        if effect_request is not None:
            straight = start is not None and is_straight(model, start)
            run = RunState(model, self.facts, straight, loaded=load is not None)
            effects = choose_effects(run, effect_request)
            turn_off_unused(run, effects)
        if load is not None:
            load.write_load(model)
        edited_geoms = self.targets.geoms if edits.keys() & {*CONTACT, *AT_REST} else ()
        return PreparedModel(
            model=model,
            pairs={pair.name: effective_parameters(model, pair) for pair in self.pairs},
            edited_geoms=tuple(name_of(model, "geom", index) for index in edited_geoms),
            effects=effects,
        )


def _rounded_json(value: object) -> str:
    """Return a value as JSON, rounded to 12 digits because machines may differ in the last ones."""
    if isinstance(value, tuple):
        return f"[{','.join(map(_rounded_json, cast('tuple[object, ...]', value)))}]"
    if isinstance(value, float):
        return _rounded_number_json(value) if value else repr(value)
    return _cached_json(value)


@lru_cache(maxsize=1 << 12)
def _rounded_number_json(value: float) -> str:
    """Return a nonzero number as JSON. Zero has two signs, so it is not cached here."""
    return json.dumps(float(f"{value:.12g}"))


_cached_json = lru_cache(maxsize=1 << 10, typed=True)(json.dumps)


@dataclass(frozen=True, eq=False)
class PreparedModel:
    """A model with the settings of a run, and the effective contact parameters of monitored pairs.

    `edited_geoms` are the geoms with contact parameters that were set. `effects` is empty if the
    effects were not decided.
    """

    model: mujoco.MjModel
    pairs: Mapping[str, PairRecord]
    edited_geoms: tuple[str, ...]
    effects: Mapping[str, EffectState] = field(default_factory=dict[str, EffectState])

    @cached_property
    def friction(self) -> NDArray[np.float64]:
        """(P, 5) the coefficients of each pair (slide, slide, torsion, roll, roll)."""
        return np.array([pair.friction for pair in self.pairs.values()]).reshape(-1, 5)


# Structures that are open in this process, by the content of their files.
_OPEN = WeakValueDictionary[tuple[object, ...], CompiledScene]()
_LAST = deque[CompiledScene](maxlen=1)  # stays open between two scenes of a command

_WRITTEN = WeakValueDictionary[tuple[object, ...], mujoco.MjModel]()
"""Models that a writer compiled from files in this process, as long as the writer keeps them."""


def share_written(source: SceneSource, model: mujoco.MjModel) -> None:
    """Let scenes of written files, without structure values, use the model compiled from them.

    The model has all effects, names for its sensors, and none of the recording sensors.
    """
    _WRITTEN[_content_key(source)] = model


def _content_key(source: SceneSource) -> tuple[object, ...]:
    return source.content.hash, source.content.model


_DETECTED = OrderedDict[tuple[object, ...], tuple[MonitoredPair, ...]]()
"""Pairs that were detected in structures of scenes, here or where a sweep was started."""


def share_detected(pairs: Mapping[tuple[object, ...], tuple[MonitoredPair, ...]]) -> None:
    """Let scenes of this process monitor pairs that another process detected."""
    for key, detected in pairs.items():
        _remember_detected(key, detected)


def find_detected(
    source: SceneSource, structure: Mapping[str, object]
) -> Mapping[tuple[object, ...], tuple[MonitoredPair, ...]]:
    """Return the pairs that were detected in a structure, for `share_detected`; empty if none."""
    key = _structure_key(source, structure)
    return {key: _DETECTED[key]} if key in _DETECTED else {}


def _structure_key(source: SceneSource, structure: Mapping[str, object]) -> tuple[object, ...]:
    return *_content_key(source), tuple(structure.items())


def _remember_detected(key: tuple[object, ...], pairs: tuple[MonitoredPair, ...]) -> None:
    most_structures = 64  # a sweep may have any number of them
    _DETECTED[key] = pairs
    while len(_DETECTED) > most_structures:
        _DETECTED.popitem(last=False)


def open_structure(
    source: SceneSource, structure: Mapping[str, object], without: frozenset[str]
) -> CompiledScene:
    """Return one compiled structure of a scene without some effects.

    A store's copy whose files have the bytes of an open scene's is the same model, so that it is
    not compiled again.
    """
    key = (*_structure_key(source, structure), without)
    compiled = _OPEN.get(key) if source.content.copied else None
    if compiled is None:
        compiled = _OPEN[key] = compile_scene(source, structure, without)
    _LAST.append(compiled)
    return compiled


def compile_scene(
    source: SceneSource, structure: Mapping[str, object], without: Collection[str] = ()
) -> CompiledScene:
    """Compile one structure of a scene without some effects. A SceneError explains a failure."""
    written_model = None if structure else _WRITTEN.get(_content_key(source))
    plain = written_model or compile_model(source, structure, name_sensors)
    free = _conserves_momentum(plain)
    with source.named_in_errors():
        subject = _find_subject(plain, source.manifest)
        declared = declared_pairs(plain, source.manifest.pairs) if source.manifest else ()
        keyframe = default_keyframe(plain, source.manifest)
        pairs = declared or _detect_pairs(source, structure, plain, keyframe)
        holding = find_hold(plain, source.manifest, subject)

    energy = "energy" not in without

    def record(spec: mujoco.MjSpec) -> None:
        remove_from_spec(spec, without)
        add_sensors(spec, pairs, holding, free=free, energy=energy)

    model = compile_model(source, structure, record)
    settings = base_settings(model, pairs, subject)
    if keyframe_names(model):
        settings["keyframe"] = keyframe
    if source.model.suffix == BINARY:
        settings["engine"] = LOOP_ENGINE
    targets = find_targets(model, pairs, subject)
    return CompiledScene(
        model=model,
        pairs=pairs,
        layout=find_layout(model, pairs, holding, free=free),
        settings=settings,
        flags=read_flags(model),
        targets=targets,
        nonuniform=nonuniform_settings(model, settings, targets),
        free=free,
        holding=holding,
        facts=ModelFacts(model, energy=energy),
    )


def _detect_pairs(
    source: SceneSource, structure: Mapping[str, object], model: mujoco.MjModel, keyframe: str
) -> tuple[MonitoredPair, ...]:
    key = _structure_key(source, structure)
    if key not in _DETECTED:
        _remember_detected(key, detected_pairs(model, keyframe))
    return _DETECTED[key]


def full_structure(
    manifest: SceneManifest | None, values: Mapping[str, object]
) -> dict[str, object]:
    """Return every structure value of a scene, with defaults for missing values."""
    full: dict[str, object] = {}
    for name, entry in (manifest.structure if manifest else {}).items():
        value = as_number(values.get(name, entry.default))
        full[name] = int(value) if entry.integer else value
    return full


def _find_subject(model: mujoco.MjModel, manifest: SceneManifest | None) -> int | None:
    """Return the manifest's subject, or the only moving body."""
    if manifest and manifest.subject:
        index = find_id(model, "body", manifest.subject)
        if index < 0:
            body_names = [model.body(body).name for body in range(1, model.nbody)]
            hint = did_you_mean(manifest.subject, body_names)
            raise SceneError(f"subject '{manifest.subject}' is not a body of the model{hint}")
        if not model.body_mass[index]:
            raise SceneError(f"subject '{manifest.subject}' has no mass of its own")
        return index
    moving = np.flatnonzero(model.body_weldid != 0)
    return int(moving[0]) if len(moving) == 1 else None


def _conserves_momentum(model: mujoco.MjModel) -> bool:
    """Return whether momentum is conserved: free roots, no gravity, no external forces."""
    roots = set(np.flatnonzero(model.body_parentid == 0)[1:].tolist())
    free = set(model.jnt_bodyid[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)].tolist())
    acted_on = model.opt.gravity.any() or model.opt.density or model.opt.viscosity or model.nu
    is_held = model.neq or (model.geom_bodyid == 0).any()
    return bool(roots) and roots <= free and not acted_on and not is_held

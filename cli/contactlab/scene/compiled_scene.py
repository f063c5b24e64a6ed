"""A scene's model, compiled once for each structure, with the sensors that record a run."""

import copy
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.compile_model import compile_model
from contactlab.scene.contact_pairs import Pair, declared_pairs, effective, found_pairs
from contactlab.scene.effects import (
    Choice,
    Facts,
    Situation,
    Wishes,
    choose,
    find_facts,
    leave_out,
    remove,
)
from contactlab.scene.engine_flags import read_flags
from contactlab.scene.initial_states import (
    OWN_START,
    keyframe_names,
    place_mocap,
    usual_keyframe,
)
from contactlab.scene.model_edits import Targets, apply, edited, find_targets, varied
from contactlab.scene.recording_sensors import Layout, add_sensors, find_layout
from contactlab.scene.scene_source import SceneSource
from contactlab.scene.settings import base_settings
from contactlab.scene.timed_inputs import Holding, find_holding
from contactlab.schema import PairRecord, SceneManifest


@dataclass(frozen=True)
class Base:
    """A compiled structure of a scene, from which the models of its runs are made.

    Attributes:
        model: the compiled model; never edited.
        pairs: the graded contact pairs.
        layout: where the recorded numbers lie.
        settings: every setting of the model as written.
        flags: every engine switch of the model as written.
        targets: where contact and mass settings go.
        varied: contact settings that not every target has as `settings` says.
        free: whether no static body, actuator or field outside acts on it.
        holding: what is held by what, if the manifest says.
        facts: what it decides about its effects.
    """

    model: mujoco.MjModel
    pairs: tuple[Pair, ...]
    layout: Layout
    settings: Mapping[str, object]
    flags: Mapping[str, bool]
    targets: Targets
    varied: frozenset[str]
    free: bool
    holding: Holding | None
    facts: Facts

    @property
    def size(self) -> int:
        """Memory of its model, and of each that is made from it [bytes]; mostly meshes."""
        return int(mujoco.mj_sizeModel(self.model))

    def prepare(
        self, edits: Mapping[str, object], wishes: Wishes | None = None, *, straight: bool = False
    ) -> "Prepared":
        """Return a copy of the model with the edits written, and what came of them.

        Args:
            edits: settings and effects to write.
            wishes: decide the other effects; they stay as they are if None.
            straight: whether the run starts without turning or moving sideways.
        """
        model = copy.copy(self.model)
        place_mocap(model, str({**self.settings, **edits}.get("keyframe", OWN_START)))
        apply(model, edits, self.targets)
        effects: dict[str, Choice] = {}
        if wishes is not None:
            run = Situation(model, self.facts, straight)
            effects = choose(run, wishes)
            leave_out(run, effects)
        return Prepared(
            model=model,
            pairs={pair.name: effective(model, pair) for pair in self.pairs},
            edited_geoms=tuple(model.geom(index).name for index in edited(edits, self.targets)),
            effects=effects,
        )


@dataclass(frozen=True)
class Prepared:
    """A model ready to run.

    Attributes:
        model: the compiled model with a run's settings.
        pairs: the effective contact parameters of every graded pair.
        edited_geoms: the geoms whose contact parameters were set.
        effects: every effect, on or off, with the reason; empty if that was not decided.
    """

    model: mujoco.MjModel
    pairs: Mapping[str, PairRecord]
    edited_geoms: tuple[str, ...]
    effects: Mapping[str, Choice] = field(default_factory=dict[str, Choice])


def compile_base(
    source: SceneSource, structure: Mapping[str, object], without: Collection[str] = ()
) -> Base:
    """Compile one structure of a scene.

    Args:
        source: the scene.
        structure: its structure values.
        without: effects to compile it without.

    Raises:
        SceneError: the model does not compile, or the manifest names what it does not have.
    """
    plain = compile_model(source, structure, lambda _: None)
    free = _is_free(plain)
    with source.blamed():
        subject = _subject(plain, source.manifest)
        declared = declared_pairs(plain, source.manifest.pairs) if source.manifest else ()
        keyframe = usual_keyframe(plain, source.manifest)
        pairs = declared or found_pairs(plain, keyframe)
        holding = find_holding(plain, source.manifest, subject)

    energy = "energy" not in without

    def record(spec: mujoco.MjSpec) -> None:
        remove(spec, without)
        add_sensors(spec, pairs, holding, free=free, energy=energy)

    model = compile_model(source, structure, record)
    settings = base_settings(model, pairs, subject)
    if keyframe_names(model):
        settings["keyframe"] = keyframe
    targets = find_targets(model, pairs, subject)
    return Base(
        model=model,
        pairs=pairs,
        layout=find_layout(model, pairs, holding, free=free, energy=energy),
        settings=settings,
        flags=read_flags(model),
        targets=targets,
        varied=varied(model, settings, targets),
        free=free,
        holding=holding,
        facts=find_facts(model, energy=energy),
    )


def _subject(model: mujoco.MjModel, manifest: SceneManifest | None) -> int | None:
    """Return the manifest's subject, or the only moving body."""
    if manifest and manifest.subject:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, manifest.subject)
        if index < 0:
            known = [model.body(each).name for each in range(1, model.nbody)]
            hint = did_you_mean(manifest.subject, known)
            raise SceneError(f"subject '{manifest.subject}' is no body of the model{hint}")
        if not model.body_mass[index]:
            raise SceneError(f"subject '{manifest.subject}' has no mass of its own")
        return index
    moving = np.flatnonzero(model.body_weldid != 0)
    return int(moving[0]) if len(moving) == 1 else None


def _is_free(model: mujoco.MjModel) -> bool:
    """Say whether momentum must be conserved: free roots only, no gravity, nothing from outside."""
    roots = np.flatnonzero((model.body_parentid == 0) & (np.arange(model.nbody) > 0))
    joints = [int(model.body_jntadr[root]) for root in roots if model.body_jntnum[root] == 1]
    rooted = len(joints) == len(roots) and all(
        model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE for joint in joints
    )
    still = not model.opt.gravity.any() and not model.opt.density and not model.opt.viscosity
    static = bool((model.geom_bodyid == 0).any())
    return bool(len(roots) and rooted and still and not static and not model.nu and not model.neq)

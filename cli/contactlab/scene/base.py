"""A scene's model, compiled once for each structure, with the sensors that record a run."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.apply import Targets, apply, edited, find_targets, varied
from contactlab.scene.compile import compile_model
from contactlab.scene.effective import effective
from contactlab.scene.flags import read_flags
from contactlab.scene.pairs import Pair, declared_pairs, found_pairs
from contactlab.scene.sensors import Layout, add_sensors, find_layout
from contactlab.scene.settings import base_settings
from contactlab.scene.source import SceneSource
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
    """

    model: mujoco.MjModel
    pairs: tuple[Pair, ...]
    layout: Layout
    settings: Mapping[str, object]
    flags: Mapping[str, bool]
    targets: Targets
    varied: frozenset[str]
    free: bool

    def prepare(self, edits: Mapping[str, object]) -> "Prepared":
        """Return a copy of the model with the edits written, and what came of them."""
        model = copy.copy(self.model)
        apply(model, edits, self.targets)
        return Prepared(
            model=model,
            pairs={pair.name: effective(model, pair) for pair in self.pairs},
            edited_geoms=tuple(model.geom(index).name for index in edited(edits, self.targets)),
        )


@dataclass(frozen=True)
class Prepared:
    """A model ready to run.

    Attributes:
        model: the compiled model with a run's settings.
        pairs: the effective contact parameters of every graded pair.
        edited_geoms: the geoms whose contact parameters were set.
    """

    model: mujoco.MjModel
    pairs: Mapping[str, PairRecord]
    edited_geoms: tuple[str, ...]


def compile_base(source: SceneSource, structure: Mapping[str, object]) -> Base:
    """Compile one structure of a scene.

    Raises:
        SceneError: the model does not compile, or the manifest names what it does not have.
    """
    plain = compile_model(source, structure, lambda _: None)
    free = _is_free(plain)
    with source.blamed():
        subject = _subject(plain, source.manifest)
        declared = declared_pairs(plain, source.manifest.pairs) if source.manifest else ()
        pairs = declared or found_pairs(plain)
    model = compile_model(source, structure, lambda spec: add_sensors(spec, pairs, free=free))
    settings = base_settings(model, pairs, subject)
    targets = find_targets(model, pairs, subject)
    return Base(
        model=model,
        pairs=pairs,
        layout=find_layout(model, pairs, free=free),
        settings=settings,
        flags=read_flags(model),
        targets=targets,
        varied=varied(model, settings, targets),
        free=free,
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

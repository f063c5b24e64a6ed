"""A scene's model, compiled once for each structure, with the sensors that record a run."""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.scene.apply import Targets, apply, edited, find_targets
from contactlab.scene.coordinates import match
from contactlab.scene.effective import effective
from contactlab.scene.flags import read_flags
from contactlab.scene.pairs import Pair, declared_pairs, found_pairs
from contactlab.scene.sensors import Layout, add_sensors, find_layout
from contactlab.scene.settings import base_settings
from contactlab.scene.source import SceneSource
from contactlab.schema import PairRecord, SceneManifest

_PERTURBATION = 1e-4


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
        free: whether no static body, actuator or field outside acts on it.
    """

    model: mujoco.MjModel
    pairs: tuple[Pair, ...]
    layout: Layout
    settings: Mapping[str, object]
    flags: Mapping[str, bool]
    targets: Targets
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
    plain = _compile(source, lambda: _spec(source, structure))
    free = _is_free(plain)
    manifest = source.manifest
    pairs = declared_pairs(plain, manifest.pairs) if manifest else ()
    pairs = pairs or found_pairs(plain)

    def with_sensors() -> mujoco.MjSpec:
        spec = _spec(source, structure)
        add_sensors(spec, pairs, free=free)
        return spec

    model = _compile(source, with_sensors)
    subject = _subject(model, manifest)
    return Base(
        model=model,
        pairs=pairs,
        layout=find_layout(model, pairs, free=free),
        settings=base_settings(model, pairs, subject),
        flags=read_flags(model),
        targets=find_targets(model, pairs, subject),
        free=free,
    )


def _compile(source: SceneSource, build: Callable[[], mujoco.MjSpec]) -> mujoco.MjModel:
    try:
        return build().compile()
    except (ValueError, mujoco.FatalError) as error:
        message = str(error).replace("\n", "\n  ")
        raise SceneError(f"{source.model}: does not compile\n  {message}") from error


def _spec(source: SceneSource, structure: Mapping[str, object]) -> mujoco.MjSpec:
    """Parse the model with its structure values written, and name every geom."""
    if structure:
        spec = mujoco.MjSpec.from_string(_edited_xml(source, structure))
        spec.modelfiledir = str(source.model.parent) + "/"
    else:
        spec = mujoco.MjSpec.from_file(str(source.model))
    for index, geom in enumerate(spec.geoms):
        geom.name = geom.name or f"geom{index}"
    return spec


def _edited_xml(source: SceneSource, structure: Mapping[str, object]) -> str:
    root = ET.parse(source.model).getroot()  # noqa: S314 - a local model that the user asked for
    entries = source.manifest.structure if source.manifest else {}
    for name, value in structure.items():
        entry = entries[name]
        elements = root.findall(entry.element)
        if not elements:
            raise SceneError(f"{source.model}: structure '{name}' finds no {entry.element}")
        for element in elements:
            element.set(entry.attribute, repr(value))
    return ET.tostring(root, "unicode")


def _subject(model: mujoco.MjModel, manifest: SceneManifest | None) -> int | None:
    """Return the manifest's subject, or the only moving body."""
    if manifest and manifest.subject:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, manifest.subject)
        if index < 0:
            raise SceneError(f"the manifest's subject '{manifest.subject}' is no body of the model")
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


def perturbed_coordinates(
    model: mujoco.MjModel, manifest: SceneManifest | None
) -> tuple[list[tuple[str, int]], float]:
    """Return which numbers of the start state a seed changes, and by how much at most.

    Without a manifest: the horizontal place of free bodies, and every slide and hinge.
    """
    if manifest and manifest.perturb:
        patterns, scale = manifest.perturb.coordinates, manifest.perturb.scale
        found = [each for pattern in patterns for each in match(model, pattern)]
        return [(each.field, each.index) for each in found], scale
    if manifest:
        return [], 0.0
    return [("qpos", index) for index in _loose(model)], _PERTURBATION


def _loose(model: mujoco.MjModel) -> list[int]:
    indices: list[int] = []
    for joint in range(model.njnt):
        address, kind = int(model.jnt_qposadr[joint]), model.jnt_type[joint]
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            indices += [address, address + 1]
        elif kind != mujoco.mjtJoint.mjJNT_BALL:
            indices.append(address)
    return indices

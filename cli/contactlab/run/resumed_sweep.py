"""Resumes a sweep after its files were written differently, if the runs are the same."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copytree

import mujoco
import numpy as np

from contactlab.errors import ContactlabError, OtherSweepError, StoreError
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.run.sweep_request import SweepRequest
from contactlab.scene.model_files import common_folder
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import MANIFEST as SCENE_MANIFEST
from contactlab.scene.scene_source import MODEL_SUFFIXES
from contactlab.schema.evidence import SweepIdentity
from contactlab.store.folder_backend import backend_at
from contactlab.store.store_files import (
    IDENTITY,
    MANIFEST,
    SCENES,
    Address,
    chooses_alike,
    other_parts,
    parse_identity,
    parse_manifest,
)
from contactlab.store.store_writer import CopyableFiles


@dataclass(frozen=True)
class StoredScene:
    """Files of a scene in a store; see `CopyableFiles`."""

    source: Path

    def copy_to(self, folder: Path) -> None:
        """Copy every file into the folder."""
        copytree(self.source, folder, dirs_exist_ok=True)


def read_stored_identity(address: Address) -> SweepIdentity | None:
    """Return the sweep of a begun or finished store; None without a valid one."""
    backend = backend_at(address, StoreError)
    try:
        if (manifest := backend.read_file(MANIFEST)) is not None:
            return parse_manifest(manifest, address).sweep
        identity = backend.read_file(IDENTITY)
        return None if identity is None else parse_identity(identity, address)
    except StoreError:
        return None


def keep_stored_scene(
    request: SweepRequest, stored: SweepIdentity | None, runs: Iterable[RunSpec]
) -> tuple[SweepRequest, CopyableFiles]:
    """Return the request and its files, from the store if its copy of the scene means the same.

    It does if the manifests have the same values, all models compile to the same bytes, and all
    other files are equal. Raises an OtherSweepError that names the first difference.
    """
    own = request, request.scene.source.content
    if stored is None or stored.scene_hash == request.scene.hash:
        return own
    if request.scene.source.environment or stored.scene != request.scene.name:
        return own
    try:
        folder = backend_at(request.store, StoreError).local_folder(SCENES) / stored.scene_hash
        scene = stored_sweep_scene(stored, folder)
        if scene.hash != stored.scene_hash:
            return own
        difference = next(_scene_differences(scene, request.scene, runs), None)
    except ContactlabError:
        # The check of the whole identity reports the other files of the scene.
        return own
    if difference is None:
        return replace(request, scene=scene), StoredScene(folder)
    raise OtherSweepError(
        f"{request.store} holds another sweep (other files of the scene: {difference})",
        "write elsewhere with -o, or replace it with --fresh",
    )


def keep_stored_identity(stored: SweepIdentity | None, requested: SweepIdentity) -> SweepIdentity:
    """Return the identity of a store that has the same runs, otherwise the requested one."""
    if stored is None or other_parts(stored, requested) or not chooses_alike(stored, requested):
        return requested
    return stored if stored.whole == requested.whole else requested


def _scene_differences(stored: Scene, ours: Scene, runs: Iterable[RunSpec]) -> Iterator[str]:
    one, other = (_named_files(scene) for scene in (stored, ours))
    for name in sorted(one.keys() ^ other.keys()):
        yield f"{name} is {'missing' if name in one else 'new'}"
    for name in sorted(one.keys() & other.keys()):
        is_parsed = one[name].suffix in MODEL_SUFFIXES or one[name].name == SCENE_MANIFEST
        if not is_parsed and one[name].read_bytes() != other[name].read_bytes():
            yield f"{name} has other bytes"
    manifests = [
        source.manifest and source.manifest.model_dump() for source in (stored.source, ours.source)
    ]
    if manifests[0] != manifests[1]:
        stored_fields, own_fields = (each or {} for each in manifests)
        keys = [
            key
            for key in {**stored_fields, **own_fields}
            if stored_fields.get(key) != own_fields.get(key)
        ]
        yield f"{SCENE_MANIFEST} has other {', '.join(keys)}"
    for structure, without in {(tuple(run.structure.items()), run.without): None for run in runs}:
        models = [scene.base(dict(structure), without).model for scene in (stored, ours)]
        if fields := differing_fields(*models):
            most_fields = 4
            field_names = ", ".join(fields[:most_fields])
            more = ", ..." if len(fields) > most_fields else ""
            yield f"{ours.source.content.model.name} has other {field_names}{more}"


def _named_files(scene: Scene) -> dict[str, Path]:
    content = scene.source.content
    paths = [content.root / file for file in content.files]
    inner = common_folder(paths)
    return {path.relative_to(inner).as_posix(): path for path in paths}


def differing_fields(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Return the names of the different fields of two compiled models."""
    buffers = [np.empty(mujoco.mj_sizeModel(model), np.uint8) for model in (one, other)]
    for model, buffer in zip((one, other), buffers, strict=True):
        mujoco.mj_saveModel(model, None, buffer)
    if np.array_equal(buffers[0], buffers[1]):
        return []
    names = [name for name in dir(one) if not name.startswith("_")]
    pairs = [(name, getattr(one, name), getattr(other, name)) for name in names]
    groups = [
        (f"{group}.", getattr(one, group), getattr(other, group)) for group in ("opt", "stat")
    ]
    pairs += [
        (prefix + name, getattr(a, name), getattr(b, name))
        for prefix, a, b in groups
        for name in dir(a)
        if not name.startswith("_")
    ]
    sizes = [name for name, a, b in pairs if isinstance(a, int | float) and not _equal_values(a, b)]
    arrays = [
        name
        for name, a, b in pairs
        if isinstance(a, np.ndarray | bytes) and not _equal_values(a, b)
    ]
    return [*sizes, *arrays] or ["settings for viewers"]


def _equal_values(one: object, other: object) -> bool:
    return np.array_equal(np.asarray(one), np.asarray(other))

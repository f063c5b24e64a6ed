"""Writes a scene's model with changes into the text of its files, then compiles and compares it.

A result that differs from the intended model is refused.
"""

import difflib
import re
import shutil
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from contactlab.errors import OutputError, SceneError
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.compiled_scene import share_written
from contactlab.scene.model_draft import (
    Change,
    CompiledFiles,
    Draft,
    ModelEdits,
    differing_rows,
    edit_spec,
    fields_of,
    mjcf_text,
)
from contactlab.scene.model_edits import FIELD_KINDS
from contactlab.scene.model_files import common_folder, plain_name, relative_path
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import SceneSource, copied_scene
from contactlab.temporary_folders import temporary_folder


@dataclass(frozen=True)
class WrittenModel:
    """A model with files that were written with changes."""

    source: SceneSource  # the scene with the written model
    folder: Path  # folder of the original files; paths in the patch and changes are relative to it
    patch: bytes  # turns the original files into the written ones, by `patch -p1`; empty for a URDF
    changes: tuple[Change, ...]  # changes by file and line
    compiled: mujoco.MjModel  # of the files, which scenes of them share while this is kept

    @property
    def path(self) -> Path:
        """The main file."""
        return self.source.model

    @property
    def reference(self) -> str:
        """The scene's name in a sweep."""
        return f"{self.source.path.parent}/" if self.source.manifest else str(self.path)

    @property
    def lines(self) -> tuple[str, ...]:
        """The changes as printed lines."""
        return tuple(map(str, self.changes))


def refuse_place(source: SceneSource, folder: Path, name: str = "") -> None:
    """Refuse to write a scene's model where it cannot lie, with an OutputError.

    This is the scene's own folder, or a name that another file of the scene needs next to it. A
    model of one file takes a copy with another name next to it.
    """
    model = source.content.model
    is_alone = source.content.files == (model,) and name not in ("", model.name)
    if folder.resolve() == source.content.root.resolve() and not is_alone:
        raise OutputError(
            f"{folder} is the folder of the scene; write into another folder, such as "
            f"{folder / 'changed' / (name or model.name)}"
        )
    if name and (target := model.with_name(name)) != model and target in source.content.files:
        raise OutputError(
            f"{folder / name}: {model.name} has another file {name}, and both go into this folder; "
            "choose another name"
        )


def write_model(scene: Scene, edits: ModelEdits, folder: Path, name: str = "") -> WrittenModel:
    """Write a scene's files into a folder with changes, if the result is the intended model.

    The main file keeps its name unless `name` is set. The patch lies next to it under the same
    name. A URDF becomes MJCF. Raises a SceneError if something cannot be written, or if the result
    differs from the intended model. Raises an OutputError if the folder cannot be written, or is
    the scene's own.
    """
    source = scene.source
    refuse_place(source, folder, name)
    with temporary_folder() as temporary, source.named_in_errors():
        copied = _copy_scene(source, Path(temporary).resolve(), name, fused=not edits.freed)
        edit = partial(edit_spec, edits=edits) if edits.changes_spec else None
        meant = CompiledFiles.from_scene(scene, source, edits.settings, edit)
        draft = Draft.from_scene(scene, copied)
        draft.set_fields(meant)
        draft.set_options(meant)
        draft.set_parts(edits, meant)
        before, after = draft.before, draft.changed_texts()
        for path, text in after.items():
            path.write_bytes(text)
        try:
            compiled = CompiledFiles.from_scene(scene, copied, {})
        except SceneError as error:
            reason = "; ".join(line.strip() for line in str(error).splitlines()[1:])
            raise SceneError(f"cannot be written: {reason}") from error
        _refuse_differences(compiled.model, meant.model, draft)
        changed = [path for path in after if after[path] != before[path]]
        start = common_folder([copied.model, *changed])
        patch = [
            _file_patch(path.relative_to(start), before[path], after[path]) for path in changed
        ]
        written_model = WrittenModel(
            source=_place_scene(copied, folder, name or copied.model.name),
            folder=source.content.root / start.relative_to(copied.content.root),
            patch=b"".join(patch) if copied.content.model == source.content.model else b"",
            changes=tuple(draft.list_changes(start)),
            compiled=compiled.compiled,
        )
        if not compiled.run.structure and not compiled.run.without:
            share_written(written_model.source, written_model.compiled)
        patch_path = written_model.path.with_suffix(".patch")
        patch_path.unlink(missing_ok=True)
        if written_model.patch:
            patch_path.write_bytes(written_model.patch)
        return written_model


# Fields that elements set are compared before fields derived from them.
_ELEMENT_FIELDS = tuple(f"{prefix}_" for prefix in FIELD_KINDS if prefix != "body")


# MuJoCo's compiler computes muscle lengths by simulation; changed options round them differently.
_SIMULATED_FIELD = "actuator_lengthrange"


def _refuse_differences(written_model: mujoco.MjModel, meant: mujoco.MjModel, draft: Draft) -> None:
    """Refuse a model that differs from another in more than names and paths."""
    for some, other in (
        (written_model, meant),
        (written_model.opt, meant.opt),
        (written_model.stat, meant.stat),
    ):
        old, new = fields_of(some), fields_of(other)
        for name in sorted(old, key=lambda name: not name.startswith(_ELEMENT_FIELDS)):
            if old[name].shape != new[name].shape:
                rows, intended = len(old[name]), len(new[name])
                raise SceneError(
                    f"cannot be written: {name} would have {rows} rows, not {intended}"
                )
            if name == _SIMULATED_FIELD and np.allclose(old[name], new[name], rtol=SUM_ROUNDING):
                continue
            for row in differing_rows(old[name], new[name])[:1]:
                then, intended_text = (mjcf_text(side[name][row].tolist()) for side in (old, new))
                of = draft.describe_row(written_model, name, row)
                raise SceneError(
                    f"cannot write {name}{of}: it would be {then}, not {intended_text}"
                )


def _file_patch(path: Path, before: bytes, after: bytes) -> bytes:
    # The tab ends the name, which may contain spaces.
    name = path.as_posix().encode() + b"\t"
    old, new = (re.findall(rb"[^\n]*\n|[^\n]+", text) for text in (before, after))
    patch_lines = difflib.diff_bytes(difflib.unified_diff, old, new, b"a/" + name, b"b/" + name)
    return b"".join(
        line if line.endswith(b"\n") else line + b"\n\\ No newline at end of file\n"
        for line in patch_lines
    )


def _copy_scene(source: SceneSource, folder: Path, name: str, *, fused: bool) -> SceneSource:
    """Copy a scene's files into a folder, a URDF as MJCF, under `name` if it is set.

    `fused` tells whether bodies welded to others merge into them, as at import.
    """
    content = source.content
    content.copy_to(folder)
    files, model = content.files, content.model
    resources = {
        name: folder / path.relative_to(content.root) for name, path in content.resources.items()
    }
    if model.suffix == ".urdf":
        model = model.with_name(name or f"{model.stem}.xml")
        # A URDF becomes MJCF, with every number exact.
        urdf = folder / content.model
        spec = mujoco.MjSpec.from_file(str(urdf))
        spec.compiler.fusestatic = spec.compiler.fusestatic and fused
        for mesh in spec.meshes:
            if resource := resources.get(plain_name(mesh.file)):
                mesh.file = relative_path(resource, urdf.parent / spec.meshdir).as_posix()
        # Versions before 4.0 round numbers; the comparison refuses results that differ.
        if hasattr(spec.compiler, "savecompiled"):
            spec.compiler.savecompiled = False
        (folder / model).write_text(spec.to_xml(), encoding="utf-8")
        urdf.unlink()
        files = (model, *(file for file in files if file != content.model))
    moved = replace(
        content, root=folder, model=model, files=files, resources=resources, copied=True
    )
    return replace(source, path=folder / relative_path(source.path, content.root), content=moved)


def _place_scene(source: SceneSource, folder: Path, name: str) -> SceneSource:
    root, model = source.content.root, source.model.with_name(name)
    source.model.rename(model)
    model_name = source.manifest and Path(source.manifest.model).with_name(name).as_posix()
    if source.manifest and model_name != source.manifest.model:
        text = re.sub("(?m)^model:.*\n", "", source.path.read_text(encoding="utf-8-sig"))
        source.path.write_text(f"{text.rstrip()}\nmodel: {model_name}\n", encoding="utf-8")
    try:
        # Copy files and folders without their permissions: those of new files are the user's.
        folder.mkdir(parents=True, exist_ok=True)
        for path in sorted(root.rglob("*")):
            target = folder / path.relative_to(root)
            if path.is_dir():
                target.mkdir(exist_ok=True)
            else:
                shutil.copyfile(path, target)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror or error}") from error
    # The folder may have other scenes, too.
    folder = folder.resolve()
    manifest = folder / relative_path(source.path, root) if source.manifest else None
    return copied_scene(folder, relative_path(model, root).as_posix(), manifest, source.name)

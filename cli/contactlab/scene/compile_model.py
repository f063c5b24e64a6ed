"""Compile a scene's model with its structure values written; say why MuJoCo refuses one."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco

from contactlab.errors import SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.scene.model_references import find_resource, is_resource, parse, references
from contactlab.scene.scene_source import MODEL_SUFFIXES, SceneSource
from contactlab.scene.written_inertia import written_inertia_faults

_MAX_LISTED = 3
_FOLDER_HINT = {
    False: '<compiler meshdir="FOLDER"/>, relative to the model',
    True: '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco> within <robot>',
}
_BRACES = re.compile(r"\{([^{}]*)\}")


def compile_model(
    source: SceneSource, structure: Mapping[str, object], edit: Callable[[mujoco.MjSpec], None]
) -> mujoco.MjModel:
    """Compile one structure of a scene, after a last edit of its specification.

    Raises:
        SceneError: the model does not compile, or no element takes a structure value.
    """
    with _model_file(source, structure) as path:
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            _find_packages(spec, path.parent)
            _name_geoms(spec)
            edit(spec)
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise compile_error(source.model, path, error) from error


@contextmanager
def _model_file(source: SceneSource, structure: Mapping[str, object]) -> Generator[Path]:
    """Yield the model file, in a copy of the scene where structure values are written."""
    if not structure:
        yield source.model
        return
    with TemporaryDirectory(prefix="contactlab-") as folder:
        source.content.copy_to(Path(folder))
        with source.named_in_errors():
            _write_structure(Path(folder), source, structure)
        yield Path(folder) / source.content.model


def _write_structure(folder: Path, source: SceneSource, structure: Mapping[str, object]) -> None:
    entries = source.manifest.structure if source.manifest else {}
    files = [folder / file for file in source.content.files if file.suffix in MODEL_SUFFIXES]
    roots = {file: parse(file) for file in files}
    for name, value in structure.items():
        entry = entries[name]
        try:
            elements = [each for root in roots.values() for each in root.findall(entry.element)]
        except (SyntaxError, TypeError, KeyError) as error:
            raise SceneError(
                f"structure '{name}': {entry.element} is not a path of elements: {error}"
            ) from error
        if not elements:
            raise SceneError(f"structure '{name}': no element of the model matches {entry.element}")
        for element in elements:
            element.set(
                entry.attribute, _BRACES.sub(partial(_computed_text, name, value), entry.text)
            )
    for file, root in roots.items():
        ET.ElementTree(root).write(file)


def _computed_text(name: str, value: object, braces: re.Match[str]) -> str:
    """Return what replaces braces in a structure's text: the value itself if they are empty."""
    if not braces[1]:
        return repr(value)
    try:
        return repr(Expression(braces[1]).evaluate({name: value}))
    except ExpressionError as error:
        raise SceneError(f"structure '{name}': cannot compute {braces[0]}: {error}") from error


def _find_packages(spec: mujoco.MjSpec, folder: Path) -> None:
    for mesh in spec.meshes:
        if is_resource(mesh.file) and (resource := find_resource(mesh.file, folder)).is_file():
            mesh.file = str(resource.absolute())


def _name_geoms(spec: mujoco.MjSpec) -> None:
    taken = {geom.name for geom in spec.geoms}
    for index, geom in enumerate(spec.geoms):
        name = geom.name or f"geom{index}"
        while not geom.name and name in taken:
            name += "_"
        geom.name = name


def compile_error(model: Path, tried: Path, error: Exception) -> SceneError:
    """Return the error for a model that does not compile, with what to write instead.

    Args:
        model: its file, for the message.
        tried: the file that was compiled, which may be a copy.
        error: what MuJoCo raised.
    """
    lines = str(error).strip().replace(str(tried), str(model)).splitlines()
    hints = [*_missing_file(lines[0], model), *_impossible_inertias(lines[0], tried)]
    return SceneError("\n  ".join([f"{model}: does not compile", *lines, *hints]))


def _impossible_inertias(message: str, tried: Path) -> Iterator[str]:
    """Yield the inertias that no real body has."""
    if "inertia" in message:
        # MuJoCo gives no access to a specification that it failed to compile.
        spec = mujoco.MjSpec.from_file(str(tried))
        for fault in written_inertia_faults(spec)[:_MAX_LISTED]:
            yield f"body '{fault.body}': {fault.reason}"


def _missing_file(message: str, model: Path) -> Iterator[str]:
    """Yield where MuJoCo looked for a file that it cannot open."""
    if "opening file" not in message:
        return
    for path in references(model):
        if not path.is_file() and f"{path.name}'" in message:
            yield f"it was expected at {path}; put it there, or say where it is:"
            yield _FOLDER_HINT[model.suffix == ".urdf"]
            return

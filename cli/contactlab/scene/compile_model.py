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

_PLACE = re.compile(r"\{([^{}]*)\}")


def compile_model(
    source: SceneSource, structure: Mapping[str, object], edit: Callable[[mujoco.MjSpec], None]
) -> mujoco.MjModel:
    """Compile one structure of a scene, after a last edit of its specification.

    Raises:
        SceneError: the model does not compile, or a structure value has no place in it.
    """
    with _model_file(source, structure) as path:
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            _find_packages(spec, path.parent)
            _name_geoms(spec)
            edit(spec)
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise refusal(source.model, path, error) from error


@contextmanager
def _model_file(source: SceneSource, structure: Mapping[str, object]) -> Generator[Path]:
    """Give the model file, in a copy of the scene where structure values must be written."""
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
            raise SceneError(f"structure '{name}': {entry.element} is no path: {error}") from error
        if not elements:
            raise SceneError(f"structure '{name}' finds no {entry.element} in the model")
        for element in elements:
            element.set(entry.attribute, _PLACE.sub(partial(_filled, name, value), entry.text))
    for file, root in roots.items():
        ET.ElementTree(root).write(file)


def _filled(name: str, value: object, place: re.Match[str]) -> str:
    """Return what a place in a structure's text comes to: the value itself if it is empty."""
    if not place[1]:
        return repr(value)
    try:
        return repr(Expression(place[1]).evaluate({name: value}))
    except ExpressionError as error:
        raise SceneError(f"structure '{name}' writes {place[0]}: {error}") from error


def _find_packages(spec: mujoco.MjSpec, folder: Path) -> None:
    for mesh in spec.meshes:
        if is_resource(mesh.file) and (found := find_resource(mesh.file, folder)).is_file():
            mesh.file = str(found.absolute())


def _name_geoms(spec: mujoco.MjSpec) -> None:
    taken = {geom.name for geom in spec.geoms}
    for index, geom in enumerate(spec.geoms):
        name = geom.name or f"geom{index}"
        while not geom.name and name in taken:
            name += "_"
        geom.name = name


_MOST = 3


def refusal(model: Path, tried: Path, error: Exception) -> SceneError:
    """Return the error for a model that does not compile.

    Args:
        model: its file, for the message.
        tried: the file that was compiled, which may be a copy.
        error: what the engine says.
    """
    said = str(error).strip().replace(str(tried), str(model)).splitlines()
    lines = [*said, *_missing(said[0], model), *_unreal(said[0], tried)]
    return SceneError("\n  ".join([f"{model}: does not compile", *lines]))


def _unreal(said: str, tried: Path) -> Iterator[str]:
    """Yield which inertias no body has."""
    if "inertia" in said:
        # The engine gives no access to a specification that it has refused.
        spec = mujoco.MjSpec.from_file(str(tried))
        for fault in written_inertia_faults(spec)[:_MOST]:
            yield f"body '{fault.body}': {fault.reason}"


def _missing(said: str, model: Path) -> Iterator[str]:
    """Yield where a file that cannot be opened was looked for."""
    if "opening file" not in said:
        return
    for path in references(model):
        if not path.is_file() and f"{path.name}'" in said:
            yield f"it was looked for at {path}; put it there, or say where it is:"
            yield _ELSEWHERE[model.suffix == ".urdf"]
            return


_ELSEWHERE = {
    False: '<compiler meshdir="FOLDER"/>, relative to the model',
    True: '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco> within <robot>',
}

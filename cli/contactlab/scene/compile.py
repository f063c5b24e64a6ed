"""Compile a scene's model with its structure values written and every geom named."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco

from contactlab.errors import SceneError
from contactlab.scene.references import parse
from contactlab.scene.source import MODEL_SUFFIXES, SceneSource


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
            _name_geoms(spec)
            edit(spec)
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            message = str(error).strip().replace(str(path), str(source.model)).replace("\n", "\n  ")
            raise SceneError(f"{source.model}: does not compile\n  {message}") from error


@contextmanager
def _model_file(source: SceneSource, structure: Mapping[str, object]) -> Generator[Path]:
    """Give the model file, in a copy of the scene where structure values must be written."""
    if not structure:
        yield source.model
        return
    with TemporaryDirectory(prefix="contactlab-") as folder:
        source.content.copy_to(Path(folder))
        with source.blamed():
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
            element.set(entry.attribute, repr(value))
    for file, root in roots.items():
        ET.ElementTree(root).write(file)


def _name_geoms(spec: mujoco.MjSpec) -> None:
    taken = {geom.name for geom in spec.geoms}
    for index, geom in enumerate(spec.geoms):
        name = geom.name or f"geom{index}"
        while not geom.name and name in taken:
            name += "_"
        geom.name = name

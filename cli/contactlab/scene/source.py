"""From what a sweep names as its scene to the scene's files and manifest."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from contactlab import resources
from contactlab.errors import SceneError
from contactlab.scene.content import Content, collect
from contactlab.scene.menagerie import is_menagerie, menagerie_model, menagerie_name
from contactlab.schema import SceneManifest

MANIFEST = "scene.yaml"
MODEL_SUFFIXES = {".xml", ".urdf", ".mjcf"}


@dataclass(frozen=True)
class SceneSource:
    """A scene as it lies on disk.

    Attributes:
        name: the shipped name, the folder's or file's stem, or robot and entry.
        path: the manifest, or the model file where there is none.
        manifest: what is asked of the model; None for a bare model file.
        content: its files and their hash.
    """

    name: str
    path: Path
    manifest: SceneManifest | None
    content: Content

    @property
    def model(self) -> Path:
        """The model file."""
        return self.content.root / self.content.model

    @contextmanager
    def blamed(self) -> Generator[None]:
        """Put the scene's file before the message of an error that is raised within."""
        try:
            yield
        except SceneError as error:
            raise SceneError(f"{self.path}: {error}") from error


def find_scene(reference: str, base: Path | None = None) -> SceneSource:
    """Return the scene of a name, a folder with a manifest, an .xml or .urdf file, or a robot.

    Args:
        reference: what the sweep says after `scene:`.
        base: the folder that relative paths are relative to; the working directory if None.

    Raises:
        SceneError: there is no such scene, or its manifest is wrong.
    """
    if is_menagerie(reference):
        return _bare_model(menagerie_model(reference), menagerie_name(reference))
    path = (base or Path()) / Path(reference).expanduser()
    if path.suffix in MODEL_SUFFIXES:
        return _bare_model(path, path.stem)
    if "/" in reference or (path / MANIFEST).is_file():
        return _folder(path, path.resolve().name)
    return _folder(resources.scene_folder(reference), reference)


def stored_scene(folder: Path, model: str, name: str) -> SceneSource:
    """Return a scene that was copied into a store's folder."""
    # The copy holds the scene's own files only, so that any manifest there is the scene's.
    manifest = next(folder.rglob(MANIFEST), None)
    if manifest is not None:
        return _folder(manifest.parent, name)
    return _bare_model(folder / model, name)


def _bare_model(path: Path, name: str) -> SceneSource:
    if not path.is_file():
        raise SceneError(f"no model file {path}")
    return SceneSource(name, path, None, collect(path))


def _folder(path: Path, name: str) -> SceneSource:
    manifest = path / MANIFEST
    if not manifest.is_file():
        raise SceneError(f"{path} holds no {MANIFEST}; name the model file itself to run without")
    read = read_manifest(manifest)
    return SceneSource(name, manifest, read, collect(path / read.model, beside=manifest))


def read_manifest(path: Path) -> SceneManifest:
    """Read a scene's manifest.

    Raises:
        SceneError: it is not YAML, or a key is unknown, missing or wrong; all are named.
    """
    try:
        data = YAML(typ="safe", pure=True).load(path)
        return SceneManifest.model_validate(data)
    except ValidationError as error:
        mistakes = [
            f"  {'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()
        ]
        raise SceneError("\n".join([f"{path}: the manifest is wrong", *mistakes])) from error
    except (YAMLError, ValueError, OSError) as error:
        raise SceneError(f"{path}: not YAML: {error}") from error

"""From what a sweep names as its scene to the files of the scene, their hash, and its manifest.

A scene is a shipped name, a folder with a manifest, a model file, or a robot of MuJoCo Menagerie:
`menagerie:ROBOT[/ENTRY]`. Which files a model refers to follows MuJoCo's XML reference (compiler,
include, asset), tried on MuJoCo 3.17 and 4.0. MuJoCo takes ROS resource names, `package://NAME/PATH`
and `model://NAME/PATH`, for plain paths, which never exist; here they are looked up.
"""

import hashlib
import importlib
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from contactlab import resources
from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.scene_tree import check_places, check_regular
from contactlab.schema.drive import drive_files
from contactlab.schema.scene_manifest import SceneManifest

_ASSET_FOLDERS = {
    "mesh": "meshdir",
    "skin": "meshdir",
    "hfield": "meshdir",
    "texture": "texturedir",
    "flexcomp": "meshdir",
}
_FILE_KEYS = (
    "file",
    "filename",
    *(f"file{side}" for side in ("right", "left", "up", "down", "front", "back")),
)


def references(model: Path) -> Iterator[Path]:
    """Yield the files that an MJCF or URDF file refers to, existing or not.

    Raises:
        SceneError: the model, or a model that it includes or attaches, is missing or not XML.
    """
    return _references(model, set())


def _references(model: Path, seen: set[Path]) -> Iterator[Path]:
    elements = list(_elements(model, model.parent, seen))
    compiler: dict[str, str] = {}
    for element, path in elements:
        if element.tag == "compiler":
            compiler.update(element.attrib)
        if path != model:
            yield path
    for element, _ in elements:
        if element.tag == "model" and element.get("file"):
            attached = model.parent / element.get("file", "")
            yield attached
            yield from _references(attached, seen)
        elif element.tag in _ASSET_FOLDERS:
            yield from _assets(element, model.parent, compiler)


def _elements(path: Path, base: Path, seen: set[Path]) -> Iterator[tuple[ET.Element, Path]]:
    """Yield every element in document order, includes in their place, with its file."""
    if path.resolve() not in seen:
        seen.add(path.resolve())
        for element in parse(path).iter():
            yield element, path
            if element.tag == "include":
                name = element.get("file", "")
                beside = path.parent / name
                known = (base / name).is_file() or not beside.is_file()
                yield from _elements(base / name if known else beside, base, seen)


def _assets(element: ET.Element, base: Path, compiler: Mapping[str, str]) -> Iterator[Path]:
    folder = compiler.get(_ASSET_FOLDERS[element.tag], compiler.get("assetdir", ""))
    strip = compiler.get("strippath", "").lower() == "true"
    for key in _FILE_KEYS:
        if name := element.get(key):
            if is_resource(name) and not strip:
                yield find_resource(name, base)
            else:
                yield base / folder / (Path(name).name if strip else name)


def parse(path: Path) -> ET.Element:
    """Return the root element of an XML file.

    Raises:
        SceneError: it does not exist, or is not XML.
    """
    check_regular(path)
    try:
        return ET.parse(path).getroot()  # noqa: S314 - a local model that the user asked to run
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except LookupError as error:
        raise SceneError(f"{path}: {error}; write the model in UTF-8") from error
    except ET.ParseError as error:
        line, column = error.position
        what = str(error).partition(":")[0]
        raise SceneError(f"{path}:{line}:{column + 1}: not XML: {what}") from error


_RESOURCE = re.compile(r"(?:package|model):/+([^/]+)/(.+)")


def is_resource(name: str) -> bool:
    """Return whether a file's name is a ROS resource name."""
    return _RESOURCE.fullmatch(name) is not None


def find_resource(name: str, folder: Path) -> Path:
    """Return the path of a ROS resource; where it is expected, if it does not exist.

    A package is a folder of that name that holds the model or lies next to a folder that does. So
    that copies of its files work too, any folder above the model may stand for the package.

    Args:
        name: `package://NAME/PATH`.
        folder: the model's folder.
    """
    places = list(_places(name, folder))
    return next((place for place in places if place.is_file()), places[0])


def _places(name: str, folder: Path) -> Iterator[Path]:
    resource = _RESOURCE.fullmatch(name)
    assert resource is not None
    package, rest = resource.groups()
    above = (folder, *folder.parents)
    named = next((each for each in above if each.name == package), None)
    if named is not None:
        yield named / rest
    for each in above:
        yield each / package / rest
        yield each / rest


@dataclass(frozen=True)
class SceneFiles:
    """The files of a scene.

    Attributes:
        root: the folder that holds them all.
        model: the model file, relative to the root.
        files: every file, relative to the root, sorted.
        hash: SHA-256 over names and bytes, shortened to 16 hex digits.
    """

    root: Path
    model: Path
    files: tuple[Path, ...]
    hash: str

    def copy_to(self, folder: Path) -> None:
        """Copy every file into the folder, keeping their places."""
        for file in self.files:
            target = folder / file
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.root / file, target)


def collect_files(model: Path, beside: Sequence[Path] = (), copy: Path | None = None) -> SceneFiles:
    """Return the model file, its includes and assets, the manifest and what that names, if any.

    Missing assets are left for the compiler to report: it does not need them all.

    Args:
        model: the model file.
        beside: the manifest, and the files that it names.
        copy: the folder of a store's copy that holds them, if one does.

    Raises:
        SceneError: a file cannot be read, is not XML, or is not the scene's to name.
    """
    model = _plain(model)
    try:
        paths = {model, *(_plain(path) for path in references(model))}
        paths |= set(map(_plain, beside))
        check_places(paths, beside[0].parent if beside else model, copy)
        files = {path for path in paths if path.is_file()} | set(map(_plain, beside))
        root = _common_folder(files)
        names = sorted(path.relative_to(root) for path in files)
        return SceneFiles(root, model.relative_to(root), tuple(names), _digest(root, names))
    except OSError as error:
        raise SceneError(f"{error.filename or model}: {error.strerror}") from error


def _plain(path: Path) -> Path:
    """Return an absolute path without `..`; links stay, so that a copy keeps their names."""
    parts: list[str] = []
    for part in path.absolute().parts:
        if part == "..":
            # Above the root is the root.
            parts = parts[:-1] or parts
        else:
            parts.append(part)
    return Path(*parts)


def _common_folder(files: Iterable[Path]) -> Path:
    folder = min(files).parent
    while not all(path.is_relative_to(folder) for path in files):
        folder = folder.parent
    return folder


def _digest(root: Path, names: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for name in names:
        data = (root / name).read_bytes()
        digest.update(f"{name.as_posix()}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()[:16]


_SCHEME = "menagerie:"


def is_menagerie(reference: str) -> bool:
    """Return whether a scene's reference names a robot of MuJoCo Menagerie."""
    return reference.startswith(_SCHEME)


def menagerie_name(reference: str) -> str:
    """Return the name of a robot's scene as a file name: `franka_emika_panda-panda`."""
    return reference.removeprefix(_SCHEME).replace("/", "-")


def menagerie_model(reference: str) -> Path:
    """Return the model file of a robot, which the package downloads on first use.

    Without an entry it is the robot's default: its scene if it has one.

    Raises:
        SceneError: the package is not installed, knows no such robot or entry, or cannot get it.
    """
    package = _package(reference)
    robot, _, entry = reference.removeprefix(_SCHEME).partition("/")
    robots: list[str] = package.names()
    if robot not in robots:
        hint = did_you_mean(robot, robots) or "; `mujoco-menagerie names` lists them"
        raise SceneError(f"MuJoCo Menagerie has no robot '{robot}'{hint}")
    known: list[str] = package.get(robot).entry_names
    if entry and entry not in known:
        hint = did_you_mean(entry, known) or f"; write one of {', '.join(known)}"
        raise SceneError(f"{robot} of MuJoCo Menagerie has no entry '{entry}'{hint}")
    try:
        path = Path(package.get(robot).xml(entry or None))
    except (package.MenagerieError, OSError) as error:
        raise SceneError(
            f"cannot get {robot}: {error}\n"
            "robots are downloaded on first use; without a network, set MENAGERIE_ROOT to a folder "
            "of robots, such as a checkout of mujoco_menagerie"
        ) from error
    if not path.is_file():
        raise SceneError(f"{path.parent} has no {path.name}, the file of '{reference}'")
    return path


def _package(reference: str) -> ModuleType:
    try:
        return importlib.import_module("mujoco_menagerie")
    except ModuleNotFoundError as error:
        raise SceneError(
            f"'{reference}' needs the package mujoco-menagerie; "
            "install it with `pip install 'contactlab[menagerie]'`"
        ) from error


MANIFEST = "scene.yaml"
MODEL_SUFFIXES = {".xml", ".urdf", ".mjcf"}


@dataclass(frozen=True)
class SceneSource:
    """A scene on disk.

    Attributes:
        name: the shipped name, the folder's or file's stem, or robot and entry.
        path: the manifest, or the model file where there is none.
        manifest: what it says about the model and its runs; None for a bare model file.
        content: its files and their hash.
    """

    name: str
    path: Path
    manifest: SceneManifest | None
    content: SceneFiles

    @property
    def model(self) -> Path:
        """The model file."""
        return self.content.root / self.content.model

    @contextmanager
    def named_in_errors(self) -> Generator[None]:
        """Name the scene's file in an error that is raised within."""
        try:
            yield
        except SceneError as error:
            raise SceneError(f"{self.path}: {error}") from error


def find_scene(reference: str, base: Path | None = None) -> SceneSource:
    """Return the scene of a name, a folder with a manifest, an .xml or .urdf file, or a robot.

    Args:
        reference: the value of a sweep's `scene`.
        base: the folder that relative paths are relative to; the working directory if None.

    Raises:
        SceneError: there is no such scene, or its manifest is invalid.
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
    # Only the scene's own files were copied, so any manifest among them is the scene's.
    manifest = next(folder.rglob(MANIFEST), None)
    if manifest is not None:
        return _folder(manifest.parent, name, copy=folder)
    return _bare_model(folder / model, name, copy=folder)


def _bare_model(path: Path, name: str, copy: Path | None = None) -> SceneSource:
    if not path.is_file():
        raise SceneError(f"no model file {path}")
    return SceneSource(name, path, None, collect_files(path, copy=copy))


def _folder(path: Path, name: str, copy: Path | None = None) -> SceneSource:
    manifest = path / MANIFEST
    if not manifest.is_file():
        raise SceneError(
            f"{path} has no {MANIFEST}; to run without one, name the model file itself"
        )
    check_places([manifest], path, copy)
    read = read_manifest(manifest)
    named = [path / file for file in drive_files(read.drive)]
    return SceneSource(
        name, manifest, read, collect_files(path / read.model, [manifest, *named], copy)
    )


def read_manifest(path: Path) -> SceneManifest:
    """Read a scene's manifest.

    Raises:
        SceneError: it is not YAML, or keys are unknown, missing or invalid; it lists all of them.
    """
    try:
        data = YAML(typ="safe", pure=True).load(path)
        return SceneManifest.model_validate(data)
    except ValidationError as error:
        errors = [f"  {'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()]
        raise SceneError("\n".join([f"{path}: invalid manifest", *errors])) from error
    except (YAMLError, ValueError, OSError) as error:
        raise SceneError(f"{path}: not YAML: {error}") from error

"""The files that a model is made of, and their hash."""

import hashlib
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import SceneError

_ASSET_FOLDERS = {
    "mesh": "meshdir",
    "skin": "meshdir",
    "hfield": "assetdir",
    "texture": "texturedir",
    "flexcomp": "meshdir",
}
_CUBE_FILES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


@dataclass(frozen=True)
class Content:
    """A model's own files.

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


def collect(model: Path, beside: Path | None = None) -> Content:
    """Return the model file, its includes and assets, and the manifest if there is one.

    Raises:
        SceneError: a file is missing or is not XML.
    """
    files = {model.resolve()} | ({beside.resolve()} if beside else set())
    for path in _references(model.resolve()):
        if not path.is_file():
            raise SceneError(f"{model}: refers to {path}, which does not exist")
        files.add(path)
    root = _common_folder(files)
    names = sorted(path.relative_to(root) for path in files)
    return Content(root, model.resolve().relative_to(root), tuple(names), _digest(root, names))


def _common_folder(files: set[Path]) -> Path:
    folder = min(files).parent
    while not all(path.is_relative_to(folder) for path in files):
        folder = folder.parent
    return folder


def _digest(root: Path, names: list[Path]) -> str:
    digest = hashlib.sha256()
    for name in names:
        data = (root / name).read_bytes()
        digest.update(f"{name.as_posix()}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()[:16]


def _references(model: Path) -> Iterator[Path]:
    """Yield included and asset files, as MuJoCo looks for them: relative to the main file."""
    trees = list(_included(model, model.parent, set()))
    folders: dict[str, str] = {}
    strip = model.suffix == ".urdf"
    for _, root in trees:
        for compiler in root.iter("compiler"):
            folders.update(compiler.attrib)
            strip = compiler.get("strippath", str(strip)).lower() == "true"
    for path, root in trees:
        if path != model:
            yield path
        for element in root.iter():
            yield from _assets(element, model.parent, folders, strip)


def _included(path: Path, base: Path, seen: set[Path]) -> Iterator[tuple[Path, ET.Element]]:
    if path in seen:
        return
    seen.add(path)
    root = _parse(path)
    yield path, root
    for element in root.iter("include"):
        yield from _included((base / element.get("file", "")).resolve(), base, seen)


def _assets(
    element: ET.Element, base: Path, folders: dict[str, str], strip: bool
) -> Iterator[Path]:
    if element.tag not in _ASSET_FOLDERS:
        return
    own = folders.get(_ASSET_FOLDERS[element.tag], folders.get("assetdir", ""))
    for key in ("file", "filename", *_CUBE_FILES):
        name = element.get(key)
        if name:
            name = Path(name).name if strip else name.removeprefix("package://")
            yield (base / own / name).resolve()


def _parse(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()  # noqa: S314 - a local model that the user asked to run
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except ET.ParseError as error:
        line, column = error.position
        raise SceneError(f"{path}:{line}:{column + 1}: not well-formed XML: {error.msg}") from error

"""The files that a model is made of, and their hash."""

import hashlib
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import SceneError
from contactlab.scene.references import references


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

    Assets that do not exist are left for the compiler to judge, which does not need them all.

    Raises:
        SceneError: a file cannot be read, or is not XML.
    """
    model = _plain(model)
    try:
        found = {model, *(_plain(path) for path in references(model))}
        files = {path for path in found if path.is_file()} | ({_plain(beside)} if beside else set())
        root = _common_folder(files)
        names = sorted(path.relative_to(root) for path in files)
        return Content(root, model.relative_to(root), tuple(names), _digest(root, names))
    except OSError as error:
        raise SceneError(f"{error.filename or model}: {error.strerror}") from error


def _plain(path: Path) -> Path:
    """Return an absolute path without `..`; links stay, so that a copy keeps their names."""
    parts: list[str] = []
    for part in path.absolute().parts:
        if part == "..":
            parts.pop()
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

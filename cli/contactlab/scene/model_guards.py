"""Guards against models of strangers: limits on files, which are copied, and on memory.

It may name the files of its own package, of installed Python packages, and of folders that the user
allows by `--allow-files` or the environment variable. Its sizes are told from its files before
memory is asked for.
"""

import math
import os
import struct
import sysconfig
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from contactlab.errors import SceneError
from contactlab.scene.model_xml import check_regular

ALLOWED = "CONTACTLAB_ALLOW_FILES"
"""The environment variable that names allowed folders; workers inherit it."""
_ROS_PACKAGE, _PYTHON_PACKAGE = "package.xml", "__init__.py"
_LEVELS = 2
_PACKAGES = (_ROS_PACKAGE, ".git", "pyproject.toml", "setup.py")


def allow_files(folders: Iterable[Path]) -> None:
    """Allow models to name the files of some folders, in this process and those that it starts."""
    os.environ[ALLOWED] = os.pathsep.join(
        str(folder.absolute()) for folder in [*_allowed(), *folders]
    )


def check_places(files: Iterable[Path], named: Path, copy: Path | None = None) -> None:
    """Check that files lie where a model, or the folder of its manifest, may name them.

    A SceneError names one that does not. Hidden files and folders, as `.ssh`, are never a scene's,
    and neither are pipes and devices.
    """
    homes = (
        [named.resolve()] if named.is_dir() else [named.parent.resolve(), named.resolve().parent]
    )
    trees = [(home, copy.resolve() if copy else scene_tree(home)) for home in homes]
    installed = (Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib"))
    shared = [] if copy else [*_allowed(), *installed]
    for file in files:
        real = file.resolve()
        check_regular(file)
        if any(real.is_relative_to(folder) for folder in shared):
            continue
        if not any(_is_inside(real, home, tree) for home, tree in trees):
            lies = "lies" if real.exists() else "does not exist, and lies"
            raise SceneError(
                f"{named}: {file} {lies} outside of {trees[0][1]}, where the model's files are; "
                f"put it there, or allow its folder: `contactlab --allow-files {real.parent} "
                "COMMAND`"
            )


def scene_tree(folder: Path) -> Path:
    """Return the folder whose files a model in a folder may name.

    That is the nearest one around the model that is a repository, a project, a ROS package or, as a
    whole, a Python package. Without any it is two folders above the model's, since meshes often lie
    beside it, or in the package beside its own; but never home, or a folder that many share.
    """
    for parent in (folder, *folder.parents):
        if _is_shared(parent):
            break
        if any((parent / name).exists() for name in _PACKAGES):
            return parent
        if (parent / _PYTHON_PACKAGE).is_file():
            above = (parent, *parent.parents)
            return next(one for one in above if not (one.parent / _PYTHON_PACKAGE).is_file())
    near = (folder, *folder.parents[:_LEVELS])
    return next((parent for parent in reversed(near) if not _is_shared(parent)), folder)


def _is_shared(folder: Path) -> bool:
    return len(folder.parts) < 3 or folder == Path.home()


def _is_inside(file: Path, home: Path, tree: Path) -> bool:
    """Return whether a file lies in a tree, or in a ROS package beside a folder of the model."""
    near = next(parent for parent in (home, *home.parents) if file.is_relative_to(parent))
    if any(part.startswith(".") for part in file.relative_to(near).parts):
        return False
    ros = next((parent for parent in file.parents if (parent / _ROS_PACKAGE).is_file()), None)
    beside = ros is not None and ros.parent in home.parents and not _is_shared(ros)
    return file.is_relative_to(tree) or beside


def _allowed() -> list[Path]:
    return [Path(path).resolve() for path in os.environ.get(ALLOWED, "").split(os.pathsep) if path]


_MOST_HEIGHTS_OR_PIXELS = 1 << 28  # heights of a field, or pixels of a texture
_MOST_COPIES_OF_AN_ELEMENT = 1 << 20  # bodies or points that one element makes
_VALUES = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
_COPIES = ("flexcomp", "composite", "replicate")
_PNG = struct.Struct(">8s4x4sII")


def element_problem(element: ET.Element) -> str:
    """Return the problem of an element with an absurd number of values or copies, otherwise ""."""
    most, counts = (
        _MOST_HEIGHTS_OR_PIXELS,
        [element.get(key, "1") for key in _VALUES.get(element.tag, ())],
    )
    if element.tag in _COPIES:
        most, counts = _MOST_COPIES_OF_AN_ELEMENT, element.get("count", "1").split()
    try:
        product = math.prod(float(count) for count in counts)
    except ValueError:
        # Left to the compiler, whose message says what is wrong.
        return ""
    if product <= most:
        return ""
    name = f" '{element.get('name')}'" if element.get("name") else ""
    return f"{element.tag}{name} of {' x '.join(counts)} is more than {most:,}; make it smaller"


def check_picture(path: Path) -> None:
    """Refuse a PNG file, which may be small, with an absurd number of pixels."""
    with path.open("rb") as file:
        head = file.read(_PNG.size)
    if len(head) == _PNG.size:
        magic, kind, width, height = _PNG.unpack(head)
        if (
            magic == b"\x89PNG\r\n\x1a\n"
            and kind == b"IHDR"
            and width * height > _MOST_HEIGHTS_OR_PIXELS
        ):
            raise SceneError(
                f"{path}: {width} x {height} pixels are more than {_MOST_HEIGHTS_OR_PIXELS:,}"
            )

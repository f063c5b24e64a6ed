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
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from contactlab.errors import SceneError
from contactlab.scene.model_xml import check_depth, check_regular

ALLOWED = "CONTACTLAB_ALLOW_FILES"
"""The environment variable that names allowed folders; workers inherit it."""
_ROS_PACKAGE, _PYTHON_PACKAGE = "package.xml", "__init__.py"
_PACKAGES = (_ROS_PACKAGE, ".git", "pyproject.toml", "setup.py")


def allow_files(folders: Iterable[Path]) -> None:
    """Allow models to name the files of some folders, in this process and those that it starts."""
    os.environ[ALLOWED] = os.pathsep.join(
        str(folder.absolute()) for folder in [*_read_allowed_folders(), *folders]
    )


def check_places(files: Iterable[Path], model_path: Path, copy: Path | None = None) -> None:
    """Check that files lie where a model, or the folder of its manifest, may name them.

    A SceneError names one that does not. Hidden files and folders, as `.ssh`, are never a scene's,
    and neither are pipes and devices.
    """
    homes = (
        [model_path.resolve()]
        if model_path.is_dir()
        else [model_path.parent.resolve(), model_path.resolve().parent]
    )
    trees = [(home, copy.resolve() if copy else scene_tree(home)) for home in homes]
    installed = (Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib"))
    shared = [] if copy else [*_read_allowed_folders(), *installed]
    for file in files:
        real = file.resolve()
        check_regular(file)
        if any(real.is_relative_to(folder) for folder in shared):
            continue
        if not any(_is_inside(real, home, tree) for home, tree in trees):
            lies = "lies" if real.exists() else "does not exist, and lies"
            raise SceneError(
                f"{model_path}: {file} {lies} outside of {trees[0][1]}, where the model's files "
                "are; "
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
    # A model in a folder of its own often uses meshes in a folder next to it, or one above.
    near = (folder, *folder.parents[:2])
    return next((parent for parent in reversed(near) if not _is_shared(parent)), folder)


def _is_shared(folder: Path) -> bool:
    return len(folder.parts) < 3 or folder == Path.home()


def _is_inside(file: Path, home: Path, tree: Path) -> bool:
    """Return whether a file lies in a tree, or in a ROS package beside a folder of the model."""
    near = next(parent for parent in (home, *home.parents) if file.is_relative_to(parent))
    if any(part.startswith(".") for part in file.relative_to(near).parts):
        return False
    ros = next((parent for parent in file.parents if (parent / _ROS_PACKAGE).is_file()), None)
    is_in_package = ros is not None and ros.parent in home.parents and not _is_shared(ros)
    return file.is_relative_to(tree) or is_in_package


def _read_allowed_folders() -> list[Path]:
    return [Path(path).resolve() for path in os.environ.get(ALLOWED, "").split(os.pathsep) if path]


class Nesting(NamedTuple):
    """The place of an element: how often it is copied, and the number of elements around it."""

    copies: float = 1.0
    depth: int = 0


OUTERMOST = Nesting()
_COPIES = ("flexcomp", "composite", "replicate")
_PNG = struct.Struct(">8s4x4sII")


@dataclass
class ModelSize:
    """The size of a model, from its files alone, before memory is requested.

    Attributes:
        most_values: most heights of fields and pixels of textures: at 3 to 20 bytes each, they take
            about 2 GiB while a model is compiled.
        most_elements: most elements with all their copies, which MuJoCo compiles in a minute.
        most_count: largest count of <size>, such as keyframes, or data of the user per element.
    """

    most_values: int = 1 << 27
    most_elements: int = 1 << 18
    most_count: int = 1 << 16
    values: float = 0
    expanded: dict[Path, float] = field(default_factory=dict[Path, float])
    """Elements of each model that was read, with those of the models that it attaches."""

    def add_values(self, name: object, counts: Sequence[float]) -> None:
        """Add an asset; raise a SceneError if the assets have too many values."""
        self.values += math.prod(counts)
        if self.values > self.most_values:
            size = " x ".join(f"{count:g}" for count in counts)
            raise SceneError(
                f"{name} of {size} makes more than {self.most_values:,} heights and pixels; "
                "make it smaller"
            )

    def check_elements(self, name: object, elements: float) -> None:
        """Raise a SceneError if something makes too many elements."""
        if elements > self.most_elements:
            raise SceneError(
                f"{name} makes more than {self.most_elements:,} elements; make it smaller"
            )

    def count_elements(
        self, root: ET.Element, attached: dict[str, float], outer: Nesting
    ) -> tuple[float, dict[ET.Element, Nesting]]:
        """Return the elements of a file with their copies, and the nesting of its includes.

        Copies of attached models are counted in `attached`. A SceneError says that there are too
        many elements, or that assets are too large.
        """
        stack, elements, includes = [(root, outer)], 0.0, dict[ET.Element, Nesting]()
        while stack:
            element, (copies, depth) = stack.pop()
            name = element.tag + (f" '{element.get('name')}'" if element.get("name") else "")
            self._check_sizes(name, element)
            if element.tag in _COPIES:
                # A grid of cells has a body at each of its corners.
                copies *= max(
                    1.0, *(_multiply_numbers(element, key) for key in ("count", "cellcount"))
                )
            elif element.tag == "attach":
                model = element.get("model", "")
                attached[model] = attached.get(model, 0.0) + copies
            elif element.tag == "include":
                includes[element] = Nesting(copies, depth)
            elements += copies
            self.check_elements(name, elements)
            check_depth(depth)
            stack += [(inner, Nesting(copies, depth + 1)) for inner in reversed(element)]
        return elements, includes

    def _check_sizes(self, name: str, element: ET.Element) -> None:
        if element.tag == "size":
            self._check_counts(element)
        elif element.tag in ("hfield", "texture"):
            sides = ("nrow", "ncol") if element.tag == "hfield" else ("width", "height")
            counts = _read_numbers(" ".join(element.get(key, "1") for key in sides))
            is_cube = element.tag == "texture" and element.get("type", "cube") != "2d"
            self.add_values(name, [counts[0], counts[0], 6] if is_cube else counts)
        elif element.tag == "mesh" and element.get("builtin"):
            # Its first number is the resolution of one side, or of two.
            self.check_elements(name, max(_read_numbers(element.get("params", "1"))) ** 2)

    def _check_counts(self, element: ET.Element) -> None:
        for key, text in element.items():
            is_count = key == "nkey" or key.startswith("nuser_")
            if is_count and max(_read_numbers(text)) > self.most_count:
                raise SceneError(
                    f"<size {key}={text!r}> is more than {self.most_count:,}; make it smaller"
                )


def _multiply_numbers(element: ET.Element, key: str) -> float:
    return math.prod(_read_numbers(element.get(key, "1")))


def _read_numbers(text: str) -> list[float]:
    # The compiler reports other words; here they count as 1.
    numbers: list[float] = []
    for word in text.split():
        try:
            numbers.append(float(word))
        except ValueError:
            numbers.append(1.0)
    return [1.0 if math.isnan(number) else number for number in numbers] or [1.0]


def check_picture(path: Path, size: ModelSize) -> None:
    """Add the pixels of a PNG file, which may be small, to the size of a model."""
    with path.open("rb") as file:
        head = file.read(_PNG.size)
    if len(head) == _PNG.size:
        magic, kind, width, height = _PNG.unpack(head)
        if magic == b"\x89PNG\r\n\x1a\n" and kind == b"IHDR":
            size.add_values(f"{path}: a picture", (width, height))
